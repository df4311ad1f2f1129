"""A link within this process."""

from __future__ import annotations

from companion.link.wire.transport import Transport


class MemoryTransport(Transport):
    """One end of a pair in this process; the other end receives within the call of ``send``."""

    def __init__(self) -> None:
        super().__init__()
        self._peer: MemoryTransport | None = None
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

    async def open(self) -> None:
        """Open this end."""
        self._is_open = True

    async def close(self) -> None:
        """Close this end."""
        self._is_open = False

    def send(self, data: bytes) -> None:
        """Pass the data to the other end if both ends are open."""
        peer = self._peer
        if self._is_open and peer is not None and peer._is_open:
            peer._receiver(data)
        else:
            self.dropped_bytes += len(data)
