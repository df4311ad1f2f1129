"""Joining and splicing of paths: poses, curvature, times, and what may be flown."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from companion.assurance.checker import Checker
from companion.frames import course_from_direction
from companion.kernels import dubins
from companion.kernels import splice as s
from companion.vehicle.motion import VehicleModel
from tests.support.paths import box, check_limits, path_of
from tests.support.worlds import packed

BOUNDS = (-5000.0, 5000.0, -5000.0, 5000.0, 0.0, 500.0)
LIMITS = VehicleModel().limits(3, BOUNDS, 15.0, 1.0)
COORDINATE = st.floats(-900.0, 900.0)
ANGLE = st.floats(-math.pi, math.pi)


def rows(capacity=400):
    states, times, rates = np.zeros((capacity, 6)), np.zeros(capacity), np.zeros((capacity, 2))
    states[0] = 0.0, 0.0, 200.0, 0.0, 0.0, 25.0
    times[0] = 10.0
    return states, times, rates


def joined(goal, capacity=400):
    states, times, rates = rows(capacity)
    status, n = s.join(states, times, rates, 1, np.array(goal, dtype=float), LIMITS)
    return status, n, states, times, rates


def as_path(states, times, n):
    courses = [course_from_direction(theta) for theta in states[:n, 3]]
    return path_of(times[:n], states[:n, :3], courses, states[:n, 4], 25.0)


def test_a_straight_join_by_hand():
    # 100 m ahead and 10 m up at 25 m/s: 100.5 m of way, so 5 edges of 20 m (level), each
    # 20/(25·cos φ) s, φ = atan 0.1.
    status, n, states, times, rates = joined((100.0, 0.0, 210.0, 0.0, 0.0, 25.0))
    phi = math.atan(0.1)
    assert (status, n) == (s.JOINED, 6)
    assert states[1:6, 0] == pytest.approx([20.0, 40.0, 60.0, 80.0, 100.0])
    assert states[1:6, 2] == pytest.approx([202.0, 204.0, 206.0, 208.0, 210.0])
    assert np.diff(times[:6]) == pytest.approx(np.full(5, 0.8 / math.cos(phi)))
    assert states[1:6, 4] == pytest.approx(np.full(5, phi))
    assert not rates[1:6, 0].any()


@pytest.mark.parametrize(
    "goal",
    [
        (100.0, 0.0, 230.0, 0.0, 0.0, 25.0),  # 16.7°
        (100.0, 0.0, 170.0, 0.0, 0.0, 25.0),
        (100.0, 0.0, 212.0, 0.0, 0.0, 25.0),  # 0.12 rad of climb at once, of 0.1 rad/s
        (300.0, 0.0, 220.0, 0.0, -0.1, 25.0),  # and 0.17 rad back at the end
        (100.0, 0.0, 200.0, 0.0, 0.0, 26.0),
        (0.5, 0.0, 200.0, 0.0, 0.0, 25.0),
    ],
)
def test_joins_that_cannot_be_flown(goal):
    assert joined(goal)[0] == s.NOT_FLYABLE


def test_a_join_that_does_not_fit_in_the_rows():
    assert joined((1000.0, 0.0, 200.0, 0.0, 0.0, 25.0), capacity=10)[:2] == (s.TOO_LONG, 1)


@settings(max_examples=150, deadline=None)
@given(COORDINATE, COORDINATE, st.floats(-20.0, 20.0), ANGLE)
def test_a_join_ends_at_the_pose_and_is_sampled_along_a_dubins_path(x, y, rise, theta):
    status, n, states, times, rates = joined((x, y, 200.0 + rise, theta, 0.0, 25.0))
    assume(status == s.JOINED)
    last = states[n - 1]
    assert last[:3] == pytest.approx([x, y, 200.0 + rise], abs=1e-3)
    assert math.remainder(last[3] - theta, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
    length = dubins.distance(0.0, 0.0, 0.0, x, y, theta, 125.0, np.empty(3))
    way = math.hypot(length, rise)
    assert times[n - 1] - 10.0 == pytest.approx(way / 25.0, rel=1e-6)
    assert np.diff(times[:n]).min() > 0.0
    assert np.diff(times[:n]).max() <= 1.0 + 1e-6
    # No sample turns faster than the smallest radius allows at this climb.
    assert np.abs(rates[1:n, 0]).max() <= 25.0 * math.cos(last[4]) / 125.0 * (1.0 + 1e-6)


@settings(max_examples=150, deadline=None)
@given(COORDINATE, COORDINATE, st.floats(-20.0, 20.0), ANGLE, COORDINATE, COORDINATE, ANGLE)
def test_what_is_called_flyable_passes_the_independent_checker(x, y, rise, theta, x2, y2, theta2):
    status, n, states, times, rates = joined((x, y, 200.0 + rise, theta, 0.0, 25.0))
    assume(status == s.JOINED)
    goal = np.array([x2, y2, states[n - 1, 2], theta2, 0.0, 25.0])
    status, n = s.join(states, times, rates, n, goal, LIMITS)
    assume(status == s.JOINED)
    flyable = s.is_flyable(states, times, rates, n, 1, LIMITS)
    found = Checker([], check_limits()).check_path(as_path(states, times, n))
    if flyable:
        assert found == ()
    tighter = LIMITS._replace(r_min=200.0)
    if np.abs(rates[1:n, 0]).max() > 25.0 / 200.0 * 1.01:
        assert not s.is_flyable(states, times, rates, n, 1, tighter)


def test_flyable_by_hand():
    # 10 straight edges of 25 m, then a turn of 0.2 rad/s (the limit at 25 m/s and 125 m).
    states, times, rates = rows(20)
    for k in range(1, 12):
        states[k] = states[k - 1] + (25.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        times[k] = times[k - 1] + 1.0
    rates[10, 0] = 0.2
    assert s.is_flyable(states, times, rates, 11, 1, LIMITS)
    rates[10, 0] = 0.201
    assert not s.is_flyable(states, times, rates, 11, 1, LIMITS)
    assert s.is_flyable(states, times, rates, 11, 11, LIMITS)  # rows before the first asked for
    rates[10, 0], rates[3, 0] = 0.1, 0.1  # 150 m of straight flight between the two turns
    assert s.is_flyable(states, times, rates, 11, 1, LIMITS)
    rates[3, 0], rates[6, 0] = 0.0, -0.1  # 75 m
    assert not s.is_flyable(states, times, rates, 11, 1, LIMITS)
    rates[6, 0] = 0.0
    states[7, 4] = 0.2
    assert not s.is_flyable(states, times, rates, 11, 1, LIMITS)
    states[7, 4], states[7, 2] = 0.0, 600.0
    assert not s.is_flyable(states, times, rates, 11, 1, LIMITS)


def test_clear_by_hand():
    # A wall 16 m beside a straight path: clear by 15 m, not if the edge bulges by 1.6 m or more.
    world = packed([box("wall", -500.0, 16.0, 500.0, 30.0)])
    states, times, rates = rows(5)
    states[1] = states[0] + (25.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    times[1] = 11.0
    assert s.is_clear(states, rates, times, 1, 2, world, 15.0)
    assert not s.is_clear(states, rates, times, 1, 2, world, 16.1)
    rates[1, 0] = 0.33  # sagitta 25·0.33/8 = 1.03 m
    assert not s.is_clear(states, rates, times, 1, 2, world, 15.0)


def straight_rows(n):
    states, times, rates = rows(n)
    for k in range(1, n):
        states[k] = states[k - 1] + (25.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        times[k] = times[k - 1] + 1.0
    return states, times, rates


def empty_rows(n):
    return np.full((n, 6), np.nan), np.full(n, np.nan), np.full((n, 2), np.nan)


def test_a_splice_keeps_what_comes_before_and_after():
    states, times, rates = straight_rows(41)
    via = states[20].copy()
    via[1] += 8.0
    out = empty_rows(80)
    status, m, at = s.splice(states, times, rates, 41, 5, via, True, 35, LIMITS, *out)
    assert status == s.JOINED
    assert np.array_equal(out[0][:6], states[:6])
    assert np.array_equal(out[1][:6], times[:6])
    assert np.array_equal(out[0][at + 1 : m], states[36:41])
    assert np.diff(out[1][at:m]) == pytest.approx(np.diff(times[35:41]))
    assert out[0][at] == pytest.approx(states[35], abs=1e-4)
    assert np.min(np.linalg.norm(out[0][:m, :2] - via[:2], axis=1)) < 1e-3
    assert np.isfinite(out[0][:m]).all()
    assert out[1][m - 1] > times[40]  # the way round is longer


def test_a_splice_without_a_via_is_the_straight_line_again():
    states, times, rates = straight_rows(41)
    out = empty_rows(80)
    status, m, at = s.splice(states, times, rates, 41, 5, np.zeros(6), False, 35, LIMITS, *out)
    assert (status, m, at) == (s.JOINED, 41, 35)
    assert out[0][:m] == pytest.approx(states, abs=1e-6)
    assert out[1][:m] == pytest.approx(times, abs=1e-6)


def test_splices_that_fail_say_so():
    states, times, rates = straight_rows(41)
    via = states[20].copy()
    via[2] += 100.0
    assert s.splice(states, times, rates, 41, 15, via, True, 25, LIMITS, *empty_rows(80))[0] == s.NOT_FLYABLE
    nothing = np.zeros(6)
    tight = empty_rows(38)
    assert s.splice(states, times, rates, 41, 5, nothing, False, 35, LIMITS, *tight)[0] == s.TOO_LONG
