"""Dubins paths with climb: hand-worked cases, their samples, their limits, and OMPL as an oracle."""

import math

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from companion.kernels.aircraft import dubins
from companion.kernels.aircraft import dubins_climb as d

RHO, CLIMB, DESCENT = 125.0, math.radians(10.0), math.radians(12.0)
COORDINATE, HEIGHT, ANGLE = st.floats(-800.0, 800.0), st.floats(-600.0, 600.0), st.floats(-math.pi, math.pi)
POSE = st.tuples(COORDINATE, COORDINATE, HEIGHT, ANGLE)


def path(start, end, climb=CLIMB, descent=DESCENT):
    made = np.empty(d.SIZE)
    return d.shortest_climb(*start, *end, RHO, climb, descent, made), made


def flat_length(start, end):
    return dubins.distance(start[0], start[1], start[3], end[0], end[1], end[3], RHO, np.empty(3))


def test_low_by_hand():
    # 300 m straight on and 40 m up: 7.6°, below 10°.
    case, made = path((0, 0, 100.0, 0.0), (300.0, 0, 140.0, 0.0))
    assert case == d.LOW
    assert d.climb_length(made) == pytest.approx(math.hypot(300.0, 40.0))
    assert d.climb_angle(made) == pytest.approx(math.atan2(40.0, 300.0))


def test_high_by_hand():
    # 300 m straight on and 500 m up at 10°: 500/tan(10°) = 2835.64 m in the plane, 2535.64 m more than
    # the straight line. A turn is 2π·125 = 785.40 m: three fit, each of 2535.64/3 = 845.21 m, so with a
    # radius of 845.21/2π = 134.52 m.
    case, made = path((0, 0, 0.0, 0.0), (300.0, 0, 500.0, 0.0))
    assert case == d.HIGH
    assert made[d.TURNS] == 3
    assert made[d.RADIUS] == pytest.approx(134.52, abs=0.005)
    assert d.climb_length(made) == pytest.approx(500.0 / math.sin(CLIMB))
    # Down at 12° the same takes 500/tan(12°) − 300 = 2052.32 m in turns: two.
    case, made = path((0, 0, 500.0, 0.0), (300.0, 0, 0.0, 0.0))
    assert case == d.HIGH
    assert made[d.TURNS] == 2
    assert d.climb_length(made) == pytest.approx(500.0 / math.sin(DESCENT))


def test_medium_by_hand():
    # 1000 m straight on and 200 m up: 200/tan(10°) = 1134.26 m in the plane, 134.26 m more than straight.
    case, made = path((0, 0, 0.0, 0.0), (1000.0, 0, 200.0, 0.0))
    assert case == d.MEDIUM
    assert made[d.TURNS] == 0
    assert made[d.FLAT] == pytest.approx(200.0 / math.tan(CLIMB), abs=1e-6)
    assert d.climb_length(made) == pytest.approx(200.0 / math.sin(CLIMB), abs=1e-6)


def test_right_above_itself_the_shortest_is_one_turn():
    # The same place and direction, 10 m up: 56.7 m would do, but a closed curve is one circle at least.
    case, made = path((0, 0, 0.0, 0.5), (0, 0, 10.0, 0.5))
    assert case == d.MEDIUM
    assert made[d.FLAT] == pytest.approx(2.0 * math.pi * RHO)
    assert d.climb_angle(made) == pytest.approx(math.atan2(10.0, 2.0 * math.pi * RHO))


@settings(max_examples=300, deadline=None)
@example((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 3e-9, 0.0))  # no way on the ground, and hardly a rise
@given(POSE, POSE)
def test_paths_end_at_the_pose_and_keep_turn_radius_and_climb_limits(start, end):
    _, made = path(start, end)
    total, pose = d.climb_length(made), np.empty(5)
    d.sample_climb(*start, made, RHO, 0.0, pose)
    assert pose[:3] == pytest.approx(start[:3], abs=1e-9)
    d.sample_climb(*start, made, RHO, total, pose)
    assert pose[:3] == pytest.approx(end[:3], abs=1e-3)
    assert math.remainder(pose[3] - end[3], 2.0 * math.pi) == pytest.approx(0.0, abs=1e-5)
    assert -DESCENT - 1e-9 <= pose[4] <= CLIMB + 1e-9
    previous, steps = np.array([*start, 0.0]), 200
    for s in np.linspace(0.0, total, steps + 1)[1:]:
        d.sample_climb(*start, made, RHO, s, pose)
        step = total / steps
        assert math.dist(pose[:3], previous[:3]) <= step + 1e-6
        gone = math.hypot(*(pose[:2] - previous[:2]))
        # Chord and turn of a curve no tighter than RHO; never faster up than the climb angle says.
        assert abs(pose[3] - previous[3]) <= step * math.cos(pose[4]) / RHO + 1e-6
        assert gone <= step * math.cos(pose[4]) + 1e-6
        assert pose[2] - previous[2] == pytest.approx(step * math.sin(pose[4]), abs=1e-6)
        previous = pose.copy()


@settings(max_examples=300, deadline=None)
@given(POSE, POSE)
def test_lengths_are_at_least_what_plane_and_climb_ask_for(start, end):
    case, made = path(start, end)
    length, flat, rise = d.climb_length(made), flat_length(start, end), end[2] - start[2]
    limit = CLIMB if rise > 0.0 else DESCENT
    assert length >= math.dist(start[:3], end[:3]) - 1e-6
    assert length >= math.hypot(flat, rise) - 1e-6
    assert length >= abs(rise) / math.sin(limit) - 1e-6
    # And no more than a turn above it; with room for the turns, no more at all.
    assert made[d.FLAT] <= max(flat, abs(rise) / math.tan(limit)) + 2.0 * math.pi * RHO + 1e-6
    if case == d.LOW:
        assert length == pytest.approx(math.hypot(flat, rise))
    elif case == d.HIGH:
        assert length == pytest.approx(abs(rise) / math.sin(limit))
        assert made[d.RADIUS] >= RHO - 1e-9
    assert length == pytest.approx(d.climb_distance(*start, *end, RHO, CLIMB, DESCENT))


@settings(max_examples=200, deadline=None)
@given(POSE, POSE)
def test_lengths_are_the_same_flown_backwards(start, end):
    there = d.climb_distance(*start, *end, RHO, CLIMB, DESCENT)
    back = d.climb_distance(
        *end[:3], end[3] + math.pi, *start[:3], start[3] + math.pi, RHO, DESCENT, CLIMB
    )  # what was climbed is now descended
    assert there == pytest.approx(back, rel=1e-6, abs=1e-3)


@settings(max_examples=100, deadline=None)
@given(st.tuples(COORDINATE, COORDINATE, ANGLE), st.floats(0.05, 0.95))
def test_far_apart_the_missing_length_is_always_met_exactly(end, share):
    # Beyond four turn radii nothing is out of reach: any length can be flown.
    assume(math.hypot(end[0], end[1]) > 4.5 * RHO)
    start, goal = (0.0, 0.0, 0.0, 0.0), (end[0], end[1], 0.0, end[2])
    need = flat_length(start, goal) + share * 2.0 * math.pi * RHO
    goal = (end[0], end[1], need * math.tan(CLIMB), end[2])
    case, made = path(start, goal)
    assert case == d.MEDIUM
    assert made[d.FLAT] == pytest.approx(need, rel=1e-6)


GRID = st.tuples(
    st.integers(-800, 800).map(float),
    st.integers(-800, 800).map(float),
    st.integers(-600, 600).map(float),
    st.integers(-31, 31).map(lambda n: 0.1 * n),
)


@settings(max_examples=300, deadline=None)
@given(GRID, GRID)
def test_lengths_agree_with_ompl(start, end):
    base = pytest.importorskip("ompl.base", reason="OMPL is not installed")
    space = base.OwenStateSpace(RHO, CLIMB)
    states = []
    for pose in (start, end):
        state = space.allocState()
        for axis in range(3):
            state[axis] = pose[axis]
        state.setYaw(pose[3])
        states.append(state)
    theirs = space.getPath(*states)
    case, made = path(start, end, CLIMB, CLIMB)
    if theirs is None:  # it searches for a root where the length jumps, and may find none
        return
    # OMPL counts an arc to the right as negative; flown, it is as long as one to the left.
    flat = math.sqrt(max(0.0, theirs.length() ** 2 - theirs.deltaZ_**2)) + 2.0 * RHO * max(0.0, -theirs.phi_)
    cases = {"LOW_ALTITUDE": d.LOW, "MEDIUM_ALTITUDE": d.MEDIUM, "HIGH_ALTITUDE": d.HIGH}
    assert case == cases[theirs.category().name]
    assert made[d.FLAT] <= flat * (1.0 + 1e-5) + 1e-3
    # Theirs never climbs more steeply than allowed, so ours is the shorter only where theirs is too long.
    need = abs(end[2] - start[2]) / math.tan(CLIMB)
    if flat <= max(need, flat_length(start, end)) * (1.0 + 1e-4):
        assert made[d.FLAT] == pytest.approx(flat, rel=1e-4, abs=1e-2)
