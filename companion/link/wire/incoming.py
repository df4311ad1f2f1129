"""Extraction of frames from the bytes of each address, within a byte budget.

Each address has its own stream, so that bytes of other senders cannot corrupt frames of the vehicle. All
other senders share one budget, which does not reduce the budget of the vehicle's address.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from companion.link.wire.framing import Framer, RawFrame
from companion.link.wire.transport import Address
from companion.token_bucket import TokenBucket, get_or_create

ADDRESSES_MAX = 16  # Incomplete frames are kept for the 16 addresses that were used last.
BURST_S = 2.0  # A burst may use the budget of this time at once.
# Framing takes up to 1.5 µs per byte on a slow computer. A line at 921,600 baud carries 92 kB/s.
PEER_BYTES_PER_S = 250_000.0
UNKNOWN_SOURCES_BYTES_PER_S = 100_000.0


class Incoming:
    """Extracts frames within the budgets.

    Parameters
    ----------
    extras : mapping of int to int
        CRC extra byte of each message id that the dialect knows.
    counters : Counter
        Counts what the framer counts, and ``flooded_bytes``, the bytes dropped because a budget was used up.
    lengths_max : mapping of int to int
        Payload length of each message with all its extensions.
    """

    def __init__(
        self, extras: Mapping[int, int], counters: Counter[str], lengths_max: Mapping[int, int]
    ) -> None:
        self._extras, self._lengths_max = extras, lengths_max
        self._counters = counters
        self._framers: dict[Address | None, Framer] = {}
        self._peer = TokenBucket(PEER_BYTES_PER_S, BURST_S * PEER_BYTES_PER_S)
        self._unknown_sources = TokenBucket(
            UNKNOWN_SOURCES_BYTES_PER_S, BURST_S * UNKNOWN_SOURCES_BYTES_PER_S
        )

    def frames(
        self, data: bytes, stamp_s: float, address: Address | None, *, is_peer: bool
    ) -> list[RawFrame]:
        """Return the frames that the bytes complete; none if the budget is used up.

        Parameters
        ----------
        data : bytes
            Received bytes, in arbitrary portions.
        stamp_s : float
            Time of arrival on the service's clock [s].
        address : tuple of str and int, or None
            Sender of the bytes; None on a line, which has one sender.
        is_peer : bool
            True if this is the vehicle's address.
        """
        if not (self._peer if is_peer else self._unknown_sources).takes(stamp_s, len(data)):
            self._counters["flooded_bytes"] += len(data)
            return []
        return get_or_create(self._framers, address, self._framer, ADDRESSES_MAX).feed(data)

    def _framer(self) -> Framer:
        return Framer(self._extras, self._counters, self._lengths_max)
