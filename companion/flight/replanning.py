"""When to plan, and what to do with a plan: swap it in, keep what is flown, or answer an emergency."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass
from typing import Protocol

from companion.assurance.emergency import EmergencyStep
from companion.clock import Clock
from companion.config import MissionConfig
from companion.errors import CompanionError
from companion.flight.checkpoint import Memory
from companion.flight.cycle import Cycle, Start
from companion.flight.decision import Judgement
from companion.flight.fallback import flown_violations, respond
from companion.flight.geofences import Fencing
from companion.flight.handover import Handover, Reading
from companion.flight.modes import Mode, ModeEvent
from companion.flight.observer import Watch
from companion.flight.situation import Picture
from companion.link.missions.autopilot_link import AutopilotLink
from companion.mission.swap import SwapOutcome
from companion.mission.waypoints import Waypoints
from companion.planning.plan_runner import Pace, Paced
from companion.recording.recorder import Recorder
from companion.types.path import Path
from companion.types.plan import Plan
from companion.types.record import PlanRecord, SwapRecord, UploadedMission
from companion.world.snapshot import Snapshot

SUSPICION_S = 1.0  # soonest after a plan that signs of another uploader are looked into
RETRY_S = 3.0  # between plans while nothing safe is flown
ENTER_EARLY_S = 1.0  # before the plan's start: later the entry would lie behind
EARLY_REPLAN_S = 5.0  # soonest after a plan that news of threats makes another
FAILED_SWAPS_TOLD = 3  # in a row: then the pilot is told that the flown plan is kept
NO_PLAN_KINDS = frozenset({"no plan", "rejected"})
PlanBy = Callable[[Start, Snapshot, Callable[[], bool]], Plan]


@dataclass(frozen=True, slots=True)
class Parts:
    """What the service is composed of."""

    mission: MissionConfig
    clock: Clock
    picture: Picture
    cycle: Cycle
    handover: Handover
    fencing: Fencing
    autopilot: AutopilotLink
    recorder: Recorder
    memory: Memory


class Pilot(Protocol):
    """Who says whether the loop may act, and hears what it decides."""

    @property
    def may_plan(self) -> bool:
        """Whether plans can be made, and are wanted."""
        ...

    @property
    def mode(self) -> Mode:
        """The service's."""
        ...

    @property
    def hears_autopilot(self) -> bool:
        """Whether a heartbeat came lately."""
        ...

    def may_act(self) -> bool:
        """Whether the aircraft is left to us."""
        ...

    def change(self, event: ModeEvent) -> None:
        """Follow the state table."""
        ...

    def decide(
        self, kind: str, text: str, plan_ms: float | None = None, latency_ms: float | None = None,
        why: Mapping[str, object] | None = None,
    ) -> None:  # fmt: skip
        """Record a decision and tell the pilot."""
        ...

    def renew(self) -> None:
        """Take up what was changed in the meantime; called between plans."""
        ...


class PlanningLoop:
    """Plans every time horizon, and sooner on news; sooner still while nothing safe is flown.

    Parameters
    ----------
    parts : Parts
        What it works with.
    pilot : Pilot
        The service.
    pace : Pace
        How long plans may take.
    watch : Watch
        Is told of each round, plan and exchange.

    Attributes
    ----------
    emergency : EmergencyStep or None
        The step of the emergency strategy that was announced last; None once a plan is flown again.
    """

    def __init__(self, parts: Parts, pilot: Pilot, pace: Pace, watch: Watch) -> None:
        self._mission, self._clock = parts.mission, parts.clock
        self._picture, self._cycle = parts.picture, parts.cycle
        self._handover, self._fencing = parts.handover, parts.fencing
        self._autopilot, self._recorder = parts.autopilot, parts.recorder
        self._memory = parts.memory
        self._pilot = pilot
        self._pace = pace
        self._occasion = "the mission is flown"
        self._retry = ""
        self._due_s = 0.0
        self._num_plans = 0
        self._watch = watch
        self._exchanging: asyncio.Task[tuple[SwapOutcome, str]] | None = None
        self._last_plan_s = -math.inf
        self.emergency: EmergencyStep | None = None
        self._num_failed_swaps = 0
        self._planned_for: tuple[int, tuple[str, ...]] = (0, ())

    def plan_at_once(self) -> None:
        """Whatever was flown meanwhile, plan from here at once."""
        self._last_plan_s = -math.inf
        self._occasion = "the mission is flown"

    def adopt(self, mission: MissionConfig) -> None:
        """Go by another mission file from now on, and plan by it at once."""
        self._mission = mission
        self.plan_at_once()

    def break_off(self) -> None:
        """End an exchange that is under way where it stands."""
        if self._exchanging is not None:
            self._exchanging.cancel()

    async def run(self) -> None:
        """Run until cancelled."""
        while True:
            self._round()
            if (
                self._pilot.mode is Mode.STANDBY
                and self._pilot.hears_autopilot
                and self._handover.layout is None
            ):
                # What is wrong with the operator's mission is said on the ground.
                await self._handover.prepare()
            if (
                self._pilot.may_plan
                and self._pilot.mode is Mode.ACTIVE
                and self._picture.ownship.state(self._clock.now_s()) is not None
            ):
                await self._plan_once()
            await self._next_occasion()

    def _round(self) -> None:
        """Between plans and exchanges."""
        self._watch.progress()
        self._pilot.renew()

    async def _next_occasion(self) -> None:
        """Sleep until the next plan is due."""
        while True:
            await self._clock.sleep_until(self._pace.next_look_s(self._clock.now_s()))
            self._round()
            horizon = float(self._mission.planning.time_horizon_s)
            since = self._clock.now_s() - self._last_plan_s
            wanted = horizon if self._cycle.flies_to_goal else RETRY_S
            if since == math.inf:
                return
            news = self._has_news() if since >= EARLY_REPLAN_S else ""
            if self._handover.is_suspicious and since >= SUSPICION_S:
                self._occasion = f"another uploader? {self._handover.suspected}"
            elif news:
                self._occasion = news
            elif since >= wanted:
                self._occasion = self._retry or f"{wanted:g} s since the last plan"
            else:
                continue
            return

    def _news(self) -> tuple[int, tuple[str, ...]]:
        identities = tuple(track.identity for track in self._picture.tracker.tracks(self._clock.now_s()))
        return self._picture.num_known_threats, identities

    def _has_news(self) -> str:
        """Which threat is known that the last plan did not know; '' if none is."""
        known, identities = self._news()
        fresh = sorted(set(identities) - set(self._planned_for[1]))
        if fresh:
            return f"news of {', '.join(fresh)}"
        return "news of a static threat" if known > self._planned_for[0] else ""

    async def _plan_once(self) -> None:
        """One cycle: plan, judge, and swap if it is worth it."""
        now = self._clock.now_s()
        self._last_plan_s, self._retry = now, ""
        self._due_s = now
        if not self._handover.is_settled():
            self._retry = "it was not known what is flown"
            self._last_plan_s = now - float(self._mission.planning.time_horizon_s) + SUSPICION_S
            return
        if not await self._knows_mission():
            return
        await self._fencing.renew()
        await self._pace.until_begun(self._clock, self._num_plans + 1)
        now = self._clock.now_s()
        state = self._picture.ownship.state(now)
        if state is None or not self._pilot.may_act() or not self._cycle.goals_left:
            return
        snapshot = self._picture.snapshot(now)
        self._planned_for = self._news()
        track_s = self._picture.newest_track_s
        lead = self._cycle.lead_s(self._handover.exchange_s)
        if self._cycle.is_on_last_leg(state, lead):
            return
        start = self._cycle.start_after(state, lead)
        budget = float(self._mission.planning.planning_budget_s)
        plan, plan_ms = await self._solved(start, snapshot, budget)
        if self._pilot.mode is not Mode.ACTIVE:
            return
        judgement = self._cycle.judge(plan, start)
        if not judgement.swap or plan.path is None:
            self._decide(judgement.kind, judgement.text, plan_ms, why=judgement.why)
            if judgement.kind in NO_PLAN_KINDS:
                await self._respond(plan, snapshot, track_s)
            else:
                self.emergency = None
            return
        waypoints, carried_s, violations = self._cycle.waypoints(plan.path, self._handover.room)
        if violations:
            self._recorder.num_rejected += 1
            self._decide("rejected", f"mission: {violations[0]}", plan_ms, why=judgement.why)
            await self._respond(plan, snapshot, track_s)
            return
        await self._swap(plan.path, waypoints, carried_s, judgement, plan_ms, track_s, start)

    async def _respond(self, failed: Plan, snapshot: Snapshot, track_s: float) -> None:
        """No plan passes: take the first step of the emergency strategy that can be taken, and say so."""
        state = self._picture.ownship.state(self._clock.now_s())
        if state is None:
            return
        start = self._cycle.start_after(state, self._cycle.lead_s(self._handover.exchange_s))
        if flown_violations(self._cycle, start) == ():
            self._announce(EmergencyStep.KEEP_FLOWN, "it still passes", "keep")
            return
        budget = float(self._mission.planning.planning_budget_s)
        least, plan_ms = await self._solved(start, snapshot, budget, self._cycle.plan_least_threat)
        if not self._pilot.may_act():
            return
        may_return = self._mission.authority.allow_rtl
        response = respond(
            self._cycle, start, least, (failed.path,), self._handover.room, may_return=may_return
        )
        step, reason = response.decision
        self._announce(step, reason, "emergency")
        if response.way is not None:
            way = response.way
            judgement = Judgement(True, "emergency", step.value)
            await self._swap(way.path, way.waypoints, way.carried_until_s, judgement, plan_ms, track_s, start)
        elif step is EmergencyStep.RETURN_TO_LAUNCH and self._pilot.may_act():
            try:
                await self._autopilot.set_mode("RTL")
            except CompanionError as error:
                self._pilot.decide("emergency", f"return to launch: {error}")

    def _announce(self, step: EmergencyStep, reason: str, kind: str) -> None:
        """Say a step of the emergency strategy, once until another is taken."""
        if step is not self.emergency:
            self.emergency = step
            self._pilot.decide(kind, f"{step.value}: {reason}")

    async def _solved(
        self, start: Start, snapshot: Snapshot, budget_s: float, plan_by: PlanBy | None = None
    ) -> tuple[Plan, float]:
        """Plan within the budget; the plan and the computer's milliseconds it took."""
        search = plan_by or self._cycle.plan
        begun_s = self._clock.now_s()
        self._num_plans += 1
        number = self._num_plans
        self._watch.progress()
        paced = await self._pace.run(
            lambda should_stop: search(start, snapshot, should_stop), self._clock, budget_s, number
        )
        self._watch.progress()
        self._watch.planned(paced.plan, paced.plan_ms)
        self._record(paced, start, snapshot, begun_s, "plan" if plan_by is None else "least threat")
        return paced.plan, paced.plan_ms

    def _record(self, paced: Paced, start: Start, snapshot: Snapshot, begun_s: float, purpose: str) -> None:
        """Write a plan down, with why it was made and from where."""
        now, state = self._clock.now_s(), start.state
        begin = {
            "stamp_s": state.stamp_s,
            "position_enu_m": state.position_enu_m,
            "direction_rad": state.direction_rad,
            "climb_rad": state.climb_rad,
            "airspeed_m_s": state.airspeed_m_s,
            "is_on_flown_path": start.rest is not None,
        }
        made = PlanRecord(
            self._num_plans, self._occasion, purpose, begin, paced.plan, paced.asked, paced.is_stopped,
            self._due_s, snapshot.stamp_s, begun_s, now - begun_s, paced.plan_ms,
        )  # fmt: skip
        self._recorder.plan(now, made, snapshot)

    def _decide(
        self, kind: str, text: str, plan_ms: float | None = None, latency_ms: float | None = None,
        why: Mapping[str, object] | None = None,
    ) -> None:  # fmt: skip
        """Say what came of a plan, and why it was made."""
        self._pilot.decide(kind, text, plan_ms, latency_ms, {"occasion": self._occasion, **(why or {})})

    async def _swap(
        self,
        path: Path,
        waypoints: Waypoints,
        carried_s: float,
        judgement: Judgement,
        plan_ms: float,
        track_s: float,
        start: Start,
    ) -> None:
        """Hand a mission over when the aircraft is where it begins."""
        enter_s = start.state.stamp_s - ENTER_EARLY_S if self._cycle.flown is not None else 0.0
        begun_s = self._clock.now_s()
        outcome, reason = await self._unless_withdrawn(
            self._handover.swap(path, waypoints, carried_s, enter_s)
        )
        self._watch.exchanged(outcome)
        now, mission = self._clock.now_s(), self._handover.offered
        if mission is not None:
            places = waypoints.positions_enu_m
            self._recorder.swap(
                now,
                SwapRecord(outcome.value, reason, begun_s, now, mission.plan_number, mission.items, places),
            )
        if outcome is not SwapOutcome.FLOWN:
            self._recorder.num_rejected += 1
            self._decide("rejected", f"{outcome.value}: {reason}", plan_ms, why=judgement.why)
            self._note_failed_swap(start)
            self._retry = "the last mission was not entered"
            self._last_plan_s = self._clock.now_s() - float(self._mission.planning.time_horizon_s) + RETRY_S
            return
        self._num_failed_swaps = 0
        if judgement.kind != "emergency":
            self.emergency = None
        latency = 1e3 * (now - track_s) if math.isfinite(track_s) else None
        if latency is not None:
            self._recorder.track_to_mission_ms.append(latency)
        self._recorder.missions.append(UploadedMission(now, waypoints.positions_enu_m, judgement.kind))
        text = f"{judgement.kind}, {judgement.text}; {reason}"
        self._decide("swap", text, plan_ms, latency, judgement.why)

    def _note_failed_swap(self, start: Start) -> None:
        """Say that the aircraft is left with what it flies, once that looks like lasting."""
        self._num_failed_swaps += 1
        if self._num_failed_swaps != FAILED_SWAPS_TOLD or not self._pilot.may_act():
            return
        passes = flown_violations(self._cycle, start) == ()
        reason = "it still passes" if passes else "nothing else reaches the autopilot"
        self._announce(
            EmergencyStep.KEEP_FLOWN, f"{reason}; {self._num_failed_swaps} swaps failed",
            "keep" if passes else "emergency",
        )  # fmt: skip

    async def _unless_withdrawn(
        self, exchange: Coroutine[object, object, tuple[SwapOutcome, str]]
    ) -> tuple[SwapOutcome, str]:
        """Carry out an exchange; :meth:`break_off` ends it where it stands."""
        withdrawn = SwapOutcome.WITHDRAWN, "the mode was changed"
        if not self._pilot.may_act():  # since the plan was made
            exchange.close()
            return withdrawn
        self._exchanging = asyncio.create_task(exchange)
        try:
            return await self._exchanging
        except asyncio.CancelledError:
            own = asyncio.current_task()
            if own is None or own.cancelling():  # the service itself ends
                raise
            return withdrawn
        finally:
            self._exchanging = None

    async def _knows_mission(self) -> bool:
        """Whether the autopilot's list is known and left to us; another uploader's is respected."""
        is_first = self._handover.layout is None
        reading = await self._handover.prepare()
        if is_first and self._handover.found_flown:
            reached = self._memory.reached([goal.position_enu_m for goal in self._cycle.goals])
            self._cycle.next_goal = max(self._cycle.next_goal, reached)
            self._pilot.decide("restart", f"the autopilot flies a mission of ours; {reached} goals reached")
        if reading is Reading.UNREADABLE:
            return False
        if reading is Reading.FOREIGN:
            if not self._mission.goals_from_autopilot:
                self._pilot.change(ModeEvent.OTHER_MISSION)
                return False
            self._pilot.decide(
                "mission", f"another mission was uploaded: {len(self._cycle.goals)} goals from it"
            )
        if not self._cycle.goals:
            self._pilot.decide("no plan", "the autopilot's mission has no waypoint to fly to")
            return False
        return True
