"""Uploads and readings of a mission over a link that loses frames: sans I/O, by a clock that is told.

Theory of operation. The autopilot asks for one item at a time, and again only after a long while
(ArduPlane after 1 s, PX4 after 0.25 s). So whoever sends must repeat, and sooner::

    opening ──first question──▶ sending ──ACK──▶ done
       │  ▲ repeats the opening      │  ▲ question n: item n
       └──┘                          └──┘ no answer in time: items n and n+1

The item after the one asked for goes with it, since the next question may be what was lost: an
ArduPlane that has item n takes n+1 unasked, one that has not refuses it with INVALID_SEQUENCE and
waits on; a PX4 ignores it. The last item is never sent before ``may_finish`` allows it.

A reading asks for several items at once where the autopilot answers so (ArduPlane), and again for
those that did not come.

References
----------
MAVLink developer guide, "Mission Protocol"; RFC 6298 for the time after which to repeat.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Sequence

from companion.link.wire.decoded_frame import (
    MissionAck,
    MissionCount,
    MissionQuestion,
    MissionTold,
)
from companion.types.mavlink_enums import MissionResult, MissionType, name_of
from companion.types.mission import MissionItem

OPENING = -1  # in place of an item's number: the message with which a transfer begins
PATIENCE_S = 7.0  # without a word of the autopilot; an ArduPlane gives up after 8 s, a PX4 after 5 s
REPEAT_MIN_S, REPEAT_MAX_S = 0.12, 1.5
_FIRST_REPEAT_S = 0.4
_REMEMBERED = 10  # answers


class RoundTrip:
    """How long an answer takes, and so after how long to ask again (RFC 6298, section 2)."""

    def __init__(self) -> None:
        self._mean_s: float | None = None
        self._spread_s = 0.0
        self._answered_s: deque[float] = deque(maxlen=_REMEMBERED)

    @property
    def least_s(self) -> float:
        """Shortest time from a first sending to the first answer, of the last few: what the line takes."""
        return min(self._answered_s, default=0.0)

    def note_first(self, took_s: float) -> None:
        """An answer came so long after the first sending; of a slow line this is all that is known.

        Whatever is asked again before the line can have answered tells nothing of single frames.
        """
        self._answered_s.append(took_s)

    def note(self, took_s: float) -> None:
        """An answer to something sent once took so long."""
        if self._mean_s is None:
            self._mean_s, self._spread_s = took_s, 0.5 * took_s
            return
        self._spread_s += 0.25 * (abs(took_s - self._mean_s) - self._spread_s)
        self._mean_s += 0.125 * (took_s - self._mean_s)

    @property
    def repeat_s(self) -> float:
        """After how long to ask again."""
        if self._mean_s is None:
            return _FIRST_REPEAT_S
        return min(REPEAT_MAX_S, max(REPEAT_MIN_S, self._mean_s + 4.0 * self._spread_s))


class Upload:
    """Items on their way to the autopilot.

    Parameters
    ----------
    items : sequence of MissionItem
        Numbered in order, from any number on.
    round_trip : RoundTrip
        Learns from this transfer, and times it.
    now_s : float
        Clock reading at which the transfer begins [s].
    may_finish : callable, optional
        Asked each time before the last item leaves; if it may not, the upload ends as withdrawn.

    Attributes
    ----------
    failure : str or None
        Why it ended; '' once it was accepted, None while it is under way.
    opaque_id : int
        What the autopilot calls the mission; 0 without a name.
    """

    def __init__(
        self,
        items: Sequence[MissionItem],
        round_trip: RoundTrip,
        now_s: float,
        may_finish: Callable[[], bool] | None = None,
    ) -> None:
        self.failure: str | None = None
        self.opaque_id = 0
        self._first, self._last = items[0].sequence, items[-1].sequence
        self._round_trip = round_trip
        self._may_finish = may_finish
        self._asked: int | None = None
        self._is_open = False
        self._heard_s = self._due_s = now_s
        self._sent_s: dict[int, float] = {}
        self._first_sent_s: dict[int, float] = {}
        self._repeated: set[int] = set()
        self._queue: list[int] = []

    def abandon(self) -> None:
        """Fail at once."""
        self.failure = "ABANDONED"

    def due(self, now_s: float) -> list[int]:
        """Numbers of the items to send now, :data:`OPENING` for the opening."""
        if self.failure is None and now_s - self._heard_s > PATIENCE_S:
            self.failure = "TIMEOUT"
        if self.failure is not None:
            return []
        if now_s >= self._due_s:
            self._due_s = now_s + self._round_trip.repeat_s
            self._queue += self._repetition()
        queue, self._queue = self._queue, []
        leaving: list[int] = []
        for number in dict.fromkeys(queue):
            if number == self._last and self._may_finish is not None and not self._may_finish():
                self.failure = "WITHDRAWN"
                return leaving
            if number in self._sent_s:
                self._repeated.add(number)
            self._sent_s[number] = now_s
            self._first_sent_s.setdefault(number, now_s)
            leaving.append(number)
        return leaving

    def _repetition(self) -> list[int]:
        if self._asked is None:
            return [self._first] if self._is_open else [OPENING]
        return [number for number in (self._asked, self._asked + 1) if number <= self._last]

    def note_question(self, question: MissionQuestion, now_s: float) -> None:
        """The autopilot asks for an item."""
        if self.failure is not None or question.mission_type != MissionType.MISSION:
            return
        if not self._first <= question.sequence <= self._last:
            return
        before = OPENING if question.sequence == self._first else question.sequence - 1
        if before in self._sent_s and question.sequence not in self._sent_s:
            self._round_trip.note_first(now_s - self._first_sent_s[before])
            if before not in self._repeated:
                self._round_trip.note(now_s - self._sent_s[before])
        self._asked = question.sequence
        self._heard_s, self._due_s = now_s, now_s + self._round_trip.repeat_s
        self._queue.append(question.sequence)

    def note_ack(self, ack: MissionAck, now_s: float) -> None:
        """The autopilot ends it, or complains of an item that came twice."""
        if self.failure is not None or ack.mission_type != MissionType.MISSION:
            return
        if ack.result == MissionResult.INVALID_SEQUENCE and self._asked is not None:
            self._heard_s = now_s
        elif ack.result == MissionResult.DENIED and OPENING in self._repeated:
            # The first was taken, its question lost: ArduPlane denies another, and asks again after 1 s.
            self._is_open, self._heard_s = True, now_s
        elif ack.result != MissionResult.ACCEPTED:
            self.failure = name_of(MissionResult, ack.result)
        elif self._last in self._sent_s:  # else it ends some transfer before this one
            is_whole = all(number in self._sent_s for number in range(self._first, self._last + 1))
            self.failure, self.opaque_id = "" if is_whole else "ACCEPTED_WITH_GAPS", ack.opaque_id


class MissionDownload:
    """The autopilot's list on its way here.

    Parameters
    ----------
    round_trip : RoundTrip
        Learns from this transfer, and times it.
    now_s : float
        Clock reading at which the transfer begins [s].
    window : int
        Items asked for at once.
    mission_type : int
        Which of its lists.

    Attributes
    ----------
    failure : str or None
        Why it ended; '' once all is read, None while it is under way.
    mission_type : int
        The same.
    """

    def __init__(
        self, round_trip: RoundTrip, now_s: float, window: int, mission_type: int = MissionType.MISSION
    ) -> None:
        self.failure: str | None = None
        self.mission_type = mission_type
        self._round_trip = round_trip
        self._window = window
        self._heard_s = now_s
        self._count: int | None = None
        self._due_s = now_s
        self._items: dict[int, MissionItem] = {}
        self._lowest = 0  # that may be missing
        self._asked_s: dict[int, float] = {}
        self._first_asked_s: dict[int, float] = {}
        self._repeated: set[int] = set()

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """What was read, in order."""
        return tuple(self._items[number] for number in sorted(self._items))

    def abandon(self) -> None:
        """Fail at once."""
        self.failure = "ABANDONED"

    def due(self, now_s: float) -> list[int]:
        """Numbers of the items to ask for now, :data:`OPENING` for the list's length."""
        if self.failure is None and now_s - self._heard_s > PATIENCE_S:
            self.failure = "TIMEOUT"
        if self.failure is not None:
            return []
        if self._count is None:
            if now_s < self._due_s:
                return []
            self._due_s = now_s + self._round_trip.repeat_s
            return [OPENING]
        return self._missing(self._count, now_s)

    def _missing(self, count: int, now_s: float) -> list[int]:
        """Numbers of the items in the window that were not asked for, or long enough ago."""
        while self._lowest in self._items:
            self._lowest += 1
        # What was read beyond the lowest was asked for within a window from it, so this ends soon.
        after = (number for number in range(self._lowest, count) if number not in self._items)
        missing = list(itertools.islice(after, self._window))
        repeat_s = self._round_trip.repeat_s
        asking = [
            number for number in missing
            if number not in self._asked_s or now_s - self._asked_s[number] >= repeat_s
        ]  # fmt: skip
        self._repeated.update(number for number in asking if number in self._asked_s)
        self._asked_s.update(dict.fromkeys(asking, now_s))
        for number in asking:
            self._first_asked_s.setdefault(number, now_s)
        return asking

    def note_count(self, count: MissionCount, now_s: float) -> None:
        """The autopilot tells how long its list is."""
        if self.failure is not None or count.mission_type != self.mission_type or self._count is not None:
            return
        self._count, self._heard_s = count.count, now_s
        if count.count == 0:
            self.failure = ""

    def note_item(self, told: MissionTold, now_s: float) -> None:
        """The autopilot tells an item."""
        number = told.item.sequence
        if self.failure is not None or told.mission_type != self.mission_type or number not in self._asked_s:
            return
        if number not in self._items:
            self._round_trip.note_first(now_s - self._first_asked_s[number])
            if number not in self._repeated:
                self._round_trip.note(now_s - self._asked_s[number])
        self._items[number], self._heard_s = told.item, now_s
        if len(self._items) == self._count:
            self.failure = ""

    def note_ack(self, ack: MissionAck, now_s: float) -> None:
        """The autopilot refuses."""
        if (
            self.failure is None
            and ack.mission_type == self.mission_type
            and ack.result != MissionResult.ACCEPTED
        ):
            self.failure, self._heard_s = name_of(MissionResult, ack.result), now_s
