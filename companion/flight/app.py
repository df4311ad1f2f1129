"""The service: composes link, picture and cycle, and runs their tasks."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import logging
import math
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path as FilePath

from companion.assurance.emergency import EmergencyStep
from companion.clock import Clock
from companion.config import MissionConfig
from companion.flight.checkpoint import Memory
from companion.flight.cycle import Cycle
from companion.flight.flight_phase import Ground
from companion.flight.geofences import Fencing
from companion.flight.handover import Handover, Place
from companion.flight.modes import Mode, ModeEvent, next_mode
from companion.flight.observer import Watch
from companion.flight.pilot_parameters import ENABLE, Parameters
from companion.flight.replanning import Parts, PlanningLoop
from companion.flight.situation import Picture
from companion.link.messages.codec import Codec
from companion.link.messages.component import answer
from companion.link.messages.streams import Streams
from companion.link.messages.vehicle_telemetry import AUTOPILOT_COMPONENT
from companion.link.missions.autopilot_link import AutopilotLink
from companion.link.missions.mavsdk_reader import MISSION_MESSAGES
from companion.link.wire.decoded_frame import DecodedFrame
from companion.link.wire.framing import frames_in
from companion.link.wire.link_quality import LinkQuality
from companion.link.wire.signing import Signer
from companion.link.wire.source_limits import SourceLimits
from companion.link.wire.transport import Transport
from companion.mission.list_layout import Layout
from companion.planning.plan_runner import InStep, InThread, Pace
from companion.recording.recorder import Recorder
from companion.types.events import Dialect, Event, GlobalPosition, Heartbeat, MissionCurrent, StatusText
from companion.types.record import UploadedMission
from companion.types.state import Ownship

SILENT_S = 5.0  # without a heartbeat the autopilot counts as lost
HOUSEKEEPING_S = 1.0
STATE_S = 0.2
FAREWELL_S = 0.2  # for the last words to leave before the link is closed
SEVERITY = {
    "swap": 5,
    "suspended": 4,
    "arrived": 5,
    "no plan": 4,
    "rejected": 4,
    "landing": 4,
    "emergency": 2,
    "stopped": 4,
    "reload": 5,
    "parameters": 4,
}
TOLD = {
    Mode.SUSPENDED: ("suspended", "by the pilot"),
    Mode.YIELDED: ("suspended", "another mission or item was chosen"),
    Mode.ARRIVED: ("arrived", "at the last goal"),
}

LinkKind = Callable[[Codec, Clock, Callable[[bytes], None]], AutopilotLink]

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
    link_kind : callable
        Makes what carries out mission transfers, as ``AutopilotLink`` is made; tests put one in whose
        time is simulated, too, and a replay one that goes on where the recorded autopilot does not answer.
    watch : Watch, optional
        Looks on.
    parameters_file : Path, optional
        Where parameters that a pilot sets are kept.
    pace : Pace, optional
        How long plans may take, where it is neither of the two that ``plans_inline`` chooses from.
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
        link_kind: LinkKind = AutopilotLink,
        watch: Watch | None = None,
        parameters_file: FilePath | None = None,
        pace: Pace | None = None,
    ) -> None:
        self.parameters = Parameters(mission, parameters_file, self._note_parameter)
        mission = self.parameters.mission()
        self.mode = Mode.WAITING
        self.autopilot_mode = ""
        self.is_warm = True
        self.picture = Picture(mission, seed)
        self.cycle = Cycle(mission, seed)
        self.recorder = recorder
        link = mission.link
        limits = SourceLimits(float(link.source_rate_max_hz), link.systems)
        self.codec = Codec(track_sources=link.track_sources, signer=signer, limits=limits)
        self.autopilot = link_kind(self.codec, clock, self.send)
        self._mission = mission
        self.transport = transport
        self._clock = clock
        self._memory = memory or Memory()
        self.ground = Ground(clock.now_s())
        self.streams = Streams(float(mission.link.stream_rate_hz))
        self.handover = Handover(
            mission,
            self.cycle,
            self.autopilot,
            clock,
            state=lambda: self.picture.ownship.state(clock.now_s()),
            may_act=self.may_act,
            say=self._say_of_mission,
            home_amsl_m=lambda: self.codec.home_altitude_amsl_m,
            memory=self._memory,
        )
        self.fencing = Fencing(mission, self.autopilot, self.cycle, self.picture, self.decide)
        self.quality = LinkQuality()
        self.decided: Counter[str] = Counter()
        self._heartbeat_s = -math.inf
        self._boot_s: float | None = None
        self._said_failure = self._said_landed = False
        parts = Parts(
            mission, clock, self.picture, self.cycle, self.handover, self.fencing, self.autopilot, recorder,
            self._memory,
        )  # fmt: skip
        self._watch = watch or Watch()
        self._loop = PlanningLoop(
            parts, self, pace or (InStep() if plans_inline else InThread()), self._watch
        )
        self._planning: asyncio.Task[None] | None = None
        self._changed: MissionConfig | None = None

    async def run(self) -> None:
        """Run until cancelled."""
        places = [goal.position_enu_m for goal in self.cycle.goals]
        kept = {end: base64.b64encode(data).decode("ascii") for end, data in self._memory.kept.items()}
        self.recorder.begin(self._clock.now_s(), {
            "goals_reached": self._memory.reached(places), "parameters": self.parameters.values_set,
            "memory": kept,
        })  # fmt: skip
        self.transport.set_receiver(self.receive)
        await self.transport.open()
        try:
            async with asyncio.TaskGroup() as tasks:
                for name, task in (("housekeeping", self._housekeeping), ("states", self._states)):
                    tasks.create_task(_guarded(name, task), name=name)
                self._planning = tasks.create_task(_guarded("planning", self._loop.run), name="planning")
        finally:
            await self.autopilot.close()
            await self.transport.close()

    async def withdraw(self) -> None:
        """Plan no more, break off an exchange that is under way, and tell the pilot, before the end.

        Wherever an exchange stands, the autopilot holds a whole mission that was checked.
        """
        if self._planning is not None:
            self._planning.cancel()
            await asyncio.wait([self._planning])
        self.decide("stopped", "the autopilot keeps its mission")
        await self._clock.sleep_until(self._clock.now_s() + FAREWELL_S)

    def adopt(self, mission: MissionConfig) -> None:
        """Go by another mission file from the next pause between two plans on."""
        self._changed = self.parameters.set_mission(mission)

    def reload(self, mission: MissionConfig, text: str) -> None:
        """Go by a mission file that was read again, and say so."""
        self.recorder.reloaded(self._clock.now_s(), mission, text)
        self.adopt(mission)
        self.decide("reload", f"{mission.name} is read again")
        kept = ", ".join(f"{name} {value:g}" for name, value in self.parameters.values_set.items())
        if kept:
            self.decide("parameters", f"still as set: {kept}")

    def _note_parameter(self, name: str) -> None:
        """A pilot has set one: take it up like another mission file."""
        self._changed = self.parameters.mission()
        self.decide("parameters", f"{name} is {self.parameters.value(name):g}")

    def renew(self) -> None:
        """Take up a changed mission file; called between plans."""
        mission, self._changed = self._changed, None
        if mission is None:
            return
        self._mission = mission
        for part in (self.cycle, self.picture, self.fencing, self.handover, self._loop):
            part.adopt(mission)

    @property
    def num_swaps(self) -> int:
        """How many missions were flown."""
        return len(self.recorder.missions)

    @property
    def layout(self) -> Layout | None:
        """How the autopilot's list is laid out, None before it was read."""
        return self.handover.layout

    @property
    def emergency(self) -> EmergencyStep | None:
        """The step of the emergency strategy being flown by, None while plans are."""
        return self._loop.emergency

    @property
    def hears_autopilot(self) -> bool:
        """Whether a heartbeat came lately."""
        return self._clock.now_s() - self._heartbeat_s <= SILENT_S

    @property
    def may_plan(self) -> bool:
        """Whether plans can be made, and are wanted."""
        return self.is_warm and self.parameters.is_replanning

    def may_act(self) -> bool:
        """Whether the aircraft is left to us."""
        return self.mode is Mode.ACTIVE

    def receive(self, data: bytes) -> None:
        """Take bytes from the transport."""
        now = self._clock.now_s()
        for frame in self.codec.feed(data, now):
            self.recorder.frame(now, frame.raw)
            self.streams.note(frame, now)
            if (frame.system_id, frame.component_id) == (self.codec.vehicle_system_id, AUTOPILOT_COMPONENT):
                self.quality.note(frame.raw)
            self.autopilot.receive(frame)
            if self.autopilot.is_exchanging and frame.message_id in MISSION_MESSAGES:
                self._watch.progress()
            reply = answer(frame, self.codec, self.parameters)
            if reply:
                self.send(reply)
            for event in frame.events:
                self._take(event, frame, now)

    def _take(self, event: Event, frame: DecodedFrame, now: float) -> None:
        if isinstance(event, Heartbeat):
            self._heartbeat_s = now
            self.autopilot_mode = event.mode
            self.cycle.flies_by = event.dialect is Dialect.ARDUPILOT
            self._note_armed(now, is_armed=event.is_armed)
            flown = event.is_mission_mode and event.is_armed
            self.change(ModeEvent.MISSION_FLOWN if flown else ModeEvent.MISSION_NOT_FLOWN)
        elif isinstance(event, MissionCurrent | StatusText):
            self.handover.note(event)
            self._follow(self.handover.place)
            if isinstance(event, StatusText):
                _log.info("autopilot: %s", event.text)
        else:
            if isinstance(event, GlobalPosition):
                self._note_boot(event.boot_s)
            self.picture.observe(event, now)

    def _note_boot(self, boot_s: float) -> None:
        """Forget a flight that the autopilot was switched off after: its mission begins anew."""
        if self._boot_s is None and boot_s < self._memory.boot_s:
            self._memory.forget()
        self._boot_s = boot_s

    def _note_armed(self, now: float, *, is_armed: bool) -> None:
        """Follow whether there is a flight; what was remembered of the last one ends with it."""
        self.ground.note(now, is_armed=is_armed)
        if self.ground.is_grounded(now) and self._memory.kept:
            self._memory.forget()
        if self.ground.is_over(now) and not self._said_landed:
            self.decide("landed", "the flight is over")
        self._said_landed = self.ground.is_over(now)

    def _follow(self, place: Place) -> None:
        """Leave a mission alone that goes on behind the goal, or at an item that somebody chose."""
        if place is Place.PAST_GOAL:
            self.change(ModeEvent.GOAL_REACHED)
        elif place is Place.ELSEWHERE:
            self.change(ModeEvent.OTHER_MISSION)

    def change(self, event: ModeEvent) -> None:
        """Follow the state table; say so when the service's mode changes."""
        before = self.mode
        self.mode = next_mode(before, event, may_resume=self._mission.authority.resume == "auto")
        if self.mode is before:
            return
        if self.mode is Mode.ACTIVE:
            self._loop.plan_at_once()
            self.handover.forget()
        else:
            self._loop.break_off()
        kind, words = TOLD.get(self.mode, ("mode", self.mode.value))
        self.decide(kind, f"{words} ({self.autopilot_mode or 'no autopilot'})")
        if self.mode is Mode.ACTIVE and not self.parameters.is_replanning:
            self.decide("parameters", f"replanning is switched off by {ENABLE}")

    def decide(
        self, kind: str, text: str, plan_ms: float | None = None, latency_ms: float | None = None,
        why: Mapping[str, object] | None = None,
    ) -> None:  # fmt: skip
        """Record a decision and tell the pilot."""
        self.decided[kind] += 1
        decision = self.recorder.decide(self._clock.now_s(), kind, text, plan_ms, latency_ms, why)
        if self.codec.vehicle_system_id is not None:
            self.send(self.codec.status_text(SEVERITY.get(kind, 6), decision.spoken))

    def send(self, data: bytes) -> None:
        """Send packed frames, signed where there is a key, and record them."""
        if self.transport.is_open and data:
            data = self.codec.on_the_wire(data)
            self.transport.send(data)
            for raw in frames_in(data):
                self.recorder.frame(self._clock.now_s(), raw)

    async def _housekeeping(self) -> None:
        """Heartbeat, streams, and the watch over the autopilot's silence, at 1 Hz."""
        while True:
            now = self._clock.now_s()
            if self.codec.vehicle_system_id is not None:
                self.send(self.codec.heartbeat(is_active=self.mode is Mode.ACTIVE))
                self.send(self.streams.due(self.codec, now))
            if not self.hears_autopilot:
                self.change(ModeEvent.AUTOPILOT_SILENT)
            self._note_link(now)
            await self._clock.sleep_until(now + HOUSEKEEPING_S)

    def _note_link(self, now: float) -> None:
        """Record how the link is, and tell once that the recording ended."""
        dialect = self.autopilot.dialect
        self.recorder.link(
            now,
            {
                "mode": self.mode.value,
                "autopilot_mode": self.autopilot_mode,
                "dialect": None if dialect is None else dialect.value,
                "vehicle_system_id": self.codec.vehicle_system_id,
                "counters": {**self.codec.counters, **self.autopilot.counters},
                "missing_streams": self.streams.missing,
            },
        )
        if self.recorder.failure and not self._said_failure and self.codec.vehicle_system_id is not None:
            self._said_failure = True
            self.decide("recording", f"stopped, flight goes on: {self.recorder.failure}")

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
                [goal.position_enu_m for goal in self.cycle.goals], self.cycle.next_goal, self._boot_s or 0.0
            )
        if is_last:
            self.change(ModeEvent.GOAL_REACHED)

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
