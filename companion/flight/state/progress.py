"""The aircraft's progress on its flown path, and the start of a plan that takes effect later."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.assurance.violation import Violation, keeps_hard_constraints
from companion.config.rules import Rules
from companion.flight.state.flight_state import SEARCH_ROWS, FlightState
from companion.frames import direction_from_course
from companion.mission.path_progress import progress_on, rest_of_path, time_at
from companion.planning.problem import GoalRegion, Problem, StartState, initial_covariances, rows_at_goals
from companion.planning.route import reassessed
from companion.tracking.ownship import predicted
from companion.types.path import Path
from companion.types.plan import PursuitRisk
from companion.types.state import Ownship
from companion.world.snapshot import Snapshot

OFF_TRACK_MAX_M = 80.0  # An aircraft farther from the flown path is off it.
OFF_HEIGHT_MAX_M = 25.0  # So is an aircraft that is this far above or below it.
LAST_LEG_S = 10.0  # A new plan is useless if less than this is left of the flown path when it takes effect.
# Largest budget and exchange margin of a plan that answers a surprise.
URGENT_BUDGET_S, URGENT_MARGIN_S = 0.2, 0.3
# A team is asked again every second. Of the members that have not answered, more than half do so each time
# even if one message in five is lost.
ASKED_EACH_S = 1.0


@dataclass(frozen=True, slots=True)
class Start:
    """The start of a plan, the rest of the flown path from there (None if off it), and the rest's risk."""

    state: StartState
    rest: Path | None
    risk: PursuitRisk | None = None


def budget_s(rules: Rules, *, is_urgent: bool = False) -> float:
    """Return the time that a plan may take [s]; a plan that answers a surprise takes less."""
    budget = float(rules.mission.planning.planning_budget_s)
    return min(budget, URGENT_BUDGET_S) if is_urgent else budget


def lead_s(state: FlightState, *, is_urgent: bool = False) -> float:
    """Return the time until a plan begun now is flown: planning, exchange with the autopilot, margin [s]."""
    margin = float(state.mission.planning.swap_margin_s)
    if is_urgent:
        margin = min(margin, URGENT_MARGIN_S)
    team = state.mission.team
    asking_s = 0.0 if team is None else ASKED_EACH_S * (1.0 + math.log2(len(team.members)))
    return budget_s(state.rules, is_urgent=is_urgent) + margin + state.mission_list.exchange_s + asking_s


def as_of_now(state: FlightState, start: Start, snapshot: Snapshot) -> Start:
    """Return the start with the rest of the flown path reassessed in the present world.

    Once the last goal is reached there is nothing to assess it for.

    Parameters
    ----------
    state : FlightState
        Goals and rules.
    start : Start
        The start of a plan.
    snapshot : Snapshot
        The present world.
    """
    if start.rest is None or not state.goals_left:
        return start
    rest, risk = reassessed(problem_at(state, start, snapshot), start.rest)
    return replace(start, rest=rest, risk=risk)


def problem_at(state: FlightState, start: Start, snapshot: Snapshot) -> Problem:
    """Return the planning problem from a start in the world of a snapshot."""
    rules = state.rules
    return Problem(start.state, state.goals_left, snapshot, rules.vehicle, rules.settings, seed=0)


def is_on_last_leg(state: FlightState, ownship: Ownship, ahead_s: float) -> bool:
    """Return whether the flown path ends before a new plan, flown in ``ahead_s`` [s], could be of use.

    A path that does not pass a goal on the way, for example one that was won meanwhile, has to be replaced.
    """
    flown = state.flown
    if flown is None or not state.flies_to_goal or flown.covered_until_s < flown.path.times_s[-1]:
        return False
    if _missed_on_the_way(state):
        return False
    progress = progress_on(flown.path, ownship.position_enu_m, flown.row, SEARCH_ROWS)
    left = float(flown.path.times_s[-1]) - time_at(flown.path, progress)
    return progress.off_track_m <= OFF_TRACK_MAX_M and left < ahead_s + LAST_LEG_S


def start_after(state: FlightState, ownship: Ownship, ahead_s: float) -> Start:
    """Return where the aircraft will be in ``ahead_s`` [s]: on the flown path, or by its own motion."""
    rest = _rest_after(state, ownship, ahead_s)
    if rest is not None:
        east, north, up = (float(value) for value in rest.positions_enu_m[0])
        begin = start_at(
            state.rules,
            ownship,
            float(rest.times_s[0]),
            (east, north, up),
            course_rad=float(rest.courses_rad[0]),
            climb_rad=float(rest.climb_angles_rad[0]),
            airspeed_m_s=float(rest.speeds_m_s[0]),
        )
        return replace(begin, rest=rest)
    return start_by_motion(state.rules, ownship, ahead_s)


def start_by_motion(rules: Rules, ownship: Ownship, ahead_s: float) -> Start:
    """Return where the aircraft will be in ``ahead_s`` [s] if it continues to turn and climb as now."""
    ahead = predicted(ownship, ahead_s)
    return start_at(
        rules,
        ownship,
        ownship.stamp_s + ahead_s,
        ahead.position_enu_m,
        course_rad=ahead.course_rad,
        climb_rad=ahead.flight_path_angle_rad,
        airspeed_m_s=ownship.airspeed_m_s,
    )


def _rest_after(state: FlightState, ownship: Ownship, ahead_s: float) -> Path | None:
    """Return the rest of the flown path in ``ahead_s`` [s]; None off the path or near its end."""
    if state.flown is None:
        return None
    path = state.flown.path
    progress = progress_on(path, ownship.position_enu_m, state.flown.row, SEARCH_ROWS)
    here, after = path.positions_enu_m[progress.row], path.positions_enu_m[progress.row + 1]
    height_m = float(here[2] + progress.share * (after[2] - here[2]))
    off_m = abs(ownship.position_enu_m[2] - height_m) if state.mission.dimension == 3 else 0.0
    if progress.off_track_m > OFF_TRACK_MAX_M or off_m > OFF_HEIGHT_MAX_M:
        return None
    share = ownship.ground_speed_m_s / max(float(path.speeds_m_s[progress.row]), 1.0)
    return rest_of_path(path, time_at(path, progress) + ahead_s * share, ownship.stamp_s + ahead_s)


def start_at(
    rules: Rules,
    ownship: Ownship,
    stamp_s: float,
    position: tuple[float, float, float],
    *,
    course_rad: float,
    climb_rad: float,
    airspeed_m_s: float,
) -> Start:
    """Return a start within the aircraft's limits, off every path; in the plane, at the mission's level.

    Parameters
    ----------
    rules : Rules
        Mission file and vehicle.
    ownship : Ownship
        The aircraft now, for the uncertainty of its position.
    stamp_s : float
        When the aircraft is there, by the clock [s].
    position : tuple of float
        East, north, up [m].
    course_rad, climb_rad : float
        Course and climb angle over the ground [rad].
    airspeed_m_s : float
        True airspeed [m/s].
    """
    vehicle = rules.vehicle
    if rules.mission.dimension == 2:
        position, climb_rad = (*position[:2], rules.level_m), 0.0
    climb = min(vehicle.climb_angle_max_rad, max(-vehicle.descent_angle_max_rad, climb_rad))
    begin = StartState(
        stamp_s=stamp_s,
        position_enu_m=position,
        direction_rad=direction_from_course(course_rad),
        climb_rad=climb,
        airspeed_m_s=min(vehicle.airspeed_max_m_s, max(vehicle.airspeed_min_m_s, airspeed_m_s)),
        error_covariance=initial_covariances(vehicle, *ownship.position_std_m),
        estimate_covariance=np.zeros((6, 6)),
    )
    return Start(begin, None)


def violations_of_rest(state: FlightState, rest: Path) -> tuple[Violation, ...]:
    """Return the violations of the rest of the flown path, which should also pass the goals left."""
    return (*state.violations_of(rest), *_missed_on_the_way(state))


def _missed_on_the_way(state: FlightState) -> tuple[Violation, ...]:
    """Return the first goal left before the last one that the rest of the flown path does not pass."""
    if state.flown is None:
        return ()
    rest = state.flown.path.since(state.flown.row)
    return missed_goal(rest, state.goals[state.next_goal : -1])


def missed_goal(path: Path, goals: Sequence[GoalRegion]) -> tuple[Violation, ...]:
    """Return the first of some goals that a path does not pass in their order; () if it passes all."""
    rows = rows_at_goals(path.positions_enu_m, goals)
    if len(rows) == len(goals):
        return ()
    goal, first = goals[len(rows)], max(rows, default=0)
    away = np.linalg.norm(path.positions_enu_m[first:] - np.asarray(goal.position_enu_m), axis=1)
    nearest = int(away.argmin())
    what = "distance to a goal on the way [m]"
    return (Violation("goal", first + nearest, float(away[nearest]), goal.acceptance_radius_m, what),)


def keeps_limits(state: FlightState, rest: Path) -> tuple[bool, bool]:
    """Return whether the rest of the flown path keeps all limits, and whether it keeps the hard ones."""
    found = violations_of_rest(state, rest)
    return not found, keeps_hard_constraints(found)
