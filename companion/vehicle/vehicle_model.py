"""What the aircraft can do."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.kernels.arrays import Limits


@dataclass(frozen=True, slots=True)
class VehicleModel:
    """Constraints and noise of the aircraft (paper 2.2).

    Speeds are true airspeeds [m/s]; ``straight_length_min_m`` is flown between two turns; the
    climb rate of change is bounded by ``pitch_rate_max_rad_s``. Noise values are standard deviations:
    process noise enters with the control, measurement noise with position, course and climb angle.
    """

    airspeed_min_m_s: float = 12.5
    airspeed_max_m_s: float = 37.5
    airspeed_cruise_m_s: float = 25.0
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

    def limits(self, dimension: int, bounds: tuple[float, ...], margin_m: float, tau_s: float) -> Limits:
        """Kernel form. ``bounds``: east, north, up, each low and high [m]."""
        return Limits(
            v_min=self.airspeed_min_m_s,
            v_max=self.airspeed_max_m_s,
            v_cruise=self.airspeed_cruise_m_s,
            a_max=self.acceleration_max_m_s2,
            r_min=self.turn_radius_min_m,
            straight_min=self.straight_length_min_m,
            climb_max=self.climb_angle_max_rad,
            descent_max=self.descent_angle_max_rad,
            pitch_rate_max=self.pitch_rate_max_rad_s,
            margin=margin_m,
            tau=tau_s,
            dimension=dimension,
            bounds=np.array(bounds, dtype=np.float64),
        )
