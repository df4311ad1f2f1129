"""One planning cycle without its waiting: whether a plan is of use, and what is done where none passes.

Synchronous and without a clock, so that a replay decides the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.assurance.emergency import EmergencyOptions, EmergencyStep, keeps_hard_constraints
from companion.assurance.violation import Violation
from companion.flight.decision import Verdict, carried_min_s, carried_s, is_caught_far_less
from companion.flight.fallback import Response, flown_violations, respond, respond_by_rally_point
from companion.flight.flight_state import FlightState
from companion.flight.progress import Start, is_on_last_leg, lead_s
from companion.flight.shaping import ShapedPath
from companion.mission.waypoints import mission_part
from companion.planning.problem import GoalRegion
from companion.types.path import Path
from companion.types.plan import Plan
from companion.types.state import Ownship

AS_GOOD = "what is flown threatens no more"
THREAT_SHARE = 0.8  # of the flown path's threat: what has less is flown instead
RALLY_POINTS_TRIED = 2  # each is a plan, while nothing that passes is flown


@dataclass(frozen=True, slots=True)
class EmergencyConclusion:
    """The step to take where no plan passes, why, and what is to be handed over for it, if anything."""

    step: EmergencyStep
    reason: str
    options: EmergencyOptions
    shaped: ShapedPath | None


def is_over(state: FlightState, ownship: Ownship) -> bool:
    """Whether the flown path ends before a plan begun now could be of use."""
    return is_on_last_leg(state, ownship, lead_s(state))


def flown_passes(state: FlightState, start: Start) -> bool:
    """Whether something of ours is flown, and the rest of it passes the check."""
    return flown_violations(state, start) == ()


def conclude_emergency(
    state: FlightState,
    least_threat: Plan,
    refused: Path | None,
    start: Start,
    way_home: tuple[Violation, ...] | None,
    *,
    may_keep: bool = False,
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
    way_home : tuple of Violation or None
        What the way home breaks; None where that is not known.
    may_keep : bool
        Whether a flown least-threat path is kept where the new one is hardly better.
    """
    response = respond(
        state, start, least_threat, (refused,), state.mission_list.max_waypoints,
        may_return=state.mission.authority.allow_rtl, way_home=way_home,
    )  # fmt: skip
    decision, route = response.decision, response.route
    is_way_on = route is not None and decision.step is EmergencyStep.LEAST_THREAT
    if may_keep and is_way_on and _flown_is_as_good(state, start, least_threat, response.options):
        return EmergencyConclusion(decision.step, AS_GOOD, response.options, None)
    return _shaped(state, start, response)


def _flown_is_as_good(state: FlightState, start: Start, plan: Plan, options: EmergencyOptions) -> bool:
    """Whether what is flown leads as far, and threatens hardly more than a least-threat plan.

    A mission handed over for nothing is an exchange in the way of the next surprise.
    """
    rest, risk, path = start.rest, start.risk, plan.path
    if rest is None or risk is None or path is None or not state.flies_to_goal:
        return False
    if options.flown is None or not keeps_hard_constraints(options.flown):
        return False
    if carried_s(state, start) < carried_min_s(state):
        return False
    return not is_caught_far_less(plan.pursuit, risk) and _threat_s(path) > THREAT_SHARE * _threat_s(rest)


def _threat_s(path: Path) -> float:
    """The threat level over a path's time [s]."""
    return float(np.trapezoid(path.threat_levels, path.times_s))


def conclude_rally(
    state: FlightState, found: EmergencyConclusion, plan: Plan, place: GoalRegion, start: Start
) -> EmergencyConclusion:
    """Choose the step anew once a plan to a rally point was made, and shape what is to be flown by it."""
    response = respond_by_rally_point(state, found.options, plan, place, state.mission_list.max_waypoints)
    return _shaped(state, start, response)


def rally_points_near(state: FlightState, start: Start) -> list[GoalRegion]:
    """The rally points that are worth a plan, the nearest first."""
    here = start.state.position_enu_m
    nearest = sorted(state.rally_points, key=lambda place: math.dist(place[:2], here[:2]))
    return [state.region_at(place) for place in nearest[:RALLY_POINTS_TRIED]]


def _shaped(state: FlightState, start: Start, response: Response) -> EmergencyConclusion:
    """What a response comes to as a mission."""
    step, reason = response.decision
    route = response.route
    if route is None:
        return EmergencyConclusion(step, reason, response.options, None)
    part = mission_part(route.waypoints, state.mission.frame, state.rules.vehicle.airspeed_cruise_m_s)
    shaped = ShapedPath(
        route.path, route.waypoints, part, route.carried_until_s, start, Verdict.EMERGENCY, step.value, {}
    )
    return EmergencyConclusion(step, reason, response.options, shaped)
