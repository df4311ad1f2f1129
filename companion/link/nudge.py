"""What MAVSDK does not do over a lossy link: send an item again that may have been lost.

It sends an item when the autopilot asks for it, and ends an upload after 2.5 s without a question; an
ArduPlane asks again once a second. Telling MAVSDK the last question once more makes it send the item
once more, and wait on.
"""

from __future__ import annotations

REPEAT_S = 0.5
PATIENCE_S = 7.0  # after the last question: an ArduPlane gives up after 8 s, a PX4 after 5 s
_INVALID_SEQUENCE = 13


class Nudge:
    """Watches one upload."""

    def __init__(self) -> None:
        self._question: bytes | None = None
        self._heard_s = 0.0
        self._due_s = 0.0

    def note_question(self, frame: bytes, now_s: float) -> None:
        """The autopilot asked for an item."""
        self._question, self._heard_s, self._due_s = frame, now_s, now_s + REPEAT_S

    def is_noise(self, result: int) -> bool:
        """Whether an acknowledgement only says that an item came twice: the upload goes on."""
        return self._question is not None and result == _INVALID_SEQUENCE

    def due(self, now_s: float) -> bytes | None:
        """The question to tell MAVSDK again, None if it is not time, or no use any more."""
        if self._question is None or now_s < self._due_s or now_s - self._heard_s > PATIENCE_S:
            return None
        self._due_s = now_s + REPEAT_S
        return self._question
