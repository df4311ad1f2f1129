"""How many of a sender's frames do not arrive, told by the gaps in their sequence numbers."""

from __future__ import annotations

from companion.link.wire.framing import MAGIC_V2

_ROUND = 256
_GAP_MAX = 128  # more is taken for a frame that comes late, or for a sender that began anew


class LinkQuality:
    """Counts the frames of one sender.

    Attributes
    ----------
    received, lost : int
        Frames that came, and frames that must have been sent between them.
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
            return  # the same again
        self._last = number
        if ahead <= _GAP_MAX:
            self.lost += ahead - 1

    @property
    def loss(self) -> float:
        """Share of the frames sent that did not arrive; 0 while nothing came."""
        sent = self.received + self.lost
        return self.lost / sent if sent else 0.0
