"""The limits that the checker applies to paths and missions."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckLimits:
    """The limits of a path.

    Parameters
    ----------
    bounds : tuple of float
        East, north, up, each low and high [m].
    margin_m : float
        Distance from obstacles, in addition to the position's uncertainty [m].
    deviations : float
        Number of standard deviations of position that are added to the margin.
    turn_radius_min_m : float
        Smallest radius of a turn [m].
    straight_length_min_m : float
        Shortest straight flight between two turns [m].
    sideways_max_m_s2 : float
        Largest centripetal acceleration; by default that of a coordinated turn with 40° of bank. With the
        wind behind, such a turn is wider than in still air [m/s²].
    climb_angle_max_rad, descent_angle_max_rad : float
        Steepest climb and descent, both positive [rad].
    airspeed_min_m_s, airspeed_max_m_s : float
        Limits of the airspeed [m/s].
    acceleration_max_m_s2 : float
        Largest increase of the airspeed, as in still air [m/s²].
    threat_level_max : float
        Largest threat level of a row; 1 means no limit.
    quality_min : float
        Smallest product of p_c over the rows.
    altitude_tolerance_m : float
        Widening of the altitude bounds, for an aircraft in flight [m].
    """

    bounds: tuple[float, float, float, float, float, float]
    margin_m: float
    deviations: float = 1.0
    turn_radius_min_m: float
    straight_length_min_m: float
    climb_angle_max_rad: float
    descent_angle_max_rad: float
    airspeed_min_m_s: float
    airspeed_max_m_s: float
    acceleration_max_m_s2: float
    sideways_max_m_s2: float = 9.80665 * math.tan(math.radians(40.0))
    threat_level_max: float = 1.0
    quality_min: float = 0.0
    altitude_tolerance_m: float = 0.0
