"""The aircraft's own state."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Ownship:
    """Where the aircraft is and how it moves, in the local frame.

    Parameters
    ----------
    stamp_s : float
        Clock reading at which it was true.
    position_enu_m : tuple of float
        East, north, up [m].
    course_rad : float
        Course over the ground, clockwise from north [rad].
    flight_path_angle_rad : float
        Positive up [rad].
    airspeed_m_s, ground_speed_m_s : float
        True airspeed and horizontal ground speed [m/s].
    wind_enu_m_s : tuple of float
        Velocity of the air over the ground, east and north [m/s].
    position_std_m : tuple of float
        One-sigma horizontal and vertical position accuracy [m].
    bank_rad : float
        Positive right wing down [rad].
    """

    stamp_s: float
    position_enu_m: tuple[float, float, float]
    course_rad: float
    flight_path_angle_rad: float
    airspeed_m_s: float
    ground_speed_m_s: float
    wind_enu_m_s: tuple[float, float] = (0.0, 0.0)
    position_std_m: tuple[float, float] = (2.0, 3.0)
    bank_rad: float = 0.0
