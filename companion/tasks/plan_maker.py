"""The plans of one flight: each by its own seed, within its budget, watched and written down."""

from __future__ import annotations

from collections.abc import Callable

from companion.clock import Clock
from companion.comms.observer import Observer
from companion.config.rules import Rules
from companion.flight.plan_request import PlanRequest
from companion.planning.plan_runner import PlanRun, PlanRunner
from companion.planning.problem import Problem
from companion.planning.solver import solve
from companion.recording.recorder import Recorder
from companion.tasks.plan_schedule import PlanSchedule
from companion.types.plan import Plan
from companion.types.record import PlanRecord
from companion.types.threat import ThreatTree

__all__ = ["PlanMaker", "PlanRun", "PlanRunner", "Planner"]

SEEDS_A_FLIGHT = 100_003  # plans that a flight may have before its seeds meet the next one's


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


class PlanMaker:
    """Has plans made one after the other.

    Parameters
    ----------
    seed : int
        The flight's.
    runner : PlanRunner
        Says how long they may take, and by whose clock.
    clock : Clock
        The service's.
    recorder : Recorder
        Keeps each with the world that it was made in.
    observer : Observer
        Told before and after.

    Attributes
    ----------
    schedule : PlanSchedule
        Says when they are made, and why.
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

    @property
    def num_plans(self) -> int:
        """The number of the plan made last, by which the mission that carries it is known."""
        return self._planner.num_plans

    def next_look_s(self) -> float:
        """When to look next whether a plan is due, by the clock [s]."""
        return self._runner.next_look_s(self._clock.now_s())

    async def until_begun(self) -> None:
        """Wait until the next plan is to be made."""
        await self._runner.until_begun(self._clock, self._num_runs + 1)

    async def make(self, request: PlanRequest) -> PlanRun:
        """Make a plan within the mission file's budget."""
        begun_s = self._clock.now_s()
        budget_s = float(request.rules.mission.planning.planning_budget_s)
        self._num_runs += 1
        self._observer.progress()
        run = await self._runner.run(self._planner.plan, request, self._clock, budget_s, self._num_runs)
        self._observer.progress()
        self._observer.planned(run.plan, run.plan_ms)
        self._record(run, request, begun_s)
        return run

    def _record(self, run: PlanRun, request: PlanRequest, begun_s: float) -> None:
        """Write a plan down, with why it was made and from where."""
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
            run.plan_ms,
        )  # fmt: skip
        self._recorder.plan(now, made, request.snapshot)
