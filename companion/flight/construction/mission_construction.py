"""From a planned path to the mission that carries it: waypoints, and a circle at their end.

One principle decides. A candidate mission is a row of the path at which it ends, a circle there and a
commanded airspeed. Each candidate is flown over in simulation by the autopilot's own guidance, from where the
path begins until one lap of the circle is done, in the wind there is. Waypoints in turns are moved against
the deviation of that track from the path until the track keeps its clearance (iterative learning control).
The first candidate whose track has no fault is taken. If all have faults, it is the one with the least.

References
----------
D. A. Bristow, M. Tharayil, A. G. Alleyne, "A survey of iterative learning control", IEEE Control Systems
Magazine 26(3), 2006.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from companion.assurance.violation import Violation
from companion.flight.construction.mission_simulation import (
    NO_FAULTS,
    Faults,
    airspeed_at_end,
    circle_stretch,
    commanded_airspeed_m_s,
    faults_of,
    followed_ground,
    guidance_of,
    is_circle_exposed,
    is_circle_taken,
    lacking_in_other_winds,
    simulated,
)
from companion.flight.construction.way_behind import is_way_behind_taken, may_go_on
from companion.flight.state.decision import Verdict
from companion.flight.state.flight_state import FlightState
from companion.flight.state.progress import Start
from companion.frames import FloatArray
from companion.mission.loiter import ROUND_PATH, TOUCHING, Circle, circles_along
from companion.mission.waypoints import (
    HEIGHT_TOLERANCE_M,
    OVER_GROUND_TOLERANCE_M,
    MissionPart,
    Waypoints,
    merge_close_waypoints,
    waypoints_from_path,
)
from companion.types.mission import MissionItem
from companion.types.path import FASTER_M_S, Path, run_on
from companion.world.ground.autopilot_ground import AutopilotGround
from companion.world.vehicle.guidance import Track

HORIZONS = 3.0  # Time horizons that a mission covers; beyond them threats are still to be sensed.
# In a team it carries more: the others keep clear of the circle at its end, which would often bar their way.
TEAM_HORIZONS = 6.0
HOT_STRETCH = 1.12  # In air 30 K warmer than the standard, ArduPlane's circles are wider by this factor.
ENDS_MAX = 12  # Ends that are simulated at each airspeed.
SHORTEST_ROWS = 12  # A mission that covers less of the path is over before the next plan is made.
RUN_ON_M = 400.0  # Where a goal has no room for a circle, the circle may lie up to this far behind it.
RUN_ON_ROWS = 4  # Circles behind the goal are tried every four rows, 100 m apart.
SPACINGS = (1.0, 0.5)  # Spacings of waypoints in turns, as shares of the usual one, tried in this order.
CORRECTIONS = 3  # Further corrections move waypoints by less than a metre.
GAIN = 0.8  # Share of a deviation by which a waypoint is moved against it: less than 1 converges.
LATE_ENTRY_MAX_M = 130.0  # A late aircraft joins a mission at most this far behind its third waypoint.
SLOWED_M_S = 2.0  # An aircraft this much faster than cruise has to be commanded to slow down.
NO_ROOM = Violation("bank", 0, 0.0, 0.0, "no part of the path fits the bank")
NO_CIRCLE = Violation("ending", 0, 0.0, 0.0, "no circle along the path has room")
WAY_TAKEN = Violation("ending", 0, 0.0, 0.0, "another member flies where the way on from the goal leads")

Actions = tuple[MissionItem, ...]


@dataclass(frozen=True, slots=True)
class ConstructedMission:
    """A path as a mission, and why it is to be flown.

    Parameters
    ----------
    path : Path
        The planned path.
    waypoints : Waypoints
        The waypoints of the part of it that the mission covers.
    part : MissionPart
        The waypoints as mission items.
    covered_until_s : float
        The path's time at the end of that part [s].
    start : Start
        Where the plan began.
    verdict : Verdict
        The reason to fly it.
    text : str
        The reason in words.
    why : mapping
        The numbers behind the reason.
    cost : float
        The path's objective.
    enters_at : int or None
        The item of the part at which the mission is entered, wherever the aircraft is; None for a waypoint
        with a clear way to it.
    """

    path: Path
    waypoints: Waypoints
    part: MissionPart
    covered_until_s: float
    start: Start
    verdict: Verdict
    text: str
    why: Mapping[str, object]
    cost: float
    enters_at: int | None = None


class Circles(NamedTuple):
    """The circles in which a mission may end.

    Parameters
    ----------
    offsets : sequence of float
        Offsets of their centres from the path, to the right, as shares of the radius.
    is_taken : bool
        Whether an aircraft on a known route comes near.
    """

    offsets: Sequence[float]
    is_taken: bool = False


class Candidate(NamedTuple):
    """A mission that may be flown, and what is wrong with it.

    Parameters
    ----------
    waypoints : Waypoints
        The mission's waypoints and circle.
    covered_until_s : float
        The path's time at the end of the part that the mission covers [s].
    violations : tuple of Violation
        Rules that forbid the mission; empty if it may be flown.
    faults : Faults
        What is wrong with its simulated flight.
    valid_until_m : float
        Length of the path beyond which every mission breaks the same rule [m].
    is_waiting : bool
        Whether it ends before a goal that is near, because another member flies where the way on leads.
    """

    waypoints: Waypoints
    covered_until_s: float
    violations: tuple[Violation, ...]
    faults: Faults = NO_FAULTS
    valid_until_m: float = math.inf
    is_waiting: bool = False


def construct(state: FlightState, path: Path, max_waypoints: int, *, is_whole: bool = False) -> Candidate:
    """Make the mission for a path: it covers the path of a few time horizons and ends in a circle.

    Should the service fall silent, the aircraft circles at a place that was checked.

    Parameters
    ----------
    state : FlightState
        Goals, rules, wind and threats.
    path : Path
        The planned path.
    max_waypoints : int
        Number of items that fit into the autopilot's list.
    is_whole : bool
        Whether the mission should cover the whole path, as far as it fits.
    """
    horizons = HORIZONS if state.mission.team is None else TEAM_HORIZONS
    wanted_s = math.inf if is_whole else horizons * state.rules.time_horizon_s
    last = len(path) - 1
    row = min(last, int(np.searchsorted(path.times_s, path.times_s[0] + wanted_s)))
    ends = [row, *range(row + 2, last, 2), last]
    goes_on = may_go_on(state, path.positions_enu_m[last])
    if not goes_on:
        path = run_on(path, RUN_ON_M)
        ends += range(last + RUN_ON_ROWS, len(path), RUN_ON_ROWS)
    ends += range(row - 2, min(row, SHORTEST_ROWS) - 1, -2)
    is_waiting = False
    if goes_on and is_way_behind_taken(state, path):
        at_goal = _row_at_goal(state, path)
        ends = [end for end in ends if end < at_goal]
        is_waiting = float(np.ptp(path.times_s)) <= HORIZONS * state.rules.time_horizon_s
    if not ends:
        return _refused(state, path, last, WAY_TAKEN)
    found = _best_of(state, path, list(dict.fromkeys(ends)), last, max_waypoints)
    return found._replace(is_waiting=is_waiting)


def construct_until(state: FlightState, path: Path, end: int) -> Candidate:
    """Make the mission that covers a path until a row, and ends in a circle there.

    Parameters
    ----------
    state : FlightState
        Goals, rules, wind and threats.
    path : Path
        The planned path.
    end : int
        The row.
    """
    return _best_of(state, path, [end], len(path) - 1, math.inf)


def _best_of(
    state: FlightState, path: Path, ends: Sequence[int], last: int, max_waypoints: float
) -> Candidate:
    """The best candidate; circles that touch the path and are free come first, then free ones round it.

    Circles that an aircraft on a known route comes near are tried only if nothing else may be flown.
    """
    best = None
    for circles in (Circles(TOUCHING), Circles(ROUND_PATH), Circles(TOUCHING, is_taken=True)):
        if best is None or (circles.is_taken and best.violations):
            other = _best_with(state, path, ends, last, max_waypoints, circles)
            if best is None or (other is not None and not other.violations):
                best = other
    if best is not None:
        return best
    return _refused(state, path.until(ends[0]), last, NO_CIRCLE)


def _refused(state: FlightState, path: Path, last: int, why: Violation) -> Candidate:
    """A mission over a path that may not be flown."""
    airspeed = _airspeeds(state, path.until(last))[-1]
    waypoints = waypoints_from_path(
        path, airspeed, flies_by=state.flies_by, height_tolerance_m=_tolerance_m(state),
        slope_min=guidance_of(state).slope_min,
    )  # fmt: skip
    return Candidate(waypoints, float(path.times_s[min(len(path) - 1, last)]), (why,))


def _row_at_goal(state: FlightState, path: Path) -> int:
    """The row of a path from which on a circle that touches it may come near the last goal."""
    goal = state.goals[-1]
    near_m = goal.acceptance_radius_m + 2.0 * state.turn_radius_m
    away = np.flatnonzero(np.linalg.norm(path.positions_enu_m - goal.position_enu_m, axis=1) > near_m)
    return int(away[-1]) + 1 if len(away) else 0


def _best_with(
    state: FlightState, path: Path, ends: Sequence[int], last: int, max_waypoints: float, circles: Circles
) -> Candidate | None:
    """The first candidate without a fault, else the one with the least; if all are forbidden, the first.

    There may be none, because no circle has room.
    """
    found: list[Candidate] = []
    forbidden: list[Candidate] = []
    for airspeed in _airspeeds(state, path.until(min(ends[0], last))):
        for candidate in _candidates(state, path, ends, last, airspeed, max_waypoints, circles=circles):
            if candidate.violations:
                forbidden.append(candidate)
                continue
            found.append(candidate)
            if not candidate.faults.at_end:
                break
        best = min(found, key=_rank, default=None)
        if best is not None and not best.faults.is_serious:
            return best
    return min(found, key=_rank) if found else next(iter(forbidden), None)


def _airspeeds(state: FlightState, part: Path) -> list[float]:
    """Airspeeds to command for a part of a path, the wanted one first [m/s]."""
    cruise = state.rules.vehicle.airspeed_cruise_m_s
    wanted = commanded_airspeed_m_s(part, state.rules.vehicle)
    return [wanted, cruise] if wanted > cruise + FASTER_M_S else [wanted]


def _rank(candidate: Candidate) -> tuple[bool, Faults]:
    """Order of candidates, the best first."""
    return bool(candidate.violations), candidate.faults


def _candidates(
    state: FlightState, path: Path, ends: Sequence[int], last: int, airspeed_m_s: float, max_waypoints: float,
    *, circles: Circles,
) -> Iterator[Candidate]:  # fmt: skip
    """Missions that end at some rows, in that order, each flown over in simulation.

    An end is left out where no circle has room, or where an earlier candidate broke a rule before it. At the
    end where the operator's items follow, no circle is flown.
    """
    slowed = airspeed_at_end(path.until(ends[0]), state.rules.vehicle, airspeed_m_s)
    goes_on_at = last if may_go_on(state, path.positions_enu_m[last]) else None
    travelled, valid_until, num_tried = path.travelled_m, math.inf, 0
    for end, circle in _circles_at(state, path, ends, slowed, circles.offsets):
        if num_tried == ENDS_MAX:
            return
        if travelled[end] >= valid_until:
            continue
        is_taken = end != goes_on_at and is_circle_taken(
            state, circle.centre_enu_m, circle.radius_m, float(path.times_s[end])
        )
        if is_taken is not circles.is_taken:
            continue
        if any(state.rules.checker.circle_violations(circle.centre_enu_m, circle.radius_m, end)):
            continue
        candidate = _fitted(state, path.until(end), airspeed_m_s, circle, goes_on=end == goes_on_at)
        candidate = _with_room(candidate, max_waypoints)
        valid_until = min(valid_until, candidate.valid_until_m)
        num_tried += 1
        yield candidate._replace(covered_until_s=float(path.times_s[min(end, last)]))


def _with_room(candidate: Candidate, max_waypoints: float) -> Candidate:
    """Return the mission, forbidden if the list has no room for all its items; a shorter one may fit."""
    distances_m, num_left = candidate.waypoints.distances_m, max_waypoints - candidate.waypoints.num_items
    if num_left >= 0.0 or candidate.violations:
        return candidate
    valid_until = float(distances_m[max(len(distances_m) + int(num_left) - 1, 0)])
    return candidate._replace(violations=(NO_ROOM,), valid_until_m=min(candidate.valid_until_m, valid_until))


def _circles_at(
    state: FlightState, path: Path, ends: Sequence[int], slowed_m_s: float, offsets: Sequence[float]
) -> Iterator[tuple[int, Circle]]:
    """Yield circles that have room at some rows of a path, in hot air, too, where ArduPlane's are wider."""
    limits, rows = state.rules.checker.limits, np.array(ends)
    vehicle = state.rules.vehicle.at_speed(slowed_m_s)
    radii = dict.fromkeys(
        (vehicle.turn_radius_in(math.hypot(*state.wind_enu_m_s)), vehicle.turn_radius_min_m)
    )
    found = [
        circles_along(
            path.positions_enu_m[rows], path.courses_rad[rows], radius_m * _hot_stretch(state),
            state.rules.obstacles, limits.bounds, limits.margin_m, offsets=offsets,
        )
        for radius_m in radii
    ]  # fmt: skip
    return ((end, circle) for k, end in enumerate(ends) for of_radius in found for circle in of_radius[k])


def _hot_stretch(state: FlightState) -> float:
    """Ratio of the radius in hot air to that in standard air."""
    return HOT_STRETCH if state.flies_by else 1.0


def _tolerance_m(state: FlightState) -> float:
    """Return by how much legs may differ from the path's height [m]."""
    return HEIGHT_TOLERANCE_M if state.mission.terrain is None else OVER_GROUND_TOLERANCE_M


def _fitted(
    state: FlightState, part: Path, airspeed_m_s: float, circle: Circle, *, goes_on: bool
) -> Candidate:
    """Return the mission over a part of a path: heights over ground if asked for and allowed, else AMSL."""
    actions, ground = _actions_along(state, part), followed_ground(state)
    marked = [length for length, _ in actions]
    best, track = _over(state, part, airspeed_m_s, circle, marked, ground)
    if best.violations and ground is not None:
        best, track = _over(state, part, airspeed_m_s, circle, marked, None)
    if track is not None and not best.violations:
        lacking = lacking_in_other_winds(state, best.waypoints, track)
        arrival_s = float(part.times_s[-1])
        is_exposed = not goes_on and (
            is_circle_exposed(state, best.waypoints, arrival_s)
            or is_circle_taken(state, *best.waypoints.circle, arrival_s)
        )
        best = best._replace(faults=best.faults.worst(Faults(lacking, is_exposed, 0.0, 0.0, 0.0)))
    finished = replace(
        best.waypoints,
        continues_with_operator_items=goes_on,
        actions=_actions_at(actions, best.waypoints),
        airspeed_again=_airspeed_again(state, part, best.waypoints),
    )
    return best._replace(waypoints=finished)


def _over(
    state: FlightState, part: Path, airspeed_m_s: float, circle: Circle, marked_m: Sequence[float],
    ground: AutopilotGround | None,
) -> tuple[Candidate, Track | None]:  # fmt: skip
    """A mission whose waypoints are moved until its simulated track follows the part, and that track."""
    tried: list[tuple[Candidate, Track | None]] = []
    slope_min = guidance_of(state).slope_min
    for spacing in SPACINGS:
        waypoints = waypoints_from_path(
            part, airspeed_m_s, flies_by=state.flies_by, marked_m=marked_m, spacing=spacing,
            height_tolerance_m=_tolerance_m(state), slope_min=slope_min, ground=ground,
        )  # fmt: skip
        for _ in range(CORRECTIONS + 1):
            candidate, track = _judged(state, part, waypoints, circle)
            tried.append((candidate, track))
            if track is None or not candidate.faults.before_circle:
                break
            waypoints = _corrected(part, candidate.waypoints, track)
        best, track = min(tried, key=lambda made: _rank(made[0]))
        if not best.violations and not best.faults.short_m:
            break
    return best, track


def _judged(
    state: FlightState, part: Path, waypoints: Waypoints, circle: Circle
) -> tuple[Candidate, Track | None]:
    """Return a mission checked as legs and in simulation; its simulated track, if the legs pass the check."""

    def wrong_with(found: Waypoints) -> tuple[Violation, ...]:
        legs: FloatArray = np.vstack([part.positions_enu_m[:1], found.positions_enu_m])
        return state.rules.checker.check_legs(
            legs, ends_in_loiter=True, loiter_radius_m=circle.radius_m,
            loiter_centre_enu_m=circle.centre_enu_m, may_come_back=True,
            wind_enu_m_s=state.wind_enu_m_s, airspeed_m_s=float(part.speeds_m_s.min()),
            follows_ground=found.ground is not None,
        )  # fmt: skip

    waypoints, violations = merge_close_waypoints(waypoints, wrong_with)
    commanded = round(circle.radius_m / _hot_stretch(state) / circle_stretch(state))
    waypoints = replace(
        waypoints, loiter_centre_enu_m=circle.centre_enu_m, loiter_radius_m=circle.direction * commanded
    )
    lengths, last = waypoints.distances_m, len(waypoints.distances_m) - 1
    if violations:
        broken = [entry.row - 1 for entry in violations if entry.row <= last]  # row 0 is the start
        valid_until = float(lengths[max(min(broken), 0)]) if broken else math.inf
        return Candidate(waypoints, 0.0, violations, valid_until_m=valid_until), None
    track = simulated(state, part, waypoints)
    tracks = [track]
    if abs(waypoints.airspeed_m_s - float(part.speeds_m_s[0])) > FASTER_M_S:  # How soon is not known.
        tracks.append(simulated(state, part, waypoints, at_once=True))
    faults, violations, broken = NO_FAULTS, (), list[int]()
    for flown in tracks:
        wrong, forbidden = faults_of(state, part, waypoints, flown)
        faults, violations = faults.worst(wrong), (*violations, *forbidden)
        broken += [int(flown.reached[entry.row]) for entry in forbidden]
    valid_until = float(lengths[min(broken)]) if broken and min(broken) < last else math.inf
    return Candidate(waypoints, 0.0, violations, faults, valid_until), track


def _corrected(part: Path, waypoints: Waypoints, track: Track) -> Waypoints:
    """Waypoints moved across the path, against the deviation of the track where each is passed.

    Those over ground keep their height over it.
    """
    passed, travelled, courses = waypoints.distances_m[:-1], part.travelled_m, np.unwrap(part.courses_rad)
    places = np.column_stack([np.interp(passed, travelled, part.positions_enu_m[:, k]) for k in range(2)])
    at = np.interp(passed, travelled, courses)
    right = np.column_stack([np.cos(at), -np.sin(at)])
    away = track.positions_enu_m[None, :, :2] - places[:, None]
    nearest = away[np.arange(len(passed)), (away**2).sum(axis=2).argmin(axis=1)]
    moved = waypoints.positions_enu_m.copy()
    moved[:-1, :2] -= GAIN * (nearest * right).sum(axis=1)[:, None] * right
    if waypoints.ground is not None:
        moved[:, 2] += waypoints.ground.up_m(moved) - waypoints.ground.up_m(waypoints.positions_enu_m)
    return replace(waypoints, positions_enu_m=moved)


def _airspeed_again(state: FlightState, part: Path, waypoints: Waypoints) -> int:
    """The last waypoint at which a late aircraft may join a mission that changes the airspeed; 0 for none."""
    cruise = state.rules.vehicle.airspeed_cruise_m_s
    if max(float(part.speeds_m_s[0]) - SLOWED_M_S, waypoints.airspeed_m_s - FASTER_M_S) <= cruise:
        return 0
    near = np.flatnonzero(waypoints.distances_m <= float(waypoints.distances_m[:3][-1]) + LATE_ENTRY_MAX_M)
    return int(near[-1])


def _actions_along(state: FlightState, part: Path) -> list[tuple[float, Actions]]:
    """The operator's DO_ items of goals that a part of a path reaches, and how far along they are [m]."""
    found: list[tuple[float, Actions]] = []
    row = 0
    for goal, items in zip(state.goals[state.next_goal :], state.actions[state.next_goal :], strict=False):
        away = np.linalg.norm(part.positions_enu_m[row:] - np.asarray(goal.position_enu_m), axis=1)
        if not away.min() <= goal.acceptance_radius_m:
            break
        row += int(np.argmin(away))
        if items:
            found.append((float(part.travelled_m[row]), items))
    return found


def _actions_at(
    actions: Sequence[tuple[float, Actions]], waypoints: Waypoints
) -> tuple[tuple[int, Actions], ...]:
    """The operator's items by the number of the waypoint at which they are carried out, the nearest."""
    found: dict[int, Actions] = {}
    for length, items in actions:
        number = int(np.argmin(np.abs(waypoints.distances_m - length)))
        found[number] = found.get(number, ()) + items
    return tuple(sorted(found.items()))
