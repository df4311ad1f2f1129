"""Improving a path that reaches the goal, in the time that remains (paper 4.4.3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray
from companion.kernels.arrays import Branches, Scene
from companion.kernels.search.dynamic_domain_rrt import grow
from companion.kernels.search.path_edit import JOINED, is_clear, is_flyable, splice
from companion.kernels.search.rrt_star import STAR_DRAWS, improve, next_stage
from companion.kernels.threat.fuzzy_threat import MAX_THREATS
from companion.kernels.threat.reachability import MAX_NEAR
from companion.planning.explore import Exploration
from companion.planning.route import Route, branch_to, cost_between, route_from_tree, visits_goals

SPARE_ROWS = 64


@dataclass(frozen=True, slots=True)
class Optimised:
    """A route, and how many edges were rewired and nodes pruned on the way to it."""

    route: Route
    num_rewired: int
    num_pruned: int


def rrt_star_route(
    exploration: Exploration, route: Route, end: int, should_stop: Callable[[], bool]
) -> Optimised:
    """RRT* on what remains of the tree: below the first waypoint that is not reached meanwhile.

    Parameters
    ----------
    exploration : Exploration
        Whose tree holds the path to ``end``; it is rearranged.
    route : Route
        That path, its last edge led to the goal itself.
    end : int
        The node at which the goal was reached.
    """
    settings, tree = exploration.problem.settings, exploration.tree
    scene = exploration.scene()
    goal = _with_last_edge(exploration, scene, route, end)
    if goal < 0:
        return Optimised(route, 0, 0)
    root = free_node(exploration, goal, settings.flown_meanwhile_s)
    branches, goals = _branches(exploration, root)
    rewired = pruned = 0
    left = settings.optimise_iterations
    while left > 0 and root != goal and not should_stop():
        burst = min(settings.burst, left)
        left -= burst
        more, less = improve(
            tree, branches, scene, root, goal, goals, exploration.rng.random((burst, STAR_DRAWS)),
            exploration.star_stats,
        )  # fmt: skip
        rewired, pruned = rewired + more, pruned + less
    return Optimised(route_from_tree(exploration, goal), rewired, pruned)


def free_node(exploration: Exploration, goal: int, flown_meanwhile_s: float) -> int:
    """Root_r: the first waypoint on the way to ``goal`` that is not reached within that time."""
    tree, node = exploration.tree, goal
    soonest = tree.time[0] + flown_meanwhile_s
    while tree.parent[node] >= 0 and tree.time[tree.parent[node]] >= soonest:
        node = int(tree.parent[node])
    return node


def _with_last_edge(exploration: Exploration, scene: Scene, route: Route, end: int) -> int:
    """Hang the rows of a route that the tree does not hold below it; the last one's node, or -1."""
    tree, rows = exploration.tree, branch_to(exploration, end)
    same = 0
    while same < min(len(rows), len(route)) and np.array_equal(tree.state[rows[same]], route.states[same]):
        same += 1
    node = rows[same - 1]
    scratch, levels = np.empty((MAX_THREATS, 2)), np.empty(len(scene.tables.normals))
    changed, reach = np.empty(4 * MAX_NEAR, dtype=np.int64), scene.pursuers.model[:, 1].copy()
    for k in range(same, len(route)):
        if tree.count[0] >= len(tree.parent):
            return -1
        dt = float(route.times[k] - route.times[k - 1])
        node = grow(
            tree, scene, node, route.states[k], np.array([0.0, *route.rates[k]]), dt, reach,
            exploration.rng.random(STAR_DRAWS), changed, scratch, levels, exploration.star_stats,
        )  # fmt: skip
        if node < 0:
            return -1
    return node


def _branches(exploration: Exploration, root: int) -> tuple[Branches, FloatArray]:
    """How the tree hangs together, only what is below ``root`` searched; and the goals on the way."""
    tree, n = exploration.tree, int(exploration.tree.count[0])
    goals = np.array(
        [[*g.position_enu_m, g.acceptance_radius_m] for g in exploration.problem.goals[:-1]], dtype=np.float64
    ).reshape(-1, 4)
    branches = Branches(
        first=np.full(len(tree.parent), -1, dtype=np.int64),
        following=np.full(len(tree.parent), -1, dtype=np.int64),
        upper=np.full(len(tree.parent), np.inf),
        stage=np.zeros(len(tree.parent), dtype=np.int64),
    )
    tree.active[:n] = 0
    tree.active[root] = 1
    for i in range(1, n):  # parents come before children until rewiring begins
        up = tree.parent[i]
        branches.following[i], branches.first[up] = branches.first[up], i
        x, y, z = tree.state[i, :3]
        branches.stage[i] = next_stage(branches.stage[up], x, y, z, goals)
        if i != root:
            tree.active[i] = tree.active[up]
    return branches, goals


def smoothed_route(
    exploration: Exploration, route: Route, should_stop: Callable[[], bool]
) -> tuple[Route, int]:
    """Smooth a path by Dubins curves: short cuts between its waypoints, until the iterations are used up.

    Rewiring on the path alone, judged by the cost with the DTs where they can be when a row is passed.
    Pairs are drawn at random, wide ones first: the reach shrinks from the whole path to a few steps.

    Returns
    -------
    Route
        The cheaper route.
    int
        How many short cuts were kept.
    """
    problem, limits = exploration.problem, exploration.limits
    settings, obstacles = problem.settings, exploration.problem.snapshot.obstacles
    kept = 0
    nowhere = np.zeros(6)
    for iteration in range(settings.smooth_iterations):
        if len(route) < 4 or should_stop():
            break
        n = len(route)
        widest = max(4, int(n * (1.0 - iteration / settings.smooth_iterations)))
        i = int(exploration.rng.integers(0, n - 3))
        j = min(n - 1, i + 3 + int(exploration.rng.integers(0, widest)))
        capacity = n + SPARE_ROWS
        states, times, rates = np.empty((capacity, 6)), np.empty(capacity), np.empty((capacity, 2))
        status, m, at = splice(
            route.states, route.times, route.rates, n, i, nowhere, False, j, limits, states, times, rates
        )
        if status != JOINED or times[at] >= route.times[j]:
            continue
        if not is_flyable(states, times, rates, m, i + 1, limits):
            continue
        if not is_clear(states, rates, times, i + 1, at + 1, obstacles, limits.margin):
            continue
        if not visits_goals(states[:m], problem.goals):
            continue
        # Rows after j keep their shape; passed sooner, they are within reach of the DTs no more than before.
        old = cost_between(exploration, route, i + 1, j + 1)
        new = cost_between(exploration, Route(states, times, rates), i + 1, at + 1)
        if new < old - 1e-9:
            route = Route(states[:m].copy(), times[:m].copy(), rates[:m].copy())
            kept += 1
    return route, kept
