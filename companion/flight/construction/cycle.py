"""One planning cycle without its waiting: judge a plan, and choose an emergency step if none passes.

Synchronous and without a clock, so that a replay decides the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.assurance.emergency import EmergencyOptions, EmergencyStep
from companion.assurance.violation import Violation, keeps_hard_constraints
from companion.flight.construction.fallback import Response, flown_violations, respond, respond_by_rally_point
from companion.flight.construction.mission_construction import (
    WAY_TAKEN,
    Candidate,
    ConstructedMission,
    construct,
)
from companion.flight.construction.way_on import way_on
from companion.flight.state.decision import (
    SwapDecision,
    Verdict,
    covered_min_s,
    covered_s,
    field_facts,
    gain_of,
    judge,
)
from companion.flight.state.flight_state import FlightState
from companion.flight.state.progress import Start, is_on_last_leg, lead_s, problem_at
from companion.mission.waypoints import mission_part
from companion.planning.problem import GoalRegion
from companion.planning.route import reassessed
from companion.types.path import Path, slowed_path
from companion.types.plan import Plan
from companion.types.state import Ownship
from companion.world.snapshot import Snapshot

FLOWN_COSTS_NO_MORE = "what is flown costs no more"  # The recorded reason for keeping the flown mission.
RALLY_POINTS_TRIED = 2  # Each rally point needs a plan, while the flown path does not pass.


@dataclass(frozen=True, slots=True)
class Conclusion:
    """The result of a plan.

    Parameters
    ----------
    decision : SwapDecision
        The judgement of the plan.
    constructed : ConstructedMission or None
        The mission to be handed over; None if there is none.
    is_unflyable : bool
        Whether the plan would be flown, but no mission can fly it.
    is_waiting : bool
        Whether the aircraft waits before the goal until the way on behind it is free.
    """

    decision: SwapDecision
    constructed: ConstructedMission | None = None
    is_unflyable: bool = False
    is_waiting: bool = False


@dataclass(frozen=True, slots=True)
class EmergencyConclusion:
    """The emergency step, its reason, its options, and the mission to be handed over for it, if any."""

    step: EmergencyStep
    reason: str
    options: EmergencyOptions
    constructed: ConstructedMission | None


def is_over(state: FlightState, ownship: Ownship) -> bool:
    """Return whether the flown path ends before a plan begun now could be of use."""
    return is_on_last_leg(state, ownship, lead_s(state))


def ends_within(state: FlightState, after_s: float) -> bool:
    """Return whether the flown mission ends less than a time [s] after a plan begun now takes effect."""
    flown = state.flown if state.may_act else None
    return flown is not None and flown.covered_s(flown.row) < lead_s(state) + after_s


def flown_passes(state: FlightState, start: Start) -> bool:
    """Return whether a path of the service is flown, and its rest passes the check."""
    return flown_violations(state, start) == ()


def conclude(state: FlightState, plan: Plan, start: Start, snapshot: Snapshot) -> Conclusion:
    """Judge a plan, and construct its mission if it is to be flown.

    A plan that a mission can only fly more slowly is judged again, because it is later everywhere. Where the
    aircraft has to wait before the goal, only the path to there is flown.

    Parameters
    ----------
    state : FlightState
        Goals and rules.
    plan : Plan
        The planner's answer.
    start : Start
        The start of the plan.
    snapshot : Snapshot
        The world of the plan.
    """
    decision = judge(state, plan, start)
    if not decision.verdict.is_swap or plan.path is None:
        return Conclusion(decision)
    paths = [(plan.path, plan.cost)]
    if decision.verdict is Verdict.EXTEND and decision.holds_flown and start.rest is not None:
        paths.insert(0, (start.rest, plan.flown_cost or plan.cost))
    (path, cost), found = _first_flyable(state, paths)
    if wrong := _wrong_with(state, found, start):
        refused = SwapDecision(Verdict.REJECTED, f"mission: {wrong[0]}", decision.why)
        return Conclusion(refused, is_unflyable=True, is_waiting=found.is_waiting)
    waypoints, covered_until_s = found.waypoints, found.covered_until_s
    slower = slowed_path(path, waypoints.airspeed_m_s)
    if slower is not path:
        covered_until_s = float(slower.times_s[np.searchsorted(path.times_s, covered_until_s)])
        path, risk = reassessed(problem_at(state, start, snapshot), slower)
        decision = judge(state, replace(plan, path=path, pursuit=risk), start)
        if not decision.verdict.is_swap:
            return Conclusion(decision)
    if found.is_waiting:
        path = path.until(int(np.searchsorted(path.times_s, covered_until_s)))
    part = mission_part(
        waypoints, state.mission.frame, state.rules.vehicle.airspeed_cruise_m_s,
        way_on(state, path, waypoints, covered_until_s, snapshot),
    )  # fmt: skip
    constructed = ConstructedMission(
        path, waypoints, part, covered_until_s, start, decision.verdict, decision.text, decision.why, cost
    )
    return Conclusion(decision, constructed, is_waiting=found.is_waiting)


def _wrong_with(state: FlightState, found: Candidate, start: Start) -> tuple[Violation, ...]:
    """Return why a mission is not flown; an aircraft that waits before the goal already keeps its circle."""
    if found.is_waiting and not state.flies_to_goal and flown_passes(state, start):
        return (WAY_TAKEN,)
    return found.violations


def _first_flyable(
    state: FlightState, paths: Sequence[tuple[Path, float]]
) -> tuple[tuple[Path, float], Candidate]:
    """Return the first path (with its cost) that a mission can fly, else the last, and its mission."""
    for wanted in paths:
        found = construct(state, wanted[0], state.mission_list.max_waypoints)
        if not found.violations:
            break
    return wanted, found


def conclude_either(
    state: FlightState, plan: Plan, start: Start, snapshot: Snapshot, *, least_gain: float
) -> tuple[Conclusion, EmergencyConclusion | None]:
    """Judge a plan; if it breaks only the limits of threat or quality, also as an emergency plan.

    No emergency plan is needed while the flown path passes the check.

    Parameters
    ----------
    state : FlightState
        The flown mission and the rules.
    plan : Plan
        The planner's answer.
    start : Start
        The start of the plan.
    snapshot : Snapshot
        The world of the plan.
    least_gain : float
        Same as in :func:`conclude_emergency`.
    """
    found = conclude(state, plan, start, snapshot)
    if not found.decision.is_flyable_in_emergency or flown_passes(state, start):
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
    """Choose the emergency step, and construct the mission that carries it out.

    Parameters
    ----------
    state : FlightState
        The flown mission and the rules.
    least_threat : Plan
        The plan that weighs threats most.
    refused : Path or None
        The path of a plan that did not pass.
    start : Start
        The start of a new mission.
    return_path : tuple of Violation or None
        Violations of the return path; None if it is not known.
    least_gain : float
        A flown path that keeps the hard constraints is kept unless the new one saves this share of its cost.
    """
    response = respond(
        state, start, least_threat, (refused,), state.mission_list.max_waypoints,
        may_return=state.mission.authority.allow_rtl, return_path=return_path,
    )  # fmt: skip
    decision, route = response.decision, response.route
    leads_to_goal = route is not None and decision.step is EmergencyStep.LEAST_THREAT
    if leads_to_goal and _flown_is_as_good(state, start, least_threat, response.options, least_gain):
        return EmergencyConclusion(decision.step, FLOWN_COSTS_NO_MORE, response.options, None)
    return _emergency_mission(state, start, response, least_threat.cost)


def _flown_is_as_good(
    state: FlightState, start: Start, plan: Plan, options: EmergencyOptions, least_gain: float
) -> bool:
    """Return whether the flown path leads as far, and costs hardly more than a least-threat plan.

    An exchange without benefit would delay the answer to the next surprise.
    """
    if start.rest is None or plan.flown_cost is None or not state.flies_to_goal:
        return False
    if options.flown is None or not keeps_hard_constraints(options.flown):
        return False
    return covered_s(state, start) >= covered_min_s(state) and gain_of(plan) <= least_gain


def conclude_rally(
    state: FlightState, found: EmergencyConclusion, plan: Plan, place: GoalRegion, start: Start
) -> EmergencyConclusion:
    """Choose the step again after a plan to a rally point, and construct the mission that carries it out."""
    response = respond_by_rally_point(state, found.options, plan, place, state.mission_list.max_waypoints)
    return _emergency_mission(state, start, response, plan.cost)


def rally_points_near(state: FlightState, from_enu_m: tuple[float, float, float]) -> list[GoalRegion]:
    """Return the rally points for which a plan is made, the nearest to a place [m] first."""
    nearest = sorted(state.rally_points, key=lambda place: math.dist(place[:2], from_enu_m[:2]))
    return [state.region_at(place) for place in nearest[:RALLY_POINTS_TRIED]]


def _emergency_mission(
    state: FlightState, start: Start, response: Response, cost: float
) -> EmergencyConclusion:
    """Return a response with its mission."""
    step, reason = response.decision
    route = response.route
    if route is None:
        return EmergencyConclusion(step, reason, response.options, None)
    part = mission_part(route.waypoints, state.mission.frame, state.rules.vehicle.airspeed_cruise_m_s)
    constructed = ConstructedMission(
        route.path, route.waypoints, part, route.covered_until_s, start, Verdict.EMERGENCY, step.value,
        field_facts(state, route.path), cost,
    )  # fmt: skip
    return EmergencyConclusion(step, reason, response.options, constructed)
