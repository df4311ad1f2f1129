"""Uploads and downloads of a mission over a link that loses frames, without I/O and by a given clock.

Theory of operation. The autopilot requests one item at a time, and repeats a request only after a long time
(ArduPlane 1 s, PX4 0.25 s). The sender must therefore repeat earlier::

    opening ──first request──▶ sending ──ACK──▶ done
       │  ▲ repeats the opening     │  ▲ request n: sends the unsent items of the window n … n+w-1
       └──┘                         └──┘ no request in time: sends the items n … n+w again

An ArduPlane that has item n accepts n+1 without a request; it takes all that arrived in one turn of its loop
of 20 ms. One that lacks item n refuses the later ones with INVALID_SEQUENCE and waits. A PX4 ignores items
that it did not request, so its window is one item. A repetition includes the item after the window, since the
autopilot may have the whole window, and only its requests were lost. The last item is never sent before
``may_finish`` allows it.

A download requests several items at once if the autopilot supports it (ArduPlane), and repeats the requests
for missing items.

References
----------
MAVLink developer guide, "Mission Protocol"; RFC 6298 for the time after which to repeat.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Collection, Sequence

from companion.link.wire.decoded_frame import (
    MissionAck,
    MissionCount,
    MissionItemReceived,
    MissionItemRequest,
)
from companion.types.mavlink_enums import MissionResult, MissionType, name_of
from companion.types.mission import MissionItem

OPENING = -1  # In place of an item number: the message that begins a transfer.
# An ArduPlane's answers to an item that was sent twice. They may arrive after the next transfer has begun.
_LATE = frozenset({MissionResult.ERROR, MissionResult.INVALID_SEQUENCE})
# Silence of the autopilot that ends a transfer. An ArduPlane gives up after 8 s, a PX4 after 5 s.
TRANSFER_TIMEOUT_S = 7.0
REPEAT_MIN_S, REPEAT_MAX_S = 0.12, 1.5
_FIRST_REPEAT_S = 0.4
_REMEMBERED = 10  # The minimum is taken over this many answers.


class RoundTrip:
    """Estimates the time of an answer, and from it the time after which to repeat (RFC 6298, section 2)."""

    def __init__(self) -> None:
        self._mean_s: float | None = None
        self._spread_s = 0.0
        self._answered_s: deque[float] = deque(maxlen=_REMEMBERED)

    @property
    def shortest_s(self) -> float:
        """Shortest time between a first sending and the first answer, of the last few answers."""
        return min(self._answered_s, default=0.0)

    def note_first_answer(self, took_s: float) -> None:
        """Record the time between a first sending and the first answer.

        On a slow line only this is known: if a message is repeated before the line can have answered, the
        answer cannot be assigned to one of the repetitions.
        """
        self._answered_s.append(took_s)

    def note_answer(self, took_s: float) -> None:
        """Record the answer time of a message that was sent once."""
        if self._mean_s is None:
            self._mean_s, self._spread_s = took_s, 0.5 * took_s
            return
        self._spread_s += 0.25 * (abs(took_s - self._mean_s) - self._spread_s)
        self._mean_s += 0.125 * (took_s - self._mean_s)

    @property
    def repeat_s(self) -> float:
        """Time after which to repeat a message [s]."""
        if self._mean_s is None:
            return _FIRST_REPEAT_S
        return min(REPEAT_MAX_S, max(REPEAT_MIN_S, self._mean_s + 4.0 * self._spread_s))


def _is_late(ack: MissionAck, repeated: Collection[int], *, is_open: bool) -> bool:
    """Return whether a refusal may answer an earlier transfer; if not, the next opening is refused, too."""
    return ack.result in _LATE and not is_open and OPENING not in repeated


class Upload:
    """An upload of mission items to the autopilot.

    Parameters
    ----------
    items : sequence of MissionItem
        Consecutively numbered items; the first number is arbitrary.
    round_trip : RoundTrip
        Estimates the answer time; this transfer updates it.
    now_s : float
        Clock reading at which the transfer begins [s].
    may_finish : callable, optional
        Called before each sending of the last item; if it returns false, the upload ends as withdrawn.
    window : int
        Number of items sent at once.

    Attributes
    ----------
    failure : str or None
        Why the upload failed; '' if it was accepted, None while it is under way.
    opaque_id : int
        The autopilot's id of the mission; 0 if it has none.
    """

    def __init__(
        self,
        items: Sequence[MissionItem],
        round_trip: RoundTrip,
        now_s: float,
        may_finish: Callable[[], bool] | None = None,
        window: int = 1,
    ) -> None:
        self.failure: str | None = None
        self.opaque_id = 0
        self._first, self._last = items[0].sequence, items[-1].sequence
        self._window = window
        self._round_trip = round_trip
        self._may_finish = may_finish
        self._requested: int | None = None
        self._unsent = self._first  # Lowest number that was not sent since the last repetition.
        self._is_open = False
        self._received_s = self._due_s = now_s
        self._sent_s: dict[int, float] = {}
        self._first_sent_s: dict[int, float] = {}
        self._repeated: set[int] = set()

    def abandon(self) -> None:
        """Fail at once."""
        self.failure = "ABANDONED"

    def due(self, now_s: float) -> list[int]:
        """Return the numbers of the items to send now, with :data:`OPENING` for the opening message."""
        if self.failure is None and now_s - self._received_s > TRANSFER_TIMEOUT_S:
            self.failure = "TIMEOUT"
        if self.failure is not None:
            return []
        leaving: list[int] = []
        for number in self._wanted(now_s):
            if number == self._last and self._may_finish is not None and not self._may_finish():
                self.failure = "WITHDRAWN"
                return leaving
            if number in self._sent_s:
                self._repeated.add(number)
            self._sent_s[number] = now_s
            self._first_sent_s.setdefault(number, now_s)
            leaving.append(number)
        return leaving

    def _wanted(self, now_s: float) -> Sequence[int]:
        """Return the numbers in the window that were not sent; after a silence, all of it and the next."""
        is_silent = now_s >= self._due_s
        if is_silent:
            self._due_s = now_s + self._round_trip.repeat_s
        if self._requested is None:
            opening = self._first if self._is_open else OPENING
            return [opening] if is_silent else []
        begin = self._requested if is_silent else max(self._unsent, self._requested)
        self._unsent = max(self._unsent, self._requested + self._window)
        return range(begin, min(self._unsent + is_silent, self._last + 1))

    def note_request(self, question: MissionItemRequest, now_s: float) -> None:
        """Take the autopilot's request for an item."""
        if self.failure is not None or question.mission_type != MissionType.MISSION:
            return
        if not self._first <= question.sequence <= self._last:
            return
        before = OPENING if question.sequence == self._first else question.sequence - 1
        is_new = self._requested is None or question.sequence > self._requested
        if is_new and before in self._sent_s:
            self._round_trip.note_first_answer(now_s - self._first_sent_s[before])
            if before not in self._repeated:
                self._round_trip.note_answer(now_s - self._sent_s[before])
        self._requested = question.sequence
        if not is_new:
            self._unsent = question.sequence
        self._received_s, self._due_s = now_s, now_s + self._round_trip.repeat_s

    def note_ack(self, ack: MissionAck, now_s: float) -> None:
        """Take the autopilot's acknowledgement, or its complaint about a repeated item."""
        if self.failure is not None or ack.mission_type != MissionType.MISSION:
            return
        if ack.result == MissionResult.INVALID_SEQUENCE and self._requested is not None:
            self._received_s = now_s
            if now_s - self._sent_s.get(self._requested, -math.inf) > self._round_trip.shortest_s:
                self._unsent = self._requested  # It was lost, and the items after it were refused.
        elif ack.result == MissionResult.DENIED and OPENING in self._repeated:
            # The opening was accepted and its request lost: ArduPlane denies a second opening, and requests
            # the first item again after 1 s.
            self._is_open, self._received_s = True, now_s
        elif _is_late(ack, self._repeated, is_open=self._requested is not None):
            pass
        elif ack.result != MissionResult.ACCEPTED:
            self.failure = name_of(MissionResult, ack.result)
        elif self._last in self._sent_s:  # Otherwise it acknowledges an earlier transfer.
            is_whole = all(number in self._sent_s for number in range(self._first, self._last + 1))
            self.failure, self.opaque_id = "" if is_whole else "ACCEPTED_WITH_GAPS", ack.opaque_id


class MissionDownload:
    """A download of one of the autopilot's lists.

    Parameters
    ----------
    round_trip : RoundTrip
        Estimates the answer time; this transfer updates it.
    now_s : float
        Clock reading at which the transfer begins [s].
    window : int
        Number of items requested at once.
    mission_type : int
        MAV_MISSION_TYPE of the list.
    num_left_out : int
        Number of items at the end of the list that are not read.

    Attributes
    ----------
    failure : str or None
        Why the download failed; '' if it is complete, None while it is under way.
    mission_type : int
        MAV_MISSION_TYPE of the list.
    """

    def __init__(
        self,
        round_trip: RoundTrip,
        now_s: float,
        window: int,
        mission_type: int = MissionType.MISSION,
        num_left_out: int = 0,
    ) -> None:
        self.failure: str | None = None
        self.mission_type = mission_type
        self._round_trip = round_trip
        self._window = window
        self._num_left_out = num_left_out
        self._received_s = now_s
        self._count: int | None = None
        self._due_s = now_s
        self._items: dict[int, MissionItem] = {}
        self._lowest = 0  # All items below this number have arrived.
        self._asked_s: dict[int, float] = {}
        self._first_asked_s: dict[int, float] = {}
        self._repeated: set[int] = set()

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """Items read so far, in order."""
        return tuple(self._items[number] for number in sorted(self._items))

    def abandon(self) -> None:
        """Fail at once."""
        self.failure = "ABANDONED"

    def due(self, now_s: float) -> list[int]:
        """Return the numbers of the items to request now, with :data:`OPENING` for the list's length."""
        if self.failure is None and now_s - self._received_s > TRANSFER_TIMEOUT_S:
            self.failure = "TIMEOUT"
        if self.failure is not None:
            return []
        if self._count is None:
            if now_s < self._due_s:
                return []
            self._due_s = now_s + self._round_trip.repeat_s
            if OPENING in self._asked_s:
                self._repeated.add(OPENING)
            self._asked_s[OPENING] = now_s
            return [OPENING]
        return self._missing(self._count, now_s)

    def _missing(self, count: int, now_s: float) -> list[int]:
        """Return the numbers in the window that were never requested, or not recently."""
        while self._lowest in self._items:
            self._lowest += 1
        # Items beyond the lowest missing one lie within a window, so this search is short.
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
        """Take the length of the autopilot's list."""
        if self.failure is not None or count.mission_type != self.mission_type or self._count is not None:
            return
        self._count, self._received_s = max(count.count - self._num_left_out, 0), now_s
        if self._count == 0:
            self.failure = ""

    def note_item(self, reply: MissionItemReceived, now_s: float) -> None:
        """Take an item of the autopilot's list."""
        number = reply.item.sequence
        if self.failure is not None or reply.mission_type != self.mission_type or number not in self._asked_s:
            return
        if number not in self._items:
            self._round_trip.note_first_answer(now_s - self._first_asked_s[number])
            if number not in self._repeated:
                self._round_trip.note_answer(now_s - self._asked_s[number])
        self._items[number], self._received_s = reply.item, now_s
        if len(self._items) == self._count:
            self.failure = ""

    def note_ack(self, ack: MissionAck, now_s: float) -> None:
        """Take a refusal of the autopilot."""
        if self.failure is not None or ack.mission_type != self.mission_type:
            return
        is_late = _is_late(ack, self._repeated, is_open=self._count is not None)
        if ack.result != MissionResult.ACCEPTED and not is_late:
            self.failure, self._received_s = name_of(MissionResult, ack.result), now_s
