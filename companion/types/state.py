"""The aircraft's own state."""

from __future__ import annotations

import math
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
    wind_std_m_s : float
        How well the wind is known [m/s].
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
    wind_std_m_s: float = 0.0

    @property
    def velocity_m_s(self) -> tuple[float, float]:
        """Velocity over the ground, east and north [m/s]."""
        speed, course = self.ground_speed_m_s, self.course_rad
        return speed * math.sin(course), speed * math.cos(course)


@dataclass(frozen=True, slots=True)
class AutopilotSettings:
    """Parameters by what they mean; None where the autopilot has not told, or has no such parameter.

    Their names are :attr:`companion.types.events.Dialect.parameter_names`.

    Parameters
    ----------
    acceptance_radius_m : float or None
        Distance at which a waypoint counts as reached [m].
    guidance_period_s : float or None
        Period of the lateral guidance [s].
    guidance_damping : float or None
        Damping of the same.
    bank_max_deg : float or None
        Largest bank [deg].
    loiter_radius_m : float or None
        Radius of circles that name none, negative anticlockwise [m].
    airspeed_min_m_s, airspeed_max_m_s, airspeed_cruise_m_s : float or None
        Equivalent airspeeds [m/s].
    climb_max_m_s, sink_max_m_s : float or None
        Largest rates of climb and descent [m/s].
    fence_height_m : float or None
        Height above home that a fence ends the flight at, 0 without one [m].
    fence_radius_m : float or None
        Distance from home that a fence ends the flight at, 0 without one [m].
    fence_enable : float or None
        Whether ArduPilot's fences are watched.
    fence_types : float or None
        Which of them: 1 the height, 2 the circle, 4 the polygons.
    return_height_m : float or None
        Height above home of a return to launch; an ArduPlane's is negative where it keeps its own [m].
    return_radius_m : float or None
        Radius of the circle at its end, 0 for that of other circles [m].
    return_kind : float or None
        Where it leads: ArduPlane's RTL_AUTOLAND, PX4's RTL_TYPE.
    num_rally_points : float or None
        How many an ArduPlane holds.
    rally_limit_km : float or None
        How far an ArduPlane flies to a rally point, 0 for any distance [km].
    rally_includes_home : float or None
        Whether it returns home where that is nearer.
    """

    acceptance_radius_m: float | None = None
    guidance_period_s: float | None = None
    guidance_damping: float | None = None
    bank_max_deg: float | None = None
    loiter_radius_m: float | None = None
    airspeed_min_m_s: float | None = None
    airspeed_max_m_s: float | None = None
    airspeed_cruise_m_s: float | None = None
    climb_max_m_s: float | None = None
    sink_max_m_s: float | None = None
    fence_height_m: float | None = None
    fence_radius_m: float | None = None
    fence_enable: float | None = None
    fence_types: float | None = None
    return_height_m: float | None = None
    return_radius_m: float | None = None
    return_kind: float | None = None
    num_rally_points: float | None = None
    rally_limit_km: float | None = None
    rally_includes_home: float | None = None

    def fence_limit_m(self, value_m: float | None, kind: int) -> float | None:
        """A limit of a fence that is watched [m]; None without.

        Parameters
        ----------
        value_m : float or None
            What the parameter says [m].
        kind : int
            The fence's bit in ``fence_types``.
        """
        is_off = self.fence_enable == 0.0 or (
            self.fence_types is not None and not int(self.fence_types) & kind
        )
        return None if is_off or not value_m or value_m < 0.0 else value_m
