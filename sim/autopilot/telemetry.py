"""The aircraft's state as MAVLink messages: those that do not depend on whose autopilot it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.frames import wrapped_angle
from ..projection import FastProjection
from ..vehicle.control import Flight
from ..vehicle.simulated_battery import SimulatedBattery
from ..vehicle.true_ground import SPACING_M
from .channel import Message

EPOCH_S = 1_767_225_600  # 2026-01-01 UTC, at simulated second 0.
_SENSORS = 0x0120FC2F  # Gyro, accelerometer, compass, barometer, airspeed, GPS and the control loops.
_EKF_FLAGS = 831  # Attitude, velocities and positions are good; GPS is in use.
_UNKNOWN_U16 = 65535
_IGNORE_ALL_BUT_POSITION = 65016
_NO_TEMPERATURE = 32767
_HEIGHT_SENSOR_M = (0.2, 120.0)  # Least and greatest distance that the height sensor measures.
_GOOD_SIGNAL, _NO_SIGNAL = 100, 1  # As DISTANCE_SENSOR has them, in percent.


@dataclass(frozen=True, slots=True)
class Home:
    """Position of home: local [m], and as in messages."""

    east_m: float
    north_m: float
    up_m: float
    latitude_e7: int
    longitude_e7: int
    altitude_amsl_m: float


Target = tuple[float, float, float]


class Telemetry:
    """Builds messages from a flight.

    Parameters
    ----------
    flight : Flight
        Flight whose estimate is reported.
    projection : FastProjection
        Projection to degrees.
    home : Home
        Home; messages also have heights above it.

    Attributes
    ----------
    now_us, boot_us : int
        Simulated time, and when the autopilot booted; set by the owner.
    target : tuple of float or None
        East, north, up [m] of the point steered for, where there is one.
    """

    def __init__(self, flight: Flight, projection: FastProjection, home: Home) -> None:
        self._flight = flight
        self._projection = projection
        self._home = home
        self.now_us = 0
        self.boot_us = 0
        self.target: Target | None = None
        self.builders: dict[int, Callable[[], Message | None]] = {
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._system_status,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self._system_time,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self._gps,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._position,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self._hud,
            mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: self._controller,
            mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: self._target,
            mavlink.MAVLINK_MSG_ID_WIND: self._wind,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._filter,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: self.home_position,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_state,
            mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4: self._motor,
        }
        if flight.battery is not None:
            self.builders[mavlink.MAVLINK_MSG_ID_BATTERY_STATUS] = self._battery_status

    def amsl_m(self, up_m: float) -> float:
        """Altitude above mean sea level of a local height [m]."""
        return up_m + self._projection.frame.altitude_amsl_m

    def _degrees_e7(self, east_m: float, north_m: float) -> tuple[int, int]:
        latitude, longitude = self._projection.degrees(east_m, north_m)
        return round(latitude * 1e7), round(longitude * 1e7)

    def boot_time_us(self) -> int:
        """Time since boot [µs]."""
        return self.now_us - self.boot_us

    def _boot_ms(self) -> int:
        return self.boot_time_us() // 1000

    def _system_status(self) -> Message:
        used = min(self.now_us / 3.6e9, 0.9)
        millivolts, centiamperes, percent = 16_000, 1_500, round(100 * (1.0 - used))
        if (battery := self._flight.battery) is not None:
            millivolts, centiamperes = round(1e3 * battery.voltage_v), _centiamperes(battery)
            percent = int(100 * battery.remaining)
        return mavlink.MAVLink_sys_status_message(
            _SENSORS, _SENSORS, _SENSORS, 250, millivolts, centiamperes, percent, 0, 0, 0, 0, 0, 0
        )

    def _battery_status(self) -> Message | None:
        """BATTERY_STATUS with the energy consumed, which PX4 leaves out."""
        battery = self._flight.battery
        if battery is None:
            return None
        cells = [round(1e3 * battery.voltage_v), *[_UNKNOWN_U16] * 9]
        is_px4 = mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS in self.builders
        energy = -1 if is_px4 else round(36.0 * battery.used_wh)
        return mavlink.MAVLink_battery_status_message(
            0, 0, mavlink.MAV_BATTERY_TYPE_LIPO, _NO_TEMPERATURE, cells, _centiamperes(battery),
            round(battery.used_mah), energy, int(100 * battery.remaining),
        )  # fmt: skip

    def terrain_report(self) -> Message | None:
        """TERRAIN_REPORT, ArduPlane's stored height of the ground below; None without any."""
        ground, estimate = self._flight.stored_ground, self._flight.estimate
        if ground is None:
            return None
        up = ground.up_m(estimate.east_m, estimate.north_m)
        return mavlink.MAVLink_terrain_report_message(
            *self._degrees_e7(estimate.east_m, estimate.north_m), round(SPACING_M), self.amsl_m(up),
            estimate.up_m - up, 0, ground.num_loaded,
        )  # fmt: skip

    def _system_time(self) -> Message:
        return mavlink.MAVLink_system_time_message(EPOCH_S * 1_000_000 + self.now_us, self._boot_ms())

    def _motor(self) -> Message:
        nothing = (0, 0, 0, 0)
        speeds = (round(self._flight.motor_rpm), 0, 0, 0)
        return mavlink.MAVLink_esc_telemetry_1_to_4_message(
            bytes(4), nothing, nothing, nothing, speeds, nothing
        )

    def _gps(self) -> Message:
        state = self._flight.estimate
        latitude, longitude = self._degrees_e7(state.east_m, state.north_m)
        altitude = round(self.amsl_m(state.up_m) * 1000)
        speed, course = (
            round(state.ground_speed_m_s * 100),
            round(math.degrees(state.course_rad) * 100) % 36000,
        )
        return mavlink.MAVLink_gps_raw_int_message(
            self.boot_time_us(),
            3,
            latitude,
            longitude,
            altitude,
            80,
            120,
            speed,
            course,
            14,
            altitude,
            1000,
            1500,
            100,
        )

    def _attitude(self) -> Message:
        state = self._flight.estimate
        return mavlink.MAVLink_attitude_message(
            self._boot_ms(),
            state.bank_rad,
            state.pitch_rad,
            wrapped_angle(state.yaw_rad),
            state.roll_rate_rad_s,
            state.pitch_rate_rad_s,
            state.yaw_rate_rad_s,
        )

    def _position(self) -> Message:
        state = self._flight.estimate
        latitude, longitude = self._degrees_e7(state.east_m, state.north_m)
        return mavlink.MAVLink_global_position_int_message(
            self._boot_ms(),
            latitude,
            longitude,
            round(self.amsl_m(state.up_m) * 1000),
            round((state.up_m - self._home.up_m) * 1000),
            round(state.velocity_north_m_s * 100),
            round(state.velocity_east_m_s * 100),
            round(-state.velocity_up_m_s * 100),
            round(math.degrees(state.yaw_rad) * 100) % 36000,
        )

    def _hud(self) -> Message:
        state = self._flight.estimate
        return mavlink.MAVLink_vfr_hud_message(
            state.airspeed_m_s,
            state.ground_speed_m_s,
            round(math.degrees(state.yaw_rad)) % 360,
            round(100 * self._flight.output.throttle),
            self.amsl_m(state.up_m),
            state.velocity_up_m_s,
        )

    def _controller(self) -> Message:
        state, output = self._flight.estimate, self._flight.output
        bearing = distance = 0
        if self.target is not None:
            east, north = self.target[0] - state.east_m, self.target[1] - state.north_m
            distance = min(round(math.hypot(east, north)), _UNKNOWN_U16)
            bearing = round(math.degrees(math.atan2(east, north)))
        return mavlink.MAVLink_nav_controller_output_message(
            math.degrees(output.bank_rad),
            math.degrees(output.pitch_rad),
            round(math.degrees(wrapped_angle(output.bearing_rad))),
            bearing,
            distance,
            output.height_error_m,
            self._flight.airspeed_m_s - state.airspeed_m_s,
            output.cross_track_m,
        )

    def _target(self) -> Message | None:
        if self.target is None:
            return None
        latitude, longitude = self._degrees_e7(self.target[0], self.target[1])
        return mavlink.MAVLink_position_target_global_int_message(
            self._boot_ms(),
            mavlink.MAV_FRAME_GLOBAL,
            _IGNORE_ALL_BUT_POSITION,
            latitude,
            longitude,
            self.amsl_m(self.target[2]),
            *(0.0,) * 8,
        )

    def _wind(self) -> Message:
        state = self._flight.estimate
        direction = math.degrees(math.atan2(-state.wind_east_m_s, -state.wind_north_m_s))
        return mavlink.MAVLink_wind_message(
            direction, math.hypot(state.wind_east_m_s, state.wind_north_m_s), 0.0
        )

    def wind_covariance(self) -> Message:
        """WIND_COV, PX4's wind: north, east, down, and how well it is known."""
        state = self._flight.estimate
        return mavlink.MAVLink_wind_cov_message(
            self.boot_time_us(), state.wind_north_m_s, state.wind_east_m_s, 0.0, 0.1, 0.1, 0.0, 0.3, 1.0
        )

    def estimator_status(self) -> Message:
        """ESTIMATOR_STATUS: accuracy of the position."""
        return mavlink.MAVLink_estimator_status_message(
            self.boot_time_us(), _EKF_FLAGS, 0.05, 0.05, 0.05, 0.05, 0.05, 0.05, 1.0, 1.0
        )

    def _filter(self) -> Message:
        return mavlink.MAVLink_ekf_status_report_message(_EKF_FLAGS, 0.05, 0.05, 0.05, 0.05, 0.0)

    def home_position(self) -> Message:
        """HOME_POSITION."""
        home = self._home
        return mavlink.MAVLink_home_position_message(
            home.latitude_e7,
            home.longitude_e7,
            round(home.altitude_amsl_m * 1000),
            *(math.nan,) * 3,
            (math.nan,) * 4,
            *(0.0,) * 3,
            self.boot_time_us(),
        )

    def height_sensor(self) -> Message:
        """DISTANCE_SENSOR: a laser that points down from the aircraft, without a signal out of its range."""
        true, (least, most) = self._flight.dynamics.state, _HEIGHT_SENSOR_M
        tilt = max(math.cos(true.bank_rad) * math.cos(true.pitch_rad), 1e-3)
        distance = (true.up_m - self._flight.ground_up_m) / tilt
        return mavlink.MAVLink_distance_sensor_message(
            self._boot_ms(), round(100 * least), round(100 * most),
            round(100 * min(max(distance, least), most)), mavlink.MAV_DISTANCE_SENSOR_LASER, 0,
            mavlink.MAV_SENSOR_ROTATION_PITCH_270, 0,
            signal_quality=_GOOD_SIGNAL if least <= distance <= most else _NO_SIGNAL,
        )  # fmt: skip

    def _extended_state(self) -> Message:
        is_down = self._flight.is_standing
        landed = mavlink.MAV_LANDED_STATE_ON_GROUND if is_down else mavlink.MAV_LANDED_STATE_IN_AIR
        return mavlink.MAVLink_extended_sys_state_message(0, landed)


def _centiamperes(battery: SimulatedBattery) -> int:
    """Current as in messages [0.01 A], whose field ends at 327 A."""
    return min(round(100 * battery.current_a), 32_767)
