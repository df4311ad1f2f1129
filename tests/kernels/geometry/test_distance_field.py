"""Samples that follow a distance field round obstacles, and greedy connections to a sub goal."""

import math

import numpy as np
import pytest

from companion.kernels.arrays import DistanceField, empty_tree
from companion.kernels.geometry import distance_field as k
from companion.kernels.printed.dynamic_domain_rrt import greedy_connect
from companion.kernels.search.growth import DRAWS
from companion.planning.explore import Exploration
from companion.planning.printed.sub_tasks import SubTasks
from companion.types.threat import Radar
from companion.world.vehicle.vehicle_model import VehicleModel
from tests.support.paths import box
from tests.support.worlds import packed, problem

BOUNDS = (0.0, 2000.0, 0.0, 2000.0, 0.0, 400.0)
SPACE = VehicleModel().limits(3, BOUNDS, 15.0, 1.0)
SUB_GOAL = np.array([1000.0, 1600.0, 250.0])


def distances(obstacles, share=1.0, ahead=200.0, bounds=BOUNDS):
    made = DistanceField(np.empty((81, 81)), np.zeros(2), 25.0, share, ahead)
    k.fill_distance_field(SUB_GOAL, np.inf, 15.0, np.array(bounds), packed(obstacles, BOUNDS), made)
    return made


def test_a_way_stays_within_the_bounds():
    # A wall from the western bound to x = 1500: round its western end there is no way, but 50 m outside.
    wall = [box("wall", 0.0, 1000.0, 1500.0, 1050.0)]
    way = distances(wall)
    straight = math.hypot(900.0, 800.0)
    assert k.distance_to_go(way, 100.0, 800.0) > 1400.0 + straight / 2.0
    assert k.distance_to_go(way, 100.0, 1600.0) == pytest.approx(900.0)
    assert k.distance_to_go(way, -500.0, 800.0) == math.inf
    assert k.distance_to_go(way, 700.0, 1020.0) == math.inf  # inside the wall


def standing_tree(*positions):
    tree = empty_tree(len(positions) + 1, 0)
    tree.count[0] = len(positions)
    tree.state[: len(positions), :3] = positions
    tree.active[: len(positions)] = 1
    return tree


def test_samples_lie_ahead_on_the_way_of_the_node_that_is_farthest_on():
    wall = [box("wall", 500.0, 1000.0, 1500.0, 1050.0)]
    way = distances(wall)
    tree = standing_tree((1000.0, 300.0, 200.0), (600.0, 900.0, 200.0), (1000.0, 500.0, 200.0))
    for i in range(3):
        tree.to_go[i] = k.distance_to_go(way, *tree.state[i, :2])
    assert np.argmin(tree.to_go[:3]) == 1
    rng, sample = np.random.default_rng(1), np.empty(3)
    for draws in rng.random((300, DRAWS)):
        draws[k.FIRST_PICK] = 0.5  # row 1 is among those picked
        assert k.draw_ahead(draws, tree, way, SUB_GOAL, SPACE, sample)
        away = math.hypot(*(sample[:2] - tree.state[1, :2]))
        gone = min(200.0, draws[1] * 200.0)
        assert away <= (1.0 + k.SPREAD) * (gone + 25.0 * math.sqrt(2.0)) + 1e-6
        assert abs(sample[2] - 200.0) <= gone + 25.0 * math.sqrt(2.0)
        assert BOUNDS[4] <= sample[2] <= BOUNDS[5]
    # Without a spread the samples come round the wall's western end, which is nearer.
    draws = np.zeros(DRAWS)
    draws[1], draws[7], draws[k.FIRST_PICK] = 1.0, 0.5, 0.5
    k.draw_ahead(draws, tree, way, SUB_GOAL, SPACE, sample)
    assert sample[0] < 510.0 < tree.state[1, 0]
    assert sample[1] > 950.0


def test_no_sample_where_no_node_has_a_way():
    way = distances([])
    tree = standing_tree((1000.0, 300.0, 200.0))
    tree.to_go[0] = math.inf
    assert not k.draw_ahead(np.full(DRAWS, 0.5), tree, way, SUB_GOAL, SPACE, np.empty(3))


def laid(obstacles=(), radars=(), goal=(1350.0, 1350.0, 150.0), **changes):
    exploration = Exploration(problem(obstacles, radars, goal=goal, **changes), np.random.default_rng(1))
    straight, stats = exploration.work.straight, exploration.stats
    sub_goal = np.array(goal)
    scene = SubTasks(exploration).scene_to(sub_goal, 60.0)
    steps = greedy_connect(
        exploration.tree, scene, 0, exploration.tree.state[0, :3].copy(), 1e4, sub_goal, straight, stats
    )
    return steps, straight.states, stats


def test_a_free_sub_goal_ahead_is_joined_step_by_step():
    # 1767.8 m away on course, 60 m wide, 25 m a step: 69 steps are more than a connection has; 1000 m away
    # it takes 38.
    steps, states, stats = laid(
        goal=(100.0 + 1000.0 / math.sqrt(2.0), 100.0 + 1000.0 / math.sqrt(2.0), 150.0)
    )
    assert steps == math.ceil((1000.0 - 60.0) / 25.0)
    assert states[steps - 1, 0] == pytest.approx(100.0 + 25.0 * steps / math.sqrt(2.0))
    assert stats[0] == steps + 1  # the line of sight and each edge
    assert laid()[0] == 0


def test_a_sub_goal_behind_a_wall_or_in_a_threat_is_not():
    goal = (800.0, 800.0, 150.0)
    assert laid(goal=goal)[0] > 0
    assert laid([box("wall", 300.0, 400.0, 700.0, 440.0)], goal=goal)[0] == 0
    # Where TI > 0.05 its domain DD/(5·TI) ends before the sub goal 900 m away.
    assert laid(radars=[Radar("r", (600.0, 600.0, 0.0), 300.0)], goal=goal)[0] == 0
    assert laid([box("wall", 300.0, 400.0, 700.0, 440.0)], goal=goal)[2][0] == 1  # no edge was checked
