"""The service: composes link, picture and cycle, and runs their tasks."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import time
from collections.abc import Awaitable, Callable, Coroutine

from companion.clock import Clock
from companion.config import MissionConfig
from companion.daemon.cycle import Cycle, Flown, Judgement, Start
from companion.daemon.modes import Mode, ModeEvent, next_mode
from companion.daemon.picture import Picture
from companion.daemon.record import Recorder
from companion.errors import CompanionError
from companion.link.autopilot import AutopilotLink
from companion.link.codec import Codec
from companion.link.frame import Frame
from companion.link.identity import answer
from companion.link.streams import Streams
from companion.link.transport import Transport
from companion.mission.builder import (
    BANK_EXTRAS,
    BANK_ITEMS_MAX,
    Banks,
    Waypoints,
    new_banks,
    sequence_of_waypoint,
)
from companion.mission.swap import SwapOutcome, enter, store
from companion.types.events import Event, Heartbeat, MissionCurrent, StatusText
from companion.types.mission import Mission
from companion.types.path import Path
from companion.types.plan import Plan
from companion.types.record import UploadedMission
from companion.world.snapshot import Snapshot

SILENT_S = 5.0  # without a heartbeat the autopilot counts as lost
HOUSEKEEPING_S = 1.0
STATE_S = 0.2
RETRY_S = 3.0  # between plans while nothing safe is flown
ENTER_EARLY_S = 1.0  # before the plan's start: later the entry would lie behind
EARLY_REPLAN_S = 5.0  # soonest after a plan that news of threats makes another
SEVERITY = {"swap": 5, "suspended": 4, "arrived": 5, "no plan": 4, "rejected": 4, "emergency": 2}

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
    ) -> None:
        self.mode = Mode.WAITING
        self.autopilot_mode = ""
        self.num_swaps = 0
        self.may_plan = True
        self.picture = Picture(mission, seed)
        self.cycle = Cycle(mission, seed)
        self.recorder = recorder
        self.codec = Codec(track_sources=mission.link.track_sources)
        self.autopilot = AutopilotLink(self.codec, clock, self._send)
        self._mission = mission
        self._transport = transport
        self._clock = clock
        self._plans_inline = plans_inline
        self._streams = Streams(float(mission.link.stream_rate_hz))
        self._banks: Banks | None = None
        self._current = (-math.inf, -1)  # when the autopilot last told the item it flies, and which
        self._doubtful: tuple[float, Banks, Flown, Waypoints] | None = (
            None  # entered, but for all we know only asked
        )
        self._exchanging: asyncio.Task[tuple[SwapOutcome, str]] | None = None
        self._heartbeat_s = -math.inf
        self._last_plan_s = -math.inf
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
            flown = event.is_mission_mode and event.is_armed
            self._change(ModeEvent.MISSION_FLOWN if flown else ModeEvent.MISSION_NOT_FLOWN)
        elif isinstance(event, MissionCurrent):
            self._current = (now, event.sequence)
        elif isinstance(event, StatusText):
            _log.info("autopilot: %s", event.text)
        else:
            self.picture.observe(event, now)

    def _change(self, event: ModeEvent) -> None:
        """Follow the state table; say so when the service's mode changes."""
        before = self.mode
        self.mode = next_mode(before, event, may_resume=self._mission.authority.resume == "auto")
        if self.mode is before:
            return
        if self.mode is Mode.ACTIVE:
            self._last_plan_s = -math.inf  # whatever was flown meanwhile, plan from here at once
        if self.mode is not Mode.ACTIVE and self._exchanging is not None:
            self._exchanging.cancel()
        kind = (
            "arrived" if self.mode is Mode.ARRIVED else "suspended" if self.mode is Mode.SUSPENDED else "mode"
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
        if self._transport.is_open:
            self._transport.send(data)
            self.recorder.frame(self._clock.now_s(), data)

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
                if self.mode is Mode.ACTIVE and self.cycle.note_position(state):
                    self._change(ModeEvent.GOAL_REACHED)
            await self._clock.sleep_until(now + STATE_S)

    async def _planning(self) -> None:
        """Plan every time horizon, and sooner on news; sooner still while nothing safe is flown."""
        while True:
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
            wanted = horizon if self.cycle.flown is not None else RETRY_S
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
        if not self._is_settled():
            return
        state = self.picture.ownship.state(now)
        if state is None:
            return
        snapshot = self.picture.snapshot(now)
        self._planned_for = self._news()
        track_s = self.picture.newest_track_s
        num_items = 2 * self._banks.size + len(self._banks.prefix) if self._banks is not None else 40
        lead = self.cycle.lead_s(num_items)
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
            return
        room = self._banks.size - BANK_EXTRAS if self._banks is not None else BANK_ITEMS_MAX - BANK_EXTRAS
        waypoints, carried_s, violations = self.cycle.waypoints(plan.path, room)
        if violations:
            self.recorder.num_rejected += 1
            self.decide("rejected", f"mission: {violations[0]}", plan_ms)
            return
        await self._swap(plan.path, waypoints, carried_s, judgement, plan_ms, track_s, start)

    async def _solved(self, start: Start, snapshot: Snapshot, budget_s: float) -> tuple[Plan, float]:
        """Plan within the budget; the plan and the computer's milliseconds it took."""
        began, due = time.perf_counter(), self._clock.now_s() + budget_s
        if self._plans_inline:
            plan = self.cycle.plan(start, snapshot, lambda: False)
            took = 1e3 * (time.perf_counter() - began)
            await self._clock.sleep_until(due)
            return plan, took
        plan = await asyncio.to_thread(
            self.cycle.plan,
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
        """Store the mission in the idle bank, and enter it when the aircraft is there."""
        banks = await self._banks_for(len(waypoints.positions_enu_m))
        if banks is None:
            return
        mission, after = self.cycle.mission_for(waypoints, banks)
        enter_s = start.state.stamp_s - ENTER_EARLY_S if self.cycle.flown is not None else 0.0
        outcome, reason = await self._unless_withdrawn(
            self._exchange(enter_s, waypoints, after, Flown(path, mission, carried_s))
        )
        self._banks = after if outcome is SwapOutcome.FLOWN else banks
        if outcome is not SwapOutcome.FLOWN:
            self.recorder.num_rejected += 1
            self.decide("rejected", f"{outcome.value}: {reason}", plan_ms)
            self._last_plan_s = self._clock.now_s() - float(self._mission.planning.time_horizon_s) + RETRY_S
            return
        now = self._clock.now_s()
        self._doubtful = None
        self.num_swaps += 1
        self.cycle.flown = Flown(path, mission, carried_s)
        latency = 1e3 * (now - track_s) if math.isfinite(track_s) else None
        if latency is not None:
            self.recorder.track_to_mission_ms.append(latency)
        self.recorder.missions.append(UploadedMission(now, waypoints.positions_enu_m, judgement.kind))
        self.decide("swap", f"{judgement.kind}, {judgement.text}; {reason}", plan_ms, latency)

    async def _exchange(
        self, enter_s: float, waypoints: Waypoints, after: Banks, flown: Flown
    ) -> tuple[SwapOutcome, str]:
        """Store a mission, and enter it at an instant."""
        mission = flown.mission
        outcome, reason = await store(self.autopilot, mission)
        if outcome is not None:
            return outcome, reason
        await self._clock.sleep_until(enter_s)
        self._doubtful = self._clock.now_s(), after, flown, waypoints
        return await enter(
            self.autopilot, mission, lambda: self._entry(mission, flown.path, waypoints), self._may_act
        )

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

    def _is_settled(self) -> bool:
        """Whether it is known which bank is flown; takes it from the autopilot where an answer was lost.

        An entry that was asked for and not acknowledged may well be flown: to write there would change
        the mission under the aircraft.
        """
        if self._doubtful is None:
            return True
        asked_s, banks, flown, waypoints = self._doubtful
        told_s, sequence = self._current
        if told_s <= asked_s:
            return False
        self._doubtful = None
        first = banks.first_of(banks.flown_index)
        if first <= sequence < first + banks.size:
            self._banks, self.cycle.flown = banks, flown
            self.num_swaps += 1
            self.recorder.missions.append(UploadedMission(told_s, waypoints.positions_enu_m, "unanswered"))
            self.decide("swap", f"entered at item {sequence}, though unanswered")
        return True

    def _may_act(self) -> bool:
        return self.mode is Mode.ACTIVE

    def _entry(self, mission: Mission, path: Path, waypoints: Waypoints) -> int | None:
        """Sequence at which the stored mission is entered from where the aircraft is."""
        state = self.picture.ownship.state(self._clock.now_s())
        first = None if state is None else self.cycle.entry(state, path, waypoints)
        return None if first is None else sequence_of_waypoint(mission, first)

    async def _banks_for(self, num_waypoints: int) -> Banks | None:
        """The banks; before the first swap, laid behind what the autopilot holds."""
        if self._banks is not None:
            return self._banks
        try:
            existing = await self.autopilot.download()
        except CompanionError as error:
            self.decide("rejected", f"the autopilot's mission cannot be read: {error}")
            return None
        return new_banks(existing, num_waypoints)


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
