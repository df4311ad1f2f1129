"""From paths to mission items, and the two-bank mission list (DESIGN: mission swap).

On ArduPlane a mission list is overwritten in place while it is flown, so a new path never goes where
the flown one stands. The list is: home, the operator's own items, bank A, bank B. The bank being
flown is sent again unchanged, the other carries the new path; each ends in a loiter; the list never
gets shorter. An upload broken off at any item leaves the flown bank whole.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.frames import FloatArray, LocalFrame
from companion.types.mission import Command, Frame, Mission, MissionItem
from companion.types.path import Path

BANK_ITEMS_MIN, BANK_ITEMS_MAX = 20, 60
BANK_EXTRAS = 2  # the airspeed, and the loiter at the end
ENTRY_AHEAD_M = 45.0  # the entry lies at least this far along the path: nearer is reached on entering
ENTRY_ROOM_M = 110.0  # from an entry on the straight to the next corner: room for its turn
CORNER_MAX_RAD = math.radians(50.0)
STRAIGHT_RAD = 1e-4
HEIGHT_TOLERANCE_M = 8.0
SLIGHT_M = 2.0
SPACING_M = 60.0  # between a waypoint for height and its neighbours


@dataclass(frozen=True, slots=True)
class Waypoints:
    """What a bank carries out.

    Parameters
    ----------
    positions_enu_m : ndarray, shape (K, 3)
        Waypoints in order, the last the path's end [m].
    distances_m : ndarray, shape (K,)
        Length of the path flown where each is passed [m].
    airspeed_m_s : float
        True airspeed commanded after the first.
    loiter_centre_enu_m : ndarray, shape (3,), or None
        Where to circle afterwards [m]; None circles the path's end.
    loiter_radius_m : float
        Positive clockwise; 0 leaves it to the autopilot.
    """

    positions_enu_m: FloatArray
    distances_m: FloatArray
    airspeed_m_s: float
    loiter_centre_enu_m: FloatArray | None = None
    loiter_radius_m: float = 0.0


def waypoints_from_path(path: Path, airspeed_m_s: float) -> Waypoints:
    """Fly-by waypoints whose rounded corners are the path.

    A turn becomes the corners of the polygon about its arc, :data:`CORNER_MAX_RAD` each: an aircraft
    that rounds them off at the path's radius flies the arc itself. Straight flight needs none but
    where the height leaves the line between two of them by more than :data:`HEIGHT_TOLERANCE_M`. The
    start is left out; corners nearer to it than :data:`ENTRY_AHEAD_M` count as flown.
    """
    points, courses = path.positions_enu_m, np.unwrap(path.courses_rad)
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1))])
    marks = [(0.0, points[0]), *_corners(points, courses, travelled), (float(travelled[-1]), points[-1])]
    marks = _with_heights(marks, points, travelled)
    chosen = [mark for mark in marks[1:-1] if mark[0] >= ENTRY_AHEAD_M]
    if marks[1][0] > ENTRY_AHEAD_M + ENTRY_ROOM_M and len(points) > 2:
        row = int(np.searchsorted(travelled[:-1], ENTRY_AHEAD_M))
        chosen.insert(0, (float(travelled[row]), points[row]))
    chosen = _without_slight_corners([*chosen, marks[-1]])
    positions, distances = np.array([at[1] for at in chosen]), np.array([at[0] for at in chosen])
    return Waypoints(positions, distances, airspeed_m_s)


def _without_slight_corners(marks: list[tuple[float, FloatArray]]) -> list[tuple[float, FloatArray]]:
    """Drop inner marks that lie within :data:`SLIGHT_M` of the line between their neighbours."""
    kept = marks[:1]
    for mark, after in itertools.pairwise(marks[1:]):
        along, offset = after[1] - kept[-1][1], mark[1] - kept[-1][1]
        share = np.clip(offset @ along / max(float(along @ along), 1e-9), 0.0, 1.0)
        if np.linalg.norm(offset - share * along) > SLIGHT_M:
            kept.append(mark)
    return [*kept, marks[-1]] if len(marks) > 1 else kept


def _corners(
    points: FloatArray, courses: FloatArray, travelled: FloatArray
) -> list[tuple[float, FloatArray]]:
    """Corners of all turns: where the tangents at the ends of each part of an arc meet.

    Each comes with the length of path flown to the middle of its part.
    """
    signs = np.sign(np.where(np.abs(np.diff(courses)) > STRAIGHT_RAD, np.diff(courses), 0.0))
    found, edge = [], 0
    while edge < len(signs):
        if signs[edge] == 0.0:
            edge += 1
            continue
        first = edge
        while (
            edge < len(signs)
            and signs[edge] == signs[first]
            and abs(courses[edge + 1] - courses[first]) <= CORNER_MAX_RAD
        ):
            edge += 1
        edge = max(edge, first + 1)
        start, end = points[first], points[edge]
        turn = courses[edge] - courses[first]
        half = 0.5 * np.linalg.norm(end[:2] - start[:2]) / math.cos(0.5 * turn)
        corner = 0.5 * (start + end)
        corner[:2] = start[:2] + half * np.array([math.sin(courses[first]), math.cos(courses[first])])
        found.append((0.5 * float(travelled[first] + travelled[edge]), corner))
    return found


def _with_heights(
    marks: list[tuple[float, FloatArray]], points: FloatArray, travelled: FloatArray
) -> list[tuple[float, FloatArray]]:
    """Add rows of the path where the height between two marks leaves their line."""
    result = [marks[0]]
    for after in marks[1:]:
        before = result[-1]
        inner = np.flatnonzero((travelled > before[0] + SPACING_M) & (travelled < after[0] - SPACING_M))
        if len(inner) > 0:
            line = np.interp(travelled[inner], [before[0], after[0]], [before[1][2], after[1][2]])
            worst = int(np.argmax(np.abs(points[inner, 2] - line)))
            if abs(points[inner[worst], 2] - line[worst]) > HEIGHT_TOLERANCE_M:
                row = inner[worst]
                result += _with_heights([before, (float(travelled[row]), points[row])], points, travelled)[1:]
                result += _with_heights([result[-1], after], points, travelled)[1:]
                continue
        result.append(after)
    return result


@dataclass(frozen=True, slots=True)
class Banks:
    """Where the banks lie in the autopilot's list.

    Parameters
    ----------
    prefix : tuple of MissionItem
        Home and the operator's own items, kept as read.
    size : int
        Items a bank.
    flown : tuple of MissionItem or None
        The bank being flown, as sent; None before the first.
    flown_index : int
        0 or 1: which one it is.
    """

    prefix: tuple[MissionItem, ...]
    size: int
    flown: tuple[MissionItem, ...] | None = None
    flown_index: int = 1

    def first_of(self, index: int) -> int:
        """Sequence of a bank's first item."""
        return len(self.prefix) + index * self.size

    def with_new(self, bank: tuple[MissionItem, ...], plan_number: int) -> tuple[Mission, Banks]:
        """The list with a new path in the idle bank, and the banks once that is flown."""
        index = 1 - self.flown_index
        banks: list[tuple[MissionItem, ...] | None] = [None, None]
        banks[index], banks[self.flown_index] = bank, self.flown
        items = list(self.prefix)
        for content in banks:
            items += content or ()
        numbered = tuple(
            replace(item, sequence=n, is_current=n == self.first_of(index)) for n, item in enumerate(items)
        )
        after = replace(self, flown=bank, flown_index=index)
        return Mission(numbered, self.first_of(index), plan_number), after


def new_banks(existing: Sequence[MissionItem], num_waypoints: int) -> Banks:
    """Banks behind what the autopilot holds now, with room for paths half as long again."""
    size = min(BANK_ITEMS_MAX, max(BANK_ITEMS_MIN, int(1.5 * num_waypoints) + BANK_EXTRAS))
    return Banks(prefix=tuple(existing), size=size)


def bank_items(waypoints: Waypoints, size: int, frame: LocalFrame) -> tuple[MissionItem, ...]:
    """A bank: waypoints, the airspeed, and loiters at the last waypoint up to the bank's size."""
    items = []
    for n, position in enumerate(waypoints.positions_enu_m):
        items.append(_item(Command.NAV_WAYPOINT, position, frame))
        if n == 0:
            airspeed = equivalent_airspeed(waypoints.airspeed_m_s, frame.altitude_amsl_m + float(position[2]))
            parameters = (0.0, round(airspeed, 1), -1.0, 0.0)  # airspeed, m/s, throttle unchanged
            items.append(MissionItem(0, Command.DO_CHANGE_SPEED, Frame.MISSION, parameters, 0, 0, 0.0))
    centre = waypoints.loiter_centre_enu_m
    last = _item(Command.NAV_LOITER_UNLIM, waypoints.positions_enu_m[-1] if centre is None else centre, frame)
    loiter = replace(last, parameters=(0.0, 0.0, waypoints.loiter_radius_m, None))
    return tuple(items) + (loiter,) * (size - len(items))


def sequence_of_waypoint(mission: Mission, number: int) -> int:
    """Sequence of the n-th waypoint of the bank a mission is entered in; the airspeed item is none."""
    return mission.entry + number + (1 if number > 0 else 0)


def equivalent_airspeed(true_airspeed_m_s: float, altitude_amsl_m: float) -> float:
    """Equivalent airspeed, which autopilots command, of a true one [m/s].

    By the density of the International Standard Atmosphere (ISO 2533, troposphere).
    """
    density_ratio = (1.0 - 2.25577e-5 * altitude_amsl_m) ** 4.25588
    return true_airspeed_m_s * math.sqrt(density_ratio)


def _item(command: Command, position_enu_m: FloatArray, frame: LocalFrame) -> MissionItem:
    latitude, longitude, altitude = frame.global_from_local(*(float(value) for value in position_enu_m))
    return MissionItem(
        sequence=0,
        command=command,
        frame=Frame.GLOBAL_INT,
        parameters=(0.0, 0.0, 0.0, None),
        latitude_e7=round(latitude * 1e7),
        longitude_e7=round(longitude * 1e7),
        altitude_m=round(altitude, 2),
    )
