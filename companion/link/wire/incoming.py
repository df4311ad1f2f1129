"""Bytes as they come from each address, cut into frames within a budget.

What a stranger sends neither tears the vehicle's frames apart nor takes the time they need: each address
has a stream of its own, and strangers share a budget that the vehicle's address does not draw on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from companion.link.wire.framing import Framer, RawFrame
from companion.link.wire.transport import Address
from companion.token_bucket import TokenBucket, kept_for

ADDRESSES_MAX = 16  # whose begun frames are kept, the last heard
BURST_S = 2.0
# Cutting costs up to 1.5 µs a byte on a slow computer; a line at 921,600 baud carries 92 kB/s.
PEER_BYTES_PER_S = 250_000.0
STRANGERS_BYTES_PER_S = 100_000.0


class Incoming:
    """Cuts frames.

    Parameters
    ----------
    extras : mapping of int to int
        CRC extra byte of each message id the dialect knows.
    counters : Counter
        Counts what the framer counts, and ``flooded_bytes``, which were too many to be looked at.
    lengths_max : mapping of int to int
        Bytes of each message with all its extensions.
    """

    def __init__(
        self, extras: Mapping[int, int], counters: Counter[str], lengths_max: Mapping[int, int]
    ) -> None:
        self._extras, self._lengths_max = extras, lengths_max
        self._counters = counters
        self._framers: dict[Address | None, Framer] = {}
        self._peer = TokenBucket(PEER_BYTES_PER_S, BURST_S * PEER_BYTES_PER_S)
        self._strangers = TokenBucket(STRANGERS_BYTES_PER_S, BURST_S * STRANGERS_BYTES_PER_S)

    def frames(
        self, data: bytes, stamp_s: float, address: Address | None, *, is_peer: bool
    ) -> list[RawFrame]:
        """Frames that bytes complete; none where their budget is used up.

        Parameters
        ----------
        data : bytes
            As they came, in any portions.
        stamp_s : float
            When, by the clock [s].
        address : tuple of str and int, or None
            Where from; None on a line, which has one end.
        is_peer : bool
            Whether the vehicle speaks from there.
        """
        if not (self._peer if is_peer else self._strangers).takes(stamp_s, len(data)):
            self._counters["flooded_bytes"] += len(data)
            return []
        return kept_for(self._framers, address, self._framer, ADDRESSES_MAX).feed(data)

    def _framer(self) -> Framer:
        return Framer(self._extras, self._counters, self._lengths_max)
