"""Dubins paths against OMPL, their own end poses and hand-worked cases."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from companion.kernels.aircraft import dubins as d

RHO = 125.0
COORDINATE = st.floats(-800.0, 800.0)
ANGLE = st.floats(-math.pi, math.pi)
POSE = st.tuples(COORDINATE, COORDINATE, ANGLE)


def length(start, end, rho=RHO):
    return d.distance(*start, *end, rho, np.empty(3))


def test_lengths_by_hand():
    # Straight on; a half circle to the left; a quarter circle and 100 m; and back to where one is.
    assert length((0, 0, 0.0), (300.0, 0, 0.0)) == pytest.approx(300.0)
    assert length((0, 0, 0.0), (0.0, 250.0, math.pi)) == pytest.approx(125.0 * math.pi)
    assert length((0, 0, 0.0), (125.0, 225.0, math.pi / 2.0)) == pytest.approx(125.0 * math.pi / 2.0 + 100.0)
    assert length((0, 0, 1.0), (0, 0, 1.0)) == pytest.approx(0.0, abs=1e-9)
    # Turning back on the spot: three arcs, 7π/3 radii (RLR and LRL alike).
    assert length((0, 0, 0.0), (0, 0, math.pi)) == pytest.approx(125.0 * 7.0 * math.pi / 3.0)


# Poses on a grid: lengths jump where a turn shrinks to nothing, and OMPL rounds there at another place.
GRID_POSE = st.tuples(
    st.integers(-800, 800).map(float),
    st.integers(-800, 800).map(float),
    st.integers(-31, 31).map(lambda n: 0.1 * n),
)


@settings(max_examples=300, deadline=None)
@given(GRID_POSE, GRID_POSE)
def test_lengths_agree_with_ompl(start, end):
    base = pytest.importorskip("ompl.base", reason="OMPL is not installed")
    space = base.DubinsStateSpace(RHO)
    states = []
    for pose in (start, end):
        state = space.allocState()
        state.setXY(pose[0], pose[1])
        state.setYaw(pose[2])
        states.append(state)
    assert length(start, end) == pytest.approx(space.distance(*states), rel=1e-5, abs=1e-3)


@settings(max_examples=300, deadline=None)
@given(POSE, POSE)
@example((0.0, 0.0, 0.0), (0.0, 0.0, math.pi))
def test_paths_end_where_they_should_and_bend_no_more_than_allowed(start, end):
    segments, pose = np.empty(3), np.empty(3)
    kind = d.shortest(*start, *end, RHO, segments)
    total = RHO * segments.sum()
    d.sample(*start, kind, segments, RHO, total, pose)
    assert pose[:2] == pytest.approx(end[:2], abs=1e-4)
    assert math.remainder(pose[2] - end[2], 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
    previous = np.array(start)
    for s in np.linspace(0.0, total, 60)[1:]:
        d.sample(*start, kind, segments, RHO, s, pose)
        step = total / 59.0
        assert math.hypot(*(pose[:2] - previous[:2])) <= step + 1e-9
        assert abs(pose[2] - previous[2]) <= step / RHO + 1e-9
        previous = pose.copy()


@settings(max_examples=200, deadline=None)
@given(POSE, POSE)
def test_every_word_that_exists_ends_at_the_pose_and_none_is_shorter(start, end):
    dx, dy = end[0] - start[0], end[1] - start[1]
    line, far = math.atan2(dy, dx), math.hypot(dx, dy) / RHO
    found = 0
    for kind in range(6):
        exists, t, p, q = d.word(kind, far, start[2] - line, end[2] - line)
        if not exists:
            continue
        found += 1
        pose = np.empty(3)
        d.sample(*start, kind, np.array([t, p, q]), RHO, RHO * (t + p + q), pose)
        assert pose[:2] == pytest.approx(end[:2], abs=1e-3)
        assert length(start, end) <= RHO * (t + p + q) + 1e-6
    assert found >= 2


@settings(max_examples=300, deadline=None)
@given(POSE, POSE)
def test_lengths_are_at_least_euclidean_and_the_same_flown_backwards(start, end):
    there = length(start, end)
    assert there >= math.hypot(end[0] - start[0], end[1] - start[1]) - 1e-6
    back = length((end[0], end[1], end[2] + math.pi), (start[0], start[1], start[2] + math.pi))
    assert there == pytest.approx(back, abs=1e-5)


@settings(max_examples=100, deadline=None)
@given(POSE, POSE, ANGLE, COORDINATE, COORDINATE)
def test_lengths_do_not_depend_on_the_frame(start, end, turn, east, north):
    c, s = math.cos(turn), math.sin(turn)

    def moved(pose):
        return (east + c * pose[0] - s * pose[1], north + s * pose[0] + c * pose[1], pose[2] + turn)

    assert length(moved(start), moved(end)) == pytest.approx(length(start, end), abs=1e-5)


def test_distance_to_a_point_by_hand():
    # Straight ahead; at the top of the left circle.
    assert d.distance_to_point(0, 0, 0.0, 200.0, 0.0, RHO) == pytest.approx(200.0)
    assert d.distance_to_point(0, 0, 0.0, 0.0, 250.0, RHO) == pytest.approx(125.0 * math.pi)
    # Aside: a quarter circle to (125, ±125), then 100 m.
    assert d.distance_to_point(0, 0, 0.0, 125.0, 225.0, RHO) == pytest.approx(125.0 * math.pi / 2 + 100.0)
    assert d.distance_to_point(0, 0, 0.0, 125.0, -225.0, RHO) == pytest.approx(125.0 * math.pi / 2 + 100.0)


@settings(max_examples=100, deadline=None)
@given(POSE, COORDINATE, COORDINATE)
def test_distance_to_a_point_is_the_least_over_all_final_directions(start, x, y):
    answer = d.distance_to_point(*start, x, y, RHO)
    finals = np.linspace(-math.pi, math.pi, 721)
    least = min(length(start, (x, y, final)) for final in finals)
    assert answer <= least + 1e-6
    ahead = (x - start[0]) * math.cos(start[2]) + (y - start[1]) * math.sin(start[2])
    aside = abs(-(x - start[0]) * math.sin(start[2]) + (y - start[1]) * math.cos(start[2]))
    if (
        math.hypot(ahead, aside - RHO) > RHO * 1.001
    ):  # outside the circles: exact, but for the directions' grid
        assert answer >= least - RHO * math.pi / 720.0 - 1e-6
