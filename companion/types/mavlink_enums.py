"""Numbers of MAVLink that the program sends or distinguishes, with their names in the dialect.

A received number may have no member here, if it comes from a newer dialect or a faulty sender. Fields of
received messages therefore are integers, which compare equal to the members.

References
----------
MAVLink ``minimal.xml``, ``standard.xml``, ``common.xml`` and ``ardupilotmega.xml``.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag


def name_of(kind: type[IntEnum], number: int) -> str:
    """Return the name of a number; a number without a member gives ``result`` and the number."""
    try:
        return kind(number).name
    except ValueError:
        return f"result {number}"


class MessageId(IntEnum):
    """Messages, by their ids."""

    HEARTBEAT = 0
    SYS_STATUS = 1
    SYSTEM_TIME = 2
    GPS_RAW_INT = 24
    SCALED_PRESSURE = 29
    ATTITUDE = 30
    GLOBAL_POSITION_INT = 33
    MISSION_WRITE_PARTIAL_LIST = 38
    MISSION_ITEM = 39
    MISSION_REQUEST = 40
    MISSION_SET_CURRENT = 41
    MISSION_CURRENT = 42
    MISSION_REQUEST_LIST = 43
    MISSION_COUNT = 44
    MISSION_CLEAR_ALL = 45
    MISSION_ITEM_REACHED = 46
    MISSION_ACK = 47
    MISSION_REQUEST_INT = 51
    MISSION_ITEM_INT = 73
    VFR_HUD = 74
    COMMAND_LONG = 76
    COMMAND_ACK = 77
    POSITION_TARGET_GLOBAL_INT = 87
    BATTERY_STATUS = 147
    DISTANCE_SENSOR = 132
    TERRAIN_REPORT = 136
    ALTITUDE = 141
    AUTOPILOT_VERSION = 148
    WIND = 168
    EKF_STATUS_REPORT = 193
    ESTIMATOR_STATUS = 230
    WIND_COV = 231
    HOME_POSITION = 242
    EXTENDED_SYS_STATE = 245
    ADSB_VEHICLE = 246
    STATUSTEXT = 253
    SETUP_SIGNING = 256
    COMPONENT_METADATA = 397
    ESC_TELEMETRY_1_TO_4 = 11030


class Command(IntEnum):
    """MAV_CMD."""

    NAV_WAYPOINT = 16
    NAV_LOITER_UNLIM = 17
    NAV_LOITER_TURNS = 18
    NAV_LOITER_TIME = 19
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    NAV_LOITER_TO_ALT = 31
    NAV_SPLINE_WAYPOINT = 82
    NAV_VTOL_TAKEOFF = 84
    DO_SET_MODE = 176
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178
    DO_RETURN_PATH_START = 188
    DO_LAND_START = 189
    DO_SET_MISSION_CURRENT = 224
    REQUEST_MESSAGE = 512
    DO_JUMP_TAG = 601
    NAV_FENCE_RETURN_POINT = 5000
    NAV_FENCE_POLYGON_VERTEX_INCLUSION = 5001
    NAV_FENCE_POLYGON_VERTEX_EXCLUSION = 5002
    NAV_FENCE_CIRCLE_INCLUSION = 5003
    NAV_FENCE_CIRCLE_EXCLUSION = 5004
    NAV_RALLY_POINT = 5100


class MavFrame(IntEnum):
    """MAV_FRAME: reference of a mission item's altitude, and encoding of its position."""

    GLOBAL = 0
    MISSION = 2
    GLOBAL_RELATIVE_ALT = 3
    GLOBAL_INT = 5
    GLOBAL_RELATIVE_ALT_INT = 6
    GLOBAL_TERRAIN_ALT = 10
    GLOBAL_TERRAIN_ALT_INT = 11


class CommandResult(IntEnum):
    """MAV_RESULT: result of a command."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6


class MissionResult(IntEnum):
    """MAV_MISSION_RESULT: result of a transfer."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_PARAM1 = 6
    INVALID_PARAM2 = 7
    INVALID_PARAM3 = 8
    INVALID_PARAM4 = 9
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    OPERATION_CANCELLED = 15


class MissionState(IntEnum):
    """MISSION_STATE: the state of the mission in MISSION_CURRENT; 0 if the autopilot does not report it."""

    UNKNOWN = 0
    NOT_STARTED = 2
    ACTIVE = 3


class LandedState(IntEnum):
    """MAV_LANDED_STATE of EXTENDED_SYS_STATE; UNDEFINED if the autopilot does not report it."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class MissionType(IntEnum):
    """MAV_MISSION_TYPE: which of the autopilot's lists."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


class Severity(IntEnum):
    """MAV_SEVERITY of a STATUSTEXT."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7


class ParameterType(IntEnum):
    """MAV_PARAM_TYPE."""

    INT32 = 6
    REAL32 = 9


class Autopilot(IntEnum):
    """MAV_AUTOPILOT: whose firmware, of those whose missions are known."""

    ARDUPILOTMEGA = 3
    PX4 = 12


class ComponentId(IntEnum):
    """MAV_COMPONENT: the autopilot's id, and the program's own."""

    AUTOPILOT1 = 1
    PATHPLANNER = 195


class ModeFlag(IntFlag):
    """MAV_MODE_FLAG, the ``base_mode`` of a HEARTBEAT."""

    CUSTOM_MODE_ENABLED = 1
    SAFETY_ARMED = 128


class SystemState(IntEnum):
    """MAV_STATE of a HEARTBEAT."""

    BOOT = 1
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5


class EstimatorStatusFlag(IntFlag):
    """ESTIMATOR_STATUS_FLAGS of PX4 that concern the position."""

    POS_HORIZ_ABS = 16
    CONST_POS_MODE = 128
    GPS_GLITCH = 1024


class EkfStatusFlag(IntFlag):
    """EKF_STATUS_FLAGS of ArduPilot that concern the position."""

    POS_HORIZ_ABS = 16
    CONST_POS_MODE = 128
    GPS_GLITCHING = 32_768


class GpsFix(IntEnum):
    """GPS_FIX_TYPE: the least type with a three-dimensional position."""

    TYPE_3D_FIX = 3


class VehicleType(IntEnum):
    """MAV_TYPE."""

    FIXED_WING = 1
    ANTENNA_TRACKER = 5
    GCS = 6
    GROUND_ROVER = 10
    SURFACE_BOAT = 11
    SUBMARINE = 12
    VTOL_DUOROTOR = 19
    VTOL_QUADROTOR = 20
    VTOL_TILTROTOR = 21
    VTOL_RESERVED2 = 22
    VTOL_RESERVED3 = 23
    VTOL_RESERVED4 = 24
    VTOL_RESERVED5 = 25
    PARAFOIL = 28


class AdsbAltitudeType(IntEnum):
    """ADSB_ALTITUDE_TYPE."""

    PRESSURE_QNH = 0
    GEOMETRIC = 1


class EmitterType(IntEnum):
    """ADSB_EMITTER_TYPE of vehicles on the ground."""

    EMERGENCY_SURFACE = 17
    SERVICE_SURFACE = 18
    POINT_OBSTACLE = 19
