"""Whether LQG-MP tells the truth: thousands of closed-loop flights along planned paths.

The flights below share no code with the planner but its gains: the motion, its noise, the Kalman filter
and the regulator are written here again, with the full nonlinear motion as the truth.
"""

import math

import numpy as np
import pytest
import shapely
from scipy.stats import binom

from companion.config import load_mission
from companion.config.offline_problem import offline_problem, offline_world
from companion.frames import direction_from_course
from companion.kernels.aircraft.lqg_mp import collision_free, look_up_gain
from companion.planning.solver import solve
from companion.world.vehicle.lqg import uncertainty_tables
from tests.sim.client import CONFIGS

FLIGHTS = 5000
MISSIONS = ("paper-2d", "paper-3d", "first-flight")
CHANCE = 1e-4  # of a false alarm over all nodes of a path
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


def fly(path, problem, dimension, rng, num=FLIGHTS):
    """True positions (rows, num, 3) of closed-loop flights along a path."""
    model = uncertainty_tables(problem.vehicle, problem.settings.tau_s, dimension)
    theta = np.unwrap([direction_from_course(course) for course in path.courses_rad])
    nominal = np.column_stack([path.positions_enu_m, theta, path.climb_angles_rad, path.speeds_m_s])
    covariance = problem.start.error_covariance
    estimate = np.tile(nominal[0], (num, 1))
    true = estimate + rng.standard_normal((num, 6)) * np.sqrt(np.diag(covariance))
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
        true = moved(true, control + rng.standard_normal((num, 3)) * np.sqrt(model.process), tau)
        measured = true[:, :5] + rng.standard_normal((num, 5)) * np.sqrt(model.measurement)
        prior = a @ covariance @ a.T + b @ process @ b.T
        k_gain = prior @ H.T @ np.linalg.inv(H @ prior @ H.T + noise)
        covariance = (np.eye(6) - k_gain @ H) @ prior
        ahead = nominal[k] + (estimate - nominal[k - 1]) @ a.T + (control - planned) @ b.T
        estimate = ahead + (measured - ahead[:, :5]) @ k_gain.T
        positions.append(true[:, :3].copy())
    return np.array(positions)


@pytest.fixture(scope="module", params=MISSIONS)
def flights(request):
    mission = load_mission(CONFIGS / f"{request.param}.yaml")
    for seed in range(1, 10):
        problem = offline_problem(mission, offline_world(mission), None, seed)
        plan = solve(problem)
        if plan.reaches_goal:
            break
    assert plan.reaches_goal
    assert np.ptp(plan.path.courses_rad) > 0.5  # there are turns
    rng = np.random.default_rng(77)
    return mission, plan.path, fly(plan.path, problem, mission.dimension, rng)


def test_realised_covariances_are_the_planned_ones_at_every_node(flights):
    mission, path, positions = flights
    dimension = mission.dimension
    for row in range(1, len(path)):
        realised = np.cov(positions[row][:, :dimension].T)
        planned = path.position_covariances_m2[row][:dimension, :dimension]
        # Relative to the planned one its eigenvalues are 1 but for sampling: a variance has the standard
        # deviation √(2/N) = 2 %, and the outermost of d eigenvalues lie 2√(d/N) farther out.
        root = np.linalg.inv(np.linalg.cholesky(planned))
        eigenvalues = np.linalg.eigvalsh(root @ realised @ root.T)
        spread = 4.0 * math.sqrt(2.0 / FLIGHTS) + 2.0 * math.sqrt(dimension / FLIGHTS)
        assert eigenvalues == pytest.approx(np.ones(dimension), abs=spread)
        bias = np.abs(positions[row].mean(axis=0) - path.positions_enu_m[row])
        assert bias.max() < 1.3


def test_no_more_flights_collide_at_any_node_than_p_c_allows(flights):
    mission, path, positions = flights
    for row in range(len(path)):
        hits = np.zeros(FLIGHTS, dtype=bool)
        for obstacle in mission.obstacle_list:
            up = positions[row][:, 2]
            inside = shapely.intersects_xy(
                shapely.Polygon(obstacle.polygon_enu_m), positions[row][:, 0], positions[row][:, 1]
            )
            hits |= inside & (up >= obstacle.base_m) & (up <= obstacle.top_m)
        allowed = 1.0 - path.collision_free[row]
        # As many hits as these are no rarer than CHANCE, were the rate the one allowed.
        assert binom.sf(hits.sum() - 1, FLIGHTS, allowed) > CHANCE / len(path)


@pytest.mark.parametrize("distance", [0.8, 1.5, 2.2])
def test_no_more_flights_hit_a_near_wall_than_p_c_allows(flights, distance):
    # The planned paths keep away from walls; so put a wall beside every node, across the direction in
    # which the position spreads most, ``distance`` deviations away: the case nearest to the bound.
    mission, path, positions = flights
    for row in range(1, len(path)):
        covariance = path.position_covariances_m2[row][:2, :2]
        values, vectors = np.linalg.eigh(covariance)
        whole = path.position_covariances_m2[row][: mission.dimension, : mission.dimension]
        deviation = math.sqrt(np.linalg.eigvalsh(whole)[-1])
        along = (positions[row][:, :2] - path.positions_enu_m[row, :2]) @ vectors[:, -1]
        hits = int((along > distance * deviation).sum())
        bound = 1.0 - collision_free(distance * deviation, deviation, mission.dimension)
        assert binom.sf(hits - 1, FLIGHTS, bound) > CHANCE / len(path)
        # And it is not an empty promise: about its own mean, a flat wall is hit as often as the normal
        # distribution says.
        normal = 0.5 * math.erfc(distance * deviation / math.sqrt(values[-1]) / math.sqrt(2.0))
        own = np.mean(along - along.mean() > distance * deviation)
        assert own == pytest.approx(normal, abs=5.0 * math.sqrt(normal / FLIGHTS) + 0.01)
