"""Reports of a vehicle by ADS-B, Remote ID or UTM, with the errors, delay and losses of each.

References
----------
.. [1] MAVLink common.xml: ADSB_VEHICLE, OPEN_DRONE_ID_LOCATION, UTM_GLOBAL_POSITION, UTM_DATA_AVAIL_FLAGS,
   MAV_ODID_HOR_ACC, MAV_ODID_VER_ACC, MAV_ODID_SPEED_ACC.
.. [2] ASTM F3411, "Standard Specification for Remote ID and Tracking": steps of the values, and at most 1 s
   from the measurement to the message.
.. [3] 14 CFR 91.227 (e): at most 0.6 s from the measurement to the ADS-B message that nothing makes up for.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from ..autopilot.channel import Message

FIRST_ICAO_ADDRESS = 0xD70001
_ADSB_VALID = 63  # Coordinates, altitude, heading, velocity, callsign and squawk are valid.
_UTM_VALID = 2 | 4 | 8 | 32 | 64  # Identity, position, altitude and both velocities are valid.
_SPEED_STEP_M_S, _CLIMB_STEP_M_S = 0.25, 0.5  # [2]_


@dataclass(frozen=True, slots=True)
class Measured:
    """A measurement of a vehicle, by itself or by an observer.

    Parameters
    ----------
    number : int
        Counts the vehicles from 0.
    name : str
        Name of the vehicle.
    emitter : int
        ADSB_EMITTER_TYPE.
    latitude_deg, longitude_deg : float
        Measured place [deg].
    altitude_m : float
        Height above the ellipsoid [m].
    velocity_enu_m_s : tuple of float
        East, north, up [m/s].
    """

    number: int
    name: str
    emitter: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    velocity_enu_m_s: tuple[float, float, float]

    @property
    def course_deg(self) -> float:
        """Clockwise from north, from -180 to 180 [deg]."""
        return math.degrees(math.atan2(*self.velocity_enu_m_s[:2]))

    @property
    def speed_m_s(self) -> float:
        """Horizontal speed [m/s]."""
        return math.hypot(*self.velocity_enu_m_s[:2])


@dataclass(frozen=True, slots=True)
class ReportSource:
    """A way in which vehicles are reported, once a second.

    Parameters
    ----------
    message : callable
        Makes the MAVLink message.
    position_std_m, height_std_m, velocity_std_m_s : float
        Standard deviations of the errors; of position and velocity those of each horizontal component.
    delay_s : float
        From the measurement to the message [s].
    loss : float
        Share of the messages that are lost.
    """

    message: Callable[[Measured], Message]
    position_std_m: float
    height_std_m: float
    velocity_std_m_s: float
    delay_s: float
    loss: float


def adsb_vehicle(seen: Measured) -> Message:
    """Return an ADSB_VEHICLE.

    Parameters
    ----------
    seen : Measured
        What is reported.
    """
    return mavlink.MAVLink_adsb_vehicle_message(
        FIRST_ICAO_ADDRESS + seen.number,
        round(seen.latitude_deg * 1e7),
        round(seen.longitude_deg * 1e7),
        mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC,
        round(seen.altitude_m * 1000),
        round(seen.course_deg * 100) % 36000,
        min(round(seen.speed_m_s * 100), 65535),
        round(seen.velocity_enu_m_s[2] * 100),
        seen.name.upper().encode("ascii", "replace")[:8],
        seen.emitter,
        0,
        _ADSB_VALID,
        0,
    )


def remote_id_location(seen: Measured) -> Message:
    """Return an OPEN_DRONE_ID_LOCATION as a receiver forwards it, in the steps of Remote ID.

    Parameters
    ----------
    seen : Measured
        What is reported.
    """
    speed_m_s = _SPEED_STEP_M_S * round(seen.speed_m_s / _SPEED_STEP_M_S)
    climb_m_s = _CLIMB_STEP_M_S * round(seen.velocity_enu_m_s[2] / _CLIMB_STEP_M_S)
    return mavlink.MAVLink_open_drone_id_location_message(
        0, 0, _identity(seen), mavlink.MAV_ODID_STATUS_AIRBORNE,
        round(seen.course_deg) % 360 * 100, round(speed_m_s * 100), round(climb_m_s * 100),
        round(seen.latitude_deg * 1e7), round(seen.longitude_deg * 1e7),
        -1000.0, 0.5 * round(seen.altitude_m / 0.5),  # Barometric: not known. Geodetic, in steps of 0.5 m.
        mavlink.MAV_ODID_HEIGHT_REF_OVER_TAKEOFF, -1000.0,
        mavlink.MAV_ODID_HOR_ACC_10_METER, mavlink.MAV_ODID_VER_ACC_10_METER,
        mavlink.MAV_ODID_VER_ACC_UNKNOWN, mavlink.MAV_ODID_SPEED_ACC_1_METERS_PER_SECOND, 0.0,
        mavlink.MAV_ODID_TIME_ACC_UNKNOWN,
    )  # fmt: skip


def utm_global_position(seen: Measured) -> Message:
    """Return a UTM_GLOBAL_POSITION, with standard deviations and without a next waypoint.

    Parameters
    ----------
    seen : Measured
        What is reported.
    """
    east, north, up = (round(value * 100) for value in seen.velocity_enu_m_s)
    return mavlink.MAVLink_utm_global_position_message(
        0, _identity(seen)[:18], round(seen.latitude_deg * 1e7), round(seen.longitude_deg * 1e7),
        round(seen.altitude_m * 1000), 0, north, east, -up,
        round(UTM.position_std_m * 1000), round(UTM.height_std_m * 1000), round(UTM.velocity_std_m_s * 100),
        0, 0, 0, 100, mavlink.UTM_FLIGHT_STATE_AIRBORNE, _UTM_VALID,
    )  # fmt: skip


def _identity(seen: Measured) -> list[int]:
    """Return 20 bytes that belong to the vehicle alone."""
    return [*(FIRST_ICAO_ADDRESS + seen.number).to_bytes(4, "big"), *([0] * 16)]


ADSB = ReportSource(adsb_vehicle, 8.0, 3.0, 1.0, 0.6, 0.1)  # [3]_
PROMPT = replace(ADSB, delay_s=0.0, loss=0.0)  # The same, neither late nor lost.
# 95 % of the errors are within the 10 m and the 1 m/s that are reported; a radio is lost more often.
REMOTE_ID = ReportSource(remote_id_location, 4.0, 5.0, 0.4, 1.0, 0.2)
UTM = ReportSource(utm_global_position, 4.0, 5.0, 0.4, 1.0, 0.1)
SOURCES = {"adsb": ADSB, "remote_id": REMOTE_ID, "utm": UTM}
