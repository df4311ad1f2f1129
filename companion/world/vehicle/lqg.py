"""Compute the LQG-MP tables once; the planner looks them up on every edge (paper 2.2).

References
----------
van den Berg, Abbeel, Goldberg, "LQG-MP", IJRR 30(7), 2011.
Åström, Murray, *Feedback Systems* (2nd ed.), section 7.5 (linear quadratic regulator).
"""

from __future__ import annotations

import functools
import itertools

import numpy as np

from companion.frames import FloatArray
from companion.kernels.aircraft.lqg_mp import linearise
from companion.kernels.arrays import Uncertainty
from companion.world.vehicle.vehicle_model import VehicleModel

# Gusts by MIL-F-8785C at about 100 m: standard deviation over wind speed, and scale length.
GUST_SHARE, GUST_LENGTH_M = 0.14, 260.0
NUM_PARTICLES = 60  # m of paper 3.3.1.
STATE_TOLERANCE = np.array([5.0, 5.0, 5.0, 0.1, 0.1, 2.0])  # Deviations that cost one unit: m, rad, m/s.
DOUBLINGS_MAX = 40  # A solution settles in some ten doublings.
COST_MAX = 1e60  # A cost above this grows without bound.
SETTLED = 1e-15  # A relative change of the solution below this is rounding.


def regulator_gains(steps: FloatArray, vehicle: VehicleModel, tau_s: float) -> FloatArray:
    """Return the LQR gains L, with u = ū + L·(ŝ − s*), for flight in direction 0.

    The cost weighs deviations by :data:`STATE_TOLERANCE` and controls by the aircraft's limits.

    Parameters
    ----------
    steps : ndarray, shape (N, 3)
        Speed [m/s], turn rate [rad/s] and climb angle [rad] of each step.
    vehicle : VehicleModel
        The aircraft.
    tau_s : float
        Duration of a step [s].

    Returns
    -------
    ndarray, shape (N, 3, 6)
        Rows: acceleration, turn rate, climb rate.
    """
    motions, controls = np.empty((len(steps), 6, 6)), np.empty((len(steps), 6, 3))
    for (speed, rate, climb), motion, control in zip(steps, motions, controls, strict=True):
        linearise(0.0, climb, speed, 0.0, rate, 0.0, tau_s, motion, control)
    control_scale = np.array(
        [
            vehicle.acceleration_max_m_s2,
            vehicle.airspeed_cruise_m_s / vehicle.turn_radius_min_m,
            vehicle.pitch_rate_max_rad_s,
        ]
    )
    control_cost = np.diag(1.0 / control_scale**2)
    solutions = riccati_solutions(motions, controls, np.diag(1.0 / STATE_TOLERANCE**2), control_cost)
    weighed = np.swapaxes(controls, 1, 2) @ solutions
    return np.asarray(
        -np.linalg.solve(control_cost + weighed @ controls, weighed @ motions), dtype=np.float64
    )


def riccati_solutions(
    motions: FloatArray, controls: FloatArray, state_cost: FloatArray, control_cost: FloatArray
) -> FloatArray:
    """Solve the discrete algebraic Riccati equations of N regulators at once, by doubling.

    Step k of the algorithm gives what 2ᵏ steps of the Riccati recursion give. SciPy solves one equation at a
    time, and takes a fifth of a second to load and to solve the 150 of a table.

    Parameters
    ----------
    motions : ndarray, shape (N, 6, 6)
        The matrices A of the regulators.
    controls : ndarray, shape (N, 6, 3)
        Their matrices B.
    state_cost : ndarray, shape (6, 6)
        Q, the cost of deviations.
    control_cost : ndarray, shape (3, 3)
        R, the cost of controls.

    Returns
    -------
    ndarray, shape (N, 6, 6)
        The solutions X.

    Raises
    ------
    ArithmeticError
        If a solution does not converge: then no control stabilises the state.

    References
    ----------
    Chu, Fan, Lin, Wang, "Structure-preserving algorithms for periodic discrete-time algebraic Riccati
    equations", International Journal of Control 77(8), 2004, algorithm SDA.
    """
    a, h = motions, np.broadcast_to(state_cost, motions.shape)
    g = controls @ np.linalg.solve(control_cost, np.swapaxes(controls, 1, 2))
    for _ in range(DOUBLINGS_MAX):
        if np.max(np.abs(h)) > COST_MAX:
            break
        inner, back = np.eye(motions.shape[-1]) + g @ h, np.swapaxes(a, 1, 2)
        onward = np.linalg.solve(inner, a)
        gained = back @ h @ onward
        g = g + a @ np.linalg.solve(inner, g) @ back
        h, a = h + gained, a @ onward
        if np.max(np.abs(gained)) <= SETTLED * np.max(np.abs(h)):
            return 0.5 * (h + np.swapaxes(h, 1, 2))
    raise ArithmeticError("a regulator's cost does not settle: no control holds its state")


def uncertainty_tables(
    vehicle: VehicleModel, tau_s: float, dimension: int, num_speeds: int = 6, num_rates: int = 5,
    num_climbs: int = 5,
) -> Uncertainty:  # fmt: skip
    """Return the gains over speed, turn rate and climb angle, the noise, and the particles.

    The particles are one fixed set of standard-normal points for all planners. Differences between nodes then
    come from the nodes, not from the draw.
    """
    rate_max = vehicle.airspeed_max_m_s / vehicle.turn_radius_min_m
    speeds = np.linspace(vehicle.airspeed_min_m_s, vehicle.airspeed_max_m_s, num_speeds)
    rates = np.linspace(-rate_max, rate_max, num_rates)
    climbs = np.linspace(-vehicle.descent_angle_max_rad, vehicle.climb_angle_max_rad, num_climbs)
    steps = np.array(list(itertools.product(speeds, rates, climbs)))
    gains = regulator_gains(steps, vehicle, tau_s).reshape(num_speeds, num_rates, num_climbs, 3, 6)
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
    """Return the tables with the process noise of gusts added; the gains stay the same.

    Gusts follow MIL-F-8785C (3.7.2) at about 100 m: their standard deviation is :data:`GUST_SHARE` of the
    wind speed, their scale length :data:`GUST_LENGTH_M`. As a Gauss-Markov process of time constant
    T = length over airspeed, they change the velocity by σ·√(2·τ/T) in a step, along the flight, across and
    upwards.

    Parameters
    ----------
    tables : Uncertainty
        The tables of still air.
    vehicle : VehicleModel
        The aircraft.
    wind_m_s : float
        Speed of the wind [m/s].
    tau_s : float
        Duration of a step [s].
    """
    speed = vehicle.airspeed_cruise_m_s
    variance = (GUST_SHARE * wind_m_s) ** 2 * 2.0 * speed / (GUST_LENGTH_M * tau_s)
    upwards = variance / speed**2 if tables.process[2] > 0.0 else 0.0
    return tables._replace(process=tables.process + np.array([variance, variance / speed**2, upwards]))


@functools.cache
def tables_once(vehicle: VehicleModel, tau_s: float, dimension: int) -> Uncertainty:
    """Return :func:`uncertainty_tables`, cached per vehicle: the paper's "off-line" part."""
    return uncertainty_tables(vehicle, tau_s, dimension)
