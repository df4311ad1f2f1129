"""Joining and splicing of paths: poses, curvature, times, and what may be flown."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from companion.assurance.checker import Checker
from companion.frames import course_from_direction
from companion.kernels.aircraft import dubins
from companion.kernels.search import path_edit as s
from companion.kernels.workspace import PathRows
from companion.world.vehicle.vehicle_model import VehicleModel
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
    return PathRows(states, times, rates)


def joined(goal, capacity=400):
    path = rows(capacity)
    status, n = s.join(path, 1, np.array(goal, dtype=float), LIMITS)
    return status, n, *path


def as_path(states, times, n):
    courses = [course_from_direction(theta) for theta in states[:n, 3]]
    return path_of(times[:n], states[:n, :3], courses, states[:n, 4], states[:n, 5])


def test_a_straight_join_by_hand():
    # 250 m ahead at 25 m/s, not level: ten edges of 25 m could be too long on a slope of up to 10°, so
    # eleven of 250/11 m (level). Climbing at 0.08 rad, entered in the first edge and left in the last,
    # which so climb at 0.04 on the mean: 250/11·(2·tan 0.04 + 9·tan 0.08) = 18.22 m.
    ds = 250.0 / 11.0
    rise = ds * (2.0 * math.tan(0.04) + 9.0 * math.tan(0.08))
    status, n, states, times, rates = joined((250.0, 0.0, 200.0 + rise, 0.0, 0.0, 25.0))
    assert (status, n) == (s.JOINED, 12)
    assert states[1:12, 0] == pytest.approx(ds * np.arange(1.0, 12.0))
    assert states[1:11, 4] == pytest.approx(np.full(10, 0.08), abs=1e-4)
    assert (states[11, 4], states[11, 2]) == (0.0, 200.0 + rise)
    assert states[2, 2] == pytest.approx(200.0 + ds * (math.tan(0.04) + math.tan(0.08)), abs=0.01)
    assert times[2] - times[1] == pytest.approx(ds / 25.0 / math.cos(0.08), abs=1e-5)
    assert rates[1, 1] == pytest.approx(0.08 / (ds / 25.0 / math.cos(0.04)), abs=1e-3)
    assert not rates[1:12, 0].any()


def test_a_climb_angle_is_entered_no_faster_than_the_pitch_rate():
    # 0.12 rad over 300 m takes two edges in and two out at 0.1 rad/s and about a second each.
    _, n, states, _, rates = joined((300.0, 0.0, 230.0, 0.0, 0.0, 25.0))
    assert np.abs(rates[1:n, 1]).max() <= 0.1 + 1e-9
    assert states[1, 4] == pytest.approx(0.1 * 25.0 * 12.0 / 13.0 / 25.0, rel=0.01)
    assert states[2, 4] > 0.1 > states[1, 4]


def test_an_airspeed_is_made_up_evenly_by_hand():
    # Half the way to 25.5 m/s are 125 m, where v² = (25² + 25.5²)/2. From 25 to 25.4 m/s takes 20.16 m at
    # 0.5 m/s²: v² grows by 20.16.
    status, n, states, times, _ = joined((250.0, 0.0, 200.0, 0.0, 0.0, 25.5))
    assert (status, n) == (s.JOINED, 11)
    assert states[[5, 10], 5] == pytest.approx([math.sqrt((625.0 + 650.25) / 2.0), 25.5])
    assert times[10] - times[0] == pytest.approx(250.0 / 25.25, rel=1e-5)  # the mean speed is in the middle
    assert joined((20.1, 0.0, 200.0, 0.0, 0.0, 25.4))[0] == s.NOT_FLYABLE
    assert joined((20.2, 0.0, 200.0, 0.0, 0.0, 25.4))[0] == s.JOINED


@pytest.mark.parametrize(
    "goal",
    [
        (100.0, 0.0, 230.0, 0.0, 0.0, 25.0),  # 16.7°
        (100.0, 0.0, 170.0, 0.0, 0.0, 25.0),
        (100.0, 0.0, 212.0, 0.0, 0.0, 25.0),  # 0.12 rad of climb and back in 4 s, of 0.1 rad/s
        (50.0, 0.0, 200.0, 0.0, 0.25, 25.0),  # 0.25 rad at the end after 2 s
        (100.0, 60.0, 200.0, 0.0, 0.0, 25.0),  # a turn to the left and back with nothing between
        (0.0, 100.0, 200.0, math.pi, 0.0, 25.0),  # right, left, right
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
    steepest = np.abs(states[:n, 4]).max()
    assert math.hypot(length, rise) * (1.0 - 1e-6) <= 25.0 * (times[n - 1] - 10.0)
    assert 25.0 * (times[n - 1] - 10.0) <= length / math.cos(steepest) * (1.0 + 1e-6)
    assert np.diff(times[:n]).min() > 0.0
    assert np.diff(times[:n]).max() <= 1.0 + 1e-6
    # No sample turns faster than the smallest radius allows at this climb.
    climbs = 0.5 * (states[: n - 1, 4] + states[1:n, 4])
    assert (np.abs(rates[1:n, 0]) <= 25.0 * np.cos(climbs) / 125.0 * (1.0 + 1e-6)).all()


@settings(max_examples=150, deadline=None)
@given(
    COORDINATE, COORDINATE, st.floats(-20.0, 20.0), ANGLE, COORDINATE, COORDINATE, ANGLE,
    st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6)) | st.just((0.0, 0.0)),
)  # fmt: skip
def test_what_is_called_flyable_passes_the_independent_checker(x, y, rise, theta, x2, y2, theta2, faster):
    status, n, states, times, rates = joined((x, y, 200.0 + rise, theta, 0.0, 25.0 + faster[0]))
    assume(status == s.JOINED)
    goal = np.array([x2, y2, states[n - 1, 2], theta2, 0.0, 25.0 + sum(faster)])
    status, n = s.join(PathRows(states, times, rates), n, goal, LIMITS)
    assume(status == s.JOINED)
    flyable = s.is_flyable(PathRows(states, times, rates), n, 1, LIMITS)
    path = as_path(states, times, n)
    found = Checker([], check_limits()).check_path(path)
    if flyable:
        assert found == ()
        ways = 0.5 * (path.speeds_m_s[1:] + path.speeds_m_s[:-1]) * np.diff(path.times_s)
        assert (np.abs(np.diff(path.speeds_m_s**2)) <= 2.0 * 0.5 * ways + 0.06).all()
    tighter = LIMITS._replace(r_min=200.0)
    fastest = np.maximum(states[1:n, 5], states[: n - 1, 5])
    if (np.abs(rates[1:n, 0]) > fastest / 200.0 * 1.01).any():
        assert not s.is_flyable(PathRows(states, times, rates), n, 1, tighter)


def test_flyable_by_hand():
    # 10 straight edges of 25 m, then a turn of 0.2 rad/s (the limit at 25 m/s and 125 m).
    states, times, rates = rows(20)
    for k in range(1, 12):
        states[k] = states[k - 1] + (25.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        times[k] = times[k - 1] + 1.0
    rates[10, 0] = 0.2
    assert s.is_flyable(PathRows(states, times, rates), 11, 1, LIMITS)
    rates[10, 0] = 0.201
    assert not s.is_flyable(PathRows(states, times, rates), 11, 1, LIMITS)
    assert s.is_flyable(PathRows(states, times, rates), 11, 11, LIMITS)  # rows before the first asked for
    rates[10, 0], rates[3, 0] = 0.1, 0.1  # 150 m of straight flight between the two turns
    assert s.is_flyable(PathRows(states, times, rates), 11, 1, LIMITS)
    rates[3, 0], rates[6, 0] = 0.0, -0.1  # 75 m
    assert not s.is_flyable(PathRows(states, times, rates), 11, 1, LIMITS)
    rates[6, 0] = 0.0
    states[7, 4] = 0.2
    assert not s.is_flyable(PathRows(states, times, rates), 11, 1, LIMITS)
    states[7, 4], states[7, 2] = 0.0, 600.0
    assert not s.is_flyable(PathRows(states, times, rates), 11, 1, LIMITS)


def test_clear_by_hand():
    # A wall 16 m beside a straight path: clear by 15 m, not if the edge bulges by 1.6 m or more.
    world = packed([box("wall", -500.0, 16.0, 500.0, 30.0)])
    states, times, rates = rows(5)
    states[1] = states[0] + (25.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    times[1] = 11.0
    assert s.is_clear(PathRows(states, times, rates), 1, 2, world, LIMITS)
    assert not s.is_clear(PathRows(states, times, rates), 1, 2, world, LIMITS._replace(margin=16.1))
    rates[1, 0] = 0.33  # sagitta 25·0.33/8 = 1.03 m
    assert not s.is_clear(PathRows(states, times, rates), 1, 2, world, LIMITS)


def straight_rows(n):
    states, times, rates = rows(n)
    for k in range(1, n):
        states[k] = states[k - 1] + (25.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        times[k] = times[k - 1] + 1.0
    return PathRows(states, times, rates)


def empty_rows(n):
    return PathRows(np.full((n, 6), np.nan), np.full(n, np.nan), np.full((n, 2), np.nan))


def test_a_splice_keeps_what_comes_before_and_after():
    states, times, _ = straight = straight_rows(41)
    via = states[20].copy()
    via[1] += 8.0
    out = empty_rows(80)
    status, m, at = s.splice(straight, 41, 5, via, True, 35, LIMITS, out)
    assert status == s.JOINED
    assert np.array_equal(out.states[:6], states[:6])
    assert np.array_equal(out.times[:6], times[:6])
    assert np.array_equal(out.states[at + 1 : m], states[36:41])
    assert np.diff(out.times[at:m]) == pytest.approx(np.diff(times[35:41]))
    assert out.states[at] == pytest.approx(states[35], abs=1e-4)
    assert np.min(np.linalg.norm(out.states[:m, :2] - via[:2], axis=1)) < 1e-3
    assert np.isfinite(out.states[:m]).all()
    assert out.times[m - 1] > times[40]  # the way round is longer


def test_a_splice_without_a_via_is_the_straight_line_again():
    states, times, _ = straight = straight_rows(41)
    out = empty_rows(80)
    status, m, at = s.splice(straight, 41, 5, np.zeros(6), False, 35, LIMITS, out)
    assert (status, m, at) == (s.JOINED, 41, 35)
    assert out.states[:m] == pytest.approx(states, abs=1e-6)
    assert out.times[:m] == pytest.approx(times, abs=1e-6)


def test_splices_that_fail_say_so():
    straight = straight_rows(41)
    via = straight.states[20].copy()
    via[2] += 100.0
    assert s.splice(straight, 41, 15, via, True, 25, LIMITS, empty_rows(80))[0] == s.NOT_FLYABLE
    nothing = np.zeros(6)
    tight = empty_rows(38)
    assert s.splice(straight, 41, 5, nothing, False, 35, LIMITS, tight)[0] == s.TOO_LONG


def test_a_short_cut_by_hand():
    """A detour over (500, 100) becomes 1,000 m straight on, 40 edges of a second, if no wall is there."""
    detour = rows(200)
    _, n = s.join(detour, 1, np.array([500.0, 100.0, 200.0, 0.0, 0.0, 25.0]), LIMITS)
    _, n = s.join(detour, n, np.array([1000.0, 0.0, 200.0, 0.0, 0.0, 25.0]), LIMITS)
    out = empty_rows(200)
    assert s.fill_short_cut(detour, n, 0, n - 1, LIMITS, packed([]), out) == (41, 40)
    assert out.times[:41] == pytest.approx(10.0 + np.arange(41.0))
    assert out.states[:41, 1] == pytest.approx(np.zeros(41), abs=1e-6)
    wall = packed([box("wall", 490.0, -5.0, 510.0, 5.0)])
    assert s.fill_short_cut(detour, n, 0, n - 1, LIMITS, wall, out) == (0, 0)
    detour.states[0, 5] = 25.2  # Faster than the row that it leads to by more than 0.1 m/s.
    assert s.fill_short_cut(detour, n, 0, n - 1, LIMITS, packed([]), out) == (0, 0)


def test_a_short_cut_of_a_straight_line_is_none():
    assert s.fill_short_cut(straight_rows(41), 41, 5, 35, LIMITS, packed([]), empty_rows(80)) == (0, 0)


def test_a_detour_leads_over_the_place_if_it_can_be_flown_and_is_clear():
    straight, out = straight_rows(41), empty_rows(200)
    via = np.array([500.0, 100.0, 200.0, 0.0, 0.0, 25.0])
    m = s.fill_detour(straight, 41, 0, via, 35, LIMITS, packed([]), out)
    assert m > 41
    assert out.states[m - 6] == pytest.approx(straight.states[35])
    assert out.states[m - 1] == pytest.approx(straight.states[40])
    assert np.hypot(*(out.states[:m, :2] - via[:2]).T).min() == pytest.approx(0.0, abs=1e-6)
    wall = packed([box("wall", 490.0, 90.0, 510.0, 110.0)])
    assert s.fill_detour(straight, 41, 0, via, 35, LIMITS, wall, out) == 0
    via[1] = 900.0
    out_of_bounds = LIMITS._replace(bounds=np.array([-100.0, 2000.0, -100.0, 500.0, 0.0, 400.0]))
    assert s.fill_detour(straight, 41, 0, via, 35, out_of_bounds, packed([]), out) == 0


def test_a_ramp_by_hand():
    # From level over 0.2 rad back to level, at most 0.1 rad from one angle to the next, in five steps of
    # 25 m: 0, 0.1, 0.2, 0.2, 0.1, 0. Each step climbs at the mean of its ends' angles:
    # 25·(tan 0.05 + tan 0.15 + tan 0.2 + tan 0.15 + tan 0.05) = 15.1266 m.
    angles = np.empty(6)
    gained = s.ramp(0.2, 0.0, 0.0, 0.1, 5, angles, 25.0)
    assert angles == pytest.approx([0.0, 0.1, 0.2, 0.2, 0.1, 0.0])
    assert gained == pytest.approx(15.1266, abs=1e-4)
    # A top that cannot be had in time: 0, 0.1, 0.2, 0.25 would need the way down as well: 0.1 is the most.
    assert s.ramp(0.25, 0.0, 0.0, 0.1, 2, angles[:3], 25.0) == pytest.approx(2.0 * 25.0 * math.tan(0.05))
    assert angles[:3] == pytest.approx([0.0, 0.1, 0.0])
    # From a climb over a lower top to a descent: each angle is at most 0.1 below the one before.
    s.ramp(0.0, 0.15, -0.1, 0.1, 4, angles[:5], 25.0)
    assert angles[:5] == pytest.approx([0.15, 0.05, 0.0, 0.0, -0.1])


def test_a_climb_profile_by_hand():
    # Ten steps of 25 m at 25 m/s: at most 0.1 rad a step. To gain 20 m from level to level, with one step
    # in and one out at half the angle and eight at the whole: 25·(2·tan(c/2) + 8·tan c) = 20 has
    # c = 0.0887, for 9·c ≈ 0.8 and tan c ≈ c + c³/3: 0.8 − 8·0.0887³/3 − 2·(0.0887/2)³/3 = 9·0.0887.
    angles = np.empty(11)
    assert s.climb_profile(20.0, 0.0, 0.0, 25.0, 10, 25.0, LIMITS, angles)
    assert angles[1:10] == pytest.approx(np.full(9, 0.0887), abs=1e-4)
    assert angles[[0, 10]].tolist() == [0.0, 0.0]
    # Descents mirror climbs.
    down = np.empty(11)
    assert s.climb_profile(-20.0, 0.0, 0.0, 25.0, 10, 25.0, LIMITS, down)
    assert down == pytest.approx(-angles, abs=1e-4)
    # The steepest there is: 10° = 0.17453 rad in all but the first and last step, reached in two:
    # 25·(2·tan 0.05 + 2·tan 0.13727 + 6·tan 0.17453) = 35.858 m. 35 m can be gained, 36 m cannot.
    assert s.climb_profile(35.0, 0.0, 0.0, 25.0, 10, 25.0, LIMITS, angles)
    assert not s.climb_profile(36.0, 0.0, 0.0, 25.0, 10, 25.0, LIMITS, angles)
    # One step changes the angle by 0.1 rad and no more.
    assert not s.climb_profile(0.0, 0.0, 0.11, 25.0, 1, 25.0, LIMITS, angles)


CLIMB = st.floats(-0.17, 0.17)


@settings(max_examples=300, deadline=None)
@given(st.floats(-60.0, 60.0), CLIMB, CLIMB, st.floats(5.0, 25.0), st.integers(1, 40))
def test_climb_profiles_gain_the_height_within_angle_and_pitch_rate(rise, start, end, ds, steps):
    angles = np.full(steps + 1, np.nan)
    found = s.climb_profile(rise, start, end, ds, steps, 25.0, LIMITS, angles)
    most = 0.1 * ds / 25.0
    if found:
        assert angles[0] == start
        assert angles[-1] == end
        assert np.abs(np.diff(angles)).max() <= most + 1e-12
        assert np.abs(angles).max() <= math.radians(10.0) + 1e-12
        gained = sum(ds * math.tan(0.5 * (a + b)) for a, b in itertools.pairwise(angles))
        assert gained == pytest.approx(rise, abs=2e-3)
        return
    # Nothing that keeps both limits gains it: by the angle as high, or as low, as they allow at every step.
    if abs(end - start) > most * steps:
        return
    k = np.arange(steps + 1)
    high = np.minimum(math.radians(10.0), np.minimum(start + most * k, end + most * (steps - k)))
    low = np.maximum(-math.radians(10.0), np.maximum(start - most * k, end - most * (steps - k)))
    reach = [sum(ds * np.tan(0.5 * (a[1:] + a[:-1]))) for a in (low, high)]
    assert rise < reach[0] + 2e-3 or rise > reach[1] - 2e-3


def test_air_times_of_all_edges_are_those_of_each():
    path, steps = straight_rows(5), np.full(5, np.nan)
    s.fill_air_times(path, 5, LIMITS, steps)
    assert steps[1:] == pytest.approx([s.air_time(path, k, LIMITS) for k in range(1, 5)])
    assert steps[1:] == pytest.approx(np.ones(4))


def test_time_stamps_go_by_the_wind():
    # East at 25 m/s with 15 m/s of wind from the south: 20 m/s are made good, so that a step takes 1.25 s.
    windy = VehicleModel().limits(3, BOUNDS, 15.0, 1.0, (0.0, 15.0))
    states, times, rates = straight_rows(4)
    path = PathRows(states, times, rates)
    s.retime(path, np.ones(4), windy)
    assert times - times[0] == pytest.approx([0.0, 1.25, 2.5, 3.75])
    assert s.air_time(path, 2, windy) == pytest.approx(1.0)
    goal = states[3] + (200.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    room = empty_rows(40)
    room.states[0], room.times[0] = states[3], 0.0
    status, n = s.join(room, 1, goal, windy)
    assert status == s.JOINED
    assert room.times[n - 1] == pytest.approx(200.0 / 20.0)
    assert s.is_flyable(room, n, 1, windy)
