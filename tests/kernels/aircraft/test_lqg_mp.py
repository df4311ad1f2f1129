"""LQG-MP against plain matrices, SciPy and NumPy."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are
from scipy.special import gammainc

from companion.kernels.aircraft import lqg_mp as u
from companion.kernels.aircraft.motion import advance
from companion.kernels.workspace import filter_scratch
from companion.world.vehicle.lqg import regulator_gains, riccati_solutions
from tests.support.worlds import VEHICLE, tables

TABLES, SCRATCH = tables(3), filter_scratch()
STILL = (0.0, 0.0, 0.0)
H = np.eye(5, 6)

STATES = st.tuples(st.floats(-math.pi, math.pi), st.floats(-0.17, 0.17), st.floats(12.5, 37.5))
CONTROLS = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.2, 0.2), st.floats(-0.1, 0.1))


def state_of(theta, phi, v):
    return np.array([100.0, -50.0, 120.0, theta, phi, v])


def jacobians(theta, phi, v, a, w, wp, tau=1.0):
    motion, control = np.empty((6, 6)), np.empty((6, 3))
    u.linearise(theta, phi, v, a, w, wp, tau, motion, control)
    return motion, control


def random_covariance(rng, scale):
    root = rng.standard_normal((6, 6)) * np.array(scale)[:, None]
    return root @ root.T


@settings(max_examples=100, deadline=None)
@given(STATES, CONTROLS)
def test_jacobians_agree_with_differences_of_the_motion(state, control):
    start = state_of(*state)
    motion, noise = jacobians(*state, *control)
    h = 1e-5

    def moved(s, c):
        out = np.empty(6)
        advance(s, *c, 1.0, out)
        return out

    for i in range(6):
        step = np.zeros(6)
        step[i] = h
        numeric = (moved(start + step, control) - moved(start - step, control)) / (2.0 * h)
        numeric[3] = (numeric[3] + 1.0) % (math.pi / h) - 1.0 if abs(numeric[3]) > 10.0 else numeric[3]
        assert motion[:, i] == pytest.approx(numeric, abs=2e-3)
    for i in range(3):
        step = np.zeros(3)
        step[i] = h
        numeric = (moved(start, control + step) - moved(start, np.array(control) - step)) / (2.0 * h)
        if abs(numeric[3]) > 10.0:
            continue  # the course wrapped between the two
        # The shortening of the chord with the turn rate is left out: v·τ²·(wτ)/12 = 37.5·0.2/12 at most.
        assert noise[:, i] == pytest.approx(numeric, abs=0.65)


@settings(max_examples=100, deadline=None)
@given(STATES, CONTROLS, st.integers(0, 10_000))
def test_one_edge_agrees_with_plain_matrices(state, control, seed):
    rng = np.random.default_rng(seed)
    scale = (2.0, 2.0, 2.0, 0.05, 0.02, 0.5)
    p, estimate = random_covariance(rng, scale), random_covariance(rng, scale)
    p_out, l_out = np.empty((6, 6)), np.empty((6, 6))
    u.propagate(state_of(*state), control, 1.0, TABLES, p, estimate, p_out, l_out, SCRATCH)
    a, b = jacobians(*state, *control)
    gain = np.empty((3, 6))
    u.look_up_gain(state[2], control[1], state[1], state[0] + 0.5 * control[1], TABLES, gain)
    prior = a @ p @ a.T + b @ np.diag(TABLES.process) @ b.T
    innovation = H @ prior @ H.T + np.diag(TABLES.measurement)
    k = prior @ H.T @ np.linalg.inv(innovation)
    closed = a + b @ gain
    expected_p = (np.eye(6) - k @ H) @ prior
    expected_l = closed @ estimate @ closed.T + k @ innovation @ k.T
    assert p_out == pytest.approx(expected_p, rel=1e-7, abs=1e-7)
    assert l_out == pytest.approx(expected_l, rel=1e-7, abs=1e-7)
    # Joseph's form of the same posterior, which is positive by construction.
    joseph = (np.eye(6) - k @ H) @ prior @ (np.eye(6) - k @ H).T + k @ np.diag(TABLES.measurement) @ k.T
    assert p_out == pytest.approx(joseph, rel=1e-6, abs=1e-6)


def test_a_steady_flight_settles_where_the_riccati_equation_says():
    # Straight level flight: P tends to the solution of the filter's algebraic Riccati equation,
    # found here by iterating plain matrices from another start.
    state = state_of(0.0, 0.0, 25.0)
    p, estimate = np.diag([4.0, 4.0, 4.0, 1e-3, 1e-3, 0.25]), np.zeros((6, 6))
    for _ in range(400):
        p_next, l_next = np.empty((6, 6)), np.empty((6, 6))
        u.propagate(state, STILL, 1.0, TABLES, p, estimate, p_next, l_next, SCRATCH)
        p, estimate = p_next, l_next
    a, b = jacobians(0.0, 0.0, 25.0, 0.0, 0.0, 0.0)
    q, n = b @ np.diag(TABLES.process) @ b.T, np.diag(TABLES.measurement)
    plain = 100.0 * np.eye(6)
    for _ in range(2000):
        prior = a @ plain @ a.T + q
        plain = prior - prior @ H.T @ np.linalg.solve(H @ prior @ H.T + n, H @ prior)
    assert p == pytest.approx(plain, abs=1e-8)
    again = np.empty((6, 6))
    u.propagate(state, STILL, 1.0, TABLES, p, estimate, np.empty((6, 6)), again, SCRATCH)
    assert again == pytest.approx(estimate, rel=1e-9, abs=1e-12)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(STATES, CONTROLS), min_size=1, max_size=25))
def test_covariances_stay_symmetric_and_positive_along_any_edges(edges):
    p, estimate = np.diag([4.0, 4.0, 4.0, 1e-3, 1e-3, 0.25]), np.zeros((6, 6))
    for state, control in edges:
        p_next, l_next = np.empty((6, 6)), np.empty((6, 6))
        u.propagate(state_of(*state), control, 1.0, TABLES, p, estimate, p_next, l_next, SCRATCH)
        p, estimate = p_next, l_next
        for matrix in (p, estimate, p + estimate):
            assert np.array_equal(matrix, matrix.T)
            assert np.linalg.eigvalsh(matrix)[0] > -1e-9


@pytest.mark.parametrize("rate", [-0.3, 0.0, 0.15])
@pytest.mark.parametrize("speed", [12.5, 25.0, 37.5])
def test_the_regulator_is_the_limit_of_the_riccati_recursion_and_stable(speed, rate):
    # Plain value iteration of the LQR, weights as documented: 5 m, 5 m, 5 m, 0.1 rad, 0.1 rad, 2 m/s.
    a, b = jacobians(0.0, 0.03, speed, 0.0, rate, 0.0)
    cost = np.diag(1.0 / np.array([5.0, 5.0, 5.0, 0.1, 0.1, 2.0]) ** 2)
    control_cost = np.diag(1.0 / np.array([0.5, 25.0 / 125.0, 0.1]) ** 2)
    value = cost.copy()
    for _ in range(3000):
        gain = -np.linalg.solve(control_cost + b.T @ value @ b, b.T @ value @ a)
        value = cost + a.T @ value @ (a + b @ gain)
    answer = regulator_gains(np.array([[speed, rate, 0.03]]), VEHICLE, 1.0)[0]
    assert answer == pytest.approx(gain, abs=1e-7)
    assert np.abs(np.linalg.eigvals(a + b @ answer)).max() < 1.0


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.5, 1.5))
def test_solutions_of_the_riccati_equation_agree_with_scipys(seed, size):
    """Random regulators, also of unstable motion."""
    rng = np.random.default_rng(seed)
    motions, controls = size * rng.standard_normal((5, 6, 6)), rng.standard_normal((5, 6, 3))
    cost, control_cost = random_covariance(rng, np.ones(6)) + np.eye(6), np.diag(rng.uniform(0.5, 2.0, 3))
    found = riccati_solutions(motions, controls, cost, control_cost)
    for motion, control, solution in zip(motions, controls, found, strict=True):
        expected = solve_discrete_are(motion, control, cost, control_cost)
        assert solution == pytest.approx(expected, rel=1e-6, abs=1e-7 * np.abs(expected).max())


def test_what_no_control_holds_is_an_error():
    with pytest.raises(ArithmeticError, match="does not settle"):
        riccati_solutions(np.array([2.0 * np.eye(6)]), np.zeros((1, 6, 3)), np.eye(6), np.eye(3))


@settings(max_examples=50, deadline=None)
@given(st.floats(-math.pi, math.pi))
def test_gains_turn_with_the_direction_of_flight(theta):
    # A deviation seen from the aircraft asks for the same control in every direction.
    ahead, turned = np.empty((3, 6)), np.empty((3, 6))
    u.look_up_gain(25.0, 0.0, 0.0, 0.0, TABLES, ahead)
    u.look_up_gain(25.0, 0.0, 0.0, theta, TABLES, turned)
    c, s = math.cos(theta), math.sin(theta)
    deviation = np.array([3.0, -2.0, 1.0, 0.05, 0.02, 0.4])
    rotated = deviation.copy()
    rotated[:2] = c * 3.0 + s * 2.0, s * 3.0 - c * 2.0
    assert turned @ rotated == pytest.approx(ahead @ deviation, abs=1e-9)


def test_gains_are_taken_from_the_nearest_entry():
    gain = np.empty((3, 6))
    for i, j, k in ((0, 0, 0), (5, 4, 4), (2, 3, 1)):
        v, w, phi = (TABLES.axes[axis, 0] + n * TABLES.axes[axis, 1] for axis, n in enumerate((i, j, k)))
        u.look_up_gain(v + 0.1, w, phi, 0.0, TABLES, gain)
        assert gain == pytest.approx(TABLES.gains[i, j, k])
    u.look_up_gain(1e3, 1e3, 1e3, 0.0, TABLES, gain)
    assert gain == pytest.approx(TABLES.gains[-1, -1, -1])


ENTRY = st.floats(-50.0, 50.0)


@settings(max_examples=300, deadline=None)
@given(st.lists(ENTRY, min_size=9, max_size=9))
@example([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
@example([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
def test_the_largest_eigenvalue_agrees_with_numpy(entries):
    root = np.array(entries).reshape(3, 3)
    m = root @ root.T
    answer = u.largest_eigenvalue(m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2])
    expected = np.linalg.eigvalsh(m)[-1]
    # Where two eigenvalues meet, the inverse cosine loses half the digits.
    assert answer == pytest.approx(expected, rel=1e-7, abs=1e-9)
    half = np.zeros((6, 6))
    half[:3, :3] = 0.5 * m
    assert u.position_deviation(half, half, 3) == pytest.approx(math.sqrt(expected), rel=1e-6, abs=1e-6)
    flat = np.linalg.eigvalsh(m[:2, :2])[-1]
    assert u.position_deviation(half, half, 2) == pytest.approx(math.sqrt(max(flat, 0.0)), rel=1e-6, abs=1e-6)
    factor = np.empty((3, 3))
    u.position_factor(half, half, 3, factor)
    assert np.array_equal(factor, np.tril(factor))
    if np.linalg.eigvalsh(m)[0] > 1e-3:
        assert factor == pytest.approx(np.linalg.cholesky(m), rel=1e-6, abs=1e-6)
        u.position_factor(half, half, 2, factor)
        assert factor[:2, :2] == pytest.approx(np.linalg.cholesky(m[:2, :2]), rel=1e-6, abs=1e-6)
        assert not factor[2].any()


@settings(max_examples=300, deadline=None)
@given(st.floats(0.0, 100.0), st.floats(0.01, 30.0), st.sampled_from([2, 3]))
def test_p_c_agrees_with_the_incomplete_gamma_function(distance, deviation, dimension):
    expected = gammainc(0.5 * dimension, 0.5 * (distance / deviation) ** 2)
    assert u.collision_free(distance, deviation, dimension) == pytest.approx(expected, abs=1e-10)


def test_p_c_by_hand():
    # Two deviations: 1 − exp(−2) = 0.864665 in the plane; erf(√2) − 2·√(2/π)·exp(−2) = 0.738536 in space.
    assert u.collision_free(6.0, 3.0, 2) == pytest.approx(0.8646647168)
    assert u.collision_free(6.0, 3.0, 3) == pytest.approx(0.7385358701)
    assert u.collision_free(0.0, 3.0, 2) == 0.0
    assert u.collision_free(-1.0, 3.0, 3) == 0.0
    assert u.collision_free(1.0, 0.0, 3) == 1.0
