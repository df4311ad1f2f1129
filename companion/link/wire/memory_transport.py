"""A link within this process."""

from __future__ import annotations

from collections.abc import Callable

from companion.link.wire.transport import BaseTransport, dropped


class MemoryTransport(BaseTransport):
    """One end of a pair in this process; what one sends the other receives in the same call."""

    def __init__(self) -> None:
        super().__init__()
        self._peer: MemoryTransport | None = None
        self._take: Callable[[bytes], None] = dropped
        self._is_open = False

    @classmethod
    def pair(cls) -> tuple[MemoryTransport, MemoryTransport]:
        """Return two ends that are joined."""
        one, other = cls(), cls()
        one._peer, other._peer = other, one
        return one, other

    @property
    def is_open(self) -> bool:
        """Whether this end is open."""
        return self._is_open

    def set_receiver(self, receiver: Callable[[bytes], None]) -> None:
        """Set who takes what the other end sends."""
        self._take = receiver

    async def open(self) -> None:
        """Open this end."""
        self._is_open = True

    async def close(self) -> None:
        """Close this end."""
        self._is_open = False

    def send(self, data: bytes) -> None:
        """Hand over to the other end if both are open."""
        peer = self._peer
        if self._is_open and peer is not None and peer._is_open:
            peer._take(data)
        else:
            self.dropped_bytes += len(data)
