"""What one call of the kernels takes that a plan calls most, from compiled code as in a plan."""

import time

import numba as nb
import numpy as np
import pytest

from companion.campaign.runs import offline_problem, offline_world
from companion.config import load_mission
from companion.kernels.aircraft.lqg_mp import propagate
from companion.kernels.borrowed import borrowed
from companion.kernels.geometry.line_of_sight import line_blocked, prisms_of
from companion.kernels.geometry.prism_distance import clearance
from companion.kernels.search.near_nodes import near_nodes
from companion.kernels.threat.fuzzy_threat import line_threat
from companion.kernels.threat.reachability import gets_to
from companion.kernels.threat.threat_tree import threat_trees_of
from companion.kernels.workspace import threat_scene
from companion.planning.explore import Exploration
from tests.sim.client import CONFIGS

pytestmark = pytest.mark.bench

CALLS, ROUNDS = 2000, 7


@nb.njit
def lines(points, prisms):
    prisms = borrowed(prisms)
    n = 0
    for k in range(CALLS):
        p, q = points[k], points[k + 1]
        n += line_blocked(p[0], p[1], p[2], q[0], q[1], q[2], prisms)
    return n


@nb.njit
def clearances(points, obstacles):
    obstacles = borrowed(obstacles)
    total = 0.0
    for k in range(CALLS):
        total += clearance(points[k, 0], points[k, 1], points[k, 2], obstacles, 1e4)
    return total


@nb.njit
def threats(points, scene):
    scene = borrowed(scene)
    total = 0.0
    for k in range(CALLS):
        q = points[k + 1]
        total += line_threat(points[k], q[0], q[1], q[2], 25.0, 0.1, 10, scene)
    return total


@nb.njit
def filters(states, tables, p, estimate, p_out, l_out, scratch):
    tables, scratch = borrowed(tables), borrowed(scratch)
    for k in range(CALLS):
        state = states[k % states.shape[0]]
        propagate(state, (0.0, 0.05, 0.0), 1.0, tables, p, estimate, p_out, l_out, scratch)


@nb.njit
def neighbours(points, tree, near):
    tree, near = borrowed(tree), borrowed(near)
    n = 0
    for k in range(CALLS):
        n += near_nodes(tree, points[k], 20, near)
    return n


@nb.njit
def pursuits(points, trees, prisms, out):
    trees, prisms = borrowed(trees), borrowed(prisms)
    n = 0
    for k in range(CALLS):
        n += gets_to(trees, 0, 0, points[k, 0], points[k, 1], points[k, 2], 40.0, prisms, out)
    return n


def least(function, *arguments):
    """The least time of a call over several rounds, in nanoseconds; compiled beforehand."""
    function(*arguments)
    best = np.inf
    for _ in range(ROUNDS):
        began = time.perf_counter()
        function(*arguments)
        best = min(best, time.perf_counter() - began)
    return 1e9 * best / CALLS


def test_kernels(tell):
    mission = load_mission(CONFIGS / "paper-3d.yaml")
    problem = offline_problem(mission, offline_world(mission), None, 1)
    search = Exploration(problem, np.random.default_rng(1))
    goal = problem.goals[-1]
    search.reach_goal(np.array(goal.position_enu_m), goal.acceptance_radius_m, 0, lambda: False)
    scene, b = search.scene(), search.limits.bounds
    points = np.random.default_rng(2).uniform(b[::2], b[1::2], (CALLS + 1, 3))
    prisms, nodes = prisms_of(scene.walls), search.tree.state[: int(search.tree.count[0])]
    here = threat_scene(search.threats, np.zeros((1, 4)), np.zeros(0), search.model)
    p, out = problem.start.error_covariance, np.empty((2, 6, 6))
    scratch, spot = search.work.growth.lqg, np.empty(6)
    took = {
        "line of sight": least(lines, points, prisms),
        "clearance": least(clearances, points, scene.obstacles),
        "threat along a line": least(threats, points, here),
        "LQG-MP step": least(filters, nodes, search.tables, p, 0.1 * p, out[0], out[1], scratch),
        f"20 near nodes of {len(nodes)}": least(neighbours, points, search.tree, search.work.near),
        "reach of a node": least(pursuits, points, threat_trees_of(search.pursuers), prisms, spot),
    }
    for name, nanoseconds in took.items():
        tell(f"paper-3d, {name}", nanoseconds, "ns")
        assert 1.0 < nanoseconds < 1e6
