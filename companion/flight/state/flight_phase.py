"""On the ground or not: when a flight has begun, when it is over, and when there is none."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from companion.types.mavlink_enums import LandedState

LANDED_S = 10.0  # not armed for so long; less may be a slip of the pilot's
GROUND_MAX_S = 3_600.0
AIRBORNE_M, AIRBORNE_M_S = 10.0, 8.0  # above home and over ground, of an autopilot that does not tell


@dataclass(frozen=True, slots=True)
class FlightPhase:
    """Whether the aircraft is, or was, armed, and whether it flies.

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
    landed_state : int
        MAV_LANDED_STATE as told last; undefined where it is not told.
    is_moving : bool
        Whether it is so fast and so high that it must be flying.
    """

    begun_s: float
    has_flown: bool = False
    is_armed: bool = False
    disarmed_s: float = math.inf
    landed_state: int = LandedState.UNDEFINED
    is_moving: bool = False

    @property
    def is_airborne(self) -> bool:
        """Whether the aircraft flies."""
        if self.landed_state == LandedState.UNDEFINED:
            return self.is_armed and self.is_moving
        is_up = self.landed_state in (LandedState.IN_AIR, LandedState.LANDING)
        # A PX4 tells TAKEOFF until its take-off item is done, on the ground as in the climb.
        is_climbing = self.landed_state == LandedState.TAKEOFF and self.is_moving
        return self.is_armed and (is_up or is_climbing)

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


def after_landed_state(phase: FlightPhase, landed_state: int) -> FlightPhase:
    """The phase after the autopilot told its MAV_LANDED_STATE."""
    return replace(phase, landed_state=landed_state)


def after_movement(phase: FlightPhase, height_above_home_m: float, ground_speed_m_s: float) -> FlightPhase:
    """The phase after the autopilot told a position: height above home [m], speed over ground [m/s]."""
    is_moving = height_above_home_m >= AIRBORNE_M and ground_speed_m_s >= AIRBORNE_M_S
    return phase if phase.is_moving is is_moving else replace(phase, is_moving=is_moving)
