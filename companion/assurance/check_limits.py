"""What the checker holds paths and missions to."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckLimits:
    """What a path has to keep.

    Parameters
    ----------
    bounds : tuple of float
        East, north, up, each low and high [m].
    margin_m : float
        Distance from obstacles beyond what the covariance asks for [m].
    deviations : float
        Standard deviations of position added to the margin.
    turn_radius_min_m, straight_length_min_m : float
        Smallest radius of a turn, and shortest straight flight between two turns [m].
    bank_max_rad : float
        With the wind behind a turn is wider: its radius is flown at no more bank than this.
    climb_angle_max_rad, descent_angle_max_rad : float
        Both positive [rad].
    airspeed_min_m_s, airspeed_max_m_s : float
        Limits of the airspeed [m/s].
    acceleration_max_m_s2 : float
        How fast the airspeed may rise along the path, as in still air [m/s²].
    threat_level_max : float
        Largest threat level of a row; 1 limits nothing.
    quality_min : float
        Smallest product of p_c over the rows.
    altitude_tolerance_m : float
        Widens the altitude band, for an aircraft in flight [m].
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
    bank_max_rad: float = math.radians(40.0)
    threat_level_max: float = 1.0
    quality_min: float = 0.0
    altitude_tolerance_m: float = 0.0
