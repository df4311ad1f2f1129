"""The service: composes link, picture and cycle, and runs their tasks."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import time
from collections.abc import Awaitable, Callable, Coroutine

from companion.assurance.emergency import EmergencyStep
from companion.clock import Clock
from companion.config import MissionConfig
from companion.daemon.cycle import Cycle, Judgement, Start
from companion.daemon.emergency import flown_violations, respond
from companion.daemon.fencing import Fencing
from companion.daemon.handover import Handover, Place, Reading
from companion.daemon.memory import Memory
from companion.daemon.modes import Mode, ModeEvent, next_mode
from companion.daemon.picture import Picture
from companion.daemon.record import Recorder
from companion.errors import CompanionError
from companion.link.autopilot import AutopilotLink
from companion.link.codec import Codec
from companion.link.frame import Frame
from companion.link.framing import frames_in
from companion.link.identity import answer
from companion.link.limits import SourceLimits
from companion.link.signing import Signer
from companion.link.streams import Streams
from companion.link.transport import Transport
from companion.mission.builder import Waypoints
from companion.mission.layout import Layout
from companion.mission.swap import SwapOutcome
from companion.types.events import Dialect, Event, Heartbeat, MissionCurrent, StatusText
from companion.types.path import Path
from companion.types.plan import Plan
from companion.types.record import UploadedMission
from companion.types.state import Ownship
from companion.world.snapshot import Snapshot

SILENT_S = 5.0  # without a heartbeat the autopilot counts as lost
HOUSEKEEPING_S = 1.0
STATE_S = 0.2
SUSPICION_S = 1.0  # soonest after a plan that signs of another uploader are looked into
RETRY_S = 3.0  # between plans while nothing safe is flown
ENTER_EARLY_S = 1.0  # before the plan's start: later the entry would lie behind
EARLY_REPLAN_S = 5.0  # soonest after a plan that news of threats makes another
SEVERITY = {
    "swap": 5,
    "suspended": 4,
    "arrived": 5,
    "no plan": 4,
    "rejected": 4,
    "landing": 4,
    "emergency": 2,
}

NO_PLAN_KINDS = frozenset({"no plan", "rejected"})
PlanBy = Callable[[Start, Snapshot, Callable[[], bool]], Plan]

_log = logging.getLogger(__name__)


class App:
    """The service, over one transport.

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    transport : Transport
        To the autopilot; opened and closed by :meth:`run`.
    clock : Clock
        Its time. With ``plans_inline`` it must be one that others move: a plan then takes the mission
        file's ``planning_budget_s`` of it, however long the computer needs.
    recorder : Recorder
        Listens.
    seed : int
        Of all plans and filters.
    plans_inline : bool
        Plan in the event loop to an iteration budget (simulation, replay) instead of in a thread to a
        deadline (service).
    memory : Memory, optional
        Of the flight, for a restart in it.
    signer : Signer, optional
        Signs what is sent and verifies what comes in.
    link_kind : type
        What carries out mission transfers; tests put one in whose time is simulated, too.
    """

    def __init__(
        self,
        mission: MissionConfig,
        transport: Transport,
        clock: Clock,
        recorder: Recorder,
        *,
        seed: int,
        plans_inline: bool,
        memory: Memory | None = None,
        signer: Signer | None = None,
        link_kind: type[AutopilotLink] = AutopilotLink,
    ) -> None:
        self.mode = Mode.WAITING
        self.autopilot_mode = ""
        self.may_plan = True
        self.picture = Picture(mission, seed)
        self.cycle = Cycle(mission, seed)
        self.recorder = recorder
        link = mission.link
        limits = SourceLimits(float(link.source_rate_max_hz), link.systems)
        self.codec = Codec(track_sources=link.track_sources, signer=signer, limits=limits)
        self.autopilot = link_kind(self.codec, clock, self._send)
        self._mission = mission
        self._transport = transport
        self._clock = clock
        self._plans_inline = plans_inline
        self._streams = Streams(float(mission.link.stream_rate_hz))
        self.handover = Handover(
            mission,
            self.cycle,
            self.autopilot,
            clock,
            state=lambda: self.picture.ownship.state(clock.now_s()),
            may_act=self._may_act,
            say=self._say_of_mission,
            home_amsl_m=lambda: self.codec.home_altitude_amsl_m,
            memory=memory or Memory(None),
        )
        self.fencing = Fencing(mission, self.autopilot, self.cycle, self.picture, self.decide)
        self._memory = memory or Memory(None)
        self._exchanging: asyncio.Task[tuple[SwapOutcome, str]] | None = None
        self._heartbeat_s = -math.inf
        self._last_plan_s = -math.inf
        self._emergency: EmergencyStep | None = None
        self._planned_for: tuple[int, tuple[str, ...]] = (0, ())

    async def run(self) -> None:
        """Run until cancelled."""
        self._transport.set_receiver(self.receive)
        await self._transport.open()
        try:
            async with asyncio.TaskGroup() as tasks:
                for name, task in (
                    ("housekeeping", self._housekeeping),
                    ("states", self._states),
                    ("planning", self._planning),
                ):
                    tasks.create_task(_guarded(name, task), name=name)
        finally:
            await self.autopilot.close()
            await self._transport.close()

    @property
    def num_swaps(self) -> int:
        """How many missions were flown."""
        return len(self.recorder.missions)

    @property
    def layout(self) -> Layout | None:
        """How the autopilot's list is laid out, None before it was read."""
        return self.handover.layout

    @property
    def hears_autopilot(self) -> bool:
        """Whether a heartbeat came lately."""
        return self._clock.now_s() - self._heartbeat_s <= SILENT_S

    def receive(self, data: bytes) -> None:
        """Take bytes from the transport."""
        now = self._clock.now_s()
        for frame in self.codec.feed(data, now):
            self.recorder.frame(now, frame.raw)
            self._streams.note(frame, now)
            self.autopilot.receive(frame)
            reply = answer(frame, self.codec)
            if reply:
                self._send(reply)
            for event in frame.events:
                self._take(event, frame, now)

    def _take(self, event: Event, frame: Frame, now: float) -> None:
        if isinstance(event, Heartbeat):
            self._heartbeat_s = now
            self.autopilot_mode = event.mode
            self.cycle.flies_by = event.dialect is Dialect.ARDUPILOT
            flown = event.is_mission_mode and event.is_armed
            self._change(ModeEvent.MISSION_FLOWN if flown else ModeEvent.MISSION_NOT_FLOWN)
        elif isinstance(event, MissionCurrent | StatusText):
            self.handover.note(event)
            self._follow(self.handover.place)
            if isinstance(event, StatusText):
                _log.info("autopilot: %s", event.text)
        else:
            self.picture.observe(event, now)

    def _follow(self, place: Place) -> None:
        """Leave a mission alone that goes on behind the goal, or at an item that somebody chose."""
        if place is Place.PAST_GOAL:
            self._change(ModeEvent.GOAL_REACHED)
        elif place is Place.ELSEWHERE:
            self._change(ModeEvent.OTHER_MISSION)

    def _change(self, event: ModeEvent) -> None:
        """Follow the state table; say so when the service's mode changes."""
        before = self.mode
        self.mode = next_mode(before, event, may_resume=self._mission.authority.resume == "auto")
        if self.mode is before:
            return
        if self.mode is Mode.ACTIVE:
            self._last_plan_s = -math.inf  # whatever was flown meanwhile, plan from here at once
            self.handover.forget()
        if self.mode is not Mode.ACTIVE and self._exchanging is not None:
            self._exchanging.cancel()
        kind = (
            "arrived"
            if self.mode is Mode.ARRIVED
            else "suspended"
            if self.mode in (Mode.SUSPENDED, Mode.YIELDED)
            else "mode"
        )
        self.decide(kind, f"{self.mode.value} ({self.autopilot_mode or 'no autopilot'})")

    def decide(
        self, kind: str, text: str, plan_ms: float | None = None, latency_ms: float | None = None
    ) -> None:
        """Record a decision and tell the pilot."""
        self.recorder.decide(self._clock.now_s(), kind, text, plan_ms, latency_ms)
        if self.codec.vehicle_system_id is not None:
            self._send(self.codec.status_text(SEVERITY.get(kind, 6), f"Planner {kind}: {text}"[:50]))

    def _send(self, data: bytes) -> None:
        if self._transport.is_open and data:
            data = self.codec.on_the_wire(data)
            self._transport.send(data)
            for raw in frames_in(data):
                self.recorder.frame(self._clock.now_s(), raw)

    async def _housekeeping(self) -> None:
        """Heartbeat, streams, and the watch over the autopilot's silence, at 1 Hz."""
        while True:
            now = self._clock.now_s()
            if self.codec.vehicle_system_id is not None:
                self._send(self.codec.heartbeat(is_active=self.mode is Mode.ACTIVE))
                self._send(self._streams.due(self.codec, now))
            if not self.hears_autopilot:
                self._change(ModeEvent.AUTOPILOT_SILENT)
            await self._clock.sleep_until(now + HOUSEKEEPING_S)

    async def _states(self) -> None:
        """Record the flight, and notice the goal."""
        while True:
            now = self._clock.now_s()
            state = self.picture.ownship.state(now)
            if state is not None:
                tracks = self.picture.tracker.tracks(now)
                self.recorder.state(now, state, tracks, self.picture.threat_at(state, tracks))
                if self.mode is Mode.ACTIVE:
                    self._note_goals(state)
            await self._clock.sleep_until(now + STATE_S)

    def _note_goals(self, state: Ownship) -> None:
        """Count the goals passed, and remember them."""
        before = self.cycle.next_goal
        is_last = self.cycle.note_position(state)
        if self.cycle.next_goal != before:
            self._memory.note_reached(
                [goal.position_enu_m for goal in self.cycle.goals], self.cycle.next_goal
            )
        if is_last:
            self._change(ModeEvent.GOAL_REACHED)

    async def _planning(self) -> None:
        """Plan every time horizon, and sooner on news; sooner still while nothing safe is flown."""
        while True:
            if self.mode is Mode.STANDBY and self.hears_autopilot and self.layout is None:
                await (
                    self.handover.prepare()
                )  # what is wrong with the operator's mission is said on the ground
            if (
                self.may_plan
                and self.mode is Mode.ACTIVE
                and self.picture.ownship.state(self._clock.now_s()) is not None
            ):
                await self._plan_once()
            await self._next_occasion()

    async def _next_occasion(self) -> None:
        """Sleep until the next plan is due."""
        horizon = float(self._mission.planning.time_horizon_s)
        while True:
            now = self._clock.now_s()
            await self._clock.sleep_until(now + STATE_S)
            since = self._clock.now_s() - self._last_plan_s
            wanted = horizon if self.cycle.flies_to_goal else RETRY_S
            if self.handover.is_suspicious and since >= SUSPICION_S:
                return
            if since >= wanted or (since >= EARLY_REPLAN_S and self._has_news()):
                return

    def _news(self) -> tuple[int, tuple[str, ...]]:
        identities = tuple(track.identity for track in self.picture.tracker.tracks(self._clock.now_s()))
        return self.picture.num_known_threats, identities

    def _has_news(self) -> bool:
        """Whether a threat is known that the last plan did not know."""
        known, identities = self._news()
        return known > self._planned_for[0] or not set(identities) <= set(self._planned_for[1])

    async def _plan_once(self) -> None:
        """One cycle: plan, judge, and swap if it is worth it."""
        now = self._clock.now_s()
        self._last_plan_s = now
        if not self.handover.is_settled():
            self._last_plan_s = now - float(self._mission.planning.time_horizon_s) + SUSPICION_S
            return
        if not await self._knows_mission():
            return
        await self.fencing.renew()
        now = self._clock.now_s()
        state = self.picture.ownship.state(now)
        if state is None or not self._may_act() or not self.cycle.goals_left:
            return
        snapshot = self.picture.snapshot(now)
        self._planned_for = self._news()
        track_s = self.picture.newest_track_s
        lead = self.cycle.lead_s(self.handover.num_items)
        if self.cycle.is_on_last_leg(state, lead):
            return
        start = self.cycle.start_after(state, lead)
        budget = float(self._mission.planning.planning_budget_s)
        plan, plan_ms = await self._solved(start, snapshot, budget)
        self.recorder.plan_ms.append(plan_ms)
        if self.mode is not Mode.ACTIVE:
            return
        judgement = self.cycle.judge(plan, start)
        if not judgement.swap or plan.path is None:
            self.decide(judgement.kind, judgement.text, plan_ms)
            if judgement.kind in NO_PLAN_KINDS:
                await self._respond(plan, snapshot, track_s)
            return
        waypoints, carried_s, violations = self.cycle.waypoints(plan.path, self.handover.room)
        if violations:
            self.recorder.num_rejected += 1
            self.decide("rejected", f"mission: {violations[0]}", plan_ms)
            await self._respond(plan, snapshot, track_s)
            return
        self._emergency = None
        await self._swap(plan.path, waypoints, carried_s, judgement, plan_ms, track_s, start)

    async def _respond(self, failed: Plan, snapshot: Snapshot, track_s: float) -> None:
        """No plan passes: take the first step of the emergency strategy that can be taken, and say so."""
        state = self.picture.ownship.state(self._clock.now_s())
        if state is None:
            return
        start = self.cycle.start_after(state, self.cycle.lead_s(self.handover.num_items))
        if flown_violations(self.cycle, start) == ():
            self._announce(EmergencyStep.KEEP_FLOWN, "it still passes", "keep")
            return
        budget = float(self._mission.planning.planning_budget_s)
        least, plan_ms = await self._solved(start, snapshot, budget, self.cycle.plan_least_threat)
        if not self._may_act():
            return
        may_return = self._mission.authority.allow_rtl
        response = respond(
            self.cycle, start, least, (failed.path,), self.handover.room, may_return=may_return
        )
        step, reason = response.decision
        self._announce(step, reason, "emergency")
        if response.way is not None:
            way = response.way
            judgement = Judgement(True, "emergency", step.value)
            await self._swap(way.path, way.waypoints, way.carried_until_s, judgement, plan_ms, track_s, start)
        elif step is EmergencyStep.RETURN_TO_LAUNCH and self._may_act():
            try:
                await self.autopilot.set_mode("RTL")
            except CompanionError as error:
                self.decide("emergency", f"return to launch: {error}")

    def _announce(self, step: EmergencyStep, reason: str, kind: str) -> None:
        """Say a step of the emergency strategy, once until another is taken."""
        if step is not self._emergency:
            self._emergency = step
            self.decide(kind, f"{step.value}: {reason}")

    async def _solved(
        self, start: Start, snapshot: Snapshot, budget_s: float, plan_by: PlanBy | None = None
    ) -> tuple[Plan, float]:
        """Plan within the budget; the plan and the computer's milliseconds it took."""
        plan_by = plan_by or self.cycle.plan
        began, due = time.perf_counter(), self._clock.now_s() + budget_s
        if self._plans_inline:
            plan = plan_by(start, snapshot, lambda: False)
            took = 1e3 * (time.perf_counter() - began)
            await self._clock.sleep_until(due)
            return plan, took
        plan = await asyncio.to_thread(
            plan_by,
            start,
            snapshot,
            lambda: self._clock.now_s() >= due,
        )
        return plan, 1e3 * (time.perf_counter() - began)

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
        enter_s = start.state.stamp_s - ENTER_EARLY_S if self.cycle.flown is not None else 0.0
        outcome, reason = await self._unless_withdrawn(
            self.handover.swap(path, waypoints, carried_s, enter_s)
        )
        if outcome is not SwapOutcome.FLOWN:
            self.recorder.num_rejected += 1
            self.decide("rejected", f"{outcome.value}: {reason}", plan_ms)
            self._last_plan_s = self._clock.now_s() - float(self._mission.planning.time_horizon_s) + RETRY_S
            return
        now = self._clock.now_s()
        latency = 1e3 * (now - track_s) if math.isfinite(track_s) else None
        if latency is not None:
            self.recorder.track_to_mission_ms.append(latency)
        self.recorder.missions.append(UploadedMission(now, waypoints.positions_enu_m, judgement.kind))
        self.decide("swap", f"{judgement.kind}, {judgement.text}; {reason}", plan_ms, latency)

    async def _unless_withdrawn(
        self, exchange: Coroutine[object, object, tuple[SwapOutcome, str]]
    ) -> tuple[SwapOutcome, str]:
        """Carry out an exchange; :meth:`_change` breaks it off where it stands when the pilot takes over."""
        withdrawn = SwapOutcome.WITHDRAWN, "the mode was changed"
        if not self._may_act():  # since the plan was made
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

    def _may_act(self) -> bool:
        return self.mode is Mode.ACTIVE

    async def _knows_mission(self) -> bool:
        """Whether the autopilot's list is known and left to us; another uploader's is respected."""
        is_first = self.handover.layout is None
        reading = await self.handover.prepare()
        if is_first and self.handover.found_flown:
            reached = self._memory.reached([goal.position_enu_m for goal in self.cycle.goals])
            self.cycle.next_goal = max(self.cycle.next_goal, reached)
            self.decide("restart", f"the autopilot flies a mission of ours; {reached} goals reached")
        if reading is Reading.UNREADABLE:
            return False
        if reading is Reading.FOREIGN:
            if not self._mission.goals_from_autopilot:
                self._change(ModeEvent.OTHER_MISSION)
                return False
            self.decide("mission", f"another mission was uploaded: {len(self.cycle.goals)} goals from it")
        if not self.cycle.goals:
            self.decide("no plan", "the autopilot's mission has no waypoint to fly to")
            return False
        return True

    def _say_of_mission(self, kind: str, text: str) -> None:
        self.decide(kind, text)
        if kind == "swap" and self.cycle.flown is not None:  # an entry found out about later
            places = self.cycle.flown.path.positions_enu_m
            self.recorder.missions.append(UploadedMission(self._clock.now_s(), places, "unanswered"))


async def _guarded(name: str, task: Callable[[], Awaitable[None]]) -> None:
    """Run a task; a fault in it is logged once, with its trace, and ends the service."""
    try:
        await task()
    except asyncio.CancelledError:
        raise
    except Exception:
        _log.exception("task %s failed", name)
        raise


async def stop(running: asyncio.Task[None]) -> None:
    """Cancel a running app and wait until it has closed everything."""
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running
