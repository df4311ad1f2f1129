"""What the aircraft can do."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from companion.kernels.aircraft.motion import WIND_RESERVE
from companion.kernels.arrays import Limits

GRAVITY_M_S2 = 9.80665
FASTER_SHARES = (0.5, 1.0)  # of what the aircraft could fly faster than at cruise
FASTER_MIN_M_S = 1.0  # less is not worth a search


@dataclass(frozen=True, slots=True)
class VehicleModel:
    """Constraints and noise of the aircraft (paper 2.2).

    Speeds are true airspeeds [m/s]; ``straight_length_min_m`` is flown between two turns; the
    climb rate of change is bounded by ``pitch_rate_max_rad_s``. Faster than cruise, up to
    ``airspeed_fast_m_s``, is flown only before moving threats. Noise values are standard deviations:
    process noise enters with the control, measurement noise with position, course and climb angle. A turn
    is banked by ``bank_max_rad`` at most, which in strong wind makes it wider.
    """

    airspeed_min_m_s: float = 12.5
    airspeed_max_m_s: float = 37.5
    airspeed_cruise_m_s: float = 25.0
    airspeed_fast_m_s: float = 37.5
    acceleration_max_m_s2: float = 0.5
    turn_radius_min_m: float = 125.0
    straight_length_min_m: float = 125.0
    climb_angle_max_rad: float = math.radians(10.0)
    descent_angle_max_rad: float = math.radians(10.0)
    pitch_rate_max_rad_s: float = 0.1
    penetration_speed_m_s: float = 25.0
    acceleration_std_m_s2: float = 0.3
    course_rate_std_rad_s: float = 0.02
    climb_rate_std_rad_s: float = 0.01
    position_std_m: float = 2.0
    altitude_std_m: float = 2.0
    course_std_rad: float = math.radians(2.0)
    climb_std_rad: float = math.radians(1.0)
    bank_max_rad: float = math.radians(40.0)

    def turn_radius_in(self, wind_m_s: float) -> float:
        """Radius over the ground of the tightest turn that can be flown on any course [m].

        ``turn_radius_min_m``, or that of ``bank_max_rad`` at the ground speed downwind, where it is larger
        (Beard, McLain, *Small Unmanned Aircraft*, eq. 9.14, without a crab angle).

        Parameters
        ----------
        wind_m_s : float
            Speed of the wind; :data:`~companion.kernels.aircraft.motion.WIND_RESERVE` more is reckoned with.
        """
        fastest = self.airspeed_cruise_m_s + WIND_RESERVE * wind_m_s
        return self._radius_at(fastest) if wind_m_s > 0.0 else self.turn_radius_min_m

    def _radius_at(self, speed_m_s: float) -> float:
        """``turn_radius_min_m``, or that of ``bank_max_rad`` at a speed, where it is larger [m]."""
        return max(self.turn_radius_min_m, speed_m_s**2 / self._sideways_max_m_s2)

    @property
    def _sideways_max_m_s2(self) -> float:
        """Acceleration in a turn banked by ``bank_max_rad`` [m/s²]."""
        return GRAVITY_M_S2 * math.tan(self.bank_max_rad)

    @property
    def faster_m_s(self) -> tuple[float, ...]:
        """Airspeeds above cruise that are worth trying, the slowest first [m/s]."""
        gained = min(self.airspeed_fast_m_s, self.airspeed_max_m_s) - self.airspeed_cruise_m_s
        if gained < FASTER_MIN_M_S:
            return ()
        return tuple(self.airspeed_cruise_m_s + share * gained for share in FASTER_SHARES)

    def at_speed(self, airspeed_m_s: float) -> VehicleModel:
        """The same aircraft, cruising faster: with wider turns where ``bank_max_rad`` allows no others."""
        if airspeed_m_s <= self.airspeed_cruise_m_s:
            return self
        return replace(
            self, airspeed_cruise_m_s=airspeed_m_s, turn_radius_min_m=self._radius_at(airspeed_m_s)
        )

    def slope_in(self, angle_rad: float, wind_m_s: float) -> float:
        """Slope over the ground that a climb angle in the air comes to at least, flown downwind [rad].

        Parameters
        ----------
        angle_rad : float
            Climb or descent angle in still air, positive.
        wind_m_s : float
            Speed of the wind; :data:`~companion.kernels.aircraft.motion.WIND_RESERVE` more is reckoned with.
        """
        if wind_m_s == 0.0:
            return angle_rad
        speed = self.airspeed_cruise_m_s
        return math.atan2(speed * math.sin(angle_rad), speed * math.cos(angle_rad) + WIND_RESERVE * wind_m_s)

    def limits(
        self, dimension: int, bounds: tuple[float, ...], margin_m: float, tau_s: float,
        wind_enu_m_s: tuple[float, float] = (0.0, 0.0),
    ) -> Limits:  # fmt: skip
        """Kernel form: what can be flown over the ground, in the wind.

        Parameters
        ----------
        dimension : int
            2 or 3.
        bounds : tuple of float
            East, north, up, each low and high [m].
        margin_m : float
            Distance kept from obstacles [m].
        tau_s : float
            Time of one step in still air [s].
        wind_enu_m_s : tuple of float
            Velocity of the air over the ground, east and north [m/s].
        """
        wind = math.hypot(*wind_enu_m_s)
        return Limits(
            v_min=self.airspeed_min_m_s,
            v_max=self.airspeed_max_m_s,
            v_cruise=self.airspeed_cruise_m_s,
            a_max=self.acceleration_max_m_s2,
            r_min=self.turn_radius_in(wind),
            sideways_max=self._sideways_max_m_s2,
            straight_min=self.straight_length_min_m,
            climb_max=self.slope_in(self.climb_angle_max_rad, wind),
            descent_max=self.slope_in(self.descent_angle_max_rad, wind),
            pitch_rate_max=self.pitch_rate_max_rad_s,
            margin=margin_m,
            tau=tau_s,
            dimension=dimension,
            bounds=np.array(bounds, dtype=np.float64),
            wind_x=float(wind_enu_m_s[0]),
            wind_y=float(wind_enu_m_s[1]),
        )
