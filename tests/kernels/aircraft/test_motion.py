"""One step of the aircraft against fine integration, and the controls' limits."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from companion.kernels.aircraft import motion as m
from companion.world.vehicle.vehicle_model import VehicleModel

VEHICLE = VehicleModel()
BOUNDS = (0.0, 1000.0, 0.0, 1000.0, 0.0, 300.0)
LIMITS = VEHICLE.limits(3, BOUNDS, 15.0, 1.0)
PLANE = VEHICLE.limits(2, BOUNDS, 15.0, 1.0)
STATES = st.tuples(st.floats(-math.pi, math.pi), st.floats(-0.17, 0.17), st.floats(12.5, 37.5))


def derivative(state, a, w, wp):
    _, _, _, theta, phi, v = state
    flat = v * math.cos(phi)
    return np.array([flat * math.cos(theta), flat * math.sin(theta), v * math.sin(phi), w, wp, a])


def integrated(state, a, w, wp, tau, steps=200):
    state, h = state.copy(), tau / steps
    for _ in range(steps):
        k1 = derivative(state, a, w, wp)
        k2 = derivative(state + 0.5 * h * k1, a, w, wp)
        k3 = derivative(state + 0.5 * h * k2, a, w, wp)
        k4 = derivative(state + h * k3, a, w, wp)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state


def test_steps_by_hand():
    out = np.empty(6)
    # Straight east at 25 m/s, gaining 0.4 m/s: 25.2 m. A quarter circle of 50 m: to (50, 50).
    m.advance(np.array([0.0, 0, 100, 0, 0, 25.0]), 0.4, 0.0, 0.0, 1.0, out)
    assert out == pytest.approx([25.2, 0.0, 100.0, 0.0, 0.0, 25.4])
    m.advance(np.array([0.0, 0, 100, 0, 0, 25.0]), 0.0, 0.5, 0.0, math.pi, out)
    assert out == pytest.approx([50.0, 50.0, 100.0, math.pi / 2, 0.0, 25.0])


@settings(max_examples=60, deadline=None)
@given(STATES, st.floats(-0.5, 0.5), st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(0.2, 1.5))
@example((math.nextafter(math.pi, 0.0), 0.0, 13.0), 0.0, 0.0, 0.0, 1.0)  # its remainder rounds past -π
def test_a_step_agrees_with_fine_integration(state, a, w, wp, tau):
    start = np.array([10.0, 20.0, 100.0, *state])
    out = np.empty(6)
    m.advance(start, a, w, wp, tau, out)
    exact = integrated(start, a, w, wp, tau)
    # What the mid-step angles leave out is of third order: v·wp²·τ³/24 + a·w·τ³/12 < 0.1 m here.
    assert out[:3] == pytest.approx(exact[:3], abs=0.1)
    assert math.remainder(out[3] - exact[3], 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert out[4:] == pytest.approx(exact[4:], abs=1e-9)
    assert -math.pi <= out[3] <= math.pi


@settings(max_examples=60, deadline=None)
@given(STATES, st.floats(-0.3, 0.3), st.floats(0.2, 1.5))
def test_a_level_turn_at_constant_speed_is_exact(state, w, tau):
    start = np.array([10.0, 20.0, 100.0, state[0], 0.0, state[2]])
    out = np.empty(6)
    m.advance(start, 0.0, w, 0.0, tau, out)
    assert out[:3] == pytest.approx(integrated(start, 0.0, w, 0.0, tau)[:3], abs=1e-6)


@settings(max_examples=300, deadline=None)
@given(STATES, st.sampled_from([-1, 0, 1]), st.floats(0.0, 200.0), st.floats(-500.0, 500.0),
       st.floats(-500.0, 500.0), st.floats(-200.0, 200.0))  # fmt: skip
def test_controls_keep_every_limit(state, turn, straight, x, y, z):
    start = np.array([0.0, 0.0, 100.0, *state])
    a, w, wp = m.steer(start, turn, straight, x, y, 100.0 + z, LIMITS)
    out = np.empty(6)
    m.advance(start, a, w, wp, 1.0, out)
    assert abs(a) <= 0.5 + 1e-12
    assert abs(wp) <= 0.1 + 1e-12
    assert 12.5 - 1e-9 <= out[5] <= 37.5 + 1e-9
    slowest = min(start[5], out[5])
    assert abs(w) <= slowest * math.cos(start[4]) / 125.0 + 1e-12
    assert out[4] <= max(VEHICLE.climb_angle_max_rad, state[1]) + 1e-9
    assert out[4] >= min(-VEHICLE.descent_angle_max_rad, state[1]) - 1e-9
    sign = int(w > m.STRAIGHT_RATE) - int(w < -m.STRAIGHT_RATE)
    if turn == 0 and straight < 125.0:
        assert w == 0.0
    if turn != 0:
        assert sign in (0, turn)
    assert m.steer(start, turn, straight, x, y, 100.0 + z, PLANE)[2] == 0.0


def test_a_step_turns_towards_its_target():
    east = np.array([0.0, 0.0, 100.0, 0.0, 0.0, 25.0])
    assert m.steer(east, 0, 125.0, 100.0, 100.0, 100.0, LIMITS) == pytest.approx((0.0, 0.2, 0.0))
    assert m.steer(east, 0, 125.0, 100.0, -100.0, 100.0, LIMITS) == pytest.approx((0.0, -0.2, 0.0))
    # 3° aside: taken up in one step. 45° up: as far as the climb's rate of change allows.
    assert m.steer(east, 0, 125.0, 100.0, 100.0 * math.tan(0.05), 200.0, LIMITS)[1:] == pytest.approx(
        (0.05, 0.1)
    )


def test_straight_length_since_the_last_turn():
    assert m.straight_after(0, 100.0, 0.0, 25.0) == (0, 125.0)
    assert m.straight_after(0, 100.0, 0.2, 25.0) == (1, 0.0)
    assert m.straight_after(1, 0.0, 0.0, 25.0) == (0, 25.0)
    assert m.straight_after(-1, 0.0, -0.2, 25.0) == (-1, 0.0)


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({}, m.OK),
        ({0: -1.0}, m.OUT_OF_BOUNDS),
        ({0: 1001.0}, m.OUT_OF_BOUNDS),
        ({1: -1.0}, m.OUT_OF_BOUNDS),
        ({1: 1001.0}, m.OUT_OF_BOUNDS),
        ({2: -1.0}, m.OUT_OF_BOUNDS),
        ({2: 301.0}, m.OUT_OF_BOUNDS),
        ({5: 12.4}, m.TOO_SLOW_OR_FAST),
        ({5: 37.6}, m.TOO_SLOW_OR_FAST),
    ],
)  # fmt: skip
def test_states_within_bounds_and_speeds(changes, status):
    state = np.array([500.0, 500.0, 100.0, 0.0, 0.0, 25.0])
    for index, value in changes.items():
        state[index] = value
    assert m.state_status(state, LIMITS) == status


@settings(max_examples=200, deadline=None)
@given(st.floats(-100.0, 100.0))
def test_angles_are_wrapped(angle):
    assert -math.pi - 1e-12 <= m.wrapped(angle) <= math.pi + 1e-12
    assert math.remainder(m.wrapped(angle) - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


WINDY = VEHICLE.limits(3, BOUNDS, 15.0, 1.0, (0.0, 15.0))  # to the north


def edge(theta, turned, v=25.0):
    return np.array([0.0, 0, 100, theta, 0, v]), np.array([0.0, 0, 100, theta + turned, 0, v])


def test_ground_speeds_by_hand():
    # Across the wind 20 of 25 m/s are left, against it 10, before it 40: triangles 3, 4, 5.
    assert m.ground_speed(0.0, 25.0, WINDY) == pytest.approx(20.0)
    assert m.ground_speed(-math.pi / 2, 25.0, WINDY) == pytest.approx(10.0)
    assert m.ground_speed(math.pi / 2, 25.0, WINDY) == pytest.approx(40.0)
    assert m.ground_speed(-math.pi / 2, 15.5, WINDY) == pytest.approx(0.1 * 15.5)  # less is not reckoned with
    assert m.slowness(*edge(0.0, 0.0), WINDY) == pytest.approx(1.25)
    assert m.slowness(*edge(1.0, 0.2), LIMITS) == 1.0


@settings(max_examples=60, deadline=None)
@given(st.floats(-math.pi, math.pi), st.floats(-0.3, 0.3), st.floats(-14.0, 14.0), st.floats(-14.0, 14.0))
def test_how_long_an_edge_takes_agrees_with_quadrature(theta, turned, east, north):
    if math.hypot(east, north) > 15.0:
        return
    limits = VEHICLE.limits(3, BOUNDS, 15.0, 1.0, (east, north))

    def share(s):
        course = theta + s * turned
        air = np.array([math.cos(course), math.sin(course)])
        # The air velocity that, with the wind, makes good the course: its length is 25 m/s.
        speeds = np.roots([1.0, -2.0 * (air @ (east, north)), east**2 + north**2 - 625.0])
        return 25.0 / speeds.max()

    exact, _ = quad(share, 0.0, 1.0)
    assert m.slowness(*edge(theta, turned), limits) == pytest.approx(exact, rel=2e-3)


def test_a_turn_is_wider_the_faster_it_is_flown_above_cruise():
    assert m.turn_radius(20.0, PLANE) == m.turn_radius(25.0, PLANE) == 125.0
    assert m.turn_radius(30.0, PLANE) == 125.0  # 109 m would do at 40 degrees
    assert m.turn_radius(37.5, PLANE) == pytest.approx(37.5**2 / (9.80665 * math.tan(math.radians(40.0))))
    windy = VEHICLE.limits(2, BOUNDS, 15.0, 1.0, wind_enu_m_s=(6.0, 8.0))
    assert m.turn_radius(25.0, windy) == windy.r_min == pytest.approx(157.5, abs=0.05)
    assert m.turn_radius(37.5, windy) == pytest.approx(
        (37.5 + 11.0) ** 2 / (9.80665 * math.tan(math.radians(40.0)))
    )


@settings(max_examples=200)
@given(st.floats(12.5, 37.5), st.floats(-math.pi, math.pi))
def test_no_step_turns_tighter_than_its_fastest_moment_allows(v, bearing):
    state = np.array([500.0, 500.0, 100.0, 0.0, 0.0, v])
    target = 500.0 + 400.0 * math.cos(bearing), 500.0 + 400.0 * math.sin(bearing), 100.0
    a, w, _ = m.steer(state, 0, 1e3, *target, PLANE)
    slow, fast = sorted((v, v + a))
    assert abs(w) <= slow / m.turn_radius(fast, PLANE) + 1e-9
