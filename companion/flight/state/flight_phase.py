"""The phase of a flight: when a flight has begun, when it is over, and when there is none."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from companion.types.mavlink_enums import LandedState

LANDED_S = 10.0  # A flight is over after this time disarmed; a shorter one may be the pilot's mistake.
GROUND_MAX_S = 3_600.0  # A recording on the ground is restarted after this time without a flight.
# An autopilot that does not report its landed state is flying above this height over home and ground speed.
AIRBORNE_M, AIRBORNE_M_S = 10.0, 8.0


@dataclass(frozen=True, slots=True)
class FlightPhase:
    """The phase of a flight: whether the aircraft is or was armed, and whether it flies.

    Parameters
    ----------
    begun_s : float
        When this phase began, by the clock [s].
    has_flown : bool
        Whether the aircraft was armed since.
    is_armed : bool
        The autopilot's last report.
    disarmed_s : float
        Since when the autopilot reports disarmed [s]; infinite before the first report.
    landed_state : int
        The last MAV_LANDED_STATE; undefined if none is reported.
    is_moving : bool
        Whether the aircraft is so fast and so high that it must be flying.
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
        # A PX4 reports TAKEOFF until its take-off item is done, on the ground and in the climb.
        is_climbing = self.landed_state == LandedState.TAKEOFF and self.is_moving
        return self.is_armed and (is_up or is_climbing)

    def is_grounded(self, now_s: float) -> bool:
        """Return whether the aircraft has been disarmed for a while; False before the first report."""
        return not self.is_armed and now_s - self.disarmed_s >= LANDED_S

    def is_over(self, now_s: float) -> bool:
        """Return whether there was a flight, and it is over."""
        return self.has_flown and self.is_grounded(now_s)

    def is_idle(self, now_s: float) -> bool:
        """Return whether there has been no flight for so long that the recording is restarted."""
        return not self.has_flown and now_s - self.begun_s >= GROUND_MAX_S


def after_armed_state(phase: FlightPhase, now_s: float, *, is_armed: bool) -> FlightPhase:
    """Return the phase after a heartbeat of the autopilot.

    Parameters
    ----------
    phase : FlightPhase
        The phase before.
    now_s : float
        When the heartbeat was received [s].
    is_armed : bool
        Whether it reports armed.
    """
    is_news = is_armed or phase.is_armed or phase.disarmed_s == math.inf
    return replace(
        phase,
        disarmed_s=now_s if is_news else phase.disarmed_s,
        is_armed=is_armed,
        has_flown=phase.has_flown or is_armed,
    )


def after_landed_state(phase: FlightPhase, landed_state: int) -> FlightPhase:
    """Return the phase after the autopilot reported its MAV_LANDED_STATE."""
    return replace(phase, landed_state=landed_state)


def after_movement(phase: FlightPhase, height_above_home_m: float, ground_speed_m_s: float) -> FlightPhase:
    """Return the phase after a position report: height above home [m], speed over ground [m/s]."""
    is_moving = height_above_home_m >= AIRBORNE_M and ground_speed_m_s >= AIRBORNE_M_S
    return phase if phase.is_moving is is_moving else replace(phase, is_moving=is_moving)
