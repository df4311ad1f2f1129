"""RRT*'s rewiring with -log p_c in its cost, against every path over a small graph."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from companion.kernels.arrays import empty_branches
from companion.kernels.printed import rrt_star as k
from companion.kernels.printed.branches import enter_below
from companion.kernels.search.growth import grow
from companion.kernels.search.path_edit import JOINED, air_time, is_clear, is_flyable, join
from companion.kernels.workspace import empty_rows
from companion.planning.explore import Exploration
from companion.planning.route import Route, assess_route, cost_between
from tests.support.paths import box
from tests.support.worlds import VEHICLE, problem

WALL = [box("wall", 600.0, 110.0, 800.0, 400.0)]  # 10 m beside the straight way
START, GOAL = (100.0, 100.0, 150.0), (1300.0, 100.0, 150.0)
PLACES = ((400.0, 75.0), (700.0, 92.0), (700.0, 70.0), (700.0, 45.0), (700.0, 5.0), (1000.0, 75.0))
POSES = np.array([(x, y, 150.0, 0.0, 0.0, 25.0) for x, y in (*PLACES, GOAL[:2])])
LAST = len(POSES) - 1
DRAWS = np.full(k.STAR_DRAWS, 0.5)


def exploration_of(noise, cost_collision):
    """A search among the poses, by an aircraft that strays so many times the usual."""
    keys = ("acceleration_std_m_s2", "course_rate_std_rad_s", "position_std_m", "course_std_rad")
    vehicle = replace(VEHICLE, **{key: noise * getattr(VEHICLE, key) for key in keys})
    asked = problem(
        WALL, start=START, goal=GOAL, direction=0.0, bounds=(0.0, 1500.0, -300.0, 800.0, 50.0, 250.0),
        clearance_min_m=1.0, cost_collision=cost_collision,
    )  # fmt: skip
    return Exploration(replace(asked, vehicle=vehicle), np.random.default_rng(1))


def route_over(exploration, chosen):
    """Dubins edges from the start over poses to the goal; None where they cannot be flown."""
    rows, n = empty_rows(400), 1
    rows.states[0], rows.times[0] = exploration.tree.state[0], exploration.tree.time[0]
    for pose in (*chosen, LAST):
        status, n = join(rows, n, POSES[pose], exploration.limits)
        if status != JOINED:
            return None
    obstacles = exploration.problem.snapshot.obstacles
    if not is_flyable(rows, n, 1, exploration.limits) or not is_clear(
        rows, 1, n, obstacles, exploration.limits
    ):
        return None
    return Route.of(rows, n)


def every_path(exploration):
    """What each path costs that flies over any of the poses eastwards: (9), and -log Q with its weight."""
    found = {}
    for number in range(len(PLACES) + 1):
        for chosen in itertools.combinations(range(len(PLACES)), number):
            if (np.diff(POSES[list(chosen), 0]) <= 0.0).any():
                continue
            route = route_over(exploration, chosen)
            if route is not None:
                risk = assess_route(exploration, route).log_risk(1)
                weight = exploration.problem.settings.weight_collision
                found[chosen] = cost_between(exploration, route) + weight * risk
    return found


def rewired(exploration):
    """The poses on the way that rewiring ends in, and its cost; each begins with an edge from the root."""
    tree, scene, work = exploration.tree, exploration.scene(), exploration.star_work
    nodes = {}
    for pose, state in enumerate(POSES):
        tree.state[tree.count[0]] = state  # the edge's end is read from the tree
        n = k.lay_edge(tree, scene, 0, int(tree.count[0]), work.edge.rows, work.stats)
        node = 0 if n else -1
        rows = Route.of(work.edge.rows, n) if n else None
        for row in range(1, n):
            control = np.array([0.0, *rows.rates[row]])
            dt = float(air_time(rows.rows, row, scene.limits))
            node = grow(tree, scene, node, rows.states[row], control, dt, DRAWS, work.growth, work.stats)
        if node > 0:
            nodes[pose] = int(node)
    goal = nodes[LAST]
    branches = empty_branches(len(tree.parent), np.empty((0, 4)))
    enter_below(tree, branches, 0)
    pairs = [(a, b) for a, b in itertools.permutations(nodes, 2) if POSES[a, 0] < POSES[b, 0]]
    while any([k.try_edge(tree, branches, scene, nodes[a], nodes[b], goal, DRAWS, work) for a, b in pairs]):
        pass
    on_the_way, node = [], goal
    while node > 0:
        node = int(tree.parent[node])
        on_the_way += [pose for pose, row in nodes.items() if row == node]
    return tuple(reversed(on_the_way)), float(tree.cost[goal] - tree.cost[0])


@pytest.mark.parametrize(
    ("noise", "weight"), [(1.0, 10.0), (2.0, 10.0), (3.0, 10.0), (3.0, 1.0), (4.0, 30.0)]
)
def test_rewiring_ends_in_the_best_of_all_paths(noise, weight):
    found = every_path(exploration_of(noise, weight))
    assert len(found) > len(PLACES)
    best = min(found, key=found.get)
    chosen, cost = rewired(exploration_of(noise, weight))
    assert chosen == best
    # Each edge is weighed with the covariance of its own beginning: a path's whole sum differs a little.
    assert cost == pytest.approx(found[best], rel=0.01)


def test_the_larger_the_noise_the_wider_the_way_round_and_without_its_weight_straight_on():
    south = [min((POSES[pose, 1] for pose in rewired(exploration_of(noise, 10.0))[0]), default=100.0)
             for noise in (0.3, 1.0, 2.0, 4.0)]  # fmt: skip
    assert south == sorted(south, reverse=True)
    assert south[0] > south[-1]
    assert rewired(exploration_of(3.0, 0.0))[0] == ()
