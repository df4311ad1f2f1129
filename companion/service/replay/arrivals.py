"""Arrivals in a replay: recorded frames at their instants, and answers after their requests."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

from companion.link.wire.framing import RawFrame
from companion.recording.reader import RecordedFrame, Recording
from companion.service.replay.lockstep import STEP_S
from companion.types.mavlink_enums import Command, ComponentId, MessageId

TRANSFERS = frozenset(
    {
        MessageId.MISSION_WRITE_PARTIAL_LIST, MessageId.MISSION_ITEM, MessageId.MISSION_REQUEST,
        MessageId.MISSION_SET_CURRENT, MessageId.MISSION_REQUEST_LIST, MessageId.MISSION_COUNT,
        MessageId.MISSION_CLEAR_ALL, MessageId.MISSION_ACK, MessageId.MISSION_REQUEST_INT,
        MessageId.MISSION_ITEM_INT,
    }
)  # fmt: skip
_ANSWERS = TRANSFERS | {MessageId.COMMAND_ACK}
_COMMANDS = frozenset({Command.DO_SET_MODE, Command.DO_SET_MISSION_CURRENT})
_NEWS = (MessageId.MISSION_CURRENT, MessageId.MISSION_ITEM_REACHED)
_STORED = b"Flight plan received"
_FOREIGN_STEP_S = 0.1
_SILENCE_US, _SILENT_STEP_US = 10_000_000, 200_000  # In a long silence only our clock ticks, in larger steps.


def is_reported(frame: RawFrame) -> bool:
    """Return whether a frame of ours is a request or command about missions."""
    if frame.message_id == MessageId.COMMAND_LONG:
        return int.from_bytes(frame.payload.ljust(30, b"\0")[28:30], "little") in _COMMANDS
    return frame.message_id in TRANSFERS


def message_name(frame: RawFrame) -> str:
    """Return the name of a frame's message."""
    return MessageId(frame.message_id).name


class Arrivals:
    """Goes through a recording.

    On a wall clock the service may send a request a little later than in flight: an answer waits for its
    request.

    Parameters
    ----------
    recording : Recording
        The recorded flight.
    late_us : int
        How much later than recorded the service may send something [µs].
    """

    def __init__(self, recording: Recording, late_us: int) -> None:
        self._frames, self._vehicle = recording.frames, recording.vehicle
        self._step_us = round(1e6 * (STEP_S if recording.is_ours else _FOREIGN_STEP_S))
        self._is_exact = recording.is_ours
        self._late_us = late_us
        self._now_us, self._index, self._num_reports = recording.start_us, 0, 0
        self._instants = deque(_instants_us(recording))
        self._waiting: deque[tuple[int, RawFrame]] = deque()

    @property
    def is_over(self) -> bool:
        """Whether every frame has arrived."""
        return self._index >= len(self._frames)

    def is_autopilots(self, frame: RawFrame) -> bool:
        """Return whether the recorded autopilot sent a frame."""
        return (frame.system_id, frame.component_id) == (self._vehicle, ComponentId.AUTOPILOT1)

    def is_answer(self, frame: RawFrame) -> bool:
        """Return whether a frame is the autopilot's answer about missions."""
        return frame.message_id in _ANSWERS and self.is_autopilots(frame)

    def is_news(self, frame: RawFrame) -> bool:
        """Return whether a frame reports the progress of the recorded autopilot's own mission."""
        is_position = frame.message_id in _NEWS and self.is_autopilots(frame)
        return is_position or (frame.message_id == MessageId.STATUSTEXT and _STORED in frame.payload)

    def waited_for(self, num_said: int, *, has_diverged: bool) -> list[RawFrame]:
        """Return the answers whose requests have been sent by now, or never will be.

        Parameters
        ----------
        num_said : int
            Number of recorded requests that have been sent.
        has_diverged : bool
            True if the service sends something else than in flight.
        """
        frames = []
        while self._waiting and (self._waiting[0][0] <= num_said or has_diverged):
            frames.append(self._waiting.popleft()[1])
        return frames

    def due(self) -> Iterator[RecordedFrame]:
        """Yield the frames that were received or sent by now, in order."""
        while not self.is_over and self._frames[self._index].at_us <= self._now_us:
            self._index += 1
            yield self._frames[self._index - 1]

    def keeps(self, recorded: RecordedFrame, num_said: int) -> bool:
        """Return whether a frame does not arrive now: our own, and answers that wait for their requests."""
        if recorded.is_ours:
            self._num_reports += is_reported(recorded.frame)
            return True
        if self._late_us and self._num_reports > num_said and self.is_answer(recorded.frame):
            self._waiting.append((self._num_reports, recorded.frame))
            return True
        return False

    def move_on(self) -> int:
        """Move to the next instant at which anything can happen, and return it [µs]."""
        now, next_us = self._now_us, None if self.is_over else self._frames[self._index].at_us
        is_silent = next_us is not None and next_us - now > _SILENCE_US
        until = now + _SILENT_STEP_US if is_silent else (now // self._step_us + 1) * self._step_us
        if self._is_exact and next_us is not None:
            until = min(until, next_us)
        while self._instants and self._instants[0] <= now:
            self._instants.popleft()
        self._now_us = min(until, self._instants[0]) if self._instants else until
        return self._now_us


def _instants_us(recording: Recording) -> list[int]:
    """Return when plans were due and begun on a wall clock; the replay acts at these instants, too [µs]."""
    if recording.is_simulated:
        return []
    found = {at for entry in recording.taken.values() for at in (entry.due_s, entry.seen_s) if at is not None}
    found |= {stamp_s for stamp_s, _ in recording.reloads}
    return sorted(math.ceil(1e6 * at - 1e-3) for at in found)
