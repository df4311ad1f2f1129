"""LQG-MP tables: gains computed once, looked up on every edge (paper 2.2).

References
----------
van den Berg, Abbeel, Goldberg, "LQG-MP", IJRR 30(7), 2011.
Åström, Murray, *Feedback Systems* (2nd ed.), section 7.5 (linear quadratic regulator).
"""

from __future__ import annotations

import functools

import numpy as np
from scipy.linalg import solve_discrete_are

from companion.frames import FloatArray
from companion.kernels.aircraft.lqg_mp import linearise
from companion.kernels.arrays import Uncertainty
from companion.vehicle.vehicle_model import VehicleModel

GUST_SHARE, GUST_LENGTH_M = 0.14, 260.0
NUM_PARTICLES = 60  # m of paper 3.3.1
STATE_TOLERANCE = np.array([5.0, 5.0, 5.0, 0.1, 0.1, 2.0])  # deviation worth one unit of cost: m, rad, m/s


def regulator_gain(
    speed_m_s: float, turn_rate_rad_s: float, climb_rad: float, vehicle: VehicleModel, tau_s: float
) -> FloatArray:
    """LQR gain L with u = ū + L·(ŝ − s*), for flight in direction 0.

    The cost weighs deviations by :data:`STATE_TOLERANCE` and controls by the aircraft's limits.

    Returns
    -------
    ndarray, shape (3, 6)
        Rows: acceleration, turn rate, climb rate.
    """
    motion, control = np.empty((6, 6)), np.empty((6, 3))
    linearise(0.0, climb_rad, speed_m_s, 0.0, turn_rate_rad_s, 0.0, tau_s, motion, control)
    state_cost = np.diag(1.0 / STATE_TOLERANCE**2)
    control_scale = np.array(
        [
            vehicle.acceleration_max_m_s2,
            vehicle.airspeed_cruise_m_s / vehicle.turn_radius_min_m,
            vehicle.pitch_rate_max_rad_s,
        ]
    )
    control_cost = np.diag(1.0 / control_scale**2)
    solution = solve_discrete_are(motion, control, state_cost, control_cost)
    inner = control_cost + control.T @ solution @ control
    return -np.linalg.solve(inner, control.T @ solution @ motion)


def uncertainty_tables(
    vehicle: VehicleModel, tau_s: float, dimension: int, num_speeds: int = 6, num_rates: int = 5,
    num_climbs: int = 5,
) -> Uncertainty:  # fmt: skip
    """Gains over speed, turn rate and climb angle, the noise, and the common particles.

    The particles are one fixed set of standard-normal points for every planner: differences between
    nodes then come from the nodes, not from the draw.
    """
    rate_max = vehicle.airspeed_max_m_s / vehicle.turn_radius_min_m
    speeds = np.linspace(vehicle.airspeed_min_m_s, vehicle.airspeed_max_m_s, num_speeds)
    rates = np.linspace(-rate_max, rate_max, num_rates)
    climbs = np.linspace(-vehicle.descent_angle_max_rad, vehicle.climb_angle_max_rad, num_climbs)
    gains = np.empty((num_speeds, num_rates, num_climbs, 3, 6))
    for i, speed in enumerate(speeds):
        for j, rate in enumerate(rates):
            for k, climb in enumerate(climbs):
                gains[i, j, k] = regulator_gain(speed, rate, climb, vehicle, tau_s)
    normals = np.random.default_rng(60).standard_normal((NUM_PARTICLES, 3))
    normals -= normals.mean(axis=0)
    vertical = 1.0 if dimension == 3 else 0.0
    return Uncertainty(
        process=np.array(
            [
                vehicle.acceleration_std_m_s2**2,
                vehicle.course_rate_std_rad_s**2,
                vertical * vehicle.climb_rate_std_rad_s**2,
            ]
        ),
        measurement=np.array(
            [
                vehicle.position_std_m**2,
                vehicle.position_std_m**2,
                vehicle.altitude_std_m**2,
                vehicle.course_std_rad**2,
                vehicle.climb_std_rad**2,
            ]
        ),
        gains=np.ascontiguousarray(gains),
        axes=np.array([[axis[0], axis[1] - axis[0]] for axis in (speeds, rates, climbs)]),
        normals=np.ascontiguousarray(normals),
    )


def with_gusts(tables: Uncertainty, vehicle: VehicleModel, wind_m_s: float, tau_s: float) -> Uncertainty:
    """The tables with the process noise that the gusts of a wind add; the gains are the same.

    Gusts by MIL-F-8785C (3.7.2) at some 100 m: their deviation a share of the wind, their length so many
    metres. As a Gauss-Markov process of time constant T = length over airspeed they change the velocity
    by σ·√(2·τ/T) in a step, along the flight, across and upwards.

    Parameters
    ----------
    tables : Uncertainty
        Those of still air.
    vehicle : VehicleModel
        The aircraft.
    wind_m_s : float
        Speed of the wind.
    tau_s : float
        How long one step takes [s].
    """
    speed = vehicle.airspeed_cruise_m_s
    variance = (GUST_SHARE * wind_m_s) ** 2 * 2.0 * speed / (GUST_LENGTH_M * tau_s)
    upwards = variance / speed**2 if tables.process[2] > 0.0 else 0.0
    return tables._replace(process=tables.process + np.array([variance, variance / speed**2, upwards]))


@functools.cache
def tables_once(vehicle: VehicleModel, tau_s: float, dimension: int) -> Uncertainty:
    """:func:`uncertainty_tables`, made once a vehicle: the paper's "off-line" part."""
    return uncertainty_tables(vehicle, tau_s, dimension)
