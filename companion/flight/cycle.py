"""One planning cycle without its waiting: where a plan begins, and what a plan comes to.

Synchronous and without a clock, so that a replay decides the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from companion.assurance.emergency import EmergencyStep
from companion.flight.decision import SwapDecision, Verdict, judge
from companion.flight.fallback import flown_violations, respond
from companion.flight.flight_state import FlightState
from companion.flight.progress import Start, is_on_last_leg, lead_s, start_after
from companion.flight.shaping import waypoints_of
from companion.mission.waypoints import Waypoints
from companion.types.path import Path
from companion.types.plan import Plan
from companion.types.state import Ownship


@dataclass(frozen=True, slots=True)
class ShapedPath:
    """A path in the shape that a mission carries it in, and why it is to be flown.

    Parameters
    ----------
    path : Path
        What is to be flown.
    waypoints : Waypoints
        What the mission carries of it.
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
    """

    path: Path
    waypoints: Waypoints
    carried_until_s: float
    start: Start
    verdict: Verdict
    text: str
    why: Mapping[str, object]


@dataclass(frozen=True, slots=True)
class Conclusion:
    """What a plan comes to.

    Parameters
    ----------
    decision : SwapDecision
        What is said of it.
    shaped : ShapedPath or None
        What is to be handed over; None where nothing is.
    is_unflyable : bool
        Whether it would be flown, but no mission can carry it.
    """

    decision: SwapDecision
    shaped: ShapedPath | None = None
    is_unflyable: bool = False


@dataclass(frozen=True, slots=True)
class EmergencyConclusion:
    """The step to take where no plan passes, why, and what is to be handed over for it, if anything."""

    step: EmergencyStep
    reason: str
    shaped: ShapedPath | None


def begin(state: FlightState, ownship: Ownship) -> Start:
    """Where a plan that is begun now takes effect."""
    return start_after(state, ownship, lead_s(state.rules, state.mission_list.exchange_s))


def is_over(state: FlightState, ownship: Ownship) -> bool:
    """Whether the flown path ends before a plan begun now could be of use."""
    return is_on_last_leg(state, ownship, lead_s(state.rules, state.mission_list.exchange_s))


def flown_passes(state: FlightState, start: Start) -> bool:
    """Whether something of ours is flown, and the rest of it passes the check."""
    return flown_violations(state, start) == ()


def conclude(state: FlightState, plan: Plan, start: Start) -> Conclusion:
    """Judge a plan, and shape what is to be flown of it."""
    decision = judge(state, plan, start)
    if not decision.verdict.is_swap or plan.path is None:
        return Conclusion(decision)
    waypoints, carried_s, violations = waypoints_of(state, plan.path, state.mission_list.max_waypoints)
    if violations:
        refused = SwapDecision(Verdict.REJECTED, f"mission: {violations[0]}", decision.why)
        return Conclusion(refused, is_unflyable=True)
    shaped = ShapedPath(plan.path, waypoints, carried_s, start, decision.verdict, decision.text, decision.why)
    return Conclusion(decision, shaped)


def conclude_emergency(
    state: FlightState, least_threat: Plan, failed: Plan, start: Start
) -> EmergencyConclusion:
    """Choose the step of the emergency strategy, and shape what is to be flown by it."""
    response = respond(
        state, start, least_threat, (failed.path,), state.mission_list.max_waypoints,
        may_return=state.mission.authority.allow_rtl,
    )  # fmt: skip
    step, reason = response.decision
    route = response.route
    if route is None:
        return EmergencyConclusion(step, reason, None)
    shaped = ShapedPath(
        route.path, route.waypoints, route.carried_until_s, start, Verdict.EMERGENCY, step.value, {}
    )
    return EmergencyConclusion(step, reason, shaped)
