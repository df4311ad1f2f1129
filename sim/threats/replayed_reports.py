"""Recorded reports of other aircraft, as ADSB_VEHICLE on the links of the simulated autopilot."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ..autopilot.base import Autopilot
from ..autopilot.channel import Message
from .adsb_source import SOURCE_COMPONENT, SOURCE_SYSTEM, send_heartbeat
from .recorded_tracks import RecordedReport

_BEAT_US = 1_000_000
# What the message has room for.
_AGE_MAX_S, _SPEED_MAX_CM_S, _CLIMB_MAX_CM_S = 255, 65_535, 32_767
_DEGREES_MAX = _ALTITUDE_MAX_MM = 2**31 - 1


def adsb_message(report: RecordedReport) -> Message:
    """Return the ADSB_VEHICLE that a receiver sends of a report.

    A flag is set only for a value that the report has. The altitude is the pressure altitude, or, without
    one, the geometric one. Values for which the message has no room are the largest that it can say.
    """
    altitude_m, altitude_type = report.pressure_altitude_m, mavlink.ADSB_ALTITUDE_TYPE_PRESSURE_QNH
    if altitude_m is None:
        altitude_m, altitude_type = report.geometric_altitude_m, mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC
    has_place = report.latitude_deg is not None and report.longitude_deg is not None
    flags = mavlink.ADSB_FLAGS_VALID_COORDS if has_place else 0
    for value, flag in (
        (altitude_m, mavlink.ADSB_FLAGS_VALID_ALTITUDE),
        (report.course_deg, mavlink.ADSB_FLAGS_VALID_HEADING),
        (report.ground_speed_m_s, mavlink.ADSB_FLAGS_VALID_VELOCITY),
        (report.climb_m_s, mavlink.ADSB_FLAGS_VERTICAL_VELOCITY_VALID),
    ):
        flags |= flag if value is not None else 0
    return mavlink.MAVLink_adsb_vehicle_message(
        report.address,
        _whole(report.latitude_deg if has_place else None, 1e7, _DEGREES_MAX),
        _whole(report.longitude_deg if has_place else None, 1e7, _DEGREES_MAX),
        altitude_type,
        _whole(altitude_m, 1e3, _ALTITUDE_MAX_MM),
        _whole(report.course_deg, 100.0, _DEGREES_MAX) % 36_000,
        max(_whole(report.ground_speed_m_s, 100.0, _SPEED_MAX_CM_S), 0),
        _whole(report.climb_m_s, 100.0, _CLIMB_MAX_CM_S),
        b"",
        mavlink.ADSB_EMITTER_TYPE_NO_INFO,
        _whole(report.age_s, 1.0, _AGE_MAX_S),
        flags,
        0,
    )


def _whole(value: float | None, factor: float, limit: int) -> int:
    """Return a value in the message's unit, at most ``limit`` to either side of 0; 0 for a missing one."""
    return min(max(round((value or 0.0) * factor), -limit), limit)


class ReplayedReports:
    """A receiver that hears again what was recorded.

    Parameters
    ----------
    autopilot : Autopilot
        Autopilot on whose links the reports appear.
    reports : iterable of (float, RecordedReport)
        Simulated times at which they are received [s], in any order, and the reports.
    """

    def __init__(self, autopilot: Autopilot, reports: Iterable[tuple[float, RecordedReport]]) -> None:
        self._autopilot = autopilot
        self._waiting = deque(sorted(reports, key=lambda entry: entry[0]))
        self._next_beat_us = 0

    def update(self, now_us: int) -> None:
        """Send what was received until ``now_us`` of simulated time, and a heartbeat each second."""
        if now_us >= self._next_beat_us:
            self._next_beat_us += _BEAT_US
            send_heartbeat(self._autopilot)
        while self._waiting and self._waiting[0][0] * 1e6 <= now_us:
            _, report = self._waiting.popleft()
            self._autopilot.relay_traffic(adsb_message(report), (SOURCE_SYSTEM, SOURCE_COMPONENT))
