"""Tell the pilot of aircraft that will come near, as air traffic controllers do: clock, distance, height."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from companion.flight.messages.announcer import Announcer
from companion.flight.state.decision import DecisionKind
from companion.types.state import Ownship
from companion.types.threat import TrackState

AHEAD_S = 45.0  # An aircraft that loses well clear within this time is announced.
STEP_S = 1.0
AGAIN_S = 30.0  # It is announced again after this time, if it still comes near.
LEVEL_M = 15.0  # Smaller differences in height are not announced.


class TrafficWatch:
    """Foresees for 45 s where aircraft that pass will be, if both go on as they do.

    Parameters
    ----------
    announcer : Announcer
        Informs the pilot.
    """

    def __init__(self, announcer: Announcer) -> None:
        self._announcer = announcer
        self._announced_s: dict[str, float] = {}

    def look(
        self, now_s: float, ownship: Ownship, tracks: Iterable[TrackState], *, is_agreed: bool = False
    ) -> None:
        """Inform the pilot of aircraft that newly come near.

        Members of a team on their announced plans keep clear of an aircraft that flies an agreed one.

        Parameters
        ----------
        now_s : float
            The clock's reading [s].
        ownship : Ownship
            The aircraft, which flies.
        tracks : iterable of TrackState
            All vehicles that are tracked.
        is_agreed : bool
            Whether the aircraft flies a plan that its team has agreed to, if it has one.
        """
        self._announced_s = {
            name: stamp_s for name, stamp_s in self._announced_s.items() if now_s - stamp_s < AGAIN_S
        }
        for track in tracks:
            is_apart = track.keeps_route and is_agreed
            if not track.flies_on or is_apart or track.identity in self._announced_s:
                continue
            nearest_s = _loses_well_clear(ownship, track)
            if nearest_s is not None:
                self._announced_s[track.identity] = now_s
                self._tell(ownship, track, nearest_s)

    def _tell(self, ownship: Ownship, track: TrackState, nearest_s: float) -> None:
        """Inform the pilot of one aircraft."""
        here = track.places_enu_m(np.array([ownship.stamp_s]))[0]
        east, north, up = (
            float(there - own) for there, own in zip(here, ownship.position_enu_m, strict=True)
        )
        hour = round(math.degrees(math.atan2(east, north) - ownship.course_rad) / 30.0) % 12 or 12
        height = "same height" if abs(up) < LEVEL_M else f"{abs(up):.0f} m {'above' if up > 0.0 else 'below'}"
        away_m = math.hypot(east, north)
        text = (
            f"{track.identity} at {hour} o'clock, {away_m:.0f} m away, {height}, nearest in {nearest_s:.0f} s"
        )
        self._announcer.decide(
            DecisionKind.TRAFFIC, text, tell="traffic", about=track.identity, hour=hour,
            distance=f"{1e-3 * away_m:.1f}", height=height, time=round(nearest_s),
        )  # fmt: skip


def _loses_well_clear(ownship: Ownship, track: TrackState) -> float | None:
    """Return in what time an aircraft that loses well clear will be nearest [s]; None if it stays clear."""
    ahead = np.arange(0.0, AHEAD_S + STEP_S, STEP_S)
    moved = np.outer(ahead, (*ownship.velocity_m_s, ownship.climb_m_s))
    away = track.places_enu_m(ownship.stamp_s + ahead) - ownship.position_enu_m - moved
    flat = np.hypot(away[:, 0], away[:, 1]) - track.circles_m(ownship.stamp_s + ahead)
    is_lost = (flat <= track.max_threat_radius_m) & (np.abs(away[:, 2]) <= track.clear_up_m)
    return float(ahead[np.argmin(flat)]) if is_lost.any() else None
