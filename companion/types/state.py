"""The aircraft's own state."""

from __future__ import annotations

import math
from dataclasses import dataclass

from companion.types.mission import SlopeMin

# Values of ArduPlane's RTL_AUTOLAND: straight home, to the landing at once, and by a return path.
STRAIGHT_HOME, LANDING_AT_ONCE, BY_RETURN_PATH = 0.0, 2.0, 4.0
# Options of ArduPlane's FLIGHT_OPTIONS: climbs of a mission are no slopes, and a return climbs first.
CLIMBS_AT_ONCE, CLIMBS_FIRST = 1 << 14, 1 << 4
BANK_MOST_DEG = 80.0  # A larger limit of the bank is a misreading.
BANK_LEAST_DEG = 32.0  # A real ArduPlane held this bank in turns, 5 % above AIRSPEED_MIN.
RETURNS_OVER_GROUND = 1 | 1 << 4  # Bits of ArduPlane's TERRAIN_FOLLOW: all modes, and a return to launch.

# Where a return ends, east, north, up [m], and whether the operator's landing follows there.
ReturnEnd = tuple[tuple[float, float, float], bool]


@dataclass(frozen=True, slots=True)
class Ownship:
    """Position and motion of the aircraft in the local frame.

    Parameters
    ----------
    stamp_s : float
        Clock reading of the state [s].
    position_enu_m : tuple of float
        East, north, up [m].
    course_rad : float
        Course over the ground, clockwise from north [rad].
    flight_path_angle_rad : float
        Flight-path angle, positive up [rad].
    airspeed_m_s, ground_speed_m_s : float
        True airspeed and horizontal ground speed [m/s].
    wind_enu_m_s : tuple of float
        Velocity of the air over the ground, east and north [m/s].
    position_std_m : tuple of float
        Standard deviation of the horizontal and of the vertical position [m].
    bank_rad : float
        Bank angle, positive with the right wing down [rad].
    wind_std_m_s : float
        Standard deviation of the wind [m/s].
    coordination : float
        Rate of turn as a share of that of a coordinated turn with the same bank.
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
    coordination: float = 1.0

    @property
    def velocity_m_s(self) -> tuple[float, float]:
        """Velocity over the ground, east and north [m/s]."""
        speed, course = self.ground_speed_m_s, self.course_rad
        return speed * math.sin(course), speed * math.cos(course)

    @property
    def climb_m_s(self) -> float:
        """Velocity upwards [m/s]."""
        return self.ground_speed_m_s * math.tan(self.flight_path_angle_rad)


@dataclass(frozen=True, slots=True)
class AutopilotSettings:
    """Parameters of the autopilot by their meaning; None if not reported or not existing.

    Their names are in :attr:`companion.types.events.Dialect.parameter_names`.

    Parameters
    ----------
    acceptance_radius_m : float or None
        Distance at which a waypoint counts as reached [m].
    passing_max_m : float or None
        An ArduPlane turns back to a waypoint that it passes farther away, unless this is 0 [m].
    height_acceptance_m : float or None
        Difference of height at which a waypoint counts as reached by a PX4 [m].
    guidance_period_s : float or None
        Period of the lateral guidance [s].
    guidance_damping : float or None
        Damping of the lateral guidance.
    bank_max_deg : float or None
        Largest bank [deg].
    stall_prevention : float or None
        Whether an ArduPlane banks less where it flies little faster than AIRSPEED_MIN.
    loiter_radius_m : float or None
        Default radius of circles, negative anticlockwise [m].
    height_offset_m : float or None
        An ArduPlane flies missions higher by this than their items say [m].
    slope_min_m : float or None
        Change of height from which an ArduPlane flies a leg as a slope; with 0 it flies no slopes [m].
    flight_options : float or None
        Options of an ArduPlane, as bits: :data:`CLIMBS_AT_ONCE` and :data:`CLIMBS_FIRST` matter here.
    airspeed_min_m_s, airspeed_max_m_s, airspeed_cruise_m_s : float or None
        Equivalent airspeeds [m/s].
    climb_max_m_s, sink_max_m_s : float or None
        Largest rates of climb and descent [m/s].
    climb_wanted_m_s, sink_wanted_m_s : float or None
        Rates with which a PX4 climbs and descends in missions [m/s].
    throttle_max : float or None
        Largest throttle: in percent on an ArduPlane, as a share of 1 on a PX4.
    fence_height_m : float or None
        Height limit of the fence above home, 0 without one [m].
    fence_radius_m : float or None
        Distance limit of the fence from home, 0 without one [m].
    fence_enable : float or None
        Whether ArduPilot's fences are enabled.
    fence_types : float or None
        Enabled types: 1 the height, 2 the circle, 4 the polygons.
    return_height_m : float or None
        Height of return to launch above home; negative on an ArduPlane that keeps its height [m].
    return_climb_m : float or None
        Climb with which an ArduPlane's return to launch begins [m].
    level_bank_deg : float or None
        Largest bank of an ArduPlane during that climb [deg].
    return_radius_m : float or None
        Radius of the circle at the end of return to launch, 0 for the default radius [m].
    return_kind : float or None
        Destination of return to launch: ArduPlane's RTL_AUTOLAND, PX4's RTL_TYPE.
    num_rally_points : float or None
        Number of rally points of an ArduPlane.
    rally_limit_km : float or None
        Largest distance to a rally point on an ArduPlane, 0 for any distance [km].
    rally_includes_home : float or None
        Whether an ArduPlane returns home if home is nearer.
    terrain_enable : float or None
        Whether an ArduPlane stores heights of the ground.
    terrain_follow : float or None
        Modes in which an ArduPlane keeps heights over ground, as bits: see :data:`RETURNS_OVER_GROUND`.
    terrain_spacing_m : float or None
        Distance of these heights from each other [m].
    look_ahead_m : float or None
        An ArduPlane climbs ahead of ground that rises within this distance, 0 for none [m].
    """

    acceptance_radius_m: float | None = None
    passing_max_m: float | None = None
    height_acceptance_m: float | None = None
    guidance_period_s: float | None = None
    guidance_damping: float | None = None
    bank_max_deg: float | None = None
    stall_prevention: float | None = None
    loiter_radius_m: float | None = None
    height_offset_m: float | None = None
    slope_min_m: float | None = None
    flight_options: float | None = None
    airspeed_min_m_s: float | None = None
    airspeed_max_m_s: float | None = None
    airspeed_cruise_m_s: float | None = None
    climb_max_m_s: float | None = None
    sink_max_m_s: float | None = None
    climb_wanted_m_s: float | None = None
    sink_wanted_m_s: float | None = None
    throttle_max: float | None = None
    fence_height_m: float | None = None
    fence_radius_m: float | None = None
    fence_enable: float | None = None
    fence_types: float | None = None
    return_height_m: float | None = None
    return_climb_m: float | None = None
    level_bank_deg: float | None = None
    return_radius_m: float | None = None
    return_kind: float | None = None
    num_rally_points: float | None = None
    rally_limit_km: float | None = None
    rally_includes_home: float | None = None
    terrain_enable: float | None = None
    terrain_follow: float | None = None
    terrain_spacing_m: float | None = None
    look_ahead_m: float | None = None

    @property
    def slope_min(self) -> SlopeMin | None:
        """Which legs an ArduPlane flies level; None if it has not reported that."""
        if self.slope_min_m is None:
            return None
        descent_m = self.slope_min_m if self.slope_min_m > 0.0 else math.inf
        return SlopeMin(math.inf if self.has_option(CLIMBS_AT_ONCE) else descent_m, descent_m)

    def has_option(self, option: int) -> bool:
        """Return whether an option of ArduPlane's FLIGHT_OPTIONS is set; it is given as a bit."""
        return bool(int(self.flight_options or 0.0) & option)

    def bank_limit_rad(self, airspeed_m_s: float) -> float:
        """Return the largest bank at an airspeed [rad]; 80° if it is not known.

        With STALL_PREVENTION an ArduPlane banks so far that AIRSPEED_MIN, times the root of the load factor,
        is no faster than it flies, and up to 25° in any case (``Plane::apply_load_factor_roll_limits``). In a
        turn it flies faster for that (``AP_TECS::_update_speed``), so that more than 25° are reached.

        Parameters
        ----------
        airspeed_m_s : float
            Equivalent airspeed [m/s].
        """
        bank_rad = math.radians(min(self.bank_max_deg or BANK_MOST_DEG, BANK_MOST_DEG))
        if not self.stall_prevention or not self.airspeed_min_m_s:
            return bank_rad
        cosine = min(1.0, (self.airspeed_min_m_s / airspeed_m_s) ** 2)
        return min(bank_rad, max(math.radians(BANK_LEAST_DEG), math.acos(cosine)))

    @property
    def climb_rate_max_m_s(self) -> float:
        """Largest rate of climb in a mission [m/s]; infinite if it is not known."""
        return min(filter(None, (self.climb_max_m_s, self.climb_wanted_m_s)), default=math.inf)

    @property
    def sink_rate_max_m_s(self) -> float:
        """Largest rate of descent in a mission [m/s]; infinite if it is not known."""
        return min(filter(None, (self.sink_max_m_s, self.sink_wanted_m_s)), default=math.inf)

    @property
    def returns_over_ground(self) -> bool:
        """Whether an ArduPlane's straight return to launch follows the ground."""
        is_straight = self.return_kind not in (LANDING_AT_ONCE, BY_RETURN_PATH)
        return is_straight and bool(int(self.terrain_follow or 0.0) & RETURNS_OVER_GROUND)

    @property
    def throttle_max_share(self) -> float:
        """Largest throttle as a share of 1; 1 if it is not known."""
        value = self.throttle_max or 1.0
        return min(value if value <= 1.0 else 1e-2 * value, 1.0)

    def fence_limit_m(self, value_m: float | None, kind: int) -> float | None:
        """Return the limit of an enabled fence [m]; None without one.

        Parameters
        ----------
        value_m : float or None
            Value of the parameter [m].
        kind : int
            Bit of the fence in ``fence_types``.
        """
        is_off = self.fence_enable == 0.0 or (
            self.fence_types is not None and not int(self.fence_types) & kind
        )
        return None if is_off or not value_m or value_m < 0.0 else value_m
