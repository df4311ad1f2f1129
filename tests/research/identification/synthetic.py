"""Recordings of flights whose noise is known: LQG-MP's own closed loop, written here again."""

import math

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config.compose import vehicle_of, world_of
from companion.recording.recorder import About, Recorder
from companion.types.path import Path
from companion.types.plan import Measures, Plan, PlanStatus
from companion.types.record import PlanRecord, SwapRecord
from companion.world.vehicle.lqg import regulator_gains
from tests.link.pymavlink_frames import heartbeat, packed

H = np.eye(5, 6)
LENGTH_S = 1_200


def straight_plan(mission, seconds=LENGTH_S):
    """Eastwards at cruise, a row a second."""
    times, cruise = np.arange(seconds, dtype=float), float(mission.vehicle.airspeed_cruise_m_s)
    positions = np.column_stack([cruise * times, np.full(seconds, 800.0), np.full(seconds, 100.0)])
    zeros = np.zeros(seconds)
    return Path(
        times,
        positions,
        zeros + math.pi / 2,
        zeros,
        zeros + cruise,
        np.zeros((seconds, 3, 3)),
        zeros + 1.0,
        zeros,
    )


def closed_loop(mission, seconds, rng):
    """Estimates (seconds, 6) about a straight plan, and true airspeeds: motion, Kalman filter, regulator."""
    vehicle, tau = vehicle_of(mission), 1.0
    cruise = vehicle.airspeed_cruise_m_s
    a = np.eye(6)
    a[0, 5] = tau
    a[1, 3] = a[2, 4] = tau * cruise
    b = np.zeros((6, 3))
    b[0, 0], b[1, 1], b[2, 2] = 0.5 * tau**2, 0.5 * tau**2 * cruise, 0.5 * tau**2 * cruise
    b[5, 0] = b[3, 1] = b[4, 2] = tau
    gain = regulator_gains(np.array([[cruise, 0.0, 0.0]]), vehicle, tau)[0]
    process = np.array(
        [vehicle.acceleration_std_m_s2, vehicle.course_rate_std_rad_s, vehicle.climb_rate_std_rad_s]
    )
    noise = np.array(
        [vehicle.position_std_m] * 2 + [vehicle.altitude_std_m, vehicle.course_std_rad, vehicle.climb_std_rad]
    )
    covariance, estimate, true = np.eye(6), np.zeros(6), np.zeros(6)
    estimates, speeds = [], []
    for _ in range(seconds):
        estimates.append(estimate)
        speeds.append(true[5])
        control = gain @ estimate
        true = a @ true + b @ (control + process * rng.standard_normal(3))
        prior = a @ covariance @ a.T + b @ np.diag(process**2) @ b.T
        k = prior @ H.T @ np.linalg.inv(H @ prior @ H.T + np.diag(noise**2))
        covariance = (np.eye(6) - k @ H) @ prior
        ahead = a @ estimate + b @ control
        estimate = ahead + k @ (true[:5] + noise * rng.standard_normal(5) - ahead[:5])
    return np.array(estimates), np.array(speeds)


def position_frame(mission, at_s, place, velocity):
    latitude, longitude, altitude = mission.frame.global_from_local(*place)
    east, north, up = (round(100.0 * value) for value in velocity)
    message = mavlink.MAVLink_global_position_int_message(
        round(1e3 * at_s), round(1e7 * latitude), round(1e7 * longitude), round(1e3 * altitude), 100_000,
        north, east, -up, 9_000,
    )  # fmt: skip
    return packed(message)


def fix_frame(mission, at_s, place, accuracies, fix_type=3):
    latitude, longitude, altitude = mission.frame.global_from_local(*place)
    told = (round(1e3 * value) for value in accuracies)
    message = mavlink.MAVLink_gps_raw_int_message(
        round(1e6 * at_s), fix_type, round(1e7 * latitude), round(1e7 * longitude), round(1e3 * altitude),
        80, 120, 2_500, 9_000, 14, round(1e3 * altitude), *told,
    )  # fmt: skip
    return packed(message)


def airspeed_frame(airspeed):
    return packed(mavlink.MAVLink_vfr_hud_message(airspeed, 25.0, 90, 50, 684.0, 0.0))


def recorder_of(folder, mission, plan):
    """A recorder that has written a plan which is flown from 0 s on."""
    recorder = Recorder(folder, 1_767_225_600.0, About(mission, 1, "", 0.02))
    recorder.begin(0.0)
    recorder.frame(0.0, heartbeat())
    answer = Plan(PlanStatus.EXACT, plan, Measures(), 1, "safe-rrt", 0)
    recorder.plan(
        0.0, PlanRecord(1, "first", "plan", {}, answer, 1, False, 0.0, 0.0, 0.0, 0.0, 1.0), world_of(mission)
    )
    recorder.swap(0.0, SwapRecord("flown", "", 0.0, 0.0, 1, (), plan.positions_enu_m[:2]))
    return recorder


def record_closed_loop(folder, mission, seed=1, seconds=LENGTH_S):
    """A flight of the closed loop, told once a second with the accuracies of the mission's noise."""
    plan, rng = straight_plan(mission, seconds), np.random.default_rng(seed)
    estimates, speeds = closed_loop(mission, seconds, rng)
    vehicle = vehicle_of(mission)
    cruise = vehicle.airspeed_cruise_m_s
    told = (vehicle.position_std_m, vehicle.altitude_std_m, vehicle.course_std_rad * cruise)
    recorder = recorder_of(folder, mission, plan)
    for at, place, deviation, speed in zip(
        plan.times_s, plan.positions_enu_m, estimates, speeds, strict=True
    ):
        flown, course = cruise + deviation[5], deviation[3]
        velocity = (flown * math.cos(course), flown * math.sin(course), flown * math.sin(deviation[4]))
        recorder.frame(at, heartbeat())
        recorder.frame(at, airspeed_frame(cruise + speed))
        recorder.frame(at, fix_frame(mission, at, place + deviation[:3], told))
        recorder.frame(at, position_frame(mission, at, place + deviation[:3], velocity))
    recorder.close()


def record_fixes(folder, mission, *, place_std, height_std, velocity_std, seed=1, seconds=120):
    """A flight exactly along its plan, told at 10 Hz with white noise and without any accuracy."""
    plan, rng = straight_plan(mission, seconds), np.random.default_rng(seed)
    recorder = recorder_of(folder, mission, plan)
    noise = np.array([place_std, place_std, height_std])
    for tick in range(10 * (seconds - 2)):
        at = 0.1 * tick
        place = np.array([25.0 * at, 800.0, 100.0])
        velocity = (25.0, 0.0, 0.0) + velocity_std * rng.standard_normal(3)
        if tick % 10 == 0:
            recorder.frame(at, heartbeat())
        recorder.frame(at, position_frame(mission, at, place, velocity))
        if tick % 2 == 0:
            recorder.frame(at, fix_frame(mission, at, place + noise * rng.standard_normal(3), (0, 0, 0)))
    recorder.close()
