"""Pieces of the local search: samples, node choice, domains, extensions."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.kernels.aircraft.motion import steer
from companion.kernels.arrays import empty_tree
from companion.kernels.printed import dynamic_domain_rrt as k
from companion.kernels.printed import extension, near_nodes
from companion.kernels.search import costs, growth
from companion.kernels.workspace import Step, empty_nearest, threat_scene
from companion.types.threat import Radar
from companion.world.threats import packed_threats
from companion.world.vehicle.vehicle_model import VehicleModel
from tests.support.paths import box
from tests.support.worlds import VEHICLE, packed, small_settings, threat_model

BOUNDS = (-1000.0, 1000.0, -1000.0, 1000.0, 0.0, 300.0)
SPACE = VehicleModel().limits(3, BOUNDS, 15.0, 1.0)
PLANE = VehicleModel().limits(2, BOUNDS, 15.0, 1.0)
EMPTY = packed([], BOUNDS)
THREATS = packed_threats([Radar("r", (200.0, 100.0, 0.0), 400.0)], EMPTY, BOUNDS)
SEARCH = small_settings().search(PLANE, 25.0, 100.0, bars_pursued=False)
UNIT = st.floats(0.0, 1.0, exclude_max=True)


@settings(max_examples=200, deadline=None)
@given(st.lists(UNIT, min_size=8, max_size=8), st.sampled_from([PLANE, SPACE]))
def test_samples_lie_in_the_horizon_or_in_the_ball_about_the_sub_goal(draws, limits):
    centre, sub_goal, q = np.array([100.0, -50.0, 120.0]), np.array([500.0, 200.0, 150.0]), np.empty(3)
    k.draw_sample(np.array(draws), 0.3, centre, 400.0, sub_goal, 120.0, limits, q)
    origin, radius = (sub_goal, 120.0) if draws[0] < 0.3 else (centre, 400.0)
    flat = math.hypot(q[0] - origin[0], q[1] - origin[1])
    assert flat <= radius + 1e-9
    assert abs(q[2] - origin[2]) <= flat * math.tan(math.radians(10.0)) + 1e-9
    assert 0.0 <= q[2] <= 300.0


def test_samples_are_uniform_in_the_disc():
    # Half the area lies within radius/√2; zooming happens in 30 of 100.
    rng = np.random.default_rng(8)
    centre, sub_goal, q = np.zeros(3) + 100.0, np.array([700.0, 700.0, 100.0]), np.empty(3)
    radii, zoomed = [], 0
    for draws in rng.random((4000, 8)):
        k.draw_sample(draws, 0.3, centre, 400.0, sub_goal, 50.0, PLANE, q)
        if math.hypot(q[0] - 700.0, q[1] - 700.0) <= 50.0:
            zoomed += 1
        else:
            radii.append(math.hypot(q[0] - 100.0, q[1] - 100.0))
    assert zoomed / 4000 == pytest.approx(0.3, abs=4.0 * math.sqrt(0.21 / 4000))
    assert np.mean(np.array(radii) < 400.0 / math.sqrt(2.0)) == pytest.approx(
        0.5, abs=4.0 * 0.5 / math.sqrt(2800)
    )


def test_turn_cost_by_hand():
    # Flying east: a point to the north is 90° aside; 45° up beside that; down is free; at most π.
    state = np.array([0.0, 0.0, 100.0, 0.0, 0.0, 25.0])
    assert costs.turn_cost(state, 0.0, 100.0, 100.0) == pytest.approx(math.pi / 2.0)
    assert costs.turn_cost(state, 100.0, 0.0, 200.0) == pytest.approx(math.pi / 4.0)
    assert costs.turn_cost(state, 100.0, 0.0, 0.0) == 0.0
    assert costs.turn_cost(state, -100.0, 0.0, 200.0) == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("clear", "level", "blocked", "expected"),
    [
        (1.0, 0.0, 0, math.inf),  # never blocked, nothing near: no limit
        (1.0, 0.0, 1, 250.0),  # DD = 10·25 m
        (0.6, 0.0, 0, 150.0),  # k_c·p_c·DD
        (0.6, 0.5, 0, 100.0),  # DD/(5·0.5)
        (1.0, 0.1, 0, 500.0),  # DD/(5·0.1), above DD: not blocked
        (1.0, 0.1, 1, 250.0),
        (0.9995, 0.0, 0, math.inf),  # certain enough
    ],
)
def test_domains_by_hand(clear, level, blocked, expected):
    assert growth.domain_radius(clear, level, blocked, SEARCH) == pytest.approx(expected)
    assert growth.domain_radius(clear, level, blocked, SEARCH._replace(use_domain=0)) == math.inf


def grown_tree(rng, n, limits=PLANE):
    tree = empty_tree(n + 5, 1)
    tree.count[0] = n
    tree.state[:n] = rng.uniform(
        (-500.0, -500.0, 100.0, -3.0, 0.0, 25.0), (500.0, 500.0, 100.1, 3.0, 0.01, 26.0), (n, 6)
    )
    tree.active[:n] = rng.random(n) < 0.8
    tree.delta[:n] = rng.uniform(0.05, 0.3, n)
    return tree


def threats_now(threats=THREATS):
    return threat_scene(threats, np.zeros((1, 4)), np.zeros(0), threat_model())


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("n", [2, 40, 400])
def test_the_node_chosen_is_the_cheapest_of_the_k_nearest(seed, n):
    rng = np.random.default_rng(seed)
    tree, scene, near = grown_tree(rng, n), threats_now(), empty_nearest(near_nodes.MAX_K)
    tree.active[0] = 1
    q = rng.uniform((-500.0, -500.0, 100.0), (500.0, 500.0, 100.1))
    chosen = near_nodes.choose_node(tree, q, SEARCH, 2, scene, near)
    away = np.linalg.norm(tree.state[:n, :3] - q, axis=1)
    away[tree.active[:n] == 0] = np.inf
    num = max(3, math.ceil(math.e * 1.5 * math.log(n)))
    nearest = [i for i in np.argsort(away)[:num] if np.isfinite(away[i])]
    paid = [costs.cost_distance(tree, i, *q, SEARCH, scene) for i in nearest]
    assert chosen == nearest[int(np.argmin(paid))]
    plain = SEARCH._replace(use_k_near=0)
    assert near_nodes.choose_node(tree, q, plain, 2, scene, near) == np.argmin(away)


def test_no_node_is_chosen_where_none_is_searched():
    tree, near = grown_tree(np.random.default_rng(0), 10), empty_nearest(near_nodes.MAX_K)
    tree.active[:] = 0
    assert near_nodes.choose_node(tree, np.zeros(3), SEARCH, 2, threats_now(), near) == near_nodes.NONE


def test_cost_distance_by_hand():
    # 100 m east, flying north, no threats: 0.5·100/25 + 0.1·π/2.
    tree = empty_tree(4, 1)
    tree.count[0] = 1
    tree.state[0] = 500.0, -500.0, 100.0, math.pi / 2.0, 0.0, 25.0
    none = THREATS._replace(known=np.zeros(1, dtype=np.int64))
    cost = costs.cost_distance(tree, 0, 600.0, -500.0, 100.0, SEARCH, threats_now(none))
    assert cost == pytest.approx(2.0 + 0.05 * math.pi)


def outcome_of(
    obstacles, q, *, centre=(0.0, 0.0, 100.0), horizon=500.0, state=(0.0, 0.0, 100.0, 0.0, 0.0, 25.0)
):
    tree = empty_tree(4, 1)
    tree.count[0] = 1
    tree.state[0] = state
    tree.straight[0] = 125.0
    stats, step = np.zeros(4, dtype=np.int64), Step(np.empty(3), np.empty(6))
    outcome = extension.extend(tree, 0, np.array(q), np.array(centre), horizon, obstacles, PLANE, step, stats)
    return outcome, stats[0], step.state


def test_extensions_and_what_stops_them():
    outcome, checks, out = outcome_of(EMPTY, (300.0, 0.0, 100.0))
    assert (outcome, checks) == (extension.EXTENDED, 1)
    assert out == pytest.approx([25.0, 0.0, 100.0, 0.0, 0.0, 25.0])
    wall = packed([box("w", 39.0, -50.0, 60.0, 50.0)], BOUNDS)
    assert outcome_of(wall, (300.0, 0.0, 100.0))[:2] == (extension.BLOCKED, 1)
    far = packed([box("w", 40.5, -50.0, 60.0, 50.0)], BOUNDS)
    assert outcome_of(far, (300.0, 0.0, 100.0))[:2] == (extension.EXTENDED, 1)
    assert outcome_of(EMPTY, (300.0, 0.0, 100.0), horizon=20.0)[:2] == (extension.LEFT_HORIZON, 0)
    edge = (990.0, 0.0, 100.0, 0.0, 0.0, 25.0)
    assert outcome_of(EMPTY, (1200.0, 0.0, 100.0), centre=(900.0, 0.0, 100.0), state=edge)[:2] == (
        extension.BLOCKED,
        0,
    )


def test_a_control_that_was_tried_is_not_tried_again():
    tree = empty_tree(4, 1)
    tree.count[0] = 2
    tree.state[0] = 0.0, 0.0, 100.0, 0.0, 0.0, 25.0
    tree.straight[0] = 125.0
    tree.parent[1], tree.children[0] = 0, 1
    tree.rate[1] = steer(tree.state[0], 0, 125.0, 100.0, 100.0, 100.0, PLANE)[1:]
    step, stats = Step(np.empty(3), np.empty(6)), np.zeros(4, dtype=np.int64)
    args = (np.zeros(3) + 100.0, 500.0, EMPTY, PLANE, step, stats)
    assert extension.extend(tree, 0, np.array([120.0, 100.0, 100.0]), *args) == extension.REPEATED
    assert extension.extend(tree, 0, np.array([120.0, -100.0, 100.0]), *args) == extension.EXTENDED
    assert extension.child_by(tree, 0, 0.2, 0.0) == 1
    assert extension.child_by(tree, 0, -0.2, 0.0) == -1
    assert VEHICLE.turn_radius_min_m == 125.0
