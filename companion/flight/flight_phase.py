"""On the ground or not: when a flight is over, and when there is none."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

LANDED_S = 10.0  # not armed for so long; less may be a slip of the pilot's
GROUND_MAX_S = 3_600.0


@dataclass(frozen=True, slots=True)
class FlightPhase:
    """Whether the aircraft is, or was, armed.

    Parameters
    ----------
    begun_s : float
        When this began, by the clock [s].
    has_flown : bool
        Whether the aircraft was armed since.
    is_armed : bool
        What the autopilot told last.
    disarmed_s : float
        Since when it tells that it is not armed [s]; infinite before it was heard.
    """

    begun_s: float
    has_flown: bool = False
    is_armed: bool = False
    disarmed_s: float = math.inf

    def is_grounded(self, now_s: float) -> bool:
        """Whether the aircraft has not been armed for a while; an autopilot never heard tells nothing."""
        return not self.is_armed and now_s - self.disarmed_s >= LANDED_S

    def is_over(self, now_s: float) -> bool:
        """Whether there was a flight, and it is over."""
        return self.has_flown and self.is_grounded(now_s)

    def is_idle(self, now_s: float) -> bool:
        """Whether there has been no flight for so long that none of it is worth a recording."""
        return not self.has_flown and now_s - self.begun_s >= GROUND_MAX_S


def after_armed_state(phase: FlightPhase, now_s: float, *, is_armed: bool) -> FlightPhase:
    """The phase after a heartbeat of the autopilot's.

    Parameters
    ----------
    phase : FlightPhase
        The one before.
    now_s : float
        When it was heard [s].
    is_armed : bool
        What it says.
    """
    is_news = is_armed or phase.is_armed or phase.disarmed_s == math.inf
    return replace(
        phase,
        disarmed_s=now_s if is_news else phase.disarmed_s,
        is_armed=is_armed,
        has_flown=phase.has_flown or is_armed,
    )
