"""The pilot's text about a new path: whether it is safe, the first turn, and the arrival."""

from __future__ import annotations

import math

import numpy as np

from companion.flight.state.flight_state import FlightState
from companion.flight.state.list_state import FlownPath
from companion.types.path import Path

TURN_BEGINS_RAD = math.radians(5.0)  # A turn begins when the course has changed by more than this.
TURN_RAD = math.radians(25.0)  # A smaller change of course is no turn that a pilot would notice.
NEARBY_M = 50.0  # Paths this close to each other look the same on a map.
LOOK_AHEAD_S = 60.0  # Two paths are compared this far ahead.
ARRIVAL_CHANGE_S = 15.0  # A smaller change of the arrival is not announced.


class PathNews:
    """Texts about the successive flown paths.

    Attributes
    ----------
    passes : bool
        Whether the last of these paths passed the check when it was entered.
    """

    def __init__(self) -> None:
        self.passes = False
        self._was_safe: bool | None = None

    def of(
        self, state: FlightState, path: Path, before: FlownPath | None, now_s: float
    ) -> tuple[str, str, str]:
        """Return the key of the text about a new path, its first turn, and where it arrives in which time.

        The key is '' if a pilot would see no difference, and for a path that does not lead to the goal, which
        is announced as an emergency.

        Parameters
        ----------
        state : FlightState
            Goals and limits.
        path : Path
            The path flown from now on.
        before : FlownPath or None
            The path flown until now.
        now_s : float
            The clock's reading [s].
        """
        was_safe, self.passes = self._was_safe, not state.violations_of(path)
        self._was_safe = is_safe = self.passes if state.leads_to_goal(path) else None
        is_same = before is not None and is_safe is was_safe and not is_another_path(path, before.path, now_s)
        if is_safe is None or is_same:
            return "", "", ""
        left_s = max(0, round(float(path.times_s[-1]) - now_s))
        place = "circle" if state.flies_aside else "goal"
        arrival = f"{place} in {left_s // 60}:{left_s % 60:02d}"
        return "path" if is_safe else "unsafe path", _first_turn(path, now_s), arrival


def _first_turn(path: Path, now_s: float) -> str:
    """Return the first turn of a path from now on, in words."""
    first = min(int(np.searchsorted(path.times_s, now_s)), len(path) - 1)
    turned = np.unwrap(path.courses_rad[first:]) - path.courses_rad[first]
    turns = np.flatnonzero(np.abs(turned) > TURN_RAD)
    if not len(turns):
        return "Straight on"
    side = math.copysign(1.0, turned[turns[0]])
    begun = np.flatnonzero(side * turned[: turns[0] + 1] <= TURN_BEGINS_RAD)[-1]
    places = path.positions_enu_m[first : first + begun + 1]
    away_m = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    words = "Right turn" if side > 0.0 else "Left turn"
    return f"{words} now" if away_m < NEARBY_M else f"{words} in {50 * round(away_m / 50.0)} m"


def is_another_path(path: Path, before: Path, now_s: float) -> bool:
    """Return whether a pilot would see a difference between two paths: on the map, or in the arrival time.

    Parameters
    ----------
    path, before : Path
        The path flown from now on, and the path flown until now.
    now_s : float
        The clock's reading [s].
    """
    if abs(path.times_s[-1] - before.times_s[-1]) > ARRIVAL_CHANGE_S:
        return True
    times = np.arange(now_s, min(now_s + LOOK_AHEAD_S, path.times_s[-1], before.times_s[-1]), 1.0)
    here, there = (
        np.column_stack([np.interp(times, one.times_s, one.positions_enu_m[:, axis]) for axis in range(3)])
        for one in (path, before)
    )
    return bool(len(times)) and float(np.linalg.norm(here - there, axis=1).max()) > NEARBY_M
