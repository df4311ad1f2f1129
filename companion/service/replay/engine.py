"""Replays a recorded flight with the present code, and compares what the service sends with the recording.

Theory of operation. The recorded frames arrive at their instants, in the steps of
:mod:`companion.service.replay.lockstep`, and MAVSDK takes part as in flight. The mission transfers and
commands that the service sends are compared with the recorded ones. While both are equal, the recorded
autopilot's answers are valid. From the first difference on they are not: they are then withheld from the
service, and :class:`ReplayLink` answers from a model of the autopilot's store. The aircraft flies on as
recorded. From there on the replay shows what the service would have decided at the recorded positions.
"""

from __future__ import annotations

import asyncio
import shutil
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from companion.clock import Clock, ManualClock
from companion.config import MissionConfig, mission_from_text, reload
from companion.errors import ConfigError
from companion.flight.tasks.app import stop
from companion.link.messages.codec import COMPONENT_ID, Codec
from companion.link.missions.mission_sniffer import MissionSniffer, Upload
from companion.link.wire.framing import RawFrame, frames_in, raw_frame
from companion.link.wire.memory_transport import MemoryTransport
from companion.recording.reader import RecordedFrame, Recording
from companion.service.replay.arrivals import Arrivals, is_reported, message_name
from companion.service.replay.lockstep import step
from companion.service.replay.recorded_link import ReplayLink
from companion.service.replay.replayed_app import replayed_app
from companion.types.mission import MissionItem
from companion.types.record import Decision

_LATE_MAX_S = 3.0  # On a wall clock, MAVSDK's threads may take this long.
_PROGRESS_STEPS = 50


def _ignore_progress(_done_s: float) -> None:
    """Ignore the progress of a replay."""


@dataclass(slots=True)
class Replayed:
    """The result of a replay.

    Parameters
    ----------
    decisions : list of Decision
        Decisions of the replay.
    uploads : list of Upload
        Complete uploads of the replay.
    flown_decisions, flown_uploads
        Decisions and complete uploads of the recording.
    diverged_s : float or None
        Time at which the service first sent something else than in flight; None if it never did.
    apart : str
        Description of that difference.
    held : tuple of MissionItem or None
        Mission list of the recorded autopilot at the end.
    wall_s : float
        Duration of the replay on the computer's clock [s].
    """

    decisions: list[Decision] = field(default_factory=list)
    uploads: list[Upload] = field(default_factory=list)
    flown_decisions: tuple[Decision, ...] = ()
    flown_uploads: tuple[Upload, ...] = ()
    diverged_s: float | None = None
    apart: str = ""
    held: tuple[MissionItem | None, ...] | None = None
    duration_s: float = 0.0
    wall_s: float = 0.0
    counters: dict[str, int] = field(default_factory=dict)


class Replay:
    """Replays one recording.

    Parameters
    ----------
    recording : Recording
        The recorded flight.
    mission : MissionConfig
        Mission file, which may differ from the recorded one.
    seed : int, optional
        Seed of plans and filters; by default the recorded one, else that of the mission file.
    """

    def __init__(self, recording: Recording, mission: MissionConfig, seed: int | None = None) -> None:
        self.result = Replayed(flown_decisions=recording.decisions)
        self._recording, self._mission = recording, mission
        self._clock = ManualClock(recording.start_us / 1e6)
        self._ours, self._theirs = MemoryTransport.pair()
        self._flown, self._now = MissionSniffer(), MissionSniffer()
        self._expected = deque(
            recorded for recorded in recording.frames if recorded.is_ours and is_reported(recorded.frame)
        )
        self._late_us = 0 if recording.is_simulated else round(1e6 * _LATE_MAX_S)
        self._arrivals = Arrivals(recording, self._late_us)
        self._last: tuple[int, bytes] | None = None
        self._link: ReplayLink | None = None
        self._reloads = deque(recording.reloads)
        self._folder = tempfile.mkdtemp(prefix="replay-")
        self._app = replayed_app(
            recording,
            mission,
            self._ours,
            self._clock,
            self._make_link,
            seed=seed,
            folder=Path(self._folder),
        )

    def listen(self, listener: Callable[[str, float, Mapping[str, object], bytes], None]) -> None:
        """Set the function that gets each message recorded in the replay, as :meth:`Recorder.listen` does."""
        self._app.recorder.listen(listener)

    def _make_link(self, codec: Codec, clock: Clock, send: Callable[[bytes], None]) -> ReplayLink:
        self._link = ReplayLink(codec, clock, send, lambda: self._flown.settled)
        return self._link

    async def run(self, on_progress: Callable[[float], None] = _ignore_progress) -> Replayed:
        """Replay to the end of the recording.

        Parameters
        ----------
        on_progress : callable
            Called at intervals with the time in the recording [s].
        """
        began = time.perf_counter()
        self._theirs.set_receiver(self._compare_sent)
        await self._theirs.open()
        running = asyncio.create_task(self._app.run(), name="service")
        if not self._recording.is_simulated:
            await asyncio.sleep(0)  # A simulated service starts with its first step, a real one before it.
        try:
            for number, (data, until_us) in enumerate(self._steps()):
                until_s = until_us * 1e-6 if self._recording.is_simulated else until_us / 1e6
                await step(self._app, self._clock, self._theirs, data, until_s)
                self._note_missing(until_us)
                self._reload(until_us)
                if running.done():
                    await running
                if number % _PROGRESS_STEPS == 0:
                    on_progress((until_us - self._recording.start_us) * 1e-6)
        finally:
            await stop(running)
            shutil.rmtree(self._folder, ignore_errors=True)
        on_progress(self._recording.duration_s)
        return self._final_result(time.perf_counter() - began)

    def _steps(self) -> Iterator[tuple[bytes, int]]:
        """Yield the bytes that arrive at each instant, and the next instant [µs]."""
        arrivals, num_expected = self._arrivals, len(self._expected)
        while not arrivals.is_over:
            num_said = num_expected - len(self._expected)
            arrived = arrivals.waited_for(num_said, has_diverged=self._has_diverged)
            arrived = [raw for raw in arrived if not self._is_withheld(raw)]
            for recorded in arrivals.due():
                self._track_autopilot(recorded)
                if not arrivals.keeps(recorded, num_said) and not self._is_withheld(recorded.frame):
                    arrived.append(recorded.frame)
            until = arrivals.move_on()
            yield b"".join(frame.raw for frame in arrived), until

    def _reload(self, now_us: int) -> None:
        """Reload the mission file as recorded; a file that is no longer valid is counted and skipped."""
        while self._reloads and round(1e6 * self._reloads[0][0]) <= now_us:
            _, text = self._reloads.popleft()
            try:
                mission = mission_from_text(text, self._recording.name)
                reload.check_change(self._mission, mission, self._recording.name)
            except ConfigError:
                self._recording.counters["reloads_not_understood"] += 1
            else:
                self._app.reload(mission, text)

    def _track_autopilot(self, recorded: RecordedFrame) -> None:
        """Track the list of the recorded autopilot."""
        if self._link is not None:
            self._flown.set_dialect(self._link.dialect)
        self._flown.feed(recorded.frame, self._recording.vehicle, recorded.at_us * 1e-6)

    def _is_withheld(self, frame: RawFrame) -> bool:
        """Return whether a recorded answer is no longer valid."""
        if self._link is None or not self._link.has_diverged:
            return False
        is_news = self._link.has_stored and self._arrivals.is_news(frame)
        return self._arrivals.is_answer(frame) or is_news

    @property
    def _has_diverged(self) -> bool:
        return self._link is not None and self._link.has_diverged

    def _compare_sent(self, data: bytes) -> None:
        """Compare what the service sends with what it sent in flight."""
        now_us = round(1e6 * self._clock.now_s())
        for raw in frames_in(data):
            frame = raw_frame(raw)
            self._now.set_dialect(None if self._link is None else self._link.dialect)
            self._now.feed(frame, self._recording.vehicle, now_us * 1e-6)
            if self._link is None or self._link.has_diverged or not is_reported(frame):
                continue
            self._compare(frame, now_us)

    def _compare(self, frame: RawFrame, now_us: int) -> None:
        """Compare a sent frame with the next one that is expected."""
        said = frame.message_id, frame.payload
        if said == self._last and not self._recording.is_simulated:
            return  # It is a repetition, which depends on the wall clock.
        while self._expected and self._late_us and _content(self._expected[0]) == self._last:
            self._expected.popleft()
        wanted = self._expected[0] if self._expected else None
        if wanted is None or abs(wanted.at_us - now_us) > self._late_us or _content(wanted) != said:
            self._diverge(
                now_us, f"{message_name(frame)} is sent, {_expectation(wanted, now_us, self._late_us)}"
            )
            return
        self._last = said
        self._expected.popleft()

    def _note_missing(self, now_us: int) -> None:
        """Detect frames that were sent by this time in flight, but not in the replay."""
        if self._link is None or self._link.has_diverged:
            return
        while self._expected and self._late_us and _content(self._expected[0]) == self._last:
            self._expected.popleft()
        if self._expected and self._expected[0].at_us < now_us - self._late_us:
            self._diverge(
                self._expected[0].at_us, f"{message_name(self._expected[0].frame)} was sent, and is not now"
            )

    def _diverge(self, at_us: int, why: str) -> None:
        assert self._link is not None
        self.result.diverged_s, self.result.apart = at_us * 1e-6, why
        self._link.part()

    def _final_result(self, wall_s: float) -> Replayed:
        result = self.result
        result.decisions = list(self._app.recorder.decisions)
        ours = (self._recording.vehicle, COMPONENT_ID)
        modelled = [] if self._link is None else self._link.uploads
        result.uploads = [entry for entry in self._now.uploads if entry.client == ours]
        result.uploads += [Upload(stamp, ours, items) for stamp, items in modelled]
        result.flown_uploads = tuple(entry for entry in self._flown.uploads if entry.client == ours)
        result.held = self._flown.items
        result.duration_s, result.wall_s = self._recording.duration_s, wall_s
        result.counters = dict(self._recording.counters + self._app.link.codec.counters)
        return result


def flown_uploads(recording: Recording) -> tuple[Upload, ...]:
    """Return the missions that the service uploaded in a recorded flight."""
    sniffer = MissionSniffer()
    for recorded in recording.frames:
        sniffer.feed(recorded.frame, recording.vehicle, recorded.at_us * 1e-6)
    return tuple(entry for entry in sniffer.uploads if entry.client == (recording.vehicle, COMPONENT_ID))


def _content(recorded: RecordedFrame) -> tuple[int, bytes]:
    return recorded.frame.message_id, recorded.frame.payload


def _expectation(wanted: RecordedFrame | None, now_us: int, late_us: int) -> str:
    if wanted is None or wanted.at_us > now_us + late_us:
        return "where nothing was"
    if wanted.at_us < now_us - late_us:
        return f"later than {message_name(wanted.frame)} was"
    return f"where {message_name(wanted.frame)} with other content was"
