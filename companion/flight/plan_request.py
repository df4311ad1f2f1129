"""What is asked of the planner."""

from __future__ import annotations

from dataclasses import dataclass

from companion.config.rules import Rules
from companion.flight.flight_state import FlightState
from companion.flight.progress import Start
from companion.planning.problem import GoalRegion
from companion.planning.settings import PlannerSettings
from companion.types.path import Path
from companion.world.snapshot import Snapshot

PLAN, LEAST_THREAT = "plan", "least threat"


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """All that a plan is made from.

    Parameters
    ----------
    purpose : str
        ``plan``, or ``least threat`` in an emergency.
    rules : Rules
        What it is held to.
    settings : PlannerSettings
        How it is searched for.
    goals : tuple of GoalRegion
        To be reached in order.
    start : Start
        Where it begins.
    improved_on : Path or None
        The rest of the flown path, where that is worth improving on.
    snapshot : Snapshot
        The world.
    """

    purpose: str
    rules: Rules
    settings: PlannerSettings
    goals: tuple[GoalRegion, ...]
    start: Start
    improved_on: Path | None
    snapshot: Snapshot


def plan_request(state: FlightState, start: Start, snapshot: Snapshot) -> PlanRequest:
    """What is asked of the planner in the ordinary course of a flight."""
    rules, rest = state.rules, start.rest
    # A flown path that fails the check, since the world has changed, is nothing to improve on.
    if rest is not None and state.violations_of(rest):
        rest = None
    settings = rules.settings if rest is None else rules.replan_settings
    return PlanRequest(PLAN, rules, settings, state.goals_left, start, rest, snapshot)


def least_threat_request(state: FlightState, start: Start, snapshot: Snapshot) -> PlanRequest:
    """What is asked in an emergency: threats weigh most, and have no limit."""
    rules = state.rules
    settings = rules.least_threat_settings
    return PlanRequest(LEAST_THREAT, rules, settings, state.goals_left, start, None, snapshot)
