"""The way from the circle at a mission's end to the operator's landing, for a PX4's return to launch.

With RTL_TYPE 2 a PX4 returns by its mission: it flies on from the current item to the landing, and a loiter
is a waypoint to it. Behind the circle at which the service's mission ends, the list therefore holds a path to
the landing that was planned and checked.

References
----------
PX4 1.17 ``RtlMissionFast::setActiveMissionItems``, ``RTL::setRtlTypeAndDestination``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from companion.flight.construction.loiter_circles import landing_circle
from companion.flight.construction.mission_construction import construct
from companion.flight.construction.mission_simulation import STEP_S, at_start, guidance_of
from companion.flight.construction.way_behind import SLOWEST_M_S
from companion.flight.state.flight_state import GOAL_RADIUS_M, FlightState
from companion.flight.state.goals_state import bound_for
from companion.flight.state.progress import start_at
from companion.frames import FloatArray
from companion.mission.waypoints import Waypoints, waypoints_from_path
from companion.planning.problem import GoalRegion, Problem
from companion.planning.solver import solve
from companion.types.path import Path
from companion.types.state import Ownship
from companion.world.snapshot import Snapshot
from companion.world.vehicle.guidance import Track, track_of_circle, track_of_legs

BY_MISSION = 2.0  # RTL_TYPE.
DESCENT_S = 60.0  # The aircraft may circle down to the landing for this time.
ENTRY_OFFSET_RAD = math.radians(25.0)  # The course at the landing's circle may differ by this much.
LEFT_OUT_MAX = 2  # At most this many of the last waypoints are left out.
LENGTH_MAX = 80  # Most items of a way on.
# The course over the circle's centre, relative to the one from the mission's end: a plan is made for each,
# until one keeps clear as it is flown.
TURNS_RAD = tuple(math.radians(turn) for turn in (0.0, 60.0, -60.0, 120.0, -120.0, 180.0))
ITERATIONS_MAX = 4_000  # A plan takes no longer than a few of the usual ones.


def way_on(
    state: FlightState, path: Path, waypoints: Waypoints, covered_until_s: float, snapshot: Snapshot
) -> FloatArray | None:
    """Return the waypoints of the way on: those that keep clear, else those that keep clear for longest.

    A landing may itself be too near to something; the way to it need not be.

    Parameters
    ----------
    state : FlightState
        The autopilot's parameters, the operator's landing, and the rules.
    path : Path
        The planned path.
    waypoints : Waypoints
        The mission made of it.
    covered_until_s : float
        The path's time at the mission's end [s].
    snapshot : Snapshot
        The world.

    Returns
    -------
    ndarray, shape (N, 3), or None
        East, north, up [m]; None if none is needed, or none is better than the straight way.
    """
    is_wanted = not state.flies_by and state.settings.return_kind == BY_MISSION
    if not is_wanted or state.tail_enu_m is None or waypoints.continues_with_operator_items:
        return None
    ends = at_start(path.since(int(np.searchsorted(path.times_s, covered_until_s))), state.wind_enu_m_s)
    centre, _ = waypoints.circle
    landing = landing_region(state, state.tail_enu_m)
    tried = list[tuple[float, FloatArray]]()
    for turn_rad in TURNS_RAD:
        home = _path_to(state, landing, _over(ends, centre, turn_rad), snapshot)
        if home is None:
            continue
        for points in _as_waypoints(state, home, landing):
            clear_s = _clear_s(state, ends, np.vstack([centre, points]))
            if math.isinf(clear_s):
                return points
            tried.append((clear_s, points))
    longest_s, best = max(tried, key=lambda each: each[0], default=(0.0, None))
    return best if longest_s > _clear_s(state, ends, np.array([centre])) else None


def _as_waypoints(state: FlightState, home: Path, landing: GoalRegion) -> Iterator[FloatArray]:
    """Yield the waypoints (N, 3) [m] of a path to the landing, corrected for the guidance and as they are.

    The last ones are also left out, because they may lie beyond the landing.
    """
    corrected = construct(bound_for(state, landing), home, LENGTH_MAX, is_whole=True)
    airspeed, slope_min = corrected.waypoints.airspeed_m_s, guidance_of(state).slope_min
    made = [waypoints_from_path(home, airspeed, flies_by=False, slope_min=slope_min).positions_enu_m]
    if not corrected.violations and corrected.covered_until_s >= float(home.times_s[-1]):
        made.insert(0, corrected.waypoints.positions_enu_m)
    for points, num_left_out in product(made, range(LEFT_OUT_MAX + 1)):
        if num_left_out < len(points) <= LENGTH_MAX + num_left_out:
            yield points[: len(points) - num_left_out]


def landing_region(state: FlightState, tail_enu_m: tuple[float, float, float]) -> GoalRegion:
    """Return the place within the bounds that is nearest to the operator's landing, as a goal.

    Parameters
    ----------
    state : FlightState
        The bounds.
    tail_enu_m : tuple of float
        Where the operator's landing begins: east, north, up [m].
    """
    bounds = np.asarray(state.rules.checker.limits.bounds, dtype=np.float64).reshape(3, 2)
    inset = np.minimum([[GOAL_RADIUS_M], [GOAL_RADIUS_M], [0.0]], 0.5 * np.ptp(bounds, axis=1, keepdims=True))
    east, north, up = np.clip(tail_enu_m, bounds[:, 0] + inset[:, 0], bounds[:, 1] - inset[:, 0])
    return state.region_at((float(east), float(north), float(up)))


def _over(ends: Ownship, centre: FloatArray, turn_rad: float) -> Ownship:
    """Return the aircraft over ``centre`` (3,) [m] of a circle, turned from its course to there."""
    east, north = centre[0] - ends.position_enu_m[0], centre[1] - ends.position_enu_m[1]
    place = (float(centre[0]), float(centre[1]), float(centre[2]))
    course = (math.atan2(east, north) + turn_rad) % (2.0 * math.pi)
    return replace(ends, position_enu_m=place, course_rad=course)


def _path_to(state: FlightState, landing: GoalRegion, ends: Ownship, snapshot: Snapshot) -> Path | None:
    """Return a path from the mission's end to the operator's landing; None if there is none.

    It is flown at an unknown time, if ever, so that moving threats are left out: nobody knows where they are
    then.
    """
    start = start_at(
        state.rules, ends, ends.stamp_s, ends.position_enu_m, course_rad=ends.course_rad, climb_rad=0.0,
        airspeed_m_s=ends.airspeed_m_s,
    ).state  # fmt: skip
    settings = replace(
        state.rules.least_threat_settings,
        max_iterations=min(state.rules.least_threat_settings.max_iterations, ITERATIONS_MAX),
        optimise_iterations_max=state.rules.least_threat_settings.optimise_iterations,
    )
    world = snapshot.with_tracks(snapshot.stamp_s, ())
    problem = Problem(start, (landing,), world, state.rules.vehicle, settings, seed=0)
    plan = solve(problem, lambda: False)
    if plan.path is None or not plan.reaches_goal:
        return None
    return plan.path


def _clear_s(state: FlightState, ends: Ownship, legs: FloatArray) -> float:
    """Return for how long the flight over ``legs`` (N, 3) [m] and to the landing keeps clear [s].

    It ends in the circle with which the landing begins, or at its first item. In a return the aircraft flies
    at the mission's airspeed or at cruise. It is infinite if it keeps clear to its end, 0 if it does not end.
    """
    cruise_m_s = state.rules.vehicle.airspeed_cruise_m_s
    slower = replace(
        ends,
        airspeed_m_s=cruise_m_s,
        ground_speed_m_s=max(ends.ground_speed_m_s + cruise_m_s - ends.airspeed_m_s, SLOWEST_M_S),
    )
    checker, clear_s = state.rules.checker, math.inf
    for begun in (ends,) if slower == ends else (ends, slower):
        tracks = _tracks_over(state, begun, legs)
        if not tracks:
            return 0.0
        for number, places in enumerate(tracks):
            found = checker.check_track(places, checker.limits.margin_m)
            near = (entry.row for entry in found if entry.rule == "clearance")
            before = len(tracks[0]) if number else 0
            clear_s = min(clear_s, STEP_S * (before + min(near, default=math.inf)))
    return clear_s


def _tracks_over(state: FlightState, begun: Ownship, legs: FloatArray) -> list[FloatArray]:
    """Return positions (K, 3) [m] over ``legs`` (N, 3) [m] to the landing, and on each way onto its circle.

    The list is empty if the aircraft circles round a place that it does not reach.
    """
    tail, circle = state.tail_enu_m, landing_circle(state)
    whole = legs if tail is None else np.vstack([legs, tail])
    length_m = float(np.linalg.norm(np.diff(whole, axis=0), axis=1).sum())
    speed = max(begun.airspeed_m_s - float(np.hypot(*state.wind_enu_m_s)), SLOWEST_M_S)
    targets = whole if circle is None else legs
    ends_s = 1.3 * length_m / speed + DESCENT_S
    track = track_of_legs(guidance_of(state), begun, targets, ends_s=ends_s, step_s=STEP_S)
    is_flown = track.reached < len(targets)
    if is_flown.all():
        return []
    flown = track.until(int(np.argmin(is_flown)))
    onto = () if circle is None else _onto_circle(state, begun, flown, circle)
    return [flown.positions_enu_m, *onto]


def _onto_circle(
    state: FlightState, begun: Ownship, flown: Track, circle: tuple[tuple[float, float, float], float]
) -> Iterator[FloatArray]:
    """Yield positions (K, 3) [m] on the ways onto the circle of a landing, from the end of a track.

    Near its centre small differences decide by which side the aircraft joins it.
    """
    at_end = flown.aircraft_at(len(flown) - 1, begun)
    for offset in (0.0, -ENTRY_OFFSET_RAD, ENTRY_OFFSET_RAD):
        turned = replace(at_end, course_rad=(at_end.course_rad + offset) % (2.0 * math.pi))
        yield track_of_circle(
            guidance_of(state), turned, np.asarray(circle[0]), circle[1], ends_s=DESCENT_S, step_s=STEP_S
        ).positions_enu_m
