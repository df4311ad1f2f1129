"""Decoding of the vehicle's messages into events; every value is checked for plausibility."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from companion.link.messages.battery_messages import BatteryMeter
from companion.link.messages.flight_modes import DIALECTS, flight_mode, motion_of
from companion.link.messages.heights import Heights
from companion.link.messages.vehicle_identity import VehicleIdentity
from companion.link.wire.framing import RawFrame
from companion.types.events import (
    WIND_STD_M_S,
    AirData,
    Attitude,
    ClockReported,
    EngineSpeed,
    EstimatorAccuracy,
    EstimatorHealth,
    Event,
    GlobalPosition,
    GroundReported,
    Heartbeat,
    HomePosition,
    LandedReported,
    MissionCurrent,
    MissionItemReached,
    Rebooted,
    StatusText,
    SteeringTarget,
    TeamMessage,
    WindEstimate,
)
from companion.types.mavlink_enums import (
    EkfStatusFlag,
    EstimatorStatusFlag,
    GpsFix,
    MessageId,
    ModeFlag,
    SystemState,
)
from companion.types.threat import REPORTED_SPEED_MAX_M_S

TEAM_PAYLOAD = 0xA7E1  # A TUNNEL payload type above 32,767 is one's own, until MAVLink registers one.
ALTITUDE_RANGE_M = (-1_000.0, 30_000.0)
NO_FIX_DEG = 0.01  # A position this close to 0°, 0°, in the sea off Africa, was sent before the first fix.

_NO_MISSION = 0xFFFF
_REORDERED_MS = 2_000  # A frame that is older than this shows a restarted clock, not a late frame.
_STD_MAX_M = 10_000.0
_RPM_MAX = 1e6
_DOWNWARD = 25  # MAV_SENSOR_ROTATION_PITCH_270.

Message = Any  # A pymavlink message, whose fields are set at run time.


class RefusedError(Exception):
    """An impossible value; ``reason`` is the name of its counter."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


def finite(value: float, limit: float, reason: str) -> float:
    """Return the value if it is finite and within ± limit, else raise RefusedError."""
    if not (math.isfinite(value) and abs(value) <= limit):
        raise RefusedError(reason)
    return float(value)


def place(latitude_e7: int, longitude_e7: int, reason: str) -> tuple[float, float]:
    """Convert latitude and longitude from 1e-7 degrees to degrees; raise RefusedError if impossible.

    An autopilot without a fix reports (0, 0), or a position that drifts from there: ArduPlane's filter does.
    """
    latitude, longitude = latitude_e7 * 1e-7, longitude_e7 * 1e-7
    is_on_earth = abs(latitude) <= 90.0 and abs(longitude) <= 180.0
    if not is_on_earth or max(abs(latitude), abs(longitude)) < NO_FIX_DEG:
        raise RefusedError(reason)
    return latitude, longitude


def altitude(value_m: float, reason: str) -> float:
    """Return the altitude [m] if an aircraft can have it, else raise RefusedError."""
    low, high = ALTITUDE_RANGE_M
    if not (math.isfinite(value_m) and low <= value_m <= high):
        raise RefusedError(reason)
    return float(value_m)


def velocity(east_m_s: float, north_m_s: float, up_m_s: float, reason: str) -> tuple[float, float, float]:
    """Return east, north and up [m/s] if an aircraft can be that fast, else raise RefusedError."""
    if not (math.hypot(east_m_s, north_m_s, up_m_s) <= REPORTED_SPEED_MAX_M_S):  # NaN compares false
        raise RefusedError(reason)
    return float(east_m_s), float(north_m_s), float(up_m_s)


class Telemetry:
    """Decodes the messages of the vehicle's autopilot.

    Parameters
    ----------
    identity : VehicleIdentity
        Knows the vehicle's system id and what is accepted of its heartbeats.
    """

    def __init__(self, identity: VehicleIdentity) -> None:
        self._identity = identity
        self.home_altitude_amsl_m: float | None = None
        self.heights = Heights()
        self._battery = BatteryMeter()
        self._boot_ms: int | None = None
        self._suspect_boot_ms: int | None = None
        self._position_boot_ms = -1
        self._decoders: dict[str, Callable[[Message, RawFrame, float], Event]] = {
            "VFR_HUD": self._air_data,
            "WIND": self._wind,
            "WIND_COV": self._wind_cov,
            "EKF_STATUS_REPORT": self._health,
            "GPS_RAW_INT": self._fix,
            "MISSION_CURRENT": self._mission_current,
            "MISSION_ITEM_REACHED": lambda m, _frame, stamp_s: MissionItemReached(stamp_s, m.seq),
            "EXTENDED_SYS_STATE": lambda m, _frame, stamp_s: LandedReported(stamp_s, m.landed_state),
            "HOME_POSITION": self._home,
            "STATUSTEXT": self._text,
            "POSITION_TARGET_GLOBAL_INT": self._target,
            "ESC_TELEMETRY_1_TO_4": _engine_speeds,
            "RPM": lambda m, _frame, stamp_s: _engine_speed(stamp_s, "RPM", m.rpm1),
            "EFI_STATUS": lambda m, _frame, stamp_s: _engine_speed(stamp_s, "EFI_STATUS", m.rpm),
        }

    @property
    def vehicle_system_id(self) -> int | None:
        """System id of the vehicle; None until it is known."""
        return self._identity.system_id

    def events(self, kind: str, message: Message, frame: RawFrame, stamp_s: float) -> Iterator[Event]:
        """Decode a message of any sender; events before an impossible value are kept.

        Raises
        ------
        RefusedError
            For impossible values.
        """
        if kind == "HEARTBEAT":
            yield from self._heartbeat(message, frame, stamp_s)
        elif kind == "TUNNEL" and message.payload_type == TEAM_PAYLOAD:
            payload = bytes(message.payload[: message.payload_length])
            yield TeamMessage(stamp_s, frame.system_id, payload)
        elif not self._identity.is_autopilot(frame.system_id, frame.component_id):
            return
        elif kind in ("GLOBAL_POSITION_INT", "ATTITUDE", "SYSTEM_TIME"):
            yield from self._timed(kind, message, stamp_s)
        elif kind == "ESTIMATOR_STATUS":
            yield self._health(message, frame, stamp_s)
            yield self._accuracy(message, stamp_s)
        elif kind == "SCALED_PRESSURE":
            self.heights.note_pressure(message.press_abs)
        elif kind in ("BATTERY_STATUS", "SYS_STATUS"):
            yield from self._battery_reports(message, stamp_s)
        elif kind in _GROUND_DECODERS:
            yield from _GROUND_DECODERS[kind](message, stamp_s)
        elif kind in self._decoders:
            yield self._decoders[kind](message, frame, stamp_s)

    def _battery_reports(self, message: Message, stamp_s: float) -> Iterator[Event]:
        try:
            yield from self._battery.reports(message, stamp_s)
        except ValueError:
            raise RefusedError("battery") from None

    def _heartbeat(self, message: Message, frame: RawFrame, stamp_s: float) -> list[Event]:
        dialect = DIALECTS.get(message.autopilot)
        if dialect is None or not self._identity.is_autopilot(frame.system_id, frame.component_id):
            return []
        mode, is_mission = flight_mode(dialect, message.type, message.base_mode, message.custom_mode)
        is_armed = bool(message.base_mode & ModeFlag.SAFETY_ARMED)
        dialect, is_armed, is_contradicted = self._identity.accept_heartbeat(
            dialect, mode, stamp_s, is_armed=is_armed
        )
        return [
            Heartbeat(
                stamp_s=stamp_s,
                system_id=frame.system_id,
                component_id=frame.component_id,
                dialect=dialect,
                mode=mode,
                is_mission_mode=is_mission and not is_contradicted,
                is_armed=is_armed,
                is_contradicted=is_contradicted,
                motion=motion_of(dialect, mode),
                is_failsafe=message.system_status == SystemState.CRITICAL,
            )
        ]

    def _timed(self, kind: str, message: Message, stamp_s: float) -> Iterator[Event]:
        if self._has_rebooted(message.time_boot_ms):
            self._position_boot_ms = -1
            yield Rebooted(stamp_s)
        if kind == "GLOBAL_POSITION_INT":
            yield self._position(message, stamp_s)
        elif kind == "ATTITUDE":
            yield self._attitude(message, stamp_s)
        elif message.time_unix_usec:  # 0 before the first GPS fix
            yield ClockReported(stamp_s, message.time_unix_usec * 1e-6)

    def _has_rebooted(self, boot_ms: int) -> bool:
        """Distinguish a reboot from a late frame: after a reboot the clock continues from a low value."""
        if self._boot_ms is None or boot_ms > self._boot_ms - _REORDERED_MS:
            self._boot_ms = max(boot_ms, self._boot_ms or 0)
            self._suspect_boot_ms = None
            return False
        if self._suspect_boot_ms is None or boot_ms <= self._suspect_boot_ms:
            self._suspect_boot_ms = boot_ms
            raise RefusedError("late")
        self._boot_ms, self._suspect_boot_ms = boot_ms, None
        return True

    def _position(self, message: Message, stamp_s: float) -> GlobalPosition:
        if message.time_boot_ms <= self._position_boot_ms:
            raise RefusedError("late")
        latitude, longitude = place(message.lat, message.lon, "position")
        above_sea = altitude(message.alt * 1e-3, "altitude")
        above_home = finite(message.relative_alt * 1e-3, 50_000.0, "altitude")
        moving = velocity(message.vy * 1e-2, message.vx * 1e-2, -message.vz * 1e-2, "velocity")
        self._position_boot_ms = message.time_boot_ms
        self.home_altitude_amsl_m = above_sea - above_home
        self.heights.note_altitude(above_sea)
        return GlobalPosition(
            stamp_s=stamp_s,
            boot_s=message.time_boot_ms * 1e-3,
            latitude_deg=latitude,
            longitude_deg=longitude,
            altitude_amsl_m=above_sea,
            height_above_home_m=above_home,
            velocity_enu_m_s=moving,
        )

    def _attitude(self, message: Message, stamp_s: float) -> Attitude:
        angles = [finite(value, 7.0, "attitude") for value in (message.roll, message.pitch, message.yaw)]
        return Attitude(stamp_s, *angles)

    def _air_data(self, message: Message, _frame: RawFrame, stamp_s: float) -> AirData:
        airspeed = finite(message.airspeed, REPORTED_SPEED_MAX_M_S, "airspeed")
        over_ground = finite(message.groundspeed, REPORTED_SPEED_MAX_M_S, "ground_speed")
        return AirData(stamp_s, airspeed, over_ground, min(max(message.throttle, 0), 100) * 1e-2)

    def _wind(self, message: Message, _frame: RawFrame, stamp_s: float) -> WindEstimate:
        """Decode WIND of ArduPilot, which gives the direction that the wind comes from."""
        direction = math.radians(finite(message.direction, 720.0, "wind"))
        speed = finite(message.speed, 150.0, "wind")
        return WindEstimate(stamp_s, -speed * math.sin(direction), -speed * math.cos(direction))

    def _wind_cov(self, message: Message, _frame: RawFrame, stamp_s: float) -> WindEstimate:
        """Decode WIND_COV of PX4: the air's velocity north and east; an accuracy of 0 or NaN is unknown."""
        east, north = finite(message.wind_y, 150.0, "wind"), finite(message.wind_x, 150.0, "wind")
        std_m_s = message.horiz_accuracy
        return WindEstimate(
            stamp_s, east, north, std_m_s if 0.0 < std_m_s < REPORTED_SPEED_MAX_M_S else WIND_STD_M_S
        )

    def _accuracy(self, message: Message, stamp_s: float) -> EstimatorAccuracy:
        horizontal = finite(message.pos_horiz_accuracy, _STD_MAX_M, "accuracy")
        vertical = finite(message.pos_vert_accuracy, _STD_MAX_M, "accuracy")
        if horizontal < 0.0 or vertical < 0.0:
            raise RefusedError("accuracy")
        return EstimatorAccuracy(stamp_s, horizontal, vertical)

    def _health(self, message: Message, frame: RawFrame, stamp_s: float) -> EstimatorHealth:
        """Decode EKF_STATUS_REPORT and ESTIMATOR_STATUS: whether the estimator has a position."""
        is_px4 = frame.message_id == MessageId.ESTIMATOR_STATUS
        glitch = EstimatorStatusFlag.GPS_GLITCH if is_px4 else EkfStatusFlag.GPS_GLITCHING
        fault = ""  # The other two bits are the same in both messages.
        if not message.flags & EkfStatusFlag.POS_HORIZ_ABS:
            fault = "the autopilot has no position"
        elif message.flags & EkfStatusFlag.CONST_POS_MODE:
            fault = "the autopilot takes it for constant"
        elif message.flags & glitch:
            fault = "GPS glitch"
        return EstimatorHealth(stamp_s, message.get_type(), fault)

    def _fix(self, message: Message, _frame: RawFrame, stamp_s: float) -> EstimatorHealth:
        fault = "" if message.fix_type >= GpsFix.TYPE_3D_FIX else "no GPS fix"
        if not fault:
            self.heights.note_fix(message.alt * 1e-3, message.alt_ellipsoid * 1e-3)
        return EstimatorHealth(stamp_s, "GPS_RAW_INT", fault)

    def _mission_current(self, message: Message, frame: RawFrame, stamp_s: float) -> MissionCurrent:
        payload = frame.payload.ljust(18, b"\0")  # The dialect does not know the ids of the lists yet.
        total = int.from_bytes(payload[2:4], "little")
        return MissionCurrent(
            stamp_s=stamp_s,
            sequence=message.seq,
            total={0: None, _NO_MISSION: 0}.get(total, total),
            mission_id=int.from_bytes(payload[6:10], "little"),
            state=payload[4],
            rally_id=int.from_bytes(payload[14:18], "little"),
            fence_id=int.from_bytes(payload[10:14], "little"),
        )

    def _home(self, message: Message, _frame: RawFrame, stamp_s: float) -> HomePosition:
        latitude, longitude = place(message.latitude, message.longitude, "home")
        above_sea = altitude(message.altitude * 1e-3, "home")
        self.home_altitude_amsl_m = above_sea
        return HomePosition(stamp_s, latitude, longitude, above_sea)

    def _target(self, message: Message, _frame: RawFrame, stamp_s: float) -> SteeringTarget:
        latitude, longitude = place(message.lat_int, message.lon_int, "target")
        return SteeringTarget(stamp_s, latitude, longitude, altitude(message.alt, "target"))

    def _text(self, message: Message, _frame: RawFrame, stamp_s: float) -> StatusText:
        text = "".join(character for character in message.text if character.isprintable())
        return StatusText(stamp_s, message.severity, text)


def _engine_speed(stamp_s: float, source: str, speed_rpm: float) -> EngineSpeed:
    """Return the event of an engine's speed [1/min]; raise RefusedError if impossible."""
    return EngineSpeed(stamp_s, source, max(finite(speed_rpm, _RPM_MAX, "rpm"), 0.0))


def _engine_speeds(message: Message, _frame: RawFrame, stamp_s: float) -> EngineSpeed:
    """Decode the speeds of up to four engines; the fastest one counts."""
    speeds = [abs(finite(float(value), _RPM_MAX, "rpm")) for value in message.rpm]
    return _engine_speed(stamp_s, message.get_type(), max(speeds))


def _stored_ground(message: Message, stamp_s: float) -> Iterator[GroundReported]:
    """Decode a TERRAIN_REPORT; where the autopilot has no heights, that is reported, too."""
    where = place(message.lat, message.lon, "position")
    height = altitude(message.terrain_height, "ground")
    yield GroundReported(
        stamp_s, "autopilot", height, None, where, float(message.spacing), message.pending, message.loaded
    )


def _measured_ground(message: Message, stamp_s: float) -> Iterator[GroundReported]:
    """Decode a DISTANCE_SENSOR that looks down and measures; out of its range it measures nothing."""
    low, high, here = message.min_distance, message.max_distance, message.current_distance
    if not 0 <= low < high:
        raise RefusedError("ground")
    if message.orientation == _DOWNWARD and low < here < high:
        yield GroundReported(stamp_s, "range finder", None, 0.01 * here)


def _estimated_ground(message: Message, stamp_s: float) -> Iterator[GroundReported]:
    """Decode an ALTITUDE with a clearance; PX4 fills ``altitude_terrain`` in its local frame.

    Not a number, or a negative clearance, stands for an unknown one.
    """
    if not (math.isnan(message.bottom_clearance) or message.bottom_clearance < 0.0):
        clearance = finite(message.bottom_clearance, ALTITUDE_RANGE_M[1], "ground")
        yield GroundReported(stamp_s, "estimator", altitude(message.altitude_amsl - clearance, "ground"))


_GROUND_DECODERS: dict[str, Callable[[Message, float], Iterator[GroundReported]]] = {
    "TERRAIN_REPORT": _stored_ground,
    "DISTANCE_SENSOR": _measured_ground,
    "ALTITUDE": _estimated_ground,
}
