"""One planning cycle without its waiting: whether a plan is of use, and what is done where none passes.

Synchronous and without a clock, so that a replay decides the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.assurance.emergency import EmergencyOptions, EmergencyStep
from companion.assurance.violation import Violation, keeps_hard_constraints
from companion.flight.state.decision import (
    SwapDecision,
    Verdict,
    carried_min_s,
    carried_s,
    gain_of,
    judge,
)
from companion.flight.state.fallback import Response, flown_violations, respond, respond_by_rally_point
from companion.flight.state.flight_state import FlightState
from companion.flight.state.mission_construction import Candidate, ConstructedMission, construct
from companion.flight.state.progress import Start, is_on_last_leg, lead_s, problem_at
from companion.mission.waypoints import mission_part
from companion.planning.problem import GoalRegion
from companion.planning.route import reassessed
from companion.types.path import Path, slowed_path
from companion.types.plan import Plan
from companion.types.state import Ownship
from companion.world.snapshot import Snapshot

AS_GOOD = "what is flown costs no more"
RALLY_POINTS_TRIED = 2  # each is a plan, while nothing that passes is flown


@dataclass(frozen=True, slots=True)
class Conclusion:
    """What a plan comes to.

    Parameters
    ----------
    decision : SwapDecision
        What is said of it.
    shaped : ConstructedMission or None
        What is to be handed over; None where nothing is.
    is_unflyable : bool
        Whether it would be flown, but no mission can fly it.
    """

    decision: SwapDecision
    shaped: ConstructedMission | None = None
    is_unflyable: bool = False


@dataclass(frozen=True, slots=True)
class EmergencyConclusion:
    """The step to take where no plan passes, why, and what is to be handed over for it, if anything."""

    step: EmergencyStep
    reason: str
    options: EmergencyOptions
    shaped: ConstructedMission | None


def is_over(state: FlightState, ownship: Ownship) -> bool:
    """Whether the flown path ends before a plan begun now could be of use."""
    return is_on_last_leg(state, ownship, lead_s(state))


def flown_passes(state: FlightState, start: Start) -> bool:
    """Whether something of ours is flown, and the rest of it passes the check."""
    return flown_violations(state, start) == ()


def conclude(state: FlightState, plan: Plan, start: Start, snapshot: Snapshot) -> Conclusion:
    """Judge a plan, and make its mission if it is to be flown.

    A plan that a mission can only fly slower is judged once more, because it is later everywhere.

    Parameters
    ----------
    state : FlightState
        Goals and rules.
    plan : Plan
        The planner's answer.
    start : Start
        Where it begins.
    snapshot : Snapshot
        The world that it was made in.
    """
    decision = judge(state, plan, start)
    if not decision.verdict.is_swap or plan.path is None:
        return Conclusion(decision)
    paths = [(plan.path, plan.cost)]
    if decision.verdict is Verdict.EXTEND and decision.holds_flown and start.rest is not None:
        paths.insert(0, (start.rest, plan.flown_cost or plan.cost))
    (path, cost), found = _first_flyable(state, paths)
    if found.violations:
        refused = SwapDecision(Verdict.REJECTED, f"mission: {found.violations[0]}", decision.why)
        return Conclusion(refused, is_unflyable=True)
    waypoints, covered_until_s = found.waypoints, found.covered_until_s
    slower = slowed_path(path, waypoints.airspeed_m_s)
    if slower is not path:
        covered_until_s = float(slower.times_s[np.searchsorted(path.times_s, covered_until_s)])
        path, risk = reassessed(problem_at(state, start, snapshot), slower)
        decision = judge(state, replace(plan, path=path, pursuit=risk), start)
        if not decision.verdict.is_swap:
            return Conclusion(decision)
    part = mission_part(waypoints, state.mission.frame, state.rules.vehicle.airspeed_cruise_m_s)
    shaped = ConstructedMission(
        path, waypoints, part, covered_until_s, start, decision.verdict, decision.text, decision.why, cost
    )
    return Conclusion(decision, shaped)


def _first_flyable(
    state: FlightState, paths: Sequence[tuple[Path, float]]
) -> tuple[tuple[Path, float], Candidate]:
    """The first of some paths with their costs that a mission can fly, else the last; and its mission."""
    for wanted in paths:
        found = construct(state, wanted[0], state.mission_list.max_waypoints)
        if not found.violations:
            break
    return wanted, found


def conclude_either(
    state: FlightState, plan: Plan, start: Start, snapshot: Snapshot, *, least_gain: float
) -> tuple[Conclusion, EmergencyConclusion | None]:
    """What a plan comes to; and as an emergency plan, where it breaks limits of threat or quality alone.

    Where the flown path passes the check, no emergency plan is wanted.

    Parameters
    ----------
    state : FlightState
        What is flown, and by which rules.
    plan : Plan
        The planner's answer.
    start : Start
        Where it begins.
    snapshot : Snapshot
        The world that it was made in.
    least_gain : float
        As in :func:`conclude_emergency`.
    """
    found = conclude(state, plan, start, snapshot)
    if not found.decision.is_flyable_anyway or flown_passes(state, start):
        return found, None
    return found, conclude_emergency(state, plan, None, start, None, least_gain=least_gain)


def conclude_emergency(
    state: FlightState,
    least_threat: Plan,
    refused: Path | None,
    start: Start,
    return_path: tuple[Violation, ...] | None,
    *,
    least_gain: float = 0.0,
) -> EmergencyConclusion:
    """Choose the step of the emergency strategy, and shape what is to be flown by it.

    Parameters
    ----------
    state : FlightState
        What is flown, and by which rules.
    least_threat : Plan
        The plan that weighs threats most.
    refused : Path or None
        A plan's path that did not pass.
    start : Start
        From where a new mission would be flown.
    return_path : tuple of Violation or None
        What the way home breaks; None where that is not known.
    least_gain : float
        A flown path that keeps the hard constraints is kept unless the new one costs less by this share.
    """
    response = respond(
        state, start, least_threat, (refused,), state.mission_list.max_waypoints,
        may_return=state.mission.authority.allow_rtl, return_path=return_path,
    )  # fmt: skip
    decision, route = response.decision, response.route
    is_way_on = route is not None and decision.step is EmergencyStep.LEAST_THREAT
    if is_way_on and _flown_is_as_good(state, start, least_threat, response.options, least_gain):
        return EmergencyConclusion(decision.step, AS_GOOD, response.options, None)
    return _shaped(state, start, response, least_threat.cost)


def _flown_is_as_good(
    state: FlightState, start: Start, plan: Plan, options: EmergencyOptions, least_gain: float
) -> bool:
    """Whether what is flown leads as far, and costs hardly more than a least-threat plan.

    A mission handed over for nothing is an exchange in the way of the next surprise.
    """
    if start.rest is None or plan.flown_cost is None or not state.flies_to_goal:
        return False
    if options.flown is None or not keeps_hard_constraints(options.flown):
        return False
    return carried_s(state, start) >= carried_min_s(state) and gain_of(plan) <= least_gain


def conclude_rally(
    state: FlightState, found: EmergencyConclusion, plan: Plan, place: GoalRegion, start: Start
) -> EmergencyConclusion:
    """Choose the step anew once a plan to a rally point was made, and shape what is to be flown by it."""
    response = respond_by_rally_point(state, found.options, plan, place, state.mission_list.max_waypoints)
    return _shaped(state, start, response, plan.cost)


def rally_points_near(state: FlightState, start: Start) -> list[GoalRegion]:
    """The rally points that are worth a plan, the nearest first."""
    here = start.state.position_enu_m
    nearest = sorted(state.rally_points, key=lambda place: math.dist(place[:2], here[:2]))
    return [state.region_at(place) for place in nearest[:RALLY_POINTS_TRIED]]


def _shaped(state: FlightState, start: Start, response: Response, cost: float) -> EmergencyConclusion:
    """What a response comes to as a mission."""
    step, reason = response.decision
    route = response.route
    if route is None:
        return EmergencyConclusion(step, reason, response.options, None)
    part = mission_part(route.waypoints, state.mission.frame, state.rules.vehicle.airspeed_cruise_m_s)
    shaped = ConstructedMission(
        route.path, route.waypoints, part, route.covered_until_s, start, Verdict.EMERGENCY, step.value, {},
        cost,
    )  # fmt: skip
    return EmergencyConclusion(step, reason, response.options, shaped)
