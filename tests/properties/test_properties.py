"""Properties that hold for every input, across the kernels."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.kernels.aircraft import dubins
from companion.kernels.aircraft.lqg_mp import collision_free
from companion.kernels.aircraft.motion import advance, steer
from companion.kernels.arrays import empty_tree
from companion.kernels.search.growth import add_node
from companion.planning.printed.sub_goal import horizon_points
from companion.world.vehicle.vehicle_model import VehicleModel
from tests.support.worlds import scene_of, small_settings, work_for

BOUNDS = (-9000.0, 9000.0, -9000.0, 9000.0, 0.0, 500.0)
LIMITS = {dimension: VehicleModel().limits(dimension, BOUNDS, 15.0, 1.0) for dimension in (2, 3)}
ANGLE = st.floats(-math.pi, math.pi)
TARGETS = st.lists(
    st.tuples(st.floats(-3000.0, 3000.0), st.floats(-3000.0, 3000.0), st.floats(0.0, 500.0)),
    min_size=1,
    max_size=30,
)


@settings(max_examples=60, deadline=None)
@given(TARGETS, st.sampled_from([2, 3]), st.randoms(use_true_random=False))
def test_trees_grown_towards_anything_keep_time_covariance_and_the_straight_rule(targets, dimension, random):
    limits, work = LIMITS[dimension], work_for(len(targets) + 1)
    scene = scene_of(limits, search=small_settings().search(limits, 25.0, 50.0, bars_pursued=False))
    tree = empty_tree(len(targets) + 1, 0)
    tree.count[0] = 1
    tree.state[0] = 0.0, 0.0, 250.0, 0.3, 0.0, 25.0
    tree.straight[0] = limits.straight_min
    tree.cov_error[0] = np.diag([4.0, 4.0, 4.0, 1e-3, 1e-3, 0.25])
    state = np.empty(6)
    for target in targets:
        parent = random.randrange(int(tree.count[0]))
        control = np.array(
            steer(tree.state[parent], tree.turn[parent], tree.straight[parent], *target, limits)
        )
        advance(tree.state[parent], *control, limits.tau, state)
        child = add_node(tree, parent, state, control, limits.tau, scene, work.growth.lqg)
        assert tree.parent[child] == parent < child
        assert tree.time[child] == tree.time[parent] + limits.tau
        covariance = tree.cov_error[child] + tree.cov_estimate[child]
        assert np.array_equal(covariance, covariance.T)
        assert np.linalg.eigvalsh(covariance)[0] > -1e-9
        deviation = math.sqrt(np.linalg.eigvalsh(covariance[:dimension, :dimension])[-1])
        assert tree.delta[child] == pytest.approx(deviation / 25.0, rel=1e-6)
        assert tree.clear[child] == 1.0  # nothing is near
        turn = np.sign(control[1]) if abs(control[1]) > 1e-4 else 0.0
        if turn != 0.0:
            assert tree.straight[child] == 0.0
            assert tree.turn[parent] == turn or (
                tree.turn[parent] == 0 and tree.straight[parent] >= limits.straight_min
            )
    assert tree.children[: tree.count[0]].sum() == tree.count[0] - 1


@settings(max_examples=200, deadline=None)
@given(st.floats(0.0, 50.0), st.floats(0.0, 10.0), st.floats(0.01, 20.0), st.floats(0.0, 5.0))
def test_p_c_grows_with_distance_and_falls_with_uncertainty_and_dimension(
    distance, farther, deviation, wider
):
    for dimension in (2, 3):
        here = collision_free(distance, deviation, dimension)
        assert 0.0 <= here <= 1.0
        assert collision_free(distance + farther, deviation, dimension) >= here - 1e-12
        assert collision_free(distance, deviation + wider, dimension) <= here + 1e-12
    assert collision_free(distance, deviation, 3) <= collision_free(distance, deviation, 2) + 1e-12


POSE = st.tuples(st.floats(-800.0, 800.0), st.floats(-800.0, 800.0), ANGLE)


@settings(max_examples=150, deadline=None)
@given(POSE, POSE, POSE)
def test_dubins_lengths_obey_the_triangle_inequality(a, b, c):
    def length(p, q):
        return dubins.distance(*p, *q, 125.0, np.empty(3))

    assert length(a, c) <= length(a, b) + length(b, c) + 1e-4


@settings(max_examples=100, deadline=None)
@given(st.floats(-500.0, 500.0), st.floats(-500.0, 500.0), st.floats(60.0, 440.0), st.floats(200.0, 1500.0))
def test_sub_goals_lie_on_the_horizon_within_climb_and_altitude_limits(x, y, z, radius):
    centre = np.array([x, y, z])
    for dimension in (2, 3):
        points = horizon_points(centre, radius, 60, LIMITS[dimension])
        away = points - centre
        assert np.linalg.norm(away, axis=1) == pytest.approx(np.full(60, radius))
        steep = np.abs(np.arctan2(away[:, 2], np.hypot(away[:, 0], away[:, 1])))
        assert steep.max() <= math.radians(10.0) + 1e-9
        assert points[:, 2].min() >= 0.0 - 1e-9
        assert points[:, 2].max() <= 500.0 + 1e-9
        # All round: no gap of more than 40° between neighbouring bearings.
        bearings = np.sort(np.arctan2(away[:, 1], away[:, 0]))
        assert np.diff(np.append(bearings, bearings[0] + 2.0 * math.pi)).max() < math.radians(40.0)
