"""What one call of the kernels takes that a plan calls most, from compiled code as in a plan."""

from __future__ import annotations

import time

import numpy as np
import pytest

from companion.config import load_mission
from companion.config.offline_problem import offline_problem, offline_world
from companion.kernels.aircraft.lqg_mp import propagate
from companion.kernels.arrays import Float1D, Float2D, Obstacles, Pursuers, Tree, Uncertainty
from companion.kernels.geometry.line_of_sight import line_blocked
from companion.kernels.geometry.prism_distance import clearance
from companion.kernels.native.kernel import kernel
from companion.kernels.printed.near_nodes import near_nodes
from companion.kernels.printed.reachability import gets_to
from companion.kernels.threat.fuzzy_threat import line_threat
from companion.kernels.workspace import FilterScratch, KNearest, ThreatScene, threat_scene
from companion.planning.explore import Exploration
from tests.sim.client import CONFIGS

pytestmark = pytest.mark.bench

CALLS, ROUNDS = 2000, 7


@kernel
def lines(points: Float2D, prisms: Obstacles) -> int:
    n = 0
    for k in range(CALLS):
        p, q = points[k], points[k + 1]
        n += line_blocked(p[0], p[1], p[2], q[0], q[1], q[2], prisms)
    return n


@kernel
def clearances(points: Float2D, obstacles: Obstacles) -> float:
    total = 0.0
    for k in range(CALLS):
        total += clearance(points[k, 0], points[k, 1], points[k, 2], obstacles, 1e4)
    return total


@kernel
def threats(points: Float2D, scene: ThreatScene) -> float:
    total = 0.0
    for k in range(CALLS):
        q = points[k + 1]
        total += line_threat(points[k], q[0], q[1], q[2], 25.0, 0.1, 10, scene)
    return total


@kernel
def filters(
    states: Float2D, tables: Uncertainty, p: Float2D, estimate: Float2D, p_out: Float2D, l_out: Float2D,
    scratch: FilterScratch,
) -> None:  # fmt: skip
    for k in range(CALLS):
        state = states[k % states.shape[0]]
        propagate(state, (0.0, 0.05, 0.0), 1.0, tables, p, estimate, p_out, l_out, scratch)


@kernel
def neighbours(points: Float2D, tree: Tree, near: KNearest, k: int) -> int:
    n = 0
    for point in range(CALLS):
        n += near_nodes(tree, points[point], k, near)
    return n


@kernel
def pursuits(points: Float2D, trees: Pursuers, prisms: Obstacles, out: Float1D) -> int:
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
    prisms, nodes = scene.walls, search.tree.state[: int(search.tree.count[0])]
    here = threat_scene(scene.threats, np.zeros((1, 4)), np.zeros(0), scene.model)
    p, out = problem.start.error_covariance, np.empty((2, 6, 6))
    scratch, spot = search.work.growth.lqg, np.empty(6)
    took = {
        "line of sight": least(lines, points, prisms),
        "clearance": least(clearances, points, scene.obstacles),
        "threat along a line": least(threats, points, here),
        "LQG-MP step": least(filters, nodes, search.tables, p, 0.1 * p, out[0], out[1], scratch),
        f"20 near nodes of {len(nodes)}": least(neighbours, points, search.tree, search.work.near, 20),
        "reach of a node": least(pursuits, points, search.pursuers, prisms, spot),
    }
    for name, nanoseconds in took.items():
        tell(f"paper-3d, {name}", nanoseconds, "ns")
        assert 1.0 < nanoseconds < 1e6
