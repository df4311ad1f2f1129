"""Estimates from the gaps in sequence numbers how many frames of a sender are lost."""

from __future__ import annotations

from companion.link.wire.framing import MAGIC_V2

_ROUND = 256
_GAP_MAX = 128  # A larger gap is a frame that arrives late, or a sender that restarted.


class LinkQuality:
    """Counts the frames of one sender.

    Attributes
    ----------
    received : int
        Number of frames received.
    lost : int
        Number of frames missing between them.
    """

    def __init__(self) -> None:
        self.received = 0
        self.lost = 0
        self._last: int | None = None

    def note(self, raw: bytes) -> None:
        """Take note of a received frame."""
        number = raw[4] if raw[0] == MAGIC_V2 else raw[2]
        ahead = 1 if self._last is None else (number - self._last) % _ROUND
        self.received += 1
        if ahead == 0:
            return  # The frame is a duplicate.
        self._last = number
        if ahead <= _GAP_MAX:
            self.lost += ahead - 1

    @property
    def loss(self) -> float:
        """Share of the sent frames that did not arrive; 0 before the first frame."""
        sent = self.received + self.lost
        return self.lost / sent if sent else 0.0
