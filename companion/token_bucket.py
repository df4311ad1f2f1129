"""A budget that time fills and use empties: how much of something is done, whoever asks for it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

Key = TypeVar("Key")
Kept = TypeVar("Kept")


def get_or_create(store: dict[Key, Kept], key: Key, make: Callable[[], Kept], most: int) -> Kept:
    """What is kept for somebody, made where there is nothing; who was asked for longest ago is forgotten.

    Parameters
    ----------
    store : dict
        In the order of asking; it never grows beyond ``most``.
    key : hashable
        Who.
    make : callable
        Makes what is kept.
    most : int
        For how many something is kept.
    """
    kept = store.pop(key, None)
    if kept is None:
        kept = make()
        if len(store) >= most:
            del store[next(iter(store))]
    store[key] = kept
    return kept


class TokenBucket:
    """So much a second, and a burst of it at once.

    Parameters
    ----------
    rate : float
        What comes back in a second: messages, bytes, whatever is counted.
    burst : float
        The most that is ever there, and what there is at first.
    """

    def __init__(self, rate: float, burst: float) -> None:
        self.rate = rate
        self._burst = self._left = burst
        self._since_s = -math.inf

    def takes(self, now_s: float, amount: float = 1.0) -> bool:
        """Whether so much is there at an instant; it is taken if it is."""
        self._fill(now_s)
        if self._left < amount:
            return False
        self._left -= amount
        return True

    def has_any(self, now_s: float) -> bool:
        """Whether the budget is not used up."""
        self._fill(now_s)
        return self._left > 0.0

    def owe(self, amount: float) -> None:
        """Take what was used already; what is not there is owed."""
        self._left -= amount

    def _fill(self, now_s: float) -> None:
        passed = now_s - self._since_s
        if passed > 0.0:  # a clock set back fills nothing
            self._left = min(self._burst, self._left + passed * self.rate)
            self._since_s = now_s
