"""The mission to fly when no plan passes: the candidates of the emergency strategy, and the step they allow.

Synchronous and without a clock. The caller carries the step out and announces it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from companion.assurance.emergency import (
    EmergencyDecision,
    EmergencyOptions,
    EmergencyStep,
    emergency_decision,
)
from companion.assurance.violation import Violation, keeps_hard_constraints
from companion.flight.construction.mission_construction import construct, construct_until
from companion.flight.state.flight_state import FlightState
from companion.flight.state.progress import Start, violations_of_rest
from companion.frames import course_from_direction
from companion.mission.waypoints import Waypoints
from companion.planning.problem import GoalRegion, StartState, rows_at_goals
from companion.types.path import Path, straight_path
from companion.types.plan import Plan

STRAIGHT_ROWS = 24  # If no plan leads anywhere, this many rows of straight flight are tried.
LOITER_ROW_MIN = 4  # A loiter is at least this many rows after the start.
LOITER_ROW_STEP = 2  # A loiter is tried at every second row.
ROW_S = 1.0  # Rows of straight flight are this far apart in time.
SAME_THREAT_MAX = 0.1  # A path whose threat level is higher by no more than this counts as equally safe.


@dataclass(frozen=True, slots=True)
class FallbackMission:
    """A path, its waypoints, and the path's time at the last of them [s]."""

    path: Path
    waypoints: Waypoints
    covered_until_s: float


@dataclass(frozen=True, slots=True)
class Response:
    """A step, its reason, the options from which it was chosen, and the mission that carries it out."""

    decision: EmergencyDecision
    options: EmergencyOptions
    route: FallbackMission | None


def flown_violations(state: FlightState, start: Start) -> tuple[Violation, ...] | None:
    """Return the violations of the rest of the flown path; None if the service's missions are not flown.

    A safe loiter is judged by its path and circle, since it does not lead to the goal.
    """
    if state.flown is None:
        return None
    if state.flies_to_goal:
        return None if start.rest is None else violations_of_rest(state, start.rest)
    return construct_until(state, state.flown.path, len(state.flown.path) - 1).violations


def respond(
    state: FlightState,
    start: Start,
    least_threat: Plan,
    failed: Sequence[Path | None],
    max_waypoints: int,
    *,
    may_return: bool,
    return_path: tuple[Violation, ...] | None = None,
) -> Response:
    """Choose the step, and the mission that carries it out.

    Parameters
    ----------
    state : FlightState
        The flown mission and the rules.
    start : Start
        The start of a new mission.
    least_threat : Plan
        The plan that weighs threats most and has no limit of the threat level.
    failed : sequence of Path or None
        Other paths along which a safe loiter may lie: refused ones, or from other starts.
    max_waypoints : int
        Largest number of waypoints of a mission.
    may_return : bool
        Whether the mission file allows return to launch.
    return_path : tuple of Violation or None
        Violations of the return path; None if it is not known.
    """
    straight_on, by_threat = _least_threat(state, least_threat, max_waypoints)
    loiter, by_loiter = _safe_loiter(state, start, (least_threat.path, *failed), max_waypoints)
    options = EmergencyOptions(
        flown=flown_violations(state, start), least_threat=by_threat, loiter=by_loiter,
        may_return=may_return, return_path=return_path,
    )  # fmt: skip
    decision = emergency_decision(options)
    if decision.step is EmergencyStep.LOITER and loiter is not None:
        decision = decision._replace(reason=decision.reason + _goals_before(state, loiter.path))
    by_step = {EmergencyStep.LEAST_THREAT: straight_on, EmergencyStep.LOITER: loiter}
    return Response(decision, options, by_step.get(decision.step))


def respond_by_rally_point(
    state: FlightState, options: EmergencyOptions, plan: Plan, place: GoalRegion, max_waypoints: int
) -> Response:
    """Choose the step again after a plan to a rally point was made.

    Parameters
    ----------
    state : FlightState
        The rules.
    options : EmergencyOptions
        The options without the rally point.
    plan : Plan
        The plan to the rally point.
    place : GoalRegion
        The rally point.
    max_waypoints : int
        Largest number of waypoints of a mission.
    """
    route = None
    if plan.path is not None and plan.reaches_goal:
        found = construct(state, plan.path, max_waypoints, is_whole=True)
        on_path = state.violations_to(place, plan.path)
        route = FallbackMission(plan.path, found.waypoints, found.covered_until_s)
        options = replace(options, rally=(*on_path, *found.violations))
    decision = emergency_decision(options)
    return Response(decision, options, route if decision.step is EmergencyStep.RALLY_POINT else None)


def _least_threat(
    state: FlightState, plan: Plan, max_waypoints: int
) -> tuple[FallbackMission | None, tuple[Violation, ...] | None]:
    """Return the least-threat plan as a mission, and its violations; None if it does not reach the goal."""
    if plan.path is None or not plan.reaches_goal:
        return None, None
    found = construct(state, plan.path, max_waypoints)
    route = FallbackMission(plan.path, found.waypoints, found.covered_until_s)
    return route, (*state.violations_of(plan.path), *found.violations)


def _safe_loiter(
    state: FlightState, start: Start, paths: Sequence[Path | None], max_waypoints: int
) -> tuple[FallbackMission | None, tuple[Violation, ...] | None]:
    """Return the reachable safe loiter with the least threat, and its violations.

    Candidates lie along paths that begin at the start, as far as these keep the hard constraints, and
    straight ahead. If none passes, the result is the violations of the first one tried.
    """
    wrong: tuple[Violation, ...] | None = None
    for path, row, *_ in _loiter_candidates(state, start, paths):
        found = construct_until(state, path, row)
        if not found.violations and len(found.waypoints.positions_enu_m) <= max_waypoints:
            return FallbackMission(path.until(row), found.waypoints, found.covered_until_s), ()
        wrong = wrong or found.violations
    return None, wrong


class _LoiterCandidate(NamedTuple):
    """A row of a path as a loiter: its threat level, the highest one before it, and the goals before it."""

    path: Path
    row: int
    level: float
    highest: float
    num_goals: int


def _goals_before(state: FlightState, path: Path) -> str:
    """Return in words how many goals are passed on the way to a loiter; '' if none is."""
    passed = len(rows_at_goals(path.positions_enu_m, state.goals_left))
    return f", behind {passed} of {len(state.goals_left)} goals" if passed else ""


def _loiter_candidates(
    state: FlightState, start: Start, paths: Sequence[Path | None]
) -> list[_LoiterCandidate]:
    """Return all candidates, the preferred one first.

    Candidates that pass goals come first, those with most goals leading, if the path to them is about as safe
    as the safest candidate. The others follow in order of threat level, then of distance.
    """
    begin = np.asarray(start.state.position_enu_m)
    candidates: list[_LoiterCandidate] = []
    for path in (*paths, straight_ahead(start.state, state.wind_enu_m_s)):
        if (
            path is None
            or len(path) <= LOITER_ROW_MIN
            or np.linalg.norm(path.positions_enu_m[0] - begin) > 1.0
        ):
            continue
        found = state.violations_to(None, path)
        hard = [entry.row for entry in found if not keeps_hard_constraints([entry])]
        last = min([len(path) - 1, *(row - 1 for row in hard)])
        candidates += _candidates_along(path, last, rows_at_goals(path.positions_enu_m, state.goals_left))
    safe = min((place.level for place in candidates), default=0.0) + SAME_THREAT_MAX

    def order(place: _LoiterCandidate) -> tuple[int, float, int]:
        return -place.num_goals if place.highest <= safe else 0, place.level, place.row

    return sorted(candidates, key=order)


def _candidates_along(path: Path, last: int, at_goals: Sequence[int]) -> Iterator[_LoiterCandidate]:
    """Yield candidates along a path up to row ``last``, also right after the goals ``at_goals``."""
    highest = np.maximum.accumulate(path.threat_levels)
    rows = {*range(LOITER_ROW_MIN, last + 1, LOITER_ROW_STEP), *(row + 1 for row in at_goals if row < last)}
    for row in sorted(rows):
        num_goals = sum(at < row for at in at_goals)
        yield _LoiterCandidate(path, row, float(path.threat_levels[row]), float(highest[row]), num_goals)


def straight_ahead(state: StartState, wind_enu_m_s: tuple[float, float]) -> Path:
    """Return level, straight flight from a start at its airspeed, with unknown threats."""
    return straight_path(
        ROW_S * np.arange(STRAIGHT_ROWS + 1.0), state.stamp_s, np.asarray(state.position_enu_m),
        course_from_direction(state.direction_rad), state.airspeed_m_s,
        covariance_m2=state.error_covariance[:3, :3],
        threat_level=1.0,  # The threat is not known, so that every place with a known one is preferred.
        wind_enu_m_s=wind_enu_m_s,
    )  # fmt: skip
