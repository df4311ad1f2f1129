"""What arrives when in a replay: recorded frames at their instants, answers after their questions."""

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
_SILENCE_US, _SILENT_STEP_US = 10_000_000, 200_000  # while nothing is heard, only our own clock ticks


def is_reported(frame: RawFrame) -> bool:
    """Whether a frame of ours asks the autopilot for, or to do, something about missions."""
    if frame.message_id == MessageId.COMMAND_LONG:
        return int.from_bytes(frame.payload.ljust(30, b"\0")[28:30], "little") in _COMMANDS
    return frame.message_id in TRANSFERS


def message_name(frame: RawFrame) -> str:
    """Name of a frame's message."""
    return MessageId(frame.message_id).name


class Arrivals:
    """Goes through a recording.

    By a wall clock the service may ask a little later than it did: an answer waits for its question.

    Parameters
    ----------
    recording : Recording
        What was heard and said.
    late_us : int
        How much later than recorded the service may say something [µs].
    """

    def __init__(self, recording: Recording, late_us: int) -> None:
        self._frames, self._vehicle = recording.frames, recording.vehicle
        self._step_us = round(1e6 * (STEP_S if recording.is_ours else _FOREIGN_STEP_S))
        self._is_exact = recording.is_ours
        self._late_us = late_us
        self._now_us, self._index, self._num_told = recording.start_us, 0, 0
        self._instants = deque(_instants_us(recording))
        self._waiting: deque[tuple[int, RawFrame]] = deque()

    @property
    def is_over(self) -> bool:
        """Whether every frame has arrived."""
        return self._index >= len(self._frames)

    def is_autopilots(self, frame: RawFrame) -> bool:
        """Whether the recorded autopilot has sent a frame."""
        return (frame.system_id, frame.component_id) == (self._vehicle, ComponentId.AUTOPILOT1)

    def is_answer(self, frame: RawFrame) -> bool:
        """Whether a frame is the autopilot's answer to something about missions."""
        return frame.message_id in _ANSWERS and self.is_autopilots(frame)

    def is_news(self, frame: RawFrame) -> bool:
        """Whether a frame tells how the recorded autopilot's own mission goes on."""
        is_position = frame.message_id in _NEWS and self.is_autopilots(frame)
        return is_position or (frame.message_id == MessageId.STATUSTEXT and _STORED in frame.payload)

    def waited_for(self, num_said: int, *, has_diverged: bool) -> list[RawFrame]:
        """Answers whose questions are asked by now, or never will be.

        Parameters
        ----------
        num_said : int
            How much of what was asked is asked.
        has_diverged : bool
            Whether the service says something else than in flight.
        """
        frames = []
        while self._waiting and (self._waiting[0][0] <= num_said or has_diverged):
            frames.append(self._waiting.popleft()[1])
        return frames

    def due(self) -> Iterator[RecordedFrame]:
        """Frames that were heard or said by now, in order."""
        while not self.is_over and self._frames[self._index].at_us <= self._now_us:
            self._index += 1
            yield self._frames[self._index - 1]

    def keeps(self, heard: RecordedFrame, num_said: int) -> bool:
        """Whether a frame does not arrive now: our own, and answers that wait for their questions."""
        if heard.is_ours:
            self._num_told += is_reported(heard.frame)
            return True
        if self._late_us and self._num_told > num_said and self.is_answer(heard.frame):
            self._waiting.append((self._num_told, heard.frame))
            return True
        return False

    def move_on(self) -> int:
        """Go to the next instant at which anything can happen, and return it [µs]."""
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
    """When plans were due and begun by a wall clock: the replay looks at just these instants, too [µs]."""
    if recording.is_simulated:
        return []
    found = {at for entry in recording.taken.values() for at in (entry.due_s, entry.seen_s) if at is not None}
    found |= {stamp_s for stamp_s, _ in recording.reloads}
    return sorted(math.ceil(1e6 * at - 1e-3) for at in found)
