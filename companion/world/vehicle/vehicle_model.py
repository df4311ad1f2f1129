"""The aircraft's limits and noise."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from companion.kernels.aircraft.motion import WIND_RESERVE
from companion.kernels.arrays import Limits

GRAVITY_M_S2 = 9.80665
FASTER_SHARES = (0.5, 1.0)  # The planner tries these shares of the range between cruise and fast airspeed.
FASTER_MIN_M_S = 1.0  # A smaller gain of airspeed is not worth a search.


@dataclass(frozen=True, slots=True)
class VehicleModel:
    """Constraints and noise of the aircraft (paper 2.2).

    Speeds are true airspeeds [m/s]. At least ``straight_length_min_m`` is flown straight between two turns.
    ``pitch_rate_max_rad_s`` limits the change of the climb angle. The aircraft flies faster than cruise, up
    to ``airspeed_fast_m_s``, only to escape moving threats. Noise values are standard deviations: process
    noise enters with the control, measurement noise with position, course and climb angle. Turns are banked
    by at most ``bank_max_rad``, which makes them wider in strong wind. ``coordination`` is the rate of turn
    at a bank as a share of that of a coordinated turn: an aircraft that slips turns less.
    ``climb_rate_max_m_s`` and ``sink_rate_max_m_s`` are what the autopilot climbs and descends with at most:
    they flatten the angles.
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
    coordination: float = 1.0
    climb_rate_max_m_s: float = math.inf
    sink_rate_max_m_s: float = math.inf

    def with_rates(self, climb_m_s: float, sink_m_s: float) -> VehicleModel:
        """Return the aircraft with these largest rates of climb and descent [m/s]."""
        return replace(self, climb_rate_max_m_s=climb_m_s, sink_rate_max_m_s=sink_m_s)._flattened()

    def with_banks(self, most_rad: float, at_cruise_rad: float) -> VehicleModel:
        """Return the aircraft with a largest bank, and one for turns at cruise [rad]."""
        at_cruise = replace(self, bank_max_rad=min(self.bank_max_rad, at_cruise_rad))
        return replace(
            self,
            bank_max_rad=min(self.bank_max_rad, most_rad),
            turn_radius_min_m=at_cruise._radius_at(self.airspeed_cruise_m_s),
        )

    def _flattened(self) -> VehicleModel:
        """Return the aircraft with angles whose rates at cruise are at most the largest."""
        climb, sink = (
            math.asin(min(rate / self.airspeed_cruise_m_s, 1.0))
            for rate in (self.climb_rate_max_m_s, self.sink_rate_max_m_s)
        )
        return replace(
            self,
            climb_angle_max_rad=min(self.climb_angle_max_rad, climb),
            descent_angle_max_rad=min(self.descent_angle_max_rad, sink),
        )

    def turn_radius_in(self, wind_m_s: float) -> float:
        """Return the ground radius of the tightest turn that is possible on any course [m].

        This is ``turn_radius_min_m``, or the radius of ``bank_max_rad`` at the ground speed downwind if that
        is larger (Beard, McLain, *Small Unmanned Aircraft*, eq. 9.14, without a crab angle).

        Parameters
        ----------
        wind_m_s : float
            Speed of the wind [m/s]; a reserve is added, by the factor
            :data:`~companion.kernels.aircraft.motion.WIND_RESERVE`.
        """
        fastest = self.airspeed_cruise_m_s + WIND_RESERVE * wind_m_s
        return self._radius_at(fastest) if wind_m_s > 0.0 else self.turn_radius_min_m

    def _radius_at(self, speed_m_s: float) -> float:
        """Return ``turn_radius_min_m``, or the radius of ``bank_max_rad`` at a speed if larger [m]."""
        return max(self.turn_radius_min_m, speed_m_s**2 / self.sideways_max_m_s2)

    @property
    def sideways_max_m_s2(self) -> float:
        """Centripetal acceleration in a turn banked by ``bank_max_rad`` [m/s²]."""
        return self.coordination * GRAVITY_M_S2 * math.tan(self.bank_max_rad)

    @property
    def faster_m_s(self) -> tuple[float, ...]:
        """Airspeeds above cruise for the planner to try, the slowest first [m/s]."""
        gained = min(self.airspeed_fast_m_s, self.airspeed_max_m_s) - self.airspeed_cruise_m_s
        if gained < FASTER_MIN_M_S:
            return ()
        return tuple(self.airspeed_cruise_m_s + share * gained for share in FASTER_SHARES)

    def at_speed(self, airspeed_m_s: float) -> VehicleModel:
        """Return the aircraft at a higher cruise speed, with the turns and climbs that are possible then."""
        if airspeed_m_s <= self.airspeed_cruise_m_s:
            return self
        return replace(
            self, airspeed_cruise_m_s=airspeed_m_s, turn_radius_min_m=self._radius_at(airspeed_m_s)
        )._flattened()

    def slope_in(self, angle_rad: float, wind_m_s: float, airspeed_m_s: float) -> float:
        """Return the ground slope of a climb angle flown downwind, the flattest that is guaranteed [rad].

        Parameters
        ----------
        angle_rad : float
            Climb or descent angle in still air, positive.
        wind_m_s : float
            Speed of the wind [m/s]; a reserve is added, by the factor
            :data:`~companion.kernels.aircraft.motion.WIND_RESERVE`.
        airspeed_m_s : float
            Airspeed; above cruise the slope at cruise is returned, the flatter one [m/s].
        """
        if wind_m_s == 0.0:
            return angle_rad
        speed = min(airspeed_m_s, self.airspeed_cruise_m_s)
        return math.atan2(speed * math.sin(angle_rad), speed * math.cos(angle_rad) + WIND_RESERVE * wind_m_s)

    def limits(
        self, dimension: int, bounds: tuple[float, ...], margin_m: float, tau_s: float,
        wind_enu_m_s: tuple[float, float] = (0.0, 0.0), from_airspeed_m_s: float = math.inf,
    ) -> Limits:  # fmt: skip
        """Return the kernels' form: the limits over the ground in the wind.

        A wind flattens the climb of a slow aircraft more than that of a fast one. The climb limits hold from
        the first airspeed on, therefore they are those of the lower one of the first airspeed and cruise.

        Parameters
        ----------
        dimension : int
            2 or 3.
        bounds : tuple of float
            East, north, up, each low and high [m].
        margin_m : float
            Distance that plans keep from obstacles [m].
        tau_s : float
            Duration of one step in still air [s].
        wind_enu_m_s : tuple of float
            Velocity of the air over the ground, east and north [m/s].
        from_airspeed_m_s : float
            Airspeed at the start of the path [m/s].
        """
        wind = math.hypot(*wind_enu_m_s)
        return Limits(
            v_min=self.airspeed_min_m_s,
            v_max=self.airspeed_max_m_s,
            v_cruise=self.airspeed_cruise_m_s,
            a_max=self.acceleration_max_m_s2,
            r_min=self.turn_radius_in(wind),
            sideways_max=self.sideways_max_m_s2,
            straight_min=self.straight_length_min_m,
            climb_max=self.slope_in(self.climb_angle_max_rad, wind, from_airspeed_m_s),
            descent_max=self.slope_in(self.descent_angle_max_rad, wind, from_airspeed_m_s),
            pitch_rate_max=self.pitch_rate_max_rad_s,
            margin=margin_m,
            tau=tau_s,
            dimension=dimension,
            bounds=np.array(bounds, dtype=np.float64),
            wind_x=float(wind_enu_m_s[0]),
            wind_y=float(wind_enu_m_s[1]),
        )
