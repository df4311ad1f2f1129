"""Events of the link: one frozen class per kind of decoded message.

Time stamps are monotonic seconds of the receiving clock. Angles are in radians and courses clockwise from
north. Positions are WGS84 as in the message; they are converted to the local frame later.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from companion.types.state import AutopilotSettings

WIND_STD_M_S = 1.0  # Standard deviation of a wind estimate that comes without one.


class Dialect(Enum):
    """Mission semantics of the autopilot, and their consequences."""

    ARDUPILOT = "ardupilot"
    PX4 = "px4"

    @property
    def flies_by(self) -> bool:
        """Whether this autopilot turns before a waypoint, as ArduPlane does by WP_RADIUS."""
        return self is Dialect.ARDUPILOT

    @property
    def num_home_items(self) -> int:
        """Number of leading items that MISSION_CURRENT does not count: ArduPlane's home item."""
        return 1 if self is Dialect.ARDUPILOT else 0

    @property
    def swaps_whole_lists(self) -> bool:
        """Whether an upload takes effect with its last item; else each item is overwritten in place."""
        return self is Dialect.PX4

    @property
    def items_at_once(self) -> int:
        """Number of items of a list that are requested, or sent, at once; a PX4 takes one at a time."""
        return 6 if self is Dialect.ARDUPILOT else 1

    @property
    def sets_current_by_command(self) -> bool:
        """Whether this autopilot understands DO_SET_MISSION_CURRENT, not MISSION_SET_CURRENT."""
        return self is Dialect.ARDUPILOT

    @property
    def stays_busy(self) -> bool:
        """Whether an aborted transfer must be cancelled: a PX4 would stay busy for 5 s."""
        return self is Dialect.PX4

    @property
    def sends_covariances(self) -> bool:
        """Whether this autopilot sends WIND_COV and ESTIMATOR_STATUS, not WIND and EKF_STATUS_REPORT."""
        return self is Dialect.PX4

    @property
    def tells_mission_slowly(self) -> bool:
        """Whether MISSION_CURRENT has a fixed rate, whatever rate is requested."""
        return self is Dialect.PX4

    @property
    def parameter_names(self) -> dict[str, str]:
        """Names of the parameters that determine its flight, by field of ``AutopilotSettings``."""
        return _PARAMETER_NAMES[self]

    @property
    def former_parameter_names(self) -> dict[str, str]:
        """Names that earlier versions have for some of these parameters, by field."""
        return {"slope_min_m": "GLIDE_SLOPE_MIN"} if self is Dialect.ARDUPILOT else {}

    def knows_return_paths(self, version: tuple[int, int, int] | None) -> bool:
        """Return whether an autopilot of this version returns by return paths if its parameter says so.

        ArduPlane's release notes name DO_RETURN_PATH_START, which RTL_AUTOLAND 4 needs, with 4.6.2. A version
        that is not known, or 0.0.0 as some builds report, counts as new.
        """
        if version is None or version == (0, 0, 0):
            return True
        return self is Dialect.PX4 or version >= (4, 6, 2)

    @property
    def packs_parameters_bytewise(self) -> bool:
        """Whether PARAM_VALUE holds the bytes of an integer parameter; else it holds the value as a float."""
        return self is Dialect.PX4


class Motion(Enum):
    """The motion that an autopilot flies by itself in a flight mode.

    ``MISSION``: it flies its mission. ``RETURN``: it returns to launch. ``CIRCLE``: it flies to the position
    that it reports as its target, and round it. ``STEERED``: a pilot steers, or the mode is not known.
    """

    MISSION = "mission"
    RETURN = "return"
    CIRCLE = "circle"
    STEERED = "steered"


_PARAMETER_NAMES = {
    Dialect.ARDUPILOT: {
        "fence_enable": "FENCE_ENABLE",  # Requested first: the other fence parameters depend on it.
        "fence_types": "FENCE_TYPE",
        "acceptance_radius_m": "WP_RADIUS",
        "passing_max_m": "WP_MAX_RADIUS",
        "guidance_period_s": "NAVL1_PERIOD",
        "guidance_damping": "NAVL1_DAMPING",
        "bank_max_deg": "ROLL_LIMIT_DEG",
        "loiter_radius_m": "WP_LOITER_RAD",
        "height_offset_m": "ALT_OFFSET",
        "slope_min_m": "ALT_SLOPE_MIN",
        "flight_options": "FLIGHT_OPTIONS",
        "stall_prevention": "STALL_PREVENTION",
        "airspeed_min_m_s": "AIRSPEED_MIN",
        "airspeed_max_m_s": "AIRSPEED_MAX",
        "airspeed_cruise_m_s": "AIRSPEED_CRUISE",
        "climb_max_m_s": "TECS_CLMB_MAX",
        "sink_max_m_s": "TECS_SINK_MAX",
        "throttle_max": "THR_MAX",
        "fence_height_m": "FENCE_ALT_MAX",
        "fence_radius_m": "FENCE_RADIUS",
        "return_height_m": "RTL_ALTITUDE",
        "return_climb_m": "RTL_CLIMB_MIN",
        "level_bank_deg": "LEVEL_ROLL_LIMIT",
        "return_radius_m": "RTL_RADIUS",
        "return_kind": "RTL_AUTOLAND",
        "num_rally_points": "RALLY_TOTAL",
        "rally_limit_km": "RALLY_LIMIT_KM",
        "rally_includes_home": "RALLY_INCL_HOME",
        "terrain_enable": "TERRAIN_ENABLE",
        "terrain_follow": "TERRAIN_FOLLOW",
        "terrain_spacing_m": "TERRAIN_SPACING",
        "look_ahead_m": "TERRAIN_LOOKAHD",
    },
    Dialect.PX4: {
        "acceptance_radius_m": "NAV_ACC_RAD",
        "height_acceptance_m": "NAV_FW_ALT_RAD",
        "guidance_period_s": "NPFG_PERIOD",
        "guidance_damping": "NPFG_DAMPING",
        "bank_max_deg": "FW_R_LIM",
        "loiter_radius_m": "NAV_LOITER_RAD",
        "airspeed_min_m_s": "FW_AIRSPD_MIN",
        "airspeed_max_m_s": "FW_AIRSPD_MAX",
        "airspeed_cruise_m_s": "FW_AIRSPD_TRIM",
        "climb_max_m_s": "FW_T_CLMB_MAX",
        "sink_max_m_s": "FW_T_SINK_MAX",
        "climb_wanted_m_s": "FW_T_CLMB_R_SP",
        "sink_wanted_m_s": "FW_T_SINK_R_SP",
        "throttle_max": "FW_THR_MAX",
        "fence_height_m": "GF_MAX_VER_DIST",
        "fence_radius_m": "GF_MAX_HOR_DIST",
        "return_height_m": "RTL_RETURN_ALT",
        "return_radius_m": "RTL_LOITER_RAD",
        "return_kind": "RTL_TYPE",
    },
}


class Emitter(Enum):
    """Kind of a reported vehicle."""

    GROUND = "ground"
    AIR = "air"


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """HEARTBEAT of the autopilot.

    ``mode`` is the autopilot's name of the flight mode (``AUTO``, ``RTL``, ``MISSION``…), and ``motion`` what
    it does in that mode. ``is_failsafe`` is true while it reports a failsafe. ``is_mission_mode`` is true in
    the mode that flies missions. ``is_contradicted`` is true if heartbeats under the vehicle's ids contradict
    each other; then ``is_mission_mode`` is false, and dialect and ``is_armed`` are the last accepted.
    """

    stamp_s: float
    system_id: int
    component_id: int
    dialect: Dialect
    mode: str
    is_mission_mode: bool
    is_armed: bool
    is_contradicted: bool = False
    motion: Motion = Motion.STEERED
    is_failsafe: bool = False


@dataclass(frozen=True, slots=True)
class GlobalPosition:
    """GLOBAL_POSITION_INT of the vehicle's autopilot: position, and ground velocity east, north, up."""

    stamp_s: float
    boot_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    height_above_home_m: float
    velocity_enu_m_s: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class AirData:
    """VFR_HUD: equivalent airspeed, ground speed, and the throttle as a share of 1."""

    stamp_s: float
    airspeed_m_s: float
    ground_speed_m_s: float
    throttle: float = 0.0


@dataclass(frozen=True, slots=True)
class EngineSpeed:
    """ESC_TELEMETRY_1_TO_4, RPM or EFI_STATUS: the speed of the fastest engine [1/min]."""

    stamp_s: float
    source: str
    speed_rpm: float


@dataclass(frozen=True, slots=True)
class SteeringTarget:
    """POSITION_TARGET_GLOBAL_INT: the position that the autopilot flies to, or circles about."""

    stamp_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float


@dataclass(frozen=True, slots=True)
class Attitude:
    """ATTITUDE: roll, pitch, yaw."""

    stamp_s: float
    bank_rad: float
    pitch_rad: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class WindEstimate:
    """WIND or WIND_COV: velocity of the air over the ground, east and north, and its standard deviation."""

    stamp_s: float
    wind_east_m_s: float
    wind_north_m_s: float
    std_m_s: float = WIND_STD_M_S


@dataclass(frozen=True, slots=True)
class EstimatorAccuracy:
    """ESTIMATOR_STATUS: standard deviation of the horizontal and of the vertical position."""

    stamp_s: float
    position_horizontal_std_m: float
    position_vertical_std_m: float


@dataclass(frozen=True, slots=True)
class EstimatorHealth:
    """EKF_STATUS_REPORT, ESTIMATOR_STATUS or GPS_RAW_INT: the message's name and its fault, '' if none."""

    stamp_s: float
    source: str
    fault: str


@dataclass(frozen=True, slots=True)
class GroundReported:
    """TERRAIN_REPORT, DISTANCE_SENSOR or ALTITUDE: how high the ground is below the aircraft.

    ``source`` is ``autopilot`` for the heights that it stores, ``range finder``, or ``estimator``. Either the
    altitude of the ground is known, or the distance to it. The autopilot names the place, the distance
    between its stored heights (0 if it has none there), and how many it still waits for and has.
    """

    stamp_s: float
    source: str
    altitude_amsl_m: float | None
    distance_m: float | None = None
    place_deg: tuple[float, float] | None = None
    spacing_m: float = 0.0
    num_pending: int = 0
    num_loaded: int = 0


@dataclass(frozen=True, slots=True)
class MissionCurrent:
    """MISSION_CURRENT.

    ``mission_id``, ``rally_id`` and ``fence_id`` identify the lists; they are 0 if the autopilot sends none,
    as ArduPlane. ``state`` is MAVLink's MISSION_STATE: 1 no mission, 2 not started, 3 active, 4 paused, 5
    complete.
    """

    stamp_s: float
    sequence: int
    total: int | None
    mission_id: int
    state: int = 0
    rally_id: int = 0
    fence_id: int = 0


@dataclass(frozen=True, slots=True)
class MissionItemReached:
    """MISSION_ITEM_REACHED."""

    stamp_s: float
    sequence: int


@dataclass(frozen=True, slots=True)
class LandedReported:
    """EXTENDED_SYS_STATE: the number of MAV_LANDED_STATE."""

    stamp_s: float
    landed_state: int


@dataclass(frozen=True, slots=True)
class BatteryReported:
    """BATTERY_STATUS or SYS_STATUS: remaining share in [0, 1], energy used since boot [Wh], voltage [V]."""

    stamp_s: float
    remaining: float | None
    consumed_wh: float | None
    voltage_v: float | None


@dataclass(frozen=True, slots=True)
class HomePosition:
    """HOME_POSITION."""

    stamp_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float


@dataclass(frozen=True, slots=True)
class SettingsReported:
    """The autopilot reported a parameter, and the settings known of it changed."""

    stamp_s: float
    settings: AutopilotSettings


@dataclass(frozen=True, slots=True)
class StatusText:
    """STATUSTEXT of the autopilot."""

    stamp_s: float
    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class TrackReport:
    """One report of another vehicle, from any message.

    Parameters
    ----------
    stamp_s : float
        Clock reading at which the position was true: time of receipt less the age in the message [s].
    source : str
        Message and sender, for instance ``ADSB_VEHICLE 200/156``.
    identity : str
        Identity that does not change during the track: ``icao:00ABCD`` or ``system:42``.
    position_std_m : float or None
        Standard deviation of the horizontal position, if the message has it [m].
    velocity_enu_m_s : tuple of float or None
        Velocity over the ground, if the message has it [m/s].
    altitude_std_m, velocity_std_m_s : float or None
        Standard deviations of altitude and of velocity, if the message has them [m, m/s].
    next_point : tuple of float or None
        Latitude, longitude [deg] and altitude above mean sea level [m] of where the vehicle says that it
        flies next.
    """

    stamp_s: float
    source: str
    identity: str
    emitter: Emitter
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    velocity_enu_m_s: tuple[float, float, float] | None
    position_std_m: float | None
    altitude_std_m: float | None = None
    velocity_std_m_s: float | None = None
    next_point: tuple[float, float, float] | None = None

    @property
    def sender(self) -> str:
        """System and component of the sender, ``200/156``."""
        return self.source.rpartition(" ")[2]

    @property
    def system_id(self) -> int | None:
        """System id of the sender."""
        number = self.sender.partition("/")[0]
        return int(number) if number.isdecimal() else None


@dataclass(frozen=True, slots=True)
class ClockReported:
    """The autopilot's UTC time.

    Parameters
    ----------
    unix_s : float
        Seconds since 1970.
    """

    stamp_s: float
    unix_s: float


@dataclass(frozen=True, slots=True)
class TeamMessage:
    """A payload of another service's team messages.

    Parameters
    ----------
    system_id : int
        System id of the sender.
    payload : bytes
        What :mod:`companion.mission.team.wire` reads.
    """

    stamp_s: float
    system_id: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class Rebooted:
    """The autopilot's boot time decreased: streams and missions must be requested again."""

    stamp_s: float


Event = (
    Heartbeat
    | GlobalPosition
    | AirData
    | EngineSpeed
    | SteeringTarget
    | Attitude
    | WindEstimate
    | EstimatorAccuracy
    | EstimatorHealth
    | GroundReported
    | MissionCurrent
    | MissionItemReached
    | LandedReported
    | BatteryReported
    | HomePosition
    | SettingsReported
    | StatusText
    | TrackReport
    | ClockReported
    | TeamMessage
    | Rebooted
)
