"""The service for one autopilot: processes its messages, and runs the tasks that answer them."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import logging
import math
from collections.abc import Awaitable, Callable

from companion.assurance.emergency import EmergencyStep
from companion.config import MissionConfig
from companion.config.parameters.pilot_parameters import ENABLE, Sender
from companion.flight.messages.link_watch import LinkWatch
from companion.flight.state.decision import MODE_ANNOUNCEMENTS, DecisionKind, arrival_words
from companion.flight.state.flight_state import (
    FlightState,
    after_armed_reported,
    after_heartbeat,
    after_home_reported,
    after_landed_reported,
    after_mode_event,
    after_movement_reported,
    after_position,
    after_reload,
    after_settings_reported,
    after_target_reported,
)
from companion.flight.state.list_state import MissionPosition
from companion.flight.state.modes import Mode, ModeEvent
from companion.flight.tasks.composition import Composition
from companion.flight.tasks.pilot_status import PilotStatus
from companion.flight.tasks.progress_notices import ProgressNotices
from companion.token_bucket import TokenBucket
from companion.types.events import (
    ClockReported,
    Event,
    GlobalPosition,
    Heartbeat,
    HomePosition,
    LandedReported,
    MissionCurrent,
    Motion,
    SettingsReported,
    StatusText,
    SteeringTarget,
    TeamMessage,
)
from companion.types.mavlink_enums import SystemState
from companion.types.state import Ownship

SILENT_S = 5.0  # The autopilot counts as lost after this time without a heartbeat.
HOUSEKEEPING_S = 1.0  # Period of the housekeeping task.
FENCES_S = 0.2  # Period of the task that decides whether fences are read.
STATE_S = 0.2  # Period of the task that records the state.
ENERGY_S = 1.0  # Period of the task that compares the battery with the way home.
OTHER_MODES_S = 0.5  # Period of the task that predicts what somebody else flies.
RELEASE_S = 30.0  # A vehicle that is silent on the ground for this time may be replaced by another.
LOGGED_HZ, LOGGED_BURST = 2.0, 60.0  # Limits for logging the autopilot's texts; a boot sends about forty.
FRESH_AGAIN = "all is heard again"  # The recorded occasion of a plan after an input was stale.
OTHER_GOALS = "the team's goals are divided anew"
DEVIATES = "the aircraft does not do what its plan says"  # The recorded occasion of such a plan.
LAST_TEXT_S = 0.2  # Time for the last texts to be sent before the link is closed.

_log = logging.getLogger(__name__)


class App:
    """The service, over one link.

    Parameters
    ----------
    parts : Composition
        The parts of the service.
    is_warm : bool
        Whether every kernel is compiled, so that plans can be made.
    """

    def __init__(self, parts: Composition, *, is_warm: bool = True) -> None:
        self.world_model, self.recorder, self.link = parts.world_model, parts.recorder, parts.link
        self.replanning, self.announcer = parts.replanning, parts.announcer
        self._departure, self._way_home = parts.departure, parts.way_home
        self._flight, self._clock = parts.flight, parts.clock
        self._parameters, self._checkpoint = parts.parameters, parts.checkpoint
        self._observer = parts.observer
        self._is_warm = is_warm
        self._heartbeat_s = -math.inf
        self._boot_s: float | None = None
        self._awaits_item = False
        self._reported_failure = self._reported_landed = False
        self._planning: asyncio.Task[None] | None = None
        self._changed: MissionConfig | None = None
        self._link_watch = LinkWatch(self.link, self.announcer)
        self._logged = TokenBucket(LOGGED_HZ, LOGGED_BURST)
        self._pilot_status, self._progress_notices = PilotStatus(parts), ProgressNotices(parts)
        self._parameters.listen(self._note_parameter)

    async def run(self) -> None:
        """Run until cancelled."""
        places = [goal.position_enu_m for goal in self.state.goals]
        contents = self._checkpoint.contents.items()
        remembered = {
            "goals_reached": self._checkpoint.reached(places),
            "parameters": self._parameters.values_set,
            "memory": {end: base64.b64encode(data).decode("ascii") for end, data in contents},
        }
        self.recorder.begin(self._clock.now_s(), remembered)
        await self.link.open(self._take, self._parameters)
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks_by_name = {
                    "housekeeping": self._housekeeping, "states": self._states,
                    "fences": self._keep_up_fences, "other modes": self._watch_other_modes,
                    "energy": self._watch_energy,
                }  # fmt: skip
                for name, task in tasks_by_name.items():
                    tasks.create_task(_guarded(name, task), name=name)
                self._planning = tasks.create_task(_guarded("planning", self._plan), name="planning")
        finally:
            self._parameters.keep()
            await self.link.close()
            self._parameters.wait()
            self._checkpoint.wait()

    async def withdraw(self) -> None:
        """Stop planning, cancel an exchange that is under way, and inform the pilot, before the end.

        At every point of an exchange the autopilot has a complete mission that was checked.
        """
        if self._planning is not None:
            self._planning.cancel()
            await asyncio.wait([self._planning])
        self.announcer.decide(DecisionKind.STOPPED, "the autopilot keeps its mission", tell="stopped")
        await self._clock.sleep_until(self._clock.now_s() + LAST_TEXT_S)

    @property
    def state(self) -> FlightState:
        """The flight's state now."""
        return self._flight.state

    @property
    def mode(self) -> Mode:
        """The mode, which says what the service may do."""
        return self._flight.state.mode

    @property
    def autopilot_mode(self) -> str:
        """The autopilot's name of its flight mode; '' before the first heartbeat."""
        return self._flight.state.autopilot_mode

    @property
    def is_warm(self) -> bool:
        """Whether every kernel is compiled."""
        return self._is_warm

    @property
    def num_swaps(self) -> int:
        """Number of missions that were flown."""
        return len(self.recorder.missions)

    @property
    def num_plans(self) -> int:
        """Number of plans that were begun."""
        return self.replanning.num_plans

    @property
    def emergency(self) -> EmergencyStep | None:
        """The emergency step that is carried out; None while plans are flown."""
        return self.replanning.emergency

    @property
    def receives_autopilot(self) -> bool:
        """Whether a heartbeat was received recently."""
        return self._clock.now_s() - self._heartbeat_s <= SILENT_S

    def has_lost_vehicle(self, now_s: float) -> bool:
        """Return whether the vehicle fell silent on the ground, so that another may replace it."""
        is_silent = now_s - self._heartbeat_s > RELEASE_S
        return self.link.has_received and is_silent and not self.state.phase.is_armed

    def warmed_up(self) -> None:
        """Note that every kernel is compiled: plans can be made from now on."""
        self._is_warm = True

    # --- received messages

    def _take(self, event: Event, now: float) -> None:
        """Process a received event."""
        if isinstance(event, Heartbeat):
            self._take_heartbeat(event, now)
        elif isinstance(event, LandedReported):
            self._flight.apply(after_landed_reported, event.landed_state)
        elif isinstance(event, HomePosition):
            self._flight.apply(after_home_reported, event)
        elif isinstance(event, SettingsReported):
            self._flight.apply(after_settings_reported, event.settings)
        elif isinstance(event, MissionCurrent | StatusText):
            self.replanning.handover.reader.note(event)
            self._awaits_item = self._awaits_item and not isinstance(event, MissionCurrent)
            self._follow(self.replanning.handover.reader.position)
            if isinstance(event, StatusText) and self._logged.takes(now):
                _log.info("autopilot: %s", event.text)
        elif isinstance(event, SteeringTarget):
            self._flight.apply(after_target_reported, event)
        elif isinstance(event, ClockReported | TeamMessage):
            self.replanning.team.take(event)
        else:
            if isinstance(event, GlobalPosition):
                self._note_boot(event.boot_s)
                speed_m_s = math.hypot(*event.velocity_enu_m_s[:2])
                self._flight.apply(after_movement_reported, event.height_above_home_m, speed_m_s)
            self.world_model.observe(event, now)
            self.replanning.performance.observe(event)
            self.replanning.energy.observe(event)
            self._progress_notices.note(event, now)

    def _take_heartbeat(self, event: Heartbeat, now: float) -> None:
        """Follow the autopilot's mode, and whether it is armed."""
        self._heartbeat_s = now
        self._link_watch.note_heartbeat(event)
        if event.is_contradicted:
            self.change(ModeEvent.MISSION_NOT_FLOWN)
            return
        was_returning = self.state.motion is Motion.RETURN
        self._flight.apply(after_heartbeat, event)
        self._note_armed(now, is_armed=event.is_armed)
        flown = event.is_mission_mode and event.is_armed
        # A return to launch may go on by the mission; the next item that is reported says whether it does.
        self._awaits_item = flown and (was_returning or self._awaits_item)
        if not flown:
            self.change(ModeEvent.MISSION_NOT_FLOWN)
        elif not self._awaits_item:
            self._follow(self.replanning.handover.reader.position)
            self.change(ModeEvent.MISSION_FLOWN)
            self._follow(self.replanning.handover.reader.position)

    def _note_boot(self, boot_s: float) -> None:
        """Delete the checkpoint if the autopilot was restarted: its mission begins again."""
        if self._boot_s is None and boot_s < self._checkpoint.boot_s:
            self._checkpoint.forget()
        self._boot_s = boot_s

    def _note_armed(self, now: float, *, is_armed: bool) -> None:
        """Follow the flight's phase; a landing ends the flight and deletes its checkpoint."""
        phase = self._flight.apply(after_armed_reported, now, is_armed=is_armed).phase
        if phase.is_grounded(now) and self._checkpoint.contents:
            self._checkpoint.forget()
        if phase.is_over(now) and not self._reported_landed:
            self.announcer.decide(DecisionKind.LANDED, "the flight is over", tell="landed")
            self.change(ModeEvent.LANDED)
        self._reported_landed = phase.is_over(now)

    def _follow(self, position: MissionPosition) -> None:
        """Leave a mission alone that continues after the goal, elsewhere, or on the return path."""
        if position is MissionPosition.PAST_GOAL and not self.state.is_returning:
            self.change(ModeEvent.GOAL_REACHED)
        elif position is MissionPosition.ELSEWHERE:
            self.change(ModeEvent.OTHER_MISSION)
        elif position is MissionPosition.RETURNING and self.state.motion is Motion.MISSION:
            if self.state.is_returning:
                return
            self.change(ModeEvent.RETURN_FLOWN)
            if self.mode is Mode.YIELDED and self._way_home.renew_rest():
                self._checkpoint.note_progress(self.state, self._boot_s or 0.0)
                self.change(ModeEvent.RETURN_RENEWED)

    def change(self, event: ModeEvent) -> None:
        """Apply an event to the table of modes; announce a change of the mode."""
        glides_on = event is ModeEvent.GOAL_REACHED and self._departure.glide.is_commanded
        before = self.mode
        mode = before if glides_on else self._flight.apply(after_mode_event, event).mode
        if mode is before:
            return
        if mode is Mode.ACTIVE:
            self.replanning.plan_at_once()
        else:
            self.replanning.break_off()
            self._way_home.break_off()
        kind, words, tell = MODE_ANNOUNCEMENTS.get(mode, (DecisionKind.MODE, mode.value, ""))
        words, tell = self._words_of(mode, words, tell)
        mission, resumes = self.link.autopilot.mission_mode, self.state.mission.authority.resume == "auto"
        back = f"{mission} resumes" if mode is Mode.SUSPENDED else f"Leave {mission} and return to resume"
        self.announcer.decide(
            kind, f"{words} ({self.autopilot_mode or 'no autopilot'})",
            tell=tell, mode=self.autopilot_mode, back=back if resumes else "It will not resume",
            number=len(self.state.goals_left[:-1]),
        )  # fmt: skip
        if mode is Mode.ACTIVE and not self._parameters.is_replanning:
            text = f"replanning is switched off by {ENABLE}"
            self.announcer.decide(DecisionKind.PARAMETERS, text, tell="off", parameter=ENABLE)
        self._record_status()

    def _words_of(self, mode: Mode, words: str, tell: str) -> tuple[str, str]:
        """Return the recorded words of entering a mode, and the key of the pilot's text."""
        if mode is Mode.ARRIVED:
            return arrival_words(self.state)
        if mode not in (Mode.SUSPENDED, Mode.YIELDED):
            return words, tell
        if self.replanning.handover.reader.position is MissionPosition.RETURNING:
            return "on the return path", "returning"
        if self.replanning.energy.is_turning_back and self.mode is Mode.YIELDED:
            return "turning back", ""  # The pilot knows already.
        if EmergencyStep.RETURN_TO_LAUNCH is self.emergency or self.replanning.energy.is_turning_back:
            return "return to launch", tell
        if self._link_watch.is_contradicted:
            return "heartbeats contradict", "contradiction"
        if self.state.is_failsafe:
            return "a failsafe of the autopilot", "failsafe"
        return words, tell

    # --- changes of the mission file and the parameters

    def adopt(self, mission: MissionConfig) -> None:
        """Use another mission file from the next pause between two plans on."""
        self._changed = self._parameters.set_mission(mission)

    def reload(self, mission: MissionConfig, text: str) -> None:
        """Use a mission file that was read again, and announce it."""
        self.recorder.reloaded(self._clock.now_s(), mission, text)
        self.adopt(mission)
        self.announcer.decide(DecisionKind.RELOAD, f"{mission.name} is read again", tell="reloaded")
        set_values = ", ".join(f"{name} {value:g}" for name, value in self._parameters.values_set.items())
        if set_values:
            words = f"still as set: {set_values}"
            self.announcer.decide(DecisionKind.PARAMETERS, words, tell="parameter", parameter=words)

    def refuse_reload(self, key: str) -> None:
        """Announce that a mission file was read again but is not used, because of one of its keys."""
        self.announcer.decide(DecisionKind.RELOAD, f"refused: {key}", tell="not reloaded", key=key)

    def _note_parameter(self, name: str, sender: Sender) -> None:
        """Apply a parameter that the pilot has set, like another mission file."""
        self._changed = self._parameters.mission()
        words = f"{name} is {self._parameters.value(name):g}, by {sender[0]}/{sender[1]}"
        _log.warning("%s", words)
        self.announcer.decide(DecisionKind.PARAMETERS, words, tell="parameter", about=name, parameter=words)

    def _renew(self) -> None:
        """Apply a changed mission file, between plans."""
        mission, self._changed = self._changed, None
        if mission is None:
            return
        state = self._flight.apply(after_reload, mission)
        self.world_model.follow_mission(state.rules)
        self.replanning.geofences.refit()
        self.replanning.plan_at_once()

    # --- tasks

    async def _plan(self) -> None:
        """Plan whenever a plan is due, while the aircraft is left to the service, or will be."""
        while True:
            self._begin_round()
            await self._departure.glide.carry_out()
            if self._may_plan() and self.mode is Mode.ACTIVE:
                event = await self.replanning.plan()
                if event is not None:
                    self.change(event)
            elif self._may_plan() and self.mode in (Mode.DEPARTING, Mode.SUSPENDED):
                await self.replanning.look_ahead.plan()
            is_due = False
            while not is_due:
                await self._clock.sleep_until(self.replanning.next_look_s())
                self._begin_round()
                await self._keep_up_list()
                is_due = self.replanning.is_due() or self._departure.glide.is_commanded
                if not is_due and self._may_plan() and not self.replanning.freshness.is_blind:
                    is_due = await self.replanning.unless_surprised(self._way_home.keep_up())
            await self._way_home.stop()

    async def _keep_up_list(self) -> None:
        """Read the list whenever it changes, before the takeover, while it belongs to the operator."""
        if self.mode.is_before_takeover and self.receives_autopilot:
            await self._departure.keep_up()
            if self.mode is Mode.DEPARTING and self._departure.take_over_if_due():
                self.change(ModeEvent.TAKEOVER_DUE)

    def _begin_round(self) -> None:
        """Apply changes between plans and exchanges."""
        self._observer.progress()
        self._renew()
        if self.mode is Mode.ACTIVE and self.replanning.geofences.follow_limits():
            self.replanning.plan_at_once()

    def _may_plan(self) -> bool:
        """Return whether plans can be made, and are wanted."""
        is_wanted = self._parameters.is_replanning and not self._departure.glide.is_commanded
        is_known = self.world_model.ownship.state(self._clock.now_s()) is not None
        return is_wanted and self._is_warm and is_known

    async def _housekeeping(self) -> None:
        """Send heartbeat and stream requests, and detect the autopilot's silence, at 1 Hz."""
        while True:
            now = self._clock.now_s()
            self.link.keep_up(now, self._system_state())
            if not self.receives_autopilot:
                self.change(ModeEvent.AUTOPILOT_SILENT)
            self._link_watch.look(now)
            self._parameters.keep()
            self._note_link(now)
            await self._clock.sleep_until(now + HOUSEKEEPING_S)

    async def _watch_other_modes(self) -> None:
        """Predict what is flown while somebody else flies, twice a second."""
        while True:
            self._departure.other_modes.look()
            if self._departure.glide.look():
                self.change(ModeEvent.GLIDE_BEGUN)
            await self._clock.sleep_until(self._clock.now_s() + OTHER_MODES_S)

    async def _watch_energy(self) -> None:
        """Compute once a second what the battery allows; return to launch when it is time."""
        while True:
            now = self._clock.now_s()
            if self.replanning.energy.look(now, has_thrust=self.replanning.performance.has_thrust):
                self.change(ModeEvent.OTHER_MISSION)  # Nothing is planned or uploaded from now on.
                await self.replanning.handover.return_to_launch()
            status = self.replanning.energy.status(now)
            if status is not None:
                self.recorder.energy(now, status)
            await self._clock.sleep_until(now + ENERGY_S)

    async def _keep_up_fences(self) -> None:
        """Read the fences repeatedly, in parallel to planning, from the first plan to the landing."""
        while True:
            is_wanted = self.replanning.num_plans and self.state.phase.is_armed
            if is_wanted and self.receives_autopilot and not self.replanning.freshness.is_blind:
                await self.replanning.geofences.keep_up()
            await self._clock.sleep_until(self._clock.now_s() + FENCES_S)

    def _system_state(self) -> SystemState:
        """Return the state in the service's heartbeat."""
        if not self._is_warm:
            return SystemState.BOOT
        if self.mode is not Mode.ACTIVE or not self._parameters.is_replanning:
            return SystemState.STANDBY
        return SystemState.CRITICAL if self.replanning.is_in_trouble() else SystemState.ACTIVE

    def _note_link(self, now: float) -> None:
        """Record the state of the link, and announce once if the recording has ended."""
        status = {"mode": self.mode.value, "autopilot_mode": self.autopilot_mode, **self.link.status()}
        self.recorder.link(now, status)
        self._record_status()
        if self.recorder.failure and not self._reported_failure and self.link.has_received:
            self._reported_failure = True
            text = f"stopped, flight goes on: {self.recorder.failure}"
            self.announcer.decide(DecisionKind.RECORDING, text, tell="recording")

    def _record_status(self) -> None:
        """Record the status of the service."""
        status = self._pilot_status.message(is_received=self.receives_autopilot, is_warm=self._is_warm)
        self.recorder.standing(self._clock.now_s(), status)

    async def _states(self) -> None:
        """Record the flight, and note goals that are reached."""
        while True:
            now = self._clock.now_s()
            if self.replanning.team.keep_up():
                self.change(ModeEvent.OTHER_GOALS)
                self.replanning.plan_at_once(OTHER_GOALS)
            if self.replanning.freshness.look(now):
                self.replanning.plan_at_once(FRESH_AGAIN)
            tracks = self.world_model.tracks(now)
            if self.replanning.performance.look(now, tracks):
                self.replanning.plan_at_once(DEVIATES)
            ownship = self.world_model.ownship.state(now)
            if ownship is not None:
                self.recorder.state(now, ownship, tracks, self.world_model.threat_at(ownship, tracks))
                if self.mode is Mode.ACTIVE:
                    self._note_goals(ownship)
                    self.replanning.look_for_surprise()
            await self._clock.sleep_until(now + STATE_S)

    def _note_goals(self, ownship: Ownship) -> None:
        """Count the goals passed, and store them in the checkpoint."""
        before = self.state.next_goal
        state = self._flight.apply(after_position, ownship)
        if state.next_goal != before:
            self._checkpoint.note_progress(self.state, self._boot_s or 0.0)
        if state.has_arrived:
            self.change(ModeEvent.GOAL_REACHED)


async def _guarded(name: str, task: Callable[[], Awaitable[None]]) -> None:
    """Run a task; an error in it is logged once, with its trace, and ends the service."""
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
