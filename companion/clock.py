"""Time as an argument: one interface of clocks for service, simulation, replay and tests."""

from __future__ import annotations

import asyncio
import ctypes
import heapq
import itertools
import time
from typing import Protocol

UNSYNCHRONISED = 5  # TIME_ERROR of adjtimex(2).
TIMEX_BYTES = 512  # The largest struct timex has 208 bytes.


def clock_state() -> int:
    """Return the kernel's state of the time of day, as adjtimex(2) gives it; negative if unknown."""
    try:
        return int(ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(TIMEX_BYTES)))
    except (OSError, AttributeError):  # The platform is not Linux.
        return -1


class Clock(Protocol):
    """Monotonic seconds, and sleeping until an instant."""

    def now_s(self) -> float:
        """Seconds since an arbitrary start; never goes back."""
        ...

    async def sleep_until(self, instant_s: float) -> None:
        """Return as soon as ``now_s()`` has reached the instant."""
        ...


class WallClock:
    """The computer's monotonic clock, in whole microseconds: as recordings have them, for their replay."""

    def now_s(self) -> float:
        """Seconds of the monotonic clock."""
        return round(time.monotonic(), 6)

    async def sleep_until(self, instant_s: float) -> None:
        """Sleep in the event loop until the instant."""
        await asyncio.sleep(max(0.0, instant_s - time.monotonic()))


class ManualClock:
    """A clock that its owner moves: the simulator, a replay or a test.

    Parameters
    ----------
    start_s : float
        First reading [s].
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s
        self._sleepers: list[tuple[float, int, asyncio.Future[None]]] = []
        self._order = itertools.count()

    def now_s(self) -> float:
        """Return the reading to which the owner moved the clock."""
        return self._now_s

    async def sleep_until(self, instant_s: float) -> None:
        """Wait until the owner moves the clock to the instant or past it."""
        if instant_s <= self._now_s:
            await asyncio.sleep(0)
            return
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        heapq.heappush(self._sleepers, (instant_s, next(self._order), future))
        await future

    @property
    def is_awaited(self) -> bool:
        """Whether anybody sleeps until an instant of this clock."""
        return bool(self._sleepers)

    def advance_to(self, instant_s: float) -> int:
        """Move the clock and wake every sleeper that is due, earliest first.

        Returns
        -------
        int
            Number of sleepers that were woken.

        Raises
        ------
        ValueError
            If the instant lies in the past.
        """
        if instant_s < self._now_s:
            raise ValueError(f"clock moved back from {self._now_s} s to {instant_s} s")
        self._now_s = instant_s
        woken = 0
        while self._sleepers and self._sleepers[0][0] <= instant_s:
            future = heapq.heappop(self._sleepers)[2]
            if not future.done():
                future.set_result(None)
                woken += 1
        return woken
