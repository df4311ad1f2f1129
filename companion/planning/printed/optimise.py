"""Improving a path that reaches the goal, in the time that remains (paper 4.4.3)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from companion.kernels.arrays import Branches, Scene, empty_branches
from companion.kernels.printed.branches import enter_below
from companion.kernels.printed.rrt_star import STAR_DRAWS, rrt_star
from companion.kernels.search.growth import grow
from companion.kernels.search.path_edit import air_time, fill_short_cut
from companion.kernels.workspace import empty_rows
from companion.planning.explore import Exploration
from companion.planning.problem import goals_on_the_way
from companion.planning.route import (
    SPARE_ROWS,
    Assessment,
    Route,
    assess_route,
    branch_to,
    cost_between,
    route_from_tree,
    visits_goals,
)

LEAST_GAIN = 0.002  # A burst of RRT* that lowers the path's cost by a smaller share has gained nothing.
PATIENCE = 200  # RRT* ends after this many iterations without a gain.
RISK_SPARE = 1e-3  # Optimising may raise −log Q by no more than this.


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

    In space it continues while the cost falls, until it has to stop or the iterations are used up.

    Parameters
    ----------
    exploration : Exploration
        Holds the tree with the path to ``end``, which is rearranged.
    route : Route
        The path to ``end``, its last edge led to the goal itself.
    end : int
        The node at which the goal was reached.
    """
    settings, tree = exploration.problem.settings, exploration.tree
    scene = exploration.scene()
    goal = _with_last_edge(exploration, scene, route, end)
    if goal < 0:
        return Optimised(route, 0, 0)
    root = free_node(exploration, goal, settings.flown_meanwhile_s)
    branches = branches_below(exploration, root)
    rewired = pruned = 0
    least, done, idle = settings.optimise_iterations, 0, 0
    most = max(least, settings.optimise_iterations_max)
    # In the plane the cost hardly falls, but paths come to lie along the limits: an edge keeps the speed
    # that it begins with.
    if exploration.limits.dimension == 2 or tree.state[0, 5] > exploration.limits.v_cruise:
        most = least
    while least > 0 and root != goal and not should_stop():
        if done >= most or (done >= least and idle >= PATIENCE):
            break
        burst = min(settings.burst, (least if done < least else most) - done)
        done += burst
        cost = tree.cost[goal]
        draws = exploration.rng.random((burst, STAR_DRAWS))
        more, less = rrt_star(tree, branches, scene, root, goal, draws, exploration.star_work)
        rewired, pruned = rewired + more, pruned + less
        has_gained = tree.cost[goal] < (1.0 - LEAST_GAIN) * cost
        idle = 0 if has_gained else idle + burst
    return Optimised(route_from_tree(exploration, goal), rewired, pruned)


def free_node(exploration: Exploration, goal: int, flown_meanwhile_s: float) -> int:
    """Root_r: the first waypoint on the way to ``goal`` that is not reached within that time."""
    tree, node = exploration.tree, goal
    soonest = tree.time[0] + flown_meanwhile_s
    while tree.parent[node] >= 0 and tree.time[tree.parent[node]] >= soonest:
        node = int(tree.parent[node])
    return node


def _with_last_edge(exploration: Exploration, scene: Scene, route: Route, end: int) -> int:
    """Attach the rows of a route that the tree does not hold below it; the last one's node, or -1."""
    tree, rows = exploration.tree, branch_to(exploration, end)
    same = 0
    while same < min(len(rows), len(route)) and np.array_equal(tree.state[rows[same]], route.states[same]):
        same += 1
    node, work = rows[same - 1], exploration.star_work
    for k in range(same, len(route)):
        if tree.count[0] >= len(tree.parent):
            return -1
        dt = float(air_time(route.rows, k, exploration.limits))
        control, draws = np.array([0.0, *route.rates[k]]), exploration.rng.random(STAR_DRAWS)
        node = grow(tree, scene, node, route.states[k], control, dt, draws, work.growth, work.stats)
        if node < 0:
            return -1
    return node


def branches_below(exploration: Exploration, root: int) -> Branches:
    """Return the tree's links; only nodes below ``root`` are searched from now on."""
    tree = exploration.tree
    branches = empty_branches(len(tree.parent), goals_on_the_way(exploration.problem.goals))
    enter_below(tree, branches, root)
    return branches


def smoothed_route(
    exploration: Exploration, route: Route, known: Assessment, should_stop: Callable[[], bool]
) -> tuple[Route, Assessment, int]:
    """Smooth a path by Dubins curves: short cuts between its waypoints, until the iterations are used up.

    Rewiring on the path alone, judged by the cost with the DTs where they can be when a row is passed.
    Pairs are drawn at random, wide ones first: the reach shrinks from the whole path to a few steps. Together
    they hardly lower Q.

    Returns
    -------
    Route
        The cheaper route.
    Assessment
        What is known along it, as ``known`` is of the route given.
    int
        How many short cuts were kept.
    """
    problem, settings = exploration.problem, exploration.problem.settings
    kept, weight, out = 0, settings.weight_collision, empty_rows(len(route) + SPARE_ROWS)
    obstacles = problem.snapshot.obstacles
    spare = RISK_SPARE if weight > 0.0 else math.inf
    for iteration in range(settings.smooth_iterations):
        if len(route) < 4 or should_stop():
            break
        i, j = _drawn_stretch(exploration.rng, len(route), 1.0 - iteration / settings.smooth_iterations)
        num, at = fill_short_cut(route.rows, len(route), i, j, exploration.limits, obstacles, out)
        shorter = Route(out.states[:num], out.times[:num], out.rates[:num])
        if num == 0 or not visits_goals(shorter.states, problem.goals):
            continue
        gain = cost_between(exploration, route, i + 1, j + 1) - cost_between(
            exploration, shorter, i + 1, at + 1
        )
        if gain <= 1e-9:
            continue
        laid = assess_route(exploration, shorter.until(at), known, i + 1)
        more = laid.log_risk(i + 1, at) - known.log_risk(i + 1, j)
        if more <= spare and gain - weight * more > 1e-9:
            spare = min(spare, spare - more)
            route = Route.of(out, num)
            out = empty_rows(num + SPARE_ROWS)
            known = assess_route(exploration, route, laid, at + 1)
            kept += 1
    return route, known, kept


def _drawn_stretch(rng: np.random.Generator, num_rows: int, share: float) -> tuple[int, int]:
    """First and last row of a random stretch of a route, which is as long as a share of it at most."""
    widest = max(4, int(num_rows * share))
    first = int(rng.integers(0, num_rows - 3))
    return first, min(num_rows - 1, first + 3 + int(rng.integers(0, widest)))


def is_no_worse(exploration: Exploration, known: Assessment, log_risk: float) -> bool:
    """Return whether a route does not lower Q, if the method uses Q.

    Parameters
    ----------
    exploration : Exploration
        The search that found it.
    known : Assessment
        What is known along it.
    log_risk : float
        -log Q of the path that it is compared with.
    """
    return exploration.problem.settings.weight_collision == 0.0 or known.log_risk() <= log_risk + RISK_SPARE
