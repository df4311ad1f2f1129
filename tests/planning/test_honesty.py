"""Whether LQG-MP tells the truth: thousands of closed-loop flights along one planned path.

The flights below share no code with the planner but its gains: the motion, its noise, the Kalman filter
and the regulator are written here again, with the full nonlinear motion as the truth.
"""

import math

import numpy as np
import pytest

from companion.frames import direction_from_course
from companion.kernels.uncertainty import collision_free, look_up_gain
from companion.planning.problem import initial_covariances
from companion.planning.settings import Strategies
from companion.planning.solver import solve
from tests.support.paths import box
from tests.support.worlds import VEHICLE, problem, tables

FLIGHTS = 4000
H = np.eye(5, 6)


def moved(state, control, tau):
    """States (N, 6) after one step of controls (N, 3)."""
    a, w, wp = control.T
    half = 0.5 * w * tau
    v, phi = state[:, 5] + 0.5 * a * tau, state[:, 4] + 0.5 * wp * tau
    theta = state[:, 3] + half
    flat = tau * v * np.cos(phi) * np.sinc(half / math.pi)
    rates = np.column_stack(
        [flat * np.cos(theta), flat * np.sin(theta), tau * v * np.sin(phi), w * tau, wp * tau, a * tau]
    )
    return state + rates


def jacobians(state, control, tau):
    """Central differences of :func:`moved` at one state and control."""
    h, columns = 1e-5, []
    for n in range(9):
        step = np.zeros(9)
        step[n] = h
        ends = [
            moved((state + s * step[:6])[None], (control + s * step[6:])[None], tau)[0] for s in (1.0, -1.0)
        ]
        columns.append((ends[0] - ends[1]) / (2.0 * h))
    both = np.array(columns).T
    return both[:, :6], both[:, 6:]


def fly(path, dimension, rng):
    """True positions (rows, flights, 3) of closed-loop flights along a path."""
    model = tables(dimension)
    theta = np.unwrap([direction_from_course(course) for course in path.courses_rad])
    nominal = np.column_stack([path.positions_enu_m, theta, path.climb_angles_rad, path.speeds_m_s])
    covariance = initial_covariances(VEHICLE, 2.0, 2.0)
    estimate = np.tile(nominal[0], (FLIGHTS, 1))
    true = estimate + rng.standard_normal((FLIGHTS, 6)) * np.sqrt(np.diag(covariance))
    process, noise = np.diag(model.process), np.diag(model.measurement)
    positions = [true[:, :3].copy()]
    gain = np.empty((3, 6))
    for k in range(1, len(path)):
        tau = path.times_s[k] - path.times_s[k - 1]
        planned = (nominal[k, [5, 3, 4]] - nominal[k - 1, [5, 3, 4]]) / tau
        a, b = jacobians(nominal[k - 1], planned, tau)
        speed, climb, direction = nominal[k - 1, [5, 4, 3]]
        look_up_gain(speed, planned[1], climb, direction + 0.5 * planned[1] * tau, model, gain)
        control = planned + (estimate - nominal[k - 1]) @ gain.T
        true = moved(true, control + rng.standard_normal((FLIGHTS, 3)) * np.sqrt(model.process), tau)
        measured = true[:, :5] + rng.standard_normal((FLIGHTS, 5)) * np.sqrt(model.measurement)
        prior = a @ covariance @ a.T + b @ process @ b.T
        k_gain = prior @ H.T @ np.linalg.inv(H @ prior @ H.T + noise)
        covariance = (np.eye(6) - k_gain @ H) @ prior
        ahead = nominal[k] + (estimate - nominal[k - 1]) @ a.T + (control - planned) @ b.T
        estimate = ahead + (measured - ahead[:, :5]) @ k_gain.T
        positions.append(true[:, :3].copy())
    return np.array(positions)


@pytest.fixture(scope="module", params=[2, 3], ids=["plane", "space"])
def flights(request):
    dimension = request.param
    walls = (box("wall", 0.0, 700.0, 900.0, 740.0), box("post", 1150.0, 600.0, 1200.0, 900.0))
    goal = (1350.0, 1350.0, 150.0 if dimension == 2 else 200.0)
    # Straight from the tree: every edge takes one step of the recursion.
    asked = problem(
        walls, dimension=dimension, goal=goal, seed=2, strategies=Strategies(use_safety_adjustment=False)
    )
    plan = solve(asked)
    assert plan.reaches_goal
    assert np.ptp(plan.path.courses_rad) > 0.5  # there are turns
    return dimension, plan.path, fly(plan.path, dimension, np.random.default_rng(77))


def test_realised_covariances_are_the_planned_ones(flights):
    dimension, path, positions = flights
    rows = np.linspace(1, len(path) - 1, 12).astype(int)
    for row in rows:
        realised = np.cov(positions[row][:, :dimension].T)
        planned = path.position_covariances_m2[row][:dimension, :dimension]
        # Relative to the planned one: its eigenvalues are 1 but for sampling, sd √(2/N) = 2.2 %, and for
        # what linearising leaves out.
        root = np.linalg.inv(np.linalg.cholesky(planned))
        eigenvalues = np.linalg.eigvalsh(root @ realised @ root.T)
        spread = 4.0 * math.sqrt(2.0 / FLIGHTS) + 0.05
        assert eigenvalues == pytest.approx(np.ones(dimension), abs=spread)
        # Where Dubins edges join the tree's, the plan changes its climb angle at once, the flights over a
        # second: by at most 0.1 rad, 0.5·25·0.1 = 1.25 m, made up for within ten seconds.
        bias = np.abs(positions[row].mean(axis=0) - path.positions_enu_m[row])
        assert bias.max() < 1.3


@pytest.mark.parametrize("distance", [0.8, 1.5, 2.2])
def test_no_more_flights_hit_a_wall_than_p_c_allows(flights, distance):
    dimension, path, positions = flights
    checked = 0
    for row in range(5, len(path), 9):
        covariance = path.position_covariances_m2[row][:2, :2]
        values, vectors = np.linalg.eigh(covariance)
        deviation = math.sqrt(
            np.linalg.eigvalsh(path.position_covariances_m2[row][:dimension, :dimension])[-1]
        )
        # A wall across the worst direction, ``distance`` deviations away: the case nearest to the bound.
        along = (positions[row][:, :2] - path.positions_enu_m[row, :2]) @ vectors[:, -1]
        hits = np.mean(along > distance * deviation)
        bound = 1.0 - collision_free(distance * deviation, deviation, dimension)
        assert hits <= bound + 3.0 * math.sqrt(bound * (1.0 - bound) / FLIGHTS)
        # And it is not an empty promise: a flat wall is hit as often as the normal distribution says.
        normal = 0.5 * math.erfc(distance * deviation / math.sqrt(values[-1]) / math.sqrt(2.0))
        assert hits == pytest.approx(normal, abs=4.0 * math.sqrt(normal / FLIGHTS) + 0.02)
        checked += 1
    assert checked >= 5
