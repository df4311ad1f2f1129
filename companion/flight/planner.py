"""The plans of one flight: each by its own seed, and with the threat trees that the one before has grown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from companion.config.rules import Rules
from companion.flight.flight_state import FlightState
from companion.flight.progress import Start
from companion.planning.problem import GoalRegion, Problem
from companion.planning.settings import PlannerSettings
from companion.planning.solver import solve
from companion.types.path import Path
from companion.types.plan import Plan
from companion.types.threat import ThreatTree
from companion.world.snapshot import Snapshot

PLAN, LEAST_THREAT = "plan", "least threat"
SEEDS_A_FLIGHT = 100_003  # plans that a flight may have before its seeds meet the next one's


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


class Planner:
    """Makes plans one after the other; the same requests in the same order give the same plans.

    Parameters
    ----------
    seed : int
        The flight's seed, from which each plan's is counted.

    Attributes
    ----------
    num_plans : int
        How many were begun.
    """

    def __init__(self, seed: int) -> None:
        self.num_plans = 0
        self._seed = seed
        self._threat_trees: tuple[ThreatTree, ...] = ()
        self._grown_by: Rules | None = None

    def plan(self, request: PlanRequest, should_stop: Callable[[], bool]) -> Plan:
        """Search for a path until one is found and improved on, or the stopping rule holds."""
        self.num_plans += 1
        if request.rules is not self._grown_by:  # they grew round other obstacles
            self._threat_trees, self._grown_by = (), request.rules
        problem = Problem(
            start=request.start.state,
            goals=request.goals,
            snapshot=request.snapshot.with_threat_trees(self._threat_trees),
            vehicle=request.rules.vehicle,
            settings=request.settings,
            seed=self._seed * SEEDS_A_FLIGHT + self.num_plans,
        )
        plan = solve(problem, should_stop, flown=request.improved_on)
        self._threat_trees = plan.threat_trees
        return plan
