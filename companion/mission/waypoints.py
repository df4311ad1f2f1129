"""From paths to waypoints, and from waypoints to mission items."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.assurance.violation import Violation
from companion.frames import FloatArray, LocalFrame
from companion.types.mission import Command, MavFrame, Mission, MissionItem
from companion.types.path import Path

FIRST_WAYPOINT_AHEAD_M = (
    45.0  # the entry lies at least this far along the path: nearer is reached on entering
)
ENTRY_ROOM_M = 110.0  # from an entry on the straight to the next corner: room for its turn
CORNER_MAX_RAD = math.radians(50.0)
CHORD_MAX_RAD = math.radians(25.0)  # of a turn flown from point to point
GOAL_ACCEPTANCE_M = 15.0  # at the goal, before what follows it: a fly-by might pass the goal by
STRAIGHT_RAD = 1e-4
FLY_BY_M = 50.0  # WP_RADIUS, at which ArduPlane turns to the next waypoint
HEIGHT_TOLERANCE_M = 8.0
SLIGHT_M = 2.0
MARK_M = 40.0  # from something to be done, within which any waypoint serves
SPACING_M = 60.0  # between a waypoint for height and its neighbours
MENDED_RULES = frozenset({"corner", "climb"})
MENDED_MAX = 4


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
    continues_with_operator_items : bool
        Whether the operator's items that follow the goal are flown after the last waypoint.
    actions : tuple of (int, tuple of MissionItem)
        The operator's DO_ items to carry out at a waypoint, by its number.
    airspeed_again : int
        Number of the waypoint behind which the airspeed is commanded once more, for an aircraft that
        enters behind the first; 0 for none.
    """

    positions_enu_m: FloatArray
    distances_m: FloatArray
    airspeed_m_s: float
    loiter_centre_enu_m: FloatArray | None = None
    loiter_radius_m: float = 0.0
    continues_with_operator_items: bool = False
    actions: tuple[tuple[int, tuple[MissionItem, ...]], ...] = ()
    airspeed_again: int = 0

    @property
    def num_items(self) -> int:
        """How much room they take in the autopilot's list, and the operator's items among them."""
        again = self.airspeed_again > 0
        return len(self.positions_enu_m) + again + sum(len(items) for _, items in self.actions)


def waypoints_from_path(
    path: Path,
    airspeed_m_s: float,
    *,
    flies_by: bool = True,
    marked_m: Sequence[float] = (),
    spacing: float = 1.0,
) -> Waypoints:
    """Waypoints along a path, more of them in its turns.

    ArduPlane turns at WP_RADIUS before a waypoint and rounds its corner. Its waypoints are the corners of the
    polygon about an arc: an aircraft that rounds them off at the path's radius flies the arc itself. A PX4
    turns no more than some 10 m before a waypoint, whatever the item says (measured, and so in its
    ``mission_block.cpp``). Its waypoints lie on the arc. Straight flight needs no waypoint but where the
    height leaves the line between two of them by more than :data:`HEIGHT_TOLERANCE_M`.

    Parameters
    ----------
    path : Path
        What is to be flown. Its start is left out, and what lies nearer to it than
        :data:`FIRST_WAYPOINT_AHEAD_M` counts as flown.
    airspeed_m_s : float
        True airspeed to command [m/s].
    flies_by : bool
        Whether the autopilot turns before a waypoint, as ArduPlane does.
    marked_m : sequence of float
        Lengths of the path at which something is to be done [m]: straight flight without a waypoint near
        gets one there.
    spacing : float
        Turn from one waypoint to the next, as a share of the usual one.
    """
    points, courses, travelled = path.positions_enu_m, np.unwrap(path.courses_rad), path.travelled_m
    turns = _turns(points, courses, travelled, flies_by=flies_by, spacing=spacing)
    marks = [(0.0, points[0]), *turns, (float(travelled[-1]), points[-1])]
    marks = _with_heights(marks, points, travelled)
    chosen = [mark for mark in marks[1:-1] if mark[0] >= FIRST_WAYPOINT_AHEAD_M]
    if marks[1][0] > FIRST_WAYPOINT_AHEAD_M + ENTRY_ROOM_M and len(points) > 2:
        row = int(np.searchsorted(travelled[:-1], FIRST_WAYPOINT_AHEAD_M))
        chosen.insert(0, _mark(points, travelled, row))
    chosen = _without_slight_corners([*chosen, marks[-1]])
    for length in marked_m:
        row = int(np.argmin(np.abs(travelled - length)))
        if _is_straight(courses, row) and min(abs(travelled[row] - at[0]) for at in chosen) > MARK_M:
            chosen.append(_mark(points, travelled, row))
    return _in_order(chosen, airspeed_m_s)


def _mark(points: FloatArray, travelled: FloatArray, row: int) -> tuple[float, FloatArray]:
    """Length flown, of ``travelled`` (N,) [m], and place (3,), of ``points`` (N, 3) [m], at a row."""
    return float(travelled[row]), points[row]


def _in_order(marks: list[tuple[float, FloatArray]], airspeed_m_s: float) -> Waypoints:
    """Waypoints at ``marks``, pairs of a length of path flown and a place (3,) [m]."""
    ordered = sorted(marks, key=lambda mark: mark[0])
    positions, distances = np.array([at[1] for at in ordered]), np.array([at[0] for at in ordered])
    return Waypoints(positions, distances, airspeed_m_s)


def _is_straight(courses: FloatArray, row: int) -> bool:
    """Whether a path of ``courses`` (N,) [rad] flies straight before and behind a row."""
    return 0 < row < len(courses) - 1 and not np.diff(courses[row - 1 : row + 2]).any()


def _without_slight_corners(marks: list[tuple[float, FloatArray]]) -> list[tuple[float, FloatArray]]:
    """Marks without inner ones that lie within :data:`SLIGHT_M` of the line between their neighbours.

    ``marks`` are pairs of a length of path flown and a place (3,) [m], and so is what is returned:
    pairs of a length and a place (3,) [m].
    """
    kept = marks[:1]
    for mark, after in itertools.pairwise(marks[1:]):
        along, offset = after[1] - kept[-1][1], mark[1] - kept[-1][1]
        share = np.clip(offset @ along / max(float(along @ along), 1e-9), 0.0, 1.0)
        if np.linalg.norm(offset - share * along) > SLIGHT_M:
            kept.append(mark)
    return [*kept, marks[-1]] if len(marks) > 1 else kept


def _turns(
    points: FloatArray, courses: FloatArray, travelled: FloatArray, *, flies_by: bool, spacing: float
) -> list[tuple[float, FloatArray]]:
    """Waypoints of all turns: corners about them for an autopilot that flies by, else places on them.

    Each turn is cut into parts of equal change of course. A corner is where the tangents at the ends of a
    part meet. Each waypoint, (3,) [m], comes with the length of path to it [m]. ``points`` (N, 3) are the
    path's places [m], ``courses`` (N,) its unwrapped courses [rad], and ``travelled`` (N,) its level length
    to each [m].
    """
    found: list[tuple[float, FloatArray]] = []
    for first, last in _runs_of_turning(courses):
        turn = float(courses[last] - courses[first])
        num = math.ceil(abs(turn) / (spacing * (CORNER_MAX_RAD if flies_by else CHORD_MAX_RAD)))
        cuts = courses[first] + turn * np.linspace(0.0, 1.0, num + 1)
        lengths, places = _at_courses(points, courses, travelled, first, last, cuts)
        if not flies_by:
            found += [
                (float(length), place)
                for length, place in zip(lengths, places, strict=True)
                if 0.0 < length < travelled[-1] and not (found and length <= found[-1][0])
            ]
            continue
        for part in range(num):
            begin, end = places[part], places[part + 1]
            course, half_turn = courses[first] + turn * part / num, 0.5 * turn / num
            reach = 0.5 * float(np.linalg.norm((end - begin)[:2])) / math.cos(half_turn)
            corner = 0.5 * (begin + end)
            corner[:2] = begin[:2] + reach * np.array([math.sin(course), math.cos(course)])
            found.append((0.5 * float(lengths[part] + lengths[part + 1]), corner))
    return found


def _at_courses(
    points: FloatArray, courses: FloatArray, travelled: FloatArray, first: int, last: int, cuts: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Lengths (K,) [m] and places (K, 3) [m] at which a turn has the courses ``cuts`` (K,) [rad].

    The turn goes from row ``first`` to row ``last``; between two rows it is an arc. ``points`` (N, 3) [m],
    ``courses`` (N,) [rad] and ``travelled`` (N,) [m] are as in :func:`_turns`.
    """
    turned = np.abs(courses[first : last + 1] - courses[first])
    rows = first + np.clip(
        np.searchsorted(turned, np.abs(cuts - courses[first]), side="right") - 1, 0, last - first - 1
    )
    turn, chord = courses[rows + 1] - courses[rows], points[rows + 1] - points[rows]
    share = (cuts - courses[rows]) / turn
    lengths = travelled[rows] + share * (travelled[rows + 1] - travelled[rows])
    reach = np.hypot(chord[:, 0], chord[:, 1]) * np.sin(0.5 * share * turn) / np.sin(0.5 * turn)
    course = courses[rows] + 0.5 * share * turn
    level = points[rows, :2] + reach[:, None] * np.column_stack([np.sin(course), np.cos(course)])
    return lengths, np.column_stack([level, points[rows, 2] + share * chord[:, 2]])


def _runs_of_turning(courses: FloatArray) -> list[tuple[int, int]]:
    """First and last row of each turn to one side; ``courses`` (N,) are unwrapped [rad]."""
    steps = np.diff(courses)
    signs = np.concatenate([[0.0], np.sign(np.where(np.abs(steps) > STRAIGHT_RAD, steps, 0.0)), [0.0]])
    edges = np.flatnonzero(np.diff(signs))  # Row at which the side of turning changes.
    return [(int(a), int(b)) for a, b in itertools.pairwise(edges) if signs[a + 1] != 0.0]


def _with_heights(
    marks: list[tuple[float, FloatArray]], points: FloatArray, travelled: FloatArray
) -> list[tuple[float, FloatArray]]:
    """Marks, and rows of the path where the height between two marks leaves their line.

    ``marks`` are pairs of a length of path flown and a place (3,) [m], and so is what is returned: pairs
    of a length and a place (3,) [m]. ``points`` (N, 3) are the path's places [m], ``travelled`` (N,) the
    level length flown to each [m].
    """
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


def merge_close_waypoints(
    waypoints: Waypoints, wrong_with: Callable[[Waypoints], tuple[Violation, ...]]
) -> tuple[Waypoints, tuple[Violation, ...]]:
    """Waypoints without those that stand too close for the turn or the climb between them.

    Where two turns of a path nearly meet, so do their waypoints; the path flies it, legs may not.

    Parameters
    ----------
    waypoints : Waypoints
        As made from a path.
    wrong_with : callable
        What the checker says of them; it has the last word.

    Returns
    -------
    Waypoints, tuple of Violation
        With fewer violations, if not none, and those.
    """
    violations = wrong_with(waypoints)
    for _ in range(MENDED_MAX):
        if not violations or any(entry.rule not in MENDED_RULES for entry in violations):
            break
        row = violations[0].row  # of the legs, which begin with the start: its waypoint is one less
        tries = [_without(waypoints, n) for n in (row - 1, row) if 0 <= n < len(waypoints.distances_m) - 1]
        judged = [(found, wrong_with(found)) for found in tries]
        better = [entry for entry in judged if len(entry[1]) < len(violations)]
        if not better:
            break
        waypoints, violations = min(better, key=lambda entry: len(entry[1]))
    return waypoints, violations


def _without(waypoints: Waypoints, number: int) -> Waypoints:
    return replace(
        waypoints,
        positions_enu_m=np.delete(waypoints.positions_enu_m, number, axis=0),
        distances_m=np.delete(waypoints.distances_m, number),
    )


@dataclass(frozen=True, slots=True)
class MissionPart:
    """Waypoints as mission items, to be put into an autopilot's list.

    Parameters
    ----------
    items : tuple of MissionItem
        The waypoints, the airspeed behind the first, and the operator's DO_ items where they belong.
    speed : MissionItem
        The airspeed at cruise.
    loiter : MissionItem
        The circle at the end.
    continues_with_operator_items : bool
        Whether the operator's items that follow the goal are flown after the last waypoint.
    """

    items: tuple[MissionItem, ...]
    speed: MissionItem
    loiter: MissionItem
    continues_with_operator_items: bool


def mission_part(waypoints: Waypoints, frame: LocalFrame, cruise_m_s: float | None = None) -> MissionPart:
    """Waypoints as mission items.

    Parameters
    ----------
    waypoints : Waypoints
        What is flown to.
    frame : LocalFrame
        Where they are.
    cruise_m_s : float, optional
        True airspeed that the operator's items behind them are flown at [m/s]; left out, the waypoints'.
    """
    return MissionPart(
        path_items(waypoints, frame),
        speed_item(replace(waypoints, airspeed_m_s=cruise_m_s or waypoints.airspeed_m_s), frame),
        loiter_item(waypoints, frame),
        waypoints.continues_with_operator_items,
    )


def path_items(waypoints: Waypoints, frame: LocalFrame) -> tuple[MissionItem, ...]:
    """Waypoints, the airspeed behind the first, perhaps once more, and the operator's DO_ items."""
    actions = dict(waypoints.actions)
    items = []
    for n, position in enumerate(waypoints.positions_enu_m):
        items.append(_item(Command.NAV_WAYPOINT, position, frame))
        if waypoints.continues_with_operator_items and n == len(waypoints.positions_enu_m) - 1:
            items[-1] = replace(items[-1], parameters=(0.0, GOAL_ACCEPTANCE_M, 0.0, None))
        if n in (0, waypoints.airspeed_again):
            items.append(speed_item(waypoints, frame))
        items += actions.get(n, ())
    return tuple(items)


def speed_item(waypoints: Waypoints, frame: LocalFrame) -> MissionItem:
    """The airspeed, throttle unchanged."""
    altitude = frame.altitude_amsl_m + float(waypoints.positions_enu_m[0, 2])
    airspeed = equivalent_airspeed(waypoints.airspeed_m_s, altitude)
    parameters = (0.0, round(airspeed, 1), -1.0, 0.0)
    return MissionItem(0, Command.DO_CHANGE_SPEED, MavFrame.MISSION, parameters, 0, 0, 0.0)


def loiter_item(waypoints: Waypoints, frame: LocalFrame) -> MissionItem:
    """The circle at the end."""
    centre = waypoints.loiter_centre_enu_m
    last = _item(Command.NAV_LOITER_UNLIM, waypoints.positions_enu_m[-1] if centre is None else centre, frame)
    return replace(last, parameters=(0.0, 0.0, waypoints.loiter_radius_m, None))


def sequence_of_waypoint(mission: Mission, number: int) -> int:
    """Sequence of the n-th waypoint of the part a mission is entered in; other items are none."""
    behind = mission.items[mission.entry :]
    found = [item.sequence for item in behind if item.command == Command.NAV_WAYPOINT]
    return found[number]


def equivalent_airspeed(true_airspeed_m_s: float, altitude_amsl_m: float) -> float:
    """Equivalent airspeed, which autopilots command, of a true one [m/s].

    By the density of the International Standard Atmosphere.
    """
    return true_airspeed_m_s * math.sqrt(density_ratio(altitude_amsl_m))


def density_ratio(altitude_amsl_m: float) -> float:
    """Density of the air over that at the sea, by the International Standard Atmosphere.

    ISO 2533, troposphere.
    """
    return float((1.0 - 2.25577e-5 * altitude_amsl_m) ** 4.25588)


def _item(command: Command, position_enu_m: FloatArray, frame: LocalFrame) -> MissionItem:
    """A command at ``position_enu_m`` (3,) [m] as a mission item."""
    latitude, longitude, altitude = frame.global_from_local(*(float(value) for value in position_enu_m))
    return MissionItem(
        sequence=0,
        command=command,
        frame=MavFrame.GLOBAL_INT,
        parameters=(0.0, 0.0, 0.0, None),
        latitude_e7=round(latitude * 1e7),
        longitude_e7=round(longitude * 1e7),
        altitude_m=round(altitude, 2),
    )
