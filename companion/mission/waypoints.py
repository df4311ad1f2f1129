"""Convert paths to waypoints, and waypoints to mission items."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.assurance.violation import Violation
from companion.frames import FloatArray, LocalFrame, equivalent_airspeed
from companion.types.mission import ARDUPLANE_SLOPES, Command, MavFrame, Mission, MissionItem, SlopeMin
from companion.types.path import Path
from companion.world.ground.autopilot_ground import AutopilotGround

# The first waypoint is at least this far along the path; nearer ones are passed.
FIRST_WAYPOINT_AHEAD_M = 45.0
# The turn at the first corner needs this distance from an entry on the straight.
ENTRY_STRAIGHT_MIN_M = 110.0
CORNER_MAX_RAD = math.radians(50.0)  # A turn is divided into corners of at most this angle.
CHORD_MAX_RAD = math.radians(25.0)  # A turn flown from point to point is divided into parts of this angle.
# Acceptance radius of a goal that the mission continues after: a fly-by might miss it.
GOAL_ACCEPTANCE_M = 15.0
STRAIGHT_RAD = 1e-4  # Smaller changes of course are rounding.
FLY_BY_M = 50.0  # WP_RADIUS: ArduPlane turns by a right angle at this distance from a waypoint.
# Waypoints are added if the height differs from the line between them by more; over ground, by less.
HEIGHT_TOLERANCE_M, OVER_GROUND_TOLERANCE_M = 8.0, 2.5
# A leg that is flown level is divided if its height changes by more than the first, in steps of the second.
LEVEL_TOLERANCE_M, LEVEL_STEP_M = 4.0, 7.5
HIGHER_M = 15.0  # Where the autopilot follows the ground, it may fly higher than the path by this much.
SLIGHT_M = 2.0  # A waypoint this close to the line between its neighbours is removed.
MARK_M = 40.0  # An action is carried out at a waypoint this near, otherwise a waypoint is added for it.
SPACING_M = 60.0  # A waypoint for height keeps this distance from its neighbours.
REPAIRABLE_RULES = frozenset({"corner", "climb"})  # Removing a waypoint may repair violations of these rules.
REMOVED_MAX = 4  # At most this many waypoints are removed.


@dataclass(frozen=True, slots=True)
class Waypoints:
    """The waypoints of a mission, and how it ends.

    Parameters
    ----------
    positions_enu_m : ndarray, shape (K, 3)
        Waypoints in order, the last is the path's end [m].
    distances_m : ndarray, shape (K,)
        Length of the path up to each waypoint [m].
    airspeed_m_s : float
        True airspeed that is commanded after the first waypoint [m/s].
    loiter_centre_enu_m : ndarray, shape (3,), or None
        Centre of the circle at the end [m]; None for the path's end.
    loiter_radius_m : float
        Radius of the circle, positive clockwise [m]; 0 for the autopilot's own.
    continues_with_operator_items : bool
        Whether the operator's items that follow the goal are flown after the last waypoint.
    actions : tuple of (int, tuple of MissionItem)
        Waypoint numbers with the operator's DO_ items to carry out there.
    airspeed_again : int
        Number of the waypoint after which the airspeed is commanded again, for an aircraft that enters behind
        the first waypoint; 0 for none.
    ground : AutopilotGround or None
        The ground over which the autopilot keeps the waypoints' heights; None for heights above mean sea
        level. The circle is level.
    """

    positions_enu_m: FloatArray
    distances_m: FloatArray
    airspeed_m_s: float
    loiter_centre_enu_m: FloatArray | None = None
    loiter_radius_m: float = 0.0
    continues_with_operator_items: bool = False
    actions: tuple[tuple[int, tuple[MissionItem, ...]], ...] = ()
    airspeed_again: int = 0
    ground: AutopilotGround | None = None

    @property
    def circle(self) -> tuple[FloatArray, float]:
        """Centre (3,) [m] and signed radius [m] of the circle at the end."""
        centre = self.positions_enu_m[-1] if self.loiter_centre_enu_m is None else self.loiter_centre_enu_m
        return centre, self.loiter_radius_m

    @property
    def num_items(self) -> int:
        """Number of items in the autopilot's list, including the operator's actions."""
        again = self.airspeed_again > 0
        return len(self.positions_enu_m) + again + sum(len(items) for _, items in self.actions)


def waypoints_from_path(
    path: Path,
    airspeed_m_s: float,
    *,
    flies_by: bool = True,
    marked_m: Sequence[float] = (),
    spacing: float = 1.0,
    height_tolerance_m: float = HEIGHT_TOLERANCE_M,
    slope_min: SlopeMin = ARDUPLANE_SLOPES,
    ground: AutopilotGround | None = None,
) -> Waypoints:
    """Return waypoints along a path, with several of them in a turn.

    ArduPlane turns before a waypoint and cuts its corner, the earlier the sharper it is. Its waypoints are
    the corners of the polygon around an arc: an aircraft that rounds them at the path's radius flies the arc
    itself. A PX4 turns no more than about 10 m before a waypoint, whatever the item requests (measured, and
    so in its ``mission_block.cpp``). Its waypoints lie on the arc. Straight flight needs a waypoint only if
    the height differs too much from the line between two waypoints.

    Parameters
    ----------
    path : Path
        The path to be flown. Its start is no waypoint, and points nearer to the start than
        :data:`FIRST_WAYPOINT_AHEAD_M` count as passed.
    airspeed_m_s : float
        True airspeed to command [m/s].
    flies_by : bool
        Whether the autopilot turns before a waypoint, as ArduPlane does.
    marked_m : sequence of float
        Lengths of the path at which an action is carried out [m]. Straight flight gets a waypoint there if
        none is near.
    spacing : float
        Turn angle from one waypoint to the next, as a share of the usual one.
    height_tolerance_m : float
        Waypoints are added if the height differs from the line between them by more [m].
    slope_min : SlopeMin
        Which legs the autopilot flies level.
    ground : AutopilotGround, optional
        The ground over which the autopilot keeps heights between waypoints. If omitted, it flies along lines.
    """
    points, courses, travelled = path.positions_enu_m, np.unwrap(path.courses_rad), path.travelled_m
    if ground is not None:
        points = _raised(points, -ground.up_m(points))
    turns = _turns(points, courses, travelled, flies_by=flies_by, spacing=spacing)
    marks = [(0.0, points[0]), *turns, (float(travelled[-1]), points[-1])]
    higher_m = height_tolerance_m if ground is None else HIGHER_M
    marks = _with_heights(marks, points, travelled, (height_tolerance_m, higher_m))
    chosen = [mark for mark in marks[1:-1] if mark[0] >= FIRST_WAYPOINT_AHEAD_M]
    if marks[1][0] > FIRST_WAYPOINT_AHEAD_M + ENTRY_STRAIGHT_MIN_M and len(points) > 2:
        row = int(np.searchsorted(travelled[:-1], FIRST_WAYPOINT_AHEAD_M))
        chosen.insert(0, _mark(points, travelled, row))
    chosen = _without_slight_corners([*chosen, marks[-1]])
    chosen = _with_short_climbs([marks[0], *chosen], points, courses, travelled, slope_min, ground=ground)[1:]
    for length in marked_m:
        row = int(np.argmin(np.abs(travelled - length)))
        if _is_straight(courses, row) and min(abs(travelled[row] - at[0]) for at in chosen) > MARK_M:
            chosen.append(_mark(points, travelled, row))
    found = _in_order(chosen, airspeed_m_s)
    if ground is None:
        return found
    places = found.positions_enu_m
    return replace(found, positions_enu_m=_raised(places, ground.up_m(places)), ground=ground)


def _raised(points: FloatArray, by_m: FloatArray) -> FloatArray:
    """Return ``points`` (N, 3) [m] higher by ``by_m`` (N,) [m], as (N, 3)."""
    return np.column_stack([points[:, :2], points[:, 2] + by_m])


def _mark(points: FloatArray, travelled: FloatArray, row: int) -> tuple[float, FloatArray]:
    """Return length of ``travelled`` (N,) [m] and position (3,) of ``points`` (N, 3) [m] at a row."""
    return float(travelled[row]), points[row]


def _in_order(marks: list[tuple[float, FloatArray]], airspeed_m_s: float) -> Waypoints:
    """Return waypoints at ``marks``, pairs of a length of path and a position (3,) [m]."""
    ordered = sorted(marks, key=lambda mark: mark[0])
    positions, distances = np.array([at[1] for at in ordered]), np.array([at[0] for at in ordered])
    return Waypoints(positions, distances, airspeed_m_s)


def _is_straight(courses: FloatArray, row: int) -> bool:
    """Return whether a path of ``courses`` (N,) [rad] is straight before and after a row."""
    return 0 < row < len(courses) - 1 and bool(np.ptp(courses[row - 1 : row + 2]) <= STRAIGHT_RAD)


def _without_slight_corners(marks: list[tuple[float, FloatArray]]) -> list[tuple[float, FloatArray]]:
    """Return marks without those within :data:`SLIGHT_M` of the line between their neighbours.

    ``marks`` and the result are pairs of a length of path and a position (3,) [m].
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
    """Return waypoints of all turns: corners around them if the autopilot flies by, else points on them.

    Each turn is divided into parts of equal change of course. A corner is where the tangents at the ends of a
    part meet. Each waypoint (3,) [m] comes with the length of the path up to it [m]. ``points`` (N, 3) are
    the path's positions [m], ``courses`` (N,) its unwrapped courses [rad], and ``travelled`` (N,) its
    horizontal length up to each [m].
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
    """Return lengths (K,) [m] and positions (K, 3) [m] at which a turn has the courses ``cuts`` (K,) [rad].

    The turn leads from row ``first`` to row ``last``; between two rows it is an arc. ``points`` (N, 3) [m],
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
    """Return first and last row of each turn to one side; ``courses`` (N,) are unwrapped [rad]."""
    steps = np.diff(courses)
    signs = np.concatenate([[0.0], np.sign(np.where(np.abs(steps) > STRAIGHT_RAD, steps, 0.0)), [0.0]])
    edges = np.flatnonzero(np.diff(signs))  # Rows at which the side of turning changes.
    return [(int(a), int(b)) for a, b in itertools.pairwise(edges) if signs[a + 1] != 0.0]


def _with_heights(
    marks: list[tuple[float, FloatArray]],
    points: FloatArray,
    travelled: FloatArray,
    tolerances_m: tuple[float, float],
) -> list[tuple[float, FloatArray]]:
    """Return marks, and rows of the path where the height between two marks differs from their line.

    The line may lie lower than the path by the first of ``tolerances_m``, and higher by the second.
    ``marks`` and the result are pairs of a length of path and a position (3,) [m]. ``points`` (N, 3) are the
    path's positions [m], ``travelled`` (N,) the horizontal length up to each [m].
    """
    result = [marks[0]]
    for after in marks[1:]:
        before = result[-1]
        inner = np.flatnonzero((travelled > before[0] + SPACING_M) & (travelled < after[0] - SPACING_M))
        if len(inner) > 0:
            line = np.interp(travelled[inner], [before[0], after[0]], [before[1][2], after[1][2]])
            above = points[inner, 2] - line
            beyond = np.maximum(above / tolerances_m[0], -above / tolerances_m[1])
            worst = int(np.argmax(beyond))
            if beyond[worst] > 1.0:
                row = inner[worst]
                middle = float(travelled[row]), points[row]
                result += _with_heights([before, middle], points, travelled, tolerances_m)[1:]
                result += _with_heights([result[-1], after], points, travelled, tolerances_m)[1:]
                continue
        result.append(after)
    return result


def _with_short_climbs(
    marks: list[tuple[float, FloatArray]], points: FloatArray, courses: FloatArray, travelled: FloatArray,
    slope_min: SlopeMin, *, ground: AutopilotGround | None,
) -> list[tuple[float, FloatArray]]:  # fmt: skip
    """Return marks, with more of them in each straight leg that the autopilot flies level.

    It flies the leg at the height of its end, so the height at its begin is wrong by the change of height.
    ``marks`` and the result are pairs of a length of path and a position (3,) [m]; over ground they are the
    same. ``points`` (N, 3) are the path's positions [m], ``courses`` (N,) its courses [rad], ``travelled``
    (N,) the horizontal length up to each [m].
    """
    if ground is not None:
        return marks
    result = [marks[0]]
    for before, after in itertools.pairwise(marks):
        change = float(after[1][2] - before[1][2])
        if abs(change) > LEVEL_TOLERANCE_M and slope_min.is_level(change):
            num = min(max(math.ceil(abs(change) / LEVEL_STEP_M), 2), int((after[0] - before[0]) / SPACING_M))
            lengths = np.linspace(before[0], after[0], num + 1)[1:-1]
            rows = [int(row) for row in np.searchsorted(travelled, lengths)]
            result += [_mark(points, travelled, row) for row in rows if _is_straight(courses, row)]
        result.append(after)
    return result


def merge_close_waypoints(
    waypoints: Waypoints, wrong_with: Callable[[Waypoints], tuple[Violation, ...]]
) -> tuple[Waypoints, tuple[Violation, ...]]:
    """Remove waypoints that are too close together for the turn or the climb between them.

    If two turns of a path nearly meet, their waypoints are close together. The path is flyable, the legs may
    not be.

    Parameters
    ----------
    waypoints : Waypoints
        The waypoints of a path.
    wrong_with : callable
        Returns the checker's violations of some waypoints.

    Returns
    -------
    Waypoints, tuple of Violation
        Waypoints with fewer violations, ideally none, and those violations.
    """
    violations = wrong_with(waypoints)
    for _ in range(REMOVED_MAX):
        if not violations or any(entry.rule not in REPAIRABLE_RULES for entry in violations):
            break
        row = violations[0].row  # Rows of legs begin with the start, so the waypoint's number is one less.
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
    """Waypoints as mission items, to be inserted into an autopilot's list.

    Parameters
    ----------
    items : tuple of MissionItem
        The waypoints, the airspeed after the first, and the operator's DO_ items.
    speed : MissionItem
        The cruise airspeed.
    loiter : MissionItem
        The circle at the end.
    continues_with_operator_items : bool
        Whether the operator's items that follow the goal are flown after the last waypoint.
    way_on : tuple of MissionItem
        Waypoints from the circle to the operator's landing, for a PX4's return to launch.
    """

    items: tuple[MissionItem, ...]
    speed: MissionItem
    loiter: MissionItem
    continues_with_operator_items: bool
    way_on: tuple[MissionItem, ...] = ()


def mission_part(
    waypoints: Waypoints,
    frame: LocalFrame,
    cruise_m_s: float | None = None,
    way_on_enu_m: FloatArray | None = None,
) -> MissionPart:
    """Return waypoints as mission items.

    Parameters
    ----------
    waypoints : Waypoints
        The mission's waypoints.
    frame : LocalFrame
        The frame of their coordinates.
    cruise_m_s : float, optional
        True airspeed for the operator's items after them [m/s]; the waypoints' airspeed if omitted.
    way_on_enu_m : ndarray, shape (N, 3), optional
        Waypoints from the circle to the operator's landing [m].
    """
    way_on = () if way_on_enu_m is None else way_on_enu_m
    return MissionPart(
        path_items(waypoints, frame),
        speed_item(replace(waypoints, airspeed_m_s=cruise_m_s or waypoints.airspeed_m_s), frame),
        loiter_item(waypoints, frame),
        waypoints.continues_with_operator_items,
        tuple(placed_item(Command.NAV_WAYPOINT, position, frame) for position in way_on),
    )


def path_items(waypoints: Waypoints, frame: LocalFrame) -> tuple[MissionItem, ...]:
    """Return the waypoints, the airspeed after the first (or repeated later), and the operator's actions."""
    actions = dict(waypoints.actions)
    items = []
    for n, position in enumerate(waypoints.positions_enu_m):
        items.append(placed_item(Command.NAV_WAYPOINT, position, frame, waypoints.ground))
        if waypoints.continues_with_operator_items and n == len(waypoints.positions_enu_m) - 1:
            items[-1] = replace(items[-1], parameters=(0.0, GOAL_ACCEPTANCE_M, 0.0, None))
        if n in (0, waypoints.airspeed_again):
            items.append(speed_item(waypoints, frame))
        items += actions.get(n, ())
    return tuple(items)


def speed_item(waypoints: Waypoints, frame: LocalFrame) -> MissionItem:
    """Return the item that commands the airspeed and leaves the throttle unchanged."""
    altitude = frame.altitude_amsl_m + float(waypoints.positions_enu_m[0, 2])
    airspeed = equivalent_airspeed(waypoints.airspeed_m_s, altitude)
    parameters = (0.0, round(airspeed, 1), -1.0, 0.0)
    return MissionItem(0, Command.DO_CHANGE_SPEED, MavFrame.MISSION, parameters, 0, 0, 0.0)


def loiter_item(waypoints: Waypoints, frame: LocalFrame) -> MissionItem:
    """Return the item of the circle at the end, which is level."""
    centre, radius_m = waypoints.circle
    last = placed_item(Command.NAV_LOITER_UNLIM, centre, frame)
    return replace(last, parameters=(0.0, 0.0, radius_m, None))


def sequence_of_waypoint(mission: Mission, number: int) -> int:
    """Return the sequence of the n-th waypoint after a mission's entry; other items do not count."""
    behind = mission.items[mission.entry :]
    found = [item.sequence for item in behind if item.command == Command.NAV_WAYPOINT]
    return found[number]


def placed_item(
    command: Command, position_enu_m: FloatArray, frame: LocalFrame, ground: AutopilotGround | None = None
) -> MissionItem:
    """Return a command at a place as a mission item.

    Parameters
    ----------
    command : Command
        A command with a place.
    position_enu_m : ndarray, shape (3,)
        The place [m].
    frame : LocalFrame
        The frame of its coordinates.
    ground : AutopilotGround, optional
        The ground over which its height counts; above mean sea level if omitted.
    """
    latitude, longitude, altitude = frame.global_from_local(*(float(value) for value in position_enu_m))
    if ground is not None:
        altitude = float(position_enu_m[2] - ground.up_m(position_enu_m[None])[0])
    return MissionItem(
        sequence=0,
        command=command,
        frame=MavFrame.GLOBAL_INT if ground is None else MavFrame.GLOBAL_TERRAIN_ALT_INT,
        parameters=(0.0, 0.0, 0.0, None),
        latitude_e7=round(latitude * 1e7),
        longitude_e7=round(longitude * 1e7),
        altitude_m=round(altitude, 2),
    )
