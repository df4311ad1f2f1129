"""The plans of one flight: each with its own seed, within its budget, supervised and recorded."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

from companion.clock import Clock
from companion.config.rules import Rules
from companion.flight.messages.observer import Observer
from companion.flight.replanning.plan_schedule import PlanSchedule
from companion.flight.state.flight_state import FlightState
from companion.flight.state.progress import Start, budget_s, keeps_limits
from companion.planning.plan_runner import PlanBrokenOffError, PlanRunner, PlanTiming, StopRule
from companion.planning.problem import GoalRegion, Problem
from companion.planning.solver import solve_in_flight
from companion.planning.threads import in_thread
from companion.recording.recorder import Recorder
from companion.types.plan import Plan
from companion.types.record import PlanRecord
from companion.types.threat import ThreatTree
from companion.world.snapshot import Snapshot

Conclusion = TypeVar("Conclusion")

__all__ = ["PlanBrokenOffError", "PlanMaker", "PlanRun", "PlanRunner", "Planner"]

PLAN, LEAST_THREAT, RALLY_POINT, RETURN = "plan", "least threat", "rally point", "return"
PASSAGE = "passage"
STALLED_S = 5.0  # A plan that exceeds its budget by this time is stalled.
LOOK_INTERVAL_S = 0.1  # With simulated time, a waiting plan is checked at this interval for being unwanted.
SEEDS_A_FLIGHT = 100_003  # After this many plans the seeds of a flight would repeat those of the next seed.


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """Everything that a plan is made from.

    Parameters
    ----------
    purpose : str
        ``plan``; in an emergency ``least threat``, ``rally point``; for a return path ``return``; without the
        circles of other members ``passage``.
    rules : Rules
        The rules for the plan.
    goals : tuple of GoalRegion
        The goals in their order.
    start : Start
        The start of the plan.
    improves : bool
        Whether the rest of the flown path keeps the hard constraints, so that the plan is compared with it.
    snapshot : Snapshot
        The world.
    is_urgent : bool
        Whether the plan answers a surprise.
    is_failing : bool
        Whether the rest of the flown path breaks a limit.
    """

    purpose: str
    rules: Rules
    goals: tuple[GoalRegion, ...]
    start: Start
    improves: bool
    snapshot: Snapshot
    is_urgent: bool = False
    is_failing: bool = False


def plan_request(
    state: FlightState, start: Start, snapshot: Snapshot, *, is_urgent: bool = False
) -> PlanRequest:
    """Return the request for an ordinary plan."""
    return _request(PLAN, state, start, snapshot, is_urgent=is_urgent)


def least_threat_request(
    state: FlightState, start: Start, snapshot: Snapshot, *, is_urgent: bool = False
) -> PlanRequest:
    """Return the request for an emergency plan without a limit of the threat level."""
    return _request(LEAST_THREAT, state, start, snapshot, is_urgent=is_urgent)


def _request(
    purpose: str, state: FlightState, start: Start, snapshot: Snapshot, *, is_urgent: bool
) -> PlanRequest:
    """Return a request for a plan to the remaining goals."""
    keeps_all, keeps_hard = (True, False) if start.rest is None else keeps_limits(state, start.rest)
    return PlanRequest(
        purpose, state.rules, state.goals_left, start, keeps_hard, snapshot, is_urgent,
        is_failing=not keeps_all,
    )  # fmt: skip


def rally_request(state: FlightState, start: Start, snapshot: Snapshot, place: GoalRegion) -> PlanRequest:
    """Return the request for a plan to a rally point."""
    return PlanRequest(RALLY_POINT, state.rules, (place,), start, False, snapshot)


def return_request(state: FlightState, start: Start, snapshot: Snapshot, place: GoalRegion) -> PlanRequest:
    """Return the request for the plan of a return path; it takes as little time as one for a surprise."""
    return PlanRequest(RETURN, state.rules, (place,), start, False, snapshot, is_urgent=True)


@dataclass(frozen=True, slots=True)
class PlanRun:
    """A plan, and the effort that it took.

    Parameters
    ----------
    plan : Plan
        The planner's answer.
    plan_ms : float
        Computing time [ms].
    asked : int
        How often the search evaluated its stopping rule.
    is_stopped : bool
        Whether the rule stopped it.
    """

    plan: Plan
    plan_ms: float
    asked: int
    is_stopped: bool


class Planner:
    """Makes plans one after the other; the same requests in the same order give the same plans.

    Parameters
    ----------
    seed : int
        The flight's seed, from which each plan's seed is derived.

    Attributes
    ----------
    num_plans : int
        Number of plans that were begun.
    """

    def __init__(self, seed: int) -> None:
        self.num_plans = 0
        self._seed = seed
        self._threat_trees: tuple[ThreatTree, ...] = ()
        self._grown_by: Rules | None = None

    def plan(self, request: PlanRequest, should_stop: Callable[[], bool]) -> Plan:
        """Search until a path is found and improved, or the stopping rule holds."""
        self.num_plans += 1
        if request.rules is not self._grown_by:  # The trees grew round other obstacles.
            self._threat_trees, self._grown_by = (), request.rules
        rules = request.rules
        settings = rules.replan_settings if request.improves else rules.settings
        if request.purpose != PLAN:
            settings = rules.least_threat_settings
        if request.is_urgent:  # An answer to a surprise does not wait for a shorter path.
            settings = replace(settings, optimise_iterations_max=settings.optimise_iterations)
        problem = Problem(
            start=request.start.state,
            goals=request.goals,
            snapshot=request.snapshot.with_threat_trees(self._threat_trees),
            vehicle=rules.vehicle,
            settings=settings,
            seed=self._seed * SEEDS_A_FLIGHT + self.num_plans,
        )
        plan = solve_in_flight(problem, should_stop, flown=request.start.rest if request.improves else None)
        self._threat_trees = plan.threat_trees
        return plan

    def run(self, request: PlanRequest, rule: StopRule) -> PlanRun:
        """Make a plan, and measure its effort."""
        began = time.perf_counter()
        plan = self.plan(request, rule)
        return PlanRun(plan, 1e3 * (time.perf_counter() - began), rule.asked, rule.is_stopped)


class PlanMaker:
    """Makes plans one after the other, supervised.

    Parameters
    ----------
    seed : int
        The flight's seed.
    runner : PlanRunner
        Limits the time of plans, and determines their clock.
    clock : Clock
        The service's clock.
    recorder : Recorder
        Records each plan with its world.
    observer : Observer
        Is notified before and after each plan.

    Attributes
    ----------
    schedule : PlanSchedule
        Determines when plans are made, and why.
    """

    def __init__(
        self,
        seed: int,
        runner: PlanRunner,
        clock: Clock,
        recorder: Recorder,
        observer: Observer,
    ) -> None:
        self.schedule = PlanSchedule()
        self._planner = Planner(seed)
        self._runner = runner
        self._clock = clock
        self._recorder = recorder
        self._observer = observer
        self._num_runs = 0
        self._overdue_s = math.inf
        self._under_way: PlanTiming | None = None
        self._unwanted = ""

    def is_stalled(self, now_s: float) -> bool:
        """Return whether a plan takes far longer than its budget."""
        return now_s > self._overdue_s

    @property
    def num_plans(self) -> int:
        """Number of the last plan, under which its mission is recorded."""
        return self._planner.num_plans

    def next_look_s(self) -> float:
        """Return when to check next whether a plan is due, by the clock [s]."""
        return self._runner.next_look_s(self._clock.now_s())

    @property
    def may_break_off(self) -> bool:
        """Whether a plan is being made that can be broken off."""
        return self._under_way is not None and not self._under_way.is_broken_off

    def break_off(self, why: str) -> None:
        """Stop the plan under way, if :attr:`may_break_off`; its caller receives the reason."""
        if self._under_way is not None:
            self._unwanted = why
            self._under_way.rule.break_off()

    async def until_begun(self) -> None:
        """Wait until the next plan is to be made."""
        await self._runner.until_begun(self._clock, self._num_runs + 1)

    async def make(
        self, request: PlanRequest, conclude: Callable[[Plan], Conclusion], *, may_break_off: bool = False
    ) -> tuple[PlanRun, Conclusion]:
        """Make a plan within the mission file's budget, and draw a conclusion from it.

        If plans are made in a thread, so is the conclusion, because it simulates many missions.

        Parameters
        ----------
        request : PlanRequest
            What the plan is made from.
        conclude : callable
            Takes the plan; returns the conclusion.
        may_break_off : bool
            Whether :meth:`break_off` may stop the plan.

        Raises
        ------
        PlanBrokenOffError
            If the plan was stopped.
        """
        begun_s = self._clock.now_s()
        allowed_s = budget_s(request.rules, is_urgent=request.is_urgent)
        self._num_runs += 1
        self._overdue_s = begun_s + allowed_s + STALLED_S
        self._observer.progress()
        timing = self._runner.timing(self._clock, allowed_s, self._num_runs)
        self._under_way = timing if may_break_off else None

        def work() -> tuple[PlanRun, Conclusion]:
            run = self._planner.run(request, timing.rule)
            return run, conclude(run.plan)

        run, concluded = await in_thread(work) if timing.is_threaded else work()
        await self._until_made(timing)
        self._under_way, self._overdue_s = None, math.inf
        self._observer.progress()
        self._observer.planned(run.plan, run.plan_ms)
        is_broken_off = may_break_off and timing.is_broken_off
        self._record(run, request, begun_s, is_broken_off=is_broken_off)
        if is_broken_off:
            raise PlanBrokenOffError(self._unwanted)
        return run, concluded

    async def _until_made(self, timing: PlanTiming) -> None:
        """Wait until the time of a plan is over, or the plan is broken off."""
        until_s, may_end = timing.until_s or -math.inf, timing.was_broken_off is None
        while (now := self._clock.now_s()) < until_s and not (may_end and timing.is_broken_off):
            await self._clock.sleep_until(min(until_s, now + LOOK_INTERVAL_S) if may_end else until_s)

    def _record(self, run: PlanRun, request: PlanRequest, begun_s: float, *, is_broken_off: bool) -> None:
        """Record a plan with its occasion and its start."""
        now, state = self._clock.now_s(), request.start.state
        begin = {
            "stamp_s": state.stamp_s,
            "position_enu_m": state.position_enu_m,
            "direction_rad": state.direction_rad,
            "climb_rad": state.climb_rad,
            "airspeed_m_s": state.airspeed_m_s,
            "is_on_flown_path": request.start.rest is not None,
        }
        made = PlanRecord(
            self._num_runs, self.schedule.occasion, request.purpose, begin, run.plan, run.asked,
            run.is_stopped, self.schedule.due_s, request.snapshot.stamp_s, begun_s, now - begun_s,
            run.plan_ms, is_broken_off,
        )  # fmt: skip
        self._recorder.plan(now, made, request.snapshot)
