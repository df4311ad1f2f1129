"""From a plan to what is handed over of it: waypoints that a mission carries, and a circle at their end."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice, product

import numpy as np

from companion.assurance.violation import Violation
from companion.flight.state.decision import Verdict
from companion.flight.state.flight_state import FlightState
from companion.flight.state.flown_track import (
    airspeed_at_end,
    astray,
    blown_off,
    circle_stretch,
    commanded_airspeed_m_s,
    is_circle_exposed,
    is_circle_met,
    track_over,
)
from companion.flight.state.progress import Start
from companion.frames import FloatArray
from companion.mission.loiter import Circle, circles_beside
from companion.mission.waypoints import (
    CHORD_STYLES,
    FLY_BY_STYLES,
    MissionPart,
    TurnStyle,
    Waypoints,
    merge_close_waypoints,
    waypoints_from_path,
)
from companion.types.mission import MissionItem
from companion.types.path import FASTER_M_S, Path, run_on

CARRIED_HORIZONS = 3.0  # of a path are uploaded at once
HOT_STRETCH = 1.12  # of a circle in air 30 K warmer than the standard's, as thin at the same pressure
SAFER_ROWS = 6  # are tried for a circle that is under no threat, and easily entered
FAST_ROWS = 12  # So many ends of a fast mission are tried before it is slowed down.
STYLED_ROWS = 3  # at which other styles are tried where the usual one's mission breaks a rule
SHORTEST_ROWS = 12
GUSTS_M = 3.0  # beside its track an aircraft flies in turbulence
RUN_ON_M = (0.0, 100.0, 200.0, 300.0, 400.0)  # beyond the goal, where it has no room for a circle
CIRCLED_S = 15.0  # of the circle at the end are looked at
SLOWED_M_S = 2.0  # or more to lose until cruise
TOUCHING_M = 1.0
ENTERED_WITHIN_M = 130.0  # behind its third waypoint, a late aircraft
NEAR_M = 5.0  # of the goal's region a path to it ends
NO_ROOM = Violation("bank", 0, 0.0, 0.0, "no part of the path fits the bank")

Actions = tuple[MissionItem, ...]
_Shaped = dict[int, tuple[Waypoints, tuple[Violation, ...]]]


@dataclass(frozen=True, slots=True)
class ShapedPath:
    """A path in the shape that a mission carries it in, and why it is to be flown.

    Parameters
    ----------
    path : Path
        What is to be flown.
    waypoints : Waypoints
        What the mission carries of it.
    part : MissionPart
        The waypoints as mission items.
    carried_until_s : float
        The path's time at their end [s].
    start : Start
        Where the plan began.
    verdict : Verdict
        Why it is to be flown.
    text : str
        The same in words.
    why : mapping
        The numbers that led to it.
    cost : float
        What the path costs.
    """

    path: Path
    waypoints: Waypoints
    part: MissionPart
    carried_until_s: float
    start: Start
    verdict: Verdict
    text: str
    why: Mapping[str, object]
    cost: float


def waypoints_of(
    state: FlightState, path: Path, max_waypoints: int, *, is_whole: bool = False
) -> tuple[Waypoints, float, tuple[Violation, ...]]:
    """Waypoints of the part of a path that a mission carries, and a loiter at its end.

    Beyond a few time horizons a path is a guess: threats there are still to be sensed. The mission
    carries no more than :data:`CARRIED_HORIZONS` of it where a clear circle can end it there, else
    the nearest row at which one can; should the service fall silent, the aircraft circles at a
    place that was checked.

    Parameters
    ----------
    state : FlightState
        Goals and rules.
    path : Path
        What is to be flown.
    max_waypoints : int
        Room in the autopilot's list.
    is_whole : bool
        Whether as much of it is wanted as there is room for.

    Returns
    -------
    Waypoints
        What to upload.
    float
        The path's time at their end [s].
    tuple of Violation
        What is wrong with them, if no part of the path can be carried.
    """
    wanted = math.inf if is_whole else CARRIED_HORIZONS * state.rules.time_horizon_s
    last = len(path) - 1
    row = min(last, int(np.searchsorted(path.times_s, path.times_s[0] + wanted)))
    first_wrong: tuple[Violation, ...] = ()
    worse: list[tuple[Waypoints, float]] = []
    shaped: _Shaped = {}
    tries = _carried_to_rows(state, path, row, shaped)
    if _is_fast(state, path.until(row)):
        tries = chain(islice(_carried_to_rows(state, path, row, shaped, may_slow=False), FAST_ROWS), tries)
    for end, waypoints, violations in tries:
        if violations or waypoints.num_items > max_waypoints:
            first_wrong = first_wrong or violations
            continue
        until_s = float(path.times_s[end])
        if end == last or len(worse) == SAFER_ROWS or _ends_well(state, path.until(end), waypoints):
            return waypoints, until_s, ()
        worse.append((waypoints, until_s))
    if worse:
        return *worse[0], ()
    return _carried_otherwise(state, path, max_waypoints, (waypoints, first_wrong or (NO_ROOM,)))


def _ends_well(state: FlightState, part: Path, waypoints: Waypoints) -> bool:
    """Whether the circle at the end is under no threat, and the way into it leads nowhere else."""
    return not (
        _is_astray(state, part, waypoints) or is_circle_exposed(state, waypoints, float(part.times_s[-1]))
    )


def _carried_otherwise(
    state: FlightState, path: Path, max_waypoints: int, failed: tuple[Waypoints, tuple[Violation, ...]]
) -> tuple[Waypoints, float, tuple[Violation, ...]]:
    """The whole path where no row has room for the circle at the end of a part; if that fails, too, what did.

    At cruise where it was faster, since slower circles are narrower; and, where nothing of the operator's
    follows the goal, straight on beyond it, to where there is room.
    """
    vehicle, until_s = state.rules.vehicle, float(path.times_s[-1])
    airspeeds = sorted({commanded_airspeed_m_s(path, vehicle), vehicle.airspeed_cruise_m_s}, reverse=True)
    for metres in RUN_ON_M if state.tail_enu_m is None else RUN_ON_M[:1]:
        whole = run_on(path, metres) if metres > 0.0 else path
        hopeless: set[float] = set()
        for style, airspeed in product(_styles(state), airspeeds):
            if airspeed in hopeless:
                continue
            waypoints, violations = _with_some_circle(state, whole, whole, style, airspeed)
            if _has_no_circle(state, whole, (waypoints, violations)):
                hopeless.add(airspeed)
            violations = violations or blown_off(state, whole, waypoints)
            if not violations and waypoints.num_items <= max_waypoints:
                return waypoints, until_s, ()
    return failed[0], until_s, failed[1]


def _carried_to_rows(
    state: FlightState, path: Path, row: int, shaped: _Shaped, *, may_slow: bool = True
) -> Iterator[tuple[int, Waypoints, tuple[Violation, ...]]]:
    """Rows at which a mission may end, the wanted one first, its waypoints, and what is wrong with them.

    What they come to in the usual style is kept in ``shaped``.
    """
    last = len(path) - 1
    tries = [row, *(row + k for k in range(2, last - row, 2)), last]
    tries += list(range(row - 2, min(row, SHORTEST_ROWS) - 1, -2))
    styled = 0
    for end in tries:
        if end not in shaped:
            shaped[end] = _with_some_circle(state, path, path.until(end), _styles(state)[0])
        usual = shaped[end]
        if usual[1] and styled >= STYLED_ROWS:  # at most rows it is the circle that has no room
            continue
        styled += bool(usual[1])
        yield end, *_best_carried(state, path, end, usual, may_slow=may_slow)


def carried(state: FlightState, path: Path, end: int) -> tuple[Waypoints, tuple[Violation, ...]]:
    """Waypoints of a path up to a row with the loiter beside it, and what is wrong with them.

    Those are taken whose track, as the autopilot will fly it, keeps its distance; where none does, those
    that keep most.
    """
    return _best_carried(state, path, end, _with_some_circle(state, path, path.until(end), _styles(state)[0]))


def _styles(state: FlightState) -> tuple[TurnStyle, ...]:
    """How waypoints may lie in turns, the usual style first."""
    return FLY_BY_STYLES if state.flies_by else CHORD_STYLES


def _best_carried(
    state: FlightState, path: Path, end: int, usual: tuple[Waypoints, tuple[Violation, ...]], *,
    may_slow: bool = True,
) -> tuple[Waypoints, tuple[Violation, ...]]:  # fmt: skip
    """As :func:`carried`, beginning with what the usual style comes to.

    What is faster than cruise flies wide of its waypoints: where it would come too near to something in all
    styles, or out of the bounds at its end, it is carried at cruise, or not where it may not slow down.
    What would touch something is not carried.
    """
    best, found = usual, _room_flown(state, path, usual)
    for style in _styles(state)[1:]:
        if found >= _room_enough(state):
            break
        other = _with_some_circle(state, path, path.until(end), style)
        room = _room_flown(state, path, other)
        if room > found:
            best, found = other, room
    enough = TOUCHING_M
    if _is_fast(state, path.until(end)) and may_slow:
        best, found = _or_at_cruise(state, path, end, best, found)
    elif not may_slow and not _does(state, path.until(end), best[0], found):
        enough = math.inf
    if not best[1] and found < enough:
        return best[0], (Violation("clearance", 0, found, 0.0, "distance to something as it is flown [m]"),)
    return best


def _or_at_cruise(
    state: FlightState, path: Path, end: int, best: tuple[Waypoints, tuple[Violation, ...]], found: float
) -> tuple[tuple[Waypoints, tuple[Violation, ...]], float]:
    """What is carried as fast as planned and its room [m], or the same at cruise where that does not do."""
    part, cruise = path.until(end), state.rules.vehicle.airspeed_cruise_m_s
    if _does(state, part, best[0], found):
        return best, found
    for style in _styles(state):
        other = _with_some_circle(state, path, path.until(end), style, cruise)
        room = _room_flown(state, path, other)
        if _does(state, part, other[0], room):
            return other, room
        if room > found:
            best, found = other, room
        if _has_no_circle(state, part, other):
            break
    return best, found


def _has_no_circle(state: FlightState, part: Path, shaped: tuple[Waypoints, tuple[Violation, ...]]) -> bool:
    """Whether it is the circle at the end only that breaks rules: other turns before it do not help."""
    waypoints, violations = shaped
    if not violations:
        return False
    legs: FloatArray = np.vstack([part.positions_enu_m[:1], waypoints.positions_enu_m])
    wrong = state.rules.checker.check_legs(
        legs, ends_in_loiter=False, loiter_radius_m=None, may_come_back=True,
        wind_enu_m_s=state.wind_enu_m_s, airspeed_m_s=float(part.speeds_m_s.min()),
    )  # fmt: skip
    return all(entry.rule == "ending" for entry in wrong)


def _does(state: FlightState, part: Path, waypoints: Waypoints, room_m: float) -> bool:
    """Whether a mission with so much room [m] keeps the hard margin, and ends in a circle easily entered."""
    return room_m >= state.rules.checker.limits.margin_m and not _is_astray(state, part, waypoints)


def _is_astray(state: FlightState, part: Path, waypoints: Waypoints) -> bool:
    """Whether the way into the circle at the end comes too near to something, or far out of the bounds."""
    return not is_circle_met(waypoints) and max(astray(state, part, waypoints)) > 0.0


def _is_fast(state: FlightState, part: Path) -> bool:
    """Whether a part of a path is commanded to be faster than cruise."""
    cruise = state.rules.vehicle.airspeed_cruise_m_s
    return commanded_airspeed_m_s(part, state.rules.vehicle) > cruise + FASTER_M_S


def _room_enough(state: FlightState) -> float:
    """Distance to keep from everything, and a little for gusts [m]: more is no better."""
    return float(state.mission.planning.clearance_min_m) + GUSTS_M


def _room_flown(state: FlightState, path: Path, shaped: tuple[Waypoints, tuple[Violation, ...]]) -> float:
    """How near the flown track comes to anything [m], as far as it matters; negative for no mission.

    At the speed that the path begins with, and at the commanded one, whichever is nearer: how soon the
    aircraft is faster it is not known.
    """
    waypoints, violations = shaped
    if violations:
        return -1.0
    enough, first, then = _room_enough(state), float(path.speeds_m_s[0]), waypoints.airspeed_m_s
    room = enough
    for airspeed in (first, then) if abs(then - first) > FASTER_M_S else (first,):
        track = track_over(state, path, waypoints, CIRCLED_S, airspeed)
        wrong = state.rules.checker.check_track(track.positions_enu_m, enough)
        room = min([room, *(entry.value for entry in wrong if entry.rule == "clearance")])
    return room


def _with_some_circle(
    state: FlightState, path: Path, part: Path, style: TurnStyle, airspeed_m_s: float | None = None
) -> tuple[Waypoints, tuple[Violation, ...]]:
    """As :func:`_with_circle`, at a commanded airspeed, by default that which the part comes to.

    In the wind the circle at the end is as wide as is easily flown there, or, where that has no room, as
    wide as in still air if its track in the wind has. Faster than at cruise the track into any is looked at.
    """
    airspeed_m_s = airspeed_m_s or commanded_airspeed_m_s(part, state.rules.vehicle)
    vehicle = state.rules.vehicle.at_speed(airspeed_at_end(part, state.rules.vehicle, airspeed_m_s))
    radius, narrow = vehicle.turn_radius_in(math.hypot(*state.wind_enu_m_s)), vehicle.turn_radius_min_m
    usual = _with_circle(state, path, part, style, radius, airspeed_m_s)
    if not usual[1] and vehicle.airspeed_cruise_m_s > state.rules.vehicle.airspeed_cruise_m_s:
        usual = usual[0], blown_off(state, part, usual[0])
    if not usual[1] or radius <= narrow:
        return usual
    waypoints, violations = _with_circle(state, path, part, style, narrow, airspeed_m_s)
    return waypoints, violations or blown_off(state, part, waypoints)


def _with_circle(
    state: FlightState, path: Path, part: Path, style: TurnStyle, radius: float, airspeed_m_s: float
) -> tuple[Waypoints, tuple[Violation, ...]]:
    """Waypoints of a part of a path, a circle of a radius at their end, and what is wrong with them."""
    rules = state.rules
    actions = _actions_along(state, part)
    flown = waypoints_from_path(
        part,
        airspeed_m_s,
        flies_by=state.flies_by,
        marked_m=[length for length, _ in actions],
        style=style,
    )
    commanded = round(radius / circle_stretch(state))
    if state.flies_by:  # wider in hot air, in which the circle is to keep clear, too
        radius *= HOT_STRETCH
    circles = circles_beside(
        flown.positions_enu_m, float(part.courses_rad[-1]), radius, rules.obstacles,
        rules.checker.limits.bounds,
    )  # fmt: skip

    def ending_in(circle: Circle) -> tuple[Waypoints, tuple[Violation, ...]]:
        def wrong_with(waypoints: Waypoints) -> tuple[Violation, ...]:
            legs: FloatArray = np.vstack([part.positions_enu_m[:1], waypoints.positions_enu_m])
            return rules.checker.check_legs(
                legs,
                ends_in_loiter=True,
                loiter_radius_m=radius,
                loiter_centre_enu_m=circle.centre_enu_m,
                may_come_back=True,
                wind_enu_m_s=state.wind_enu_m_s,
                airspeed_m_s=float(part.speeds_m_s.min()),
            )

        merged, violations = merge_close_waypoints(flown, wrong_with)
        may_go_on = len(part) == len(path) and _may_go_on(state, merged.positions_enu_m[-1])
        waypoints = replace(
            merged,
            loiter_centre_enu_m=circle.centre_enu_m,
            loiter_radius_m=circle.direction * commanded,
            continues_with_operator_items=may_go_on,
            actions=_actions_at(actions, merged),
            airspeed_again=_airspeed_again(state, part, merged),
        )
        return waypoints, violations

    usual = ending_in(circles[0])
    on_legs = any(entry.row < len(usual[0].positions_enu_m) for entry in usual[1])
    if on_legs or not circles[0].is_moved:
        return usual
    best, found = (math.inf, math.inf), usual
    for shaped in (usual, *(ending_in(circle) for circle in circles[1:])):
        off = (0.0, 0.0) if is_circle_met(shaped[0]) else astray(state, part, shaped[0])
        if not shaped[1] and off < best:
            best, found = off, shaped
        if best == (0.0, 0.0):
            break
    return found


def _airspeed_again(state: FlightState, part: Path, waypoints: Waypoints) -> int:
    """The last waypoint at which a mission may be entered, where it may change the airspeed; 0 where not."""
    cruise = state.rules.vehicle.airspeed_cruise_m_s
    if max(float(part.speeds_m_s[0]) - SLOWED_M_S, waypoints.airspeed_m_s - FASTER_M_S) <= cruise:
        return 0
    near = np.flatnonzero(waypoints.distances_m <= float(waypoints.distances_m[:3][-1]) + ENTERED_WITHIN_M)
    return int(near[-1])


def _may_go_on(state: FlightState, last_enu_m: FloatArray) -> bool:
    """Whether ``last_enu_m`` (3,) [m] is the goal, and the operator's items behind it can be flown to."""
    if state.tail_enu_m is None or not state.goals:
        return False
    goal = state.goals[-1]
    if np.linalg.norm(last_enu_m - np.asarray(goal.position_enu_m)) > goal.acceptance_radius_m + NEAR_M:
        return False  # a safe loiter: from there it is planned on
    legs: FloatArray = np.vstack([last_enu_m, state.tail_enu_m])
    wrong = state.rules.checker.check_legs(legs, ends_in_loiter=True, loiter_radius_m=state.turn_radius_m)
    return not any(entry.rule == "clearance" for entry in wrong)


def _actions_along(state: FlightState, part: Path) -> list[tuple[float, Actions]]:
    """The operator's DO_ items of goals that a part of a path reaches, and how far along they are [m]."""
    found: list[tuple[float, Actions]] = []
    row = 0
    for goal, items in zip(state.goals[state.next_goal :], state.actions[state.next_goal :], strict=False):
        away = np.linalg.norm(part.positions_enu_m[row:] - np.asarray(goal.position_enu_m), axis=1)
        if not away.min() <= goal.acceptance_radius_m:
            break
        row += int(np.argmin(away))
        steps = np.linalg.norm(np.diff(part.positions_enu_m[: row + 1, :2], axis=0), axis=1)
        if items:
            found.append((float(steps.sum()), items))
    return found


def _actions_at(
    actions: Sequence[tuple[float, Actions]], waypoints: Waypoints
) -> tuple[tuple[int, Actions], ...]:
    """What is to be done by the number of the waypoint that it is done at."""
    found: dict[int, Actions] = {}
    for length, items in actions:
        behind = np.flatnonzero(waypoints.distances_m >= length - 1.0)
        number = int(behind[0]) if len(behind) else len(waypoints.distances_m) - 1
        found[number] = found.get(number, ()) + items
    return tuple(sorted(found.items()))
