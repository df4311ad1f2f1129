"""Rate limits by token buckets: a budget that refills over time."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

Key = TypeVar("Key")
Kept = TypeVar("Kept")


def get_or_create(store: dict[Key, Kept], key: Key, make: Callable[[], Kept], most: int) -> Kept:
    """Return the entry for a key, creating it if needed; removes the least recently used entry if full.

    Parameters
    ----------
    store : dict
        Entries, least recently used first.
    key : hashable
        Key of the entry.
    make : callable
        Creates an entry.
    most : int
        Maximum number of entries.
    """
    kept = store.pop(key, None)
    if kept is None:
        kept = make()
        if len(store) >= most:
            del store[next(iter(store))]
    store[key] = kept
    return kept


class TokenBucket:
    """A rate limit that allows bursts.

    Parameters
    ----------
    rate : float
        Amount that is refilled per second, for example messages or bytes.
    burst : float
        Maximum amount, and the amount at first.
    """

    def __init__(self, rate: float, burst: float) -> None:
        self.rate = rate
        self._burst = self._left = burst
        self._since_s = -math.inf

    def takes(self, now_s: float, amount: float = 1.0) -> bool:
        """Take an amount at an instant if that much is left; returns whether it was taken."""
        self._fill(now_s)
        if self._left < amount:
            return False
        self._left -= amount
        return True

    def has_any(self, now_s: float) -> bool:
        """Return whether anything is left."""
        self._fill(now_s)
        return self._left > 0.0

    def owe(self, amount: float) -> None:
        """Take an amount that was used already, even if it exceeds what is left."""
        self._left -= amount

    def _fill(self, now_s: float) -> None:
        passed = now_s - self._since_s
        if passed > 0.0:  # A clock that is set back does not refill the bucket.
            self._left = min(self._burst, self._left + passed * self.rate)
            self._since_s = now_s
