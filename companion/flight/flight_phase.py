"""On the ground or not: when a flight is over, and when there is none."""

from __future__ import annotations

import math

LANDED_S = 10.0  # not armed for so long; less may be a slip of the pilot's
GROUND_MAX_S = 3_600.0


class Ground:
    """Follows whether the aircraft is armed.

    Parameters
    ----------
    now_s : float
        When this began.

    Attributes
    ----------
    has_flown : bool
        Whether the aircraft was armed since.
    """

    def __init__(self, now_s: float) -> None:
        self.has_flown = False
        self._begun_s = now_s
        self._is_armed = False
        self._disarmed_s = math.inf

    def note(self, now_s: float, *, is_armed: bool) -> None:
        """Take what a heartbeat of the autopilot's says."""
        if is_armed or self._is_armed or self._disarmed_s == math.inf:
            self._disarmed_s = now_s
        self._is_armed = is_armed
        self.has_flown |= is_armed

    def is_grounded(self, now_s: float) -> bool:
        """Whether the aircraft has not been armed for a while; an autopilot never heard tells nothing."""
        return not self._is_armed and now_s - self._disarmed_s >= LANDED_S

    def is_over(self, now_s: float) -> bool:
        """Whether there was a flight, and it is over."""
        return self.has_flown and self.is_grounded(now_s)

    def is_idle(self, now_s: float) -> bool:
        """Whether there has been no flight for so long that none of it is worth a recording."""
        return not self.has_flown and now_s - self._begun_s >= GROUND_MAX_S
