"""Decoding of the messages that report other vehicles.

One vehicle may be reported by several messages and over several links; the identity shows which reports
belong together. Sources differ in the reference of their altitude (pressure, ellipsoid or mean sea level).
Each altitude is converted to mean sea level (:mod:`companion.link.messages.heights`).

References
----------
MAVLink common.xml: ADSB_FLAGS, UTM_DATA_AVAIL_FLAGS, AIS_FLAGS, MAV_ODID_HOR_ACC.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection
from typing import NamedTuple

from companion.link.messages.heights import Datum, Height
from companion.link.messages.vehicle_telemetry import (
    Message,
    RefusedError,
    Telemetry,
    altitude,
    finite,
    place,
    velocity,
)
from companion.link.wire.framing import RawFrame
from companion.types.events import Emitter, TrackReport
from companion.types.mavlink_enums import AdsbAltitudeType, ComponentId, EmitterType, VehicleType
from companion.types.threat import REPORTED_SPEED_MAX_M_S

_ECHO_MEMORY_S = 10.0
ECHO_IDENTITIES_MAX = 10_000  # Of more identities, those that were received longest ago are forgotten.
_AGE_MAX_S = 60.0
_STD_MAX_M = 10_000.0
_SURFACE_EMITTERS = frozenset(EmitterType)
_SURFACE_TYPES = frozenset(
    {
        VehicleType.ANTENNA_TRACKER,
        VehicleType.GCS,
        VehicleType.GROUND_ROVER,
        VehicleType.SURFACE_BOAT,
        VehicleType.SUBMARINE,
    }
)
_UNKNOWN_SPEED = 0xFFFF
_RID_UNKNOWN_SPEED_CM_S = 25_500
_RID_UNKNOWN_COURSE_CDEG = 36_100
_RID_UNKNOWN_CLIMB_CM_S = 6_300
# MAV_ODID_HOR_ACC bounds 95 % of the errors. Of a circular normal distribution, 95 % lies within 2.45 σ.
_RID_BOUNDS_M = (None, 18_520, 7_408, 3_704, 1_852, 926, 555.6, 185.2, 92.6, 30, 10, 3, 1)
# MAV_ODID_VER_ACC and MAV_ODID_SPEED_ACC likewise; of one normal component, 95 % lies within 1.96 σ.
_RID_HEIGHT_BOUNDS_M = (None, 150, 45, 25, 10, 3, 1)
_RID_SPEED_BOUNDS_M_S = (None, 10, 3, 1, 0.3)
_RID_UNKNOWN_ALTITUDE_M = -1_000.0
_ADSB_DATUMS = {
    AdsbAltitudeType.PRESSURE_QNH: Datum.PRESSURE,
    AdsbAltitudeType.GEOMETRIC: Datum.ELLIPSOID,
}
_SIGMAS_95, _SIGMAS_95_UP = 2.4477, 1.96


class ReportParts(NamedTuple):
    """The part of a report that one message carries."""

    identity: str
    emitter: Emitter
    age_s: float
    place: tuple[float, float]  # Latitude and longitude [deg].
    height: Height
    velocity_enu_m_s: tuple[float, float, float] | None
    position_std_m: float | None
    height_std_m: float | None = None
    velocity_std_m_s: float | None = None
    next_place: tuple[float, float] | None = None  # Latitude and longitude of where it flies next [deg].
    next_height: Height | None = None


def _above_sea(value_m: float) -> Height:
    return Height(altitude(value_m, "track_altitude"), Datum.SEA_LEVEL)


def _remote_id_height(message: Message) -> Height:
    """Return the ellipsoidal altitude, else the pressure altitude; -1000 m means unknown."""
    for value_m, datum in (
        (message.altitude_geodetic, Datum.ELLIPSOID), (message.altitude_barometric, Datum.PRESSURE),
    ):  # fmt: skip
        if not value_m <= _RID_UNKNOWN_ALTITUDE_M:
            return Height(altitude(value_m, "track_altitude"), datum)
    raise RefusedError("track_altitude")


def _deviation(bounds: tuple[float | None, ...], accuracy: int, sigmas: float) -> float | None:
    """Return the standard deviation of a class of accuracy of Remote ID; None if that says nothing."""
    bound = bounds[accuracy] if accuracy < len(bounds) else None
    return None if bound is None else bound / sigmas


def _along_course(course_cdeg: float, speed_m_s: float, climb_m_s: float) -> tuple[float, float, float]:
    course = math.radians(course_cdeg * 1e-2)
    return velocity(speed_m_s * math.sin(course), speed_m_s * math.cos(course), climb_m_s, "track_velocity")


def _next_of(message: Message) -> tuple[tuple[float, float], Height] | tuple[None, None]:
    """Return place and height of the next waypoint of a UTM_GLOBAL_POSITION that has a possible one."""
    if not message.flags & 0x80:
        return None, None
    try:
        height = Height(altitude(message.next_alt * 1e-3, "track_altitude"), Datum.ELLIPSOID)
        return place(message.next_lat, message.next_lon, "track_position"), height
    except RefusedError:  # Where it is now counts all the same.
        return None, None


class Tracks:
    """Decodes track messages.

    Parameters
    ----------
    telemetry : Telemetry
        Knows our own system id and the altitude of home.
    sources : collection of int, optional
        Accepted system ids; None accepts all.
    """

    def __init__(self, telemetry: Telemetry, sources: Collection[int] | None) -> None:
        self._telemetry = telemetry
        self._sources = None if sources is None else frozenset(sources)
        self._types: dict[int, int] = {}
        self._seen_elsewhere_s: dict[str, float] = {}
        self._decoders: dict[str, Callable[[Message, RawFrame], ReportParts]] = {
            "ADSB_VEHICLE": self._adsb,
            "AIS_VESSEL": self._ais,
            "OPEN_DRONE_ID_LOCATION": self._remote_id,
            "GLOBAL_POSITION_INT": self._position,
            "UTM_GLOBAL_POSITION": self._utm,
            "FOLLOW_TARGET": self._follow,
        }

    def note_heartbeat(self, message: Message, frame: RawFrame) -> None:
        """Record the vehicle type of a system."""
        if message.type not in (
            18,
            26,
            27,
            30,
        ):  # Onboard controller, gimbal, ADS-B, camera: parts of a vehicle.
            self._types[frame.system_id] = message.type

    def report(self, kind: str, message: Message, frame: RawFrame, stamp_s: float) -> TrackReport | None:
        """Decode a track message; None for other messages and for our own position.

        Raises
        ------
        RefusedError
            For impossible values, sources that are not listed, and echoes.
        """
        decoder = self._decoders.get(kind)
        # Until our own vehicle is known, no position may be taken for that of another.
        is_own = self._telemetry.vehicle_system_id in (None, frame.system_id)
        if decoder is None or (
            is_own and kind in ("GLOBAL_POSITION_INT", "UTM_GLOBAL_POSITION", "FOLLOW_TARGET")
        ):
            return None
        if kind == "OPEN_DRONE_ID_LOCATION" and not any(message.id_or_mac):
            return None  # Without an id it describes the sender itself.
        if self._sources is not None and frame.system_id not in self._sources:
            raise RefusedError("track_unlisted")
        parts = decoder(message, frame)
        self._check_echo(parts.identity, frame, stamp_s)
        if parts.age_s > _AGE_MAX_S:
            raise RefusedError("track_old")
        next_point = None
        if parts.next_place is not None and parts.next_height is not None:
            next_point = (*parts.next_place, self._above_sea_m(parts.next_height))
        return TrackReport(
            stamp_s=stamp_s - parts.age_s,
            source=f"{kind} {frame.system_id}/{frame.component_id}",
            identity=parts.identity,
            emitter=parts.emitter,
            latitude_deg=parts.place[0],
            longitude_deg=parts.place[1],
            altitude_amsl_m=self._above_sea_m(parts.height),
            velocity_enu_m_s=parts.velocity_enu_m_s,
            position_std_m=parts.position_std_m,
            altitude_std_m=parts.height_std_m,
            velocity_std_m_s=parts.velocity_std_m_s,
            next_point=next_point,
        )

    def _above_sea_m(self, height: Height) -> float:
        return altitude(self._telemetry.heights.above_sea_m(height), "track_altitude")

    def _check_echo(self, identity: str, frame: RawFrame, stamp_s: float) -> None:
        """Refuse a report that the autopilot repeats under its own ids.

        A receiver wired to the autopilot uses the same ids. The report is therefore an echo only if the same
        vehicle was recently reported by another sender as well.
        """
        autopilot = (self._telemetry.vehicle_system_id, ComponentId.AUTOPILOT1)
        if (frame.system_id, frame.component_id) != autopilot:
            self._seen_elsewhere_s.pop(identity, None)  # Keeps the dictionary ordered by time.
            self._seen_elsewhere_s[identity] = stamp_s
        elif stamp_s - self._seen_elsewhere_s.get(identity, -math.inf) <= _ECHO_MEMORY_S:
            raise RefusedError("track_echo")
        # Removing two per report lets the dictionary shrink after a flood, at a bounded cost per frame.
        for oldest, seen in list(itertools.islice(self._seen_elsewhere_s.items(), 2)):
            is_crowded = len(self._seen_elsewhere_s) > ECHO_IDENTITIES_MAX
            if is_crowded or stamp_s - seen > _ECHO_MEMORY_S:
                del self._seen_elsewhere_s[oldest]

    def _emitter(self, system_id: int) -> Emitter:
        """Return ground if the system says so; an unknown system counts as air, the worse case."""
        return Emitter.GROUND if self._types.get(system_id) in _SURFACE_TYPES else Emitter.AIR

    def _adsb(self, message: Message, _frame: RawFrame) -> ReportParts:
        has_place, has_altitude, has_course, has_velocity = (
            bool(message.flags & bit) for bit in (0x01, 0x02, 0x04, 0x08)
        )
        if not has_place:
            raise RefusedError("track_position")
        emitter = Emitter.GROUND if message.emitter_type in _SURFACE_EMITTERS else Emitter.AIR
        velocity_enu_m_s = None
        speed = message.hor_velocity
        if has_velocity and speed != _UNKNOWN_SPEED and (has_course or speed == 0):
            climb = message.ver_velocity * 1e-2 if emitter is Emitter.AIR else 0.0
            velocity_enu_m_s = _along_course(message.heading, speed * 1e-2, climb)
        return ReportParts(
            self._adsb_identity(message),
            emitter,
            float(message.tslc),
            place(message.lat, message.lon, "track_position"),
            self._adsb_height(message, emitter, is_reported=has_altitude),
            velocity_enu_m_s,
            None,
        )

    def _adsb_identity(self, message: Message) -> str:
        if message.ICAO_address:
            return f"icao:{message.ICAO_address:06X}"
        callsign = "".join(character for character in message.callsign if character.isalnum())
        if not callsign:
            raise RefusedError("track_identity")
        return f"callsign:{callsign}"

    def _adsb_height(self, message: Message, emitter: Emitter, *, is_reported: bool) -> Height:
        """Return the altitude; transponders report pressure altitude, whatever the QNH."""
        if is_reported:
            datum = _ADSB_DATUMS.get(message.altitude_type, Datum.PRESSURE)
            return Height(altitude(message.altitude * 1e-3, "track_altitude"), datum)
        if emitter is Emitter.AIR or self._telemetry.home_altitude_amsl_m is None:
            raise RefusedError("track_altitude")
        return _above_sea(self._telemetry.home_altitude_amsl_m)  # The ground is about as high as home.

    def _ais(self, message: Message, _frame: RawFrame) -> ReportParts:
        if not message.MMSI:
            raise RefusedError("track_identity")
        velocity_enu_m_s = None
        if message.flags & 0x02 and message.flags & 0x04:
            velocity_enu_m_s = _along_course(message.COG, message.velocity * 1e-2, 0.0)
        where = place(message.lat, message.lon, "track_position")
        std = 10.0 / _SIGMAS_95 if message.flags & 0x01 else None
        return ReportParts(
            f"mmsi:{message.MMSI:09d}",
            Emitter.GROUND,
            float(message.tslc),
            where,
            _above_sea(0.0),
            velocity_enu_m_s,
            std,
        )

    def _remote_id(self, message: Message, _frame: RawFrame) -> ReportParts:
        identity = bytes(message.id_or_mac).rstrip(b"\0").hex()
        velocity_enu_m_s = None
        if (
            message.speed_horizontal < _RID_UNKNOWN_SPEED_CM_S
            and message.direction < _RID_UNKNOWN_COURSE_CDEG
        ):
            climb = message.speed_vertical
            climb_m_s = 0.0 if climb >= _RID_UNKNOWN_CLIMB_CM_S else climb * 1e-2
            velocity_enu_m_s = _along_course(message.direction, message.speed_horizontal * 1e-2, climb_m_s)
        heights = message.vertical_accuracy if message.altitude_geodetic > _RID_UNKNOWN_ALTITUDE_M else 0
        return ReportParts(
            f"rid:{identity}",
            Emitter.AIR,
            0.0,
            place(message.latitude, message.longitude, "track_position"),
            _remote_id_height(message),
            velocity_enu_m_s,
            _deviation(_RID_BOUNDS_M, message.horizontal_accuracy, _SIGMAS_95),
            _deviation(_RID_HEIGHT_BOUNDS_M, heights, _SIGMAS_95_UP),
            _deviation(_RID_SPEED_BOUNDS_M_S, message.speed_accuracy, _SIGMAS_95),
        )

    def _position(self, message: Message, frame: RawFrame) -> ReportParts:
        return ReportParts(
            f"system:{frame.system_id}",
            self._emitter(frame.system_id),
            0.0,
            place(message.lat, message.lon, "track_position"),
            _above_sea(message.alt * 1e-3),
            velocity(message.vy * 1e-2, message.vx * 1e-2, -message.vz * 1e-2, "track_velocity"),
            None,
        )

    def _utm(self, message: Message, frame: RawFrame) -> ReportParts:
        if not message.flags & 0x04:
            raise RefusedError("track_position")
        if not message.flags & 0x08:
            raise RefusedError("track_altitude")
        velocity_enu_m_s = None
        if message.flags & 0x20:
            up = -message.vz * 1e-2 if message.flags & 0x40 else 0.0
            velocity_enu_m_s = velocity(message.vy * 1e-2, message.vx * 1e-2, up, "track_velocity")
        named = bytes(message.uas_id).rstrip(b"\0").hex() if message.flags & 0x02 else ""
        return ReportParts(
            f"utm:{named}" if named else f"system:{frame.system_id}",
            Emitter.AIR,
            0.0,
            place(message.lat, message.lon, "track_position"),
            Height(altitude(message.alt * 1e-3, "track_altitude"), Datum.ELLIPSOID),
            velocity_enu_m_s,
            message.h_acc * 1e-3 or None,
            message.v_acc * 1e-3 or None,
            message.vel_acc * 1e-2 or None,
            *_next_of(message),
        )

    def _follow(self, message: Message, frame: RawFrame) -> ReportParts:
        velocity_enu_m_s = None
        if message.est_capabilities & 0x02:
            north, east, down = (
                finite(value, REPORTED_SPEED_MAX_M_S, "track_velocity") for value in message.vel
            )
            velocity_enu_m_s = velocity(east, north, -down, "track_velocity")
        std = finite(message.position_cov[0], _STD_MAX_M, "track_accuracy")
        return ReportParts(
            f"system:{frame.system_id}",
            self._emitter(frame.system_id),
            0.0,
            place(message.lat, message.lon, "track_position"),
            _above_sea(message.alt),
            velocity_enu_m_s,
            std if std > 0.0 else None,
        )
