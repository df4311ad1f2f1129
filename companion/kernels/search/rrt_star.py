"""RRT* on the remaining path tree, with upper and lower cost bounds (paper 4.4.3).

Symbols: ``q_new`` a new node, ``a`` an earlier and ``b`` a later end of a new edge. Edges that join two
given nodes are Dubins edges, laid in steps of at most le; the steps become nodes of the tree.

References
----------
Karaman, Frazzoli, "Sampling-based algorithms for optimal motion planning", IJRR 30(7), 2011.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from companion.kernels.aircraft import dubins
from companion.kernels.aircraft.lqg_mp import position_deviation, propagate
from companion.kernels.aircraft.motion import straight_after
from companion.kernels.arrays import Branches, FloatArray, IntArray, Scene, Tree
from companion.kernels.search.dynamic_domain_rrt import (
    BLOCKED,
    EXTENDED,
    MAX_K,
    OUTSIDE,
    choose_node,
    cost_distance,
    distance_to,
    extend_or_descend,
    grow,
    near_nodes,
    num_near,
    step_cost,
)
from companion.kernels.search.path_edit import JOINED, breaks_turn_rule, is_clear, is_flyable_after, join
from companion.kernels.threat.fuzzy_threat import MAX_THREATS
from companion.kernels.threat.reachability import MAX_NEAR

STAR_DRAWS = 16  # uniform numbers an iteration uses
MAX_ROWS = 128  # of one Dubins edge
MAX_PATH = 4096
PATH_PICKS = 4  # waypoints of the path each new node is joined with, beside its k nearest
GAIN = 1e-6  # of cost, below which an edge is no better
SETTLED = 1e-4  # change of δ_q below which descendants keep their covariance


@nb.njit(cache=True, nogil=True)
def hang(tree: Tree, branches: Branches, i: int) -> None:
    """Enter node ``i`` among its parent's children."""
    up = tree.parent[i]
    branches.following[i] = branches.first[up]
    branches.first[up] = i


@nb.njit(cache=True, nogil=True)
def take_down(tree: Tree, branches: Branches, i: int) -> None:
    """Take node ``i`` from its parent's children."""
    up = tree.parent[i]
    tree.children[up] -= 1
    c = branches.first[up]
    if c == i:
        branches.first[up] = branches.following[i]
        return
    while branches.following[c] != i:
        c = branches.following[c]
    branches.following[c] = branches.following[i]


@nb.njit(cache=True, nogil=True)
def next_stage(stage: int, x: float, y: float, z: float, goals: FloatArray) -> int:
    """Goals passed at a point reached with ``stage`` of them passed; ``goals`` (G, 4) x y z radius."""
    if stage < goals.shape[0]:
        g = goals[stage]
        if (x - g[0]) ** 2 + (y - g[1]) ** 2 + (z - g[2]) ** 2 <= g[3] * g[3]:
            return stage + 1
    return stage


@nb.njit(cache=True, nogil=True)
def lay_edge(
    tree: Tree, scene: Scene, a: int, b: int, states: FloatArray, times: FloatArray, rates: FloatArray,
    stats: IntArray,
) -> int:  # fmt: skip
    """A Dubins edge from node ``a`` to the pose of node ``b``: its rows, ``a`` first; 0 if there is none."""
    states[0], times[0] = tree.state[a], tree.time[a]
    status, n = join(states, times, rates, 1, tree.state[b], scene.limits)
    if status != JOINED or n < 2:
        return 0
    if not is_flyable_after(tree.turn[a], tree.straight[a], states, times, rates, n, 1, scene.limits):
        return 0
    stats[0] += n - 1
    if not is_clear(states, rates, times, 1, n, scene.obstacles, scene.limits.margin):
        return 0
    return n


@nb.njit(cache=True, nogil=True)
def keeps_turn_rule_below(
    tree: Tree, branches: Branches, b: int, turn: int, straight: float, scene: Scene, stack: IntArray
) -> bool:
    """Whether all edges below ``b`` stay flyable when it is reached after another turn.

    Only as deep as the change is felt: past ``sl_min`` of straight flight, or a turn, it is not.
    """
    stack[0], top = b, 1
    turns, straights = np.empty(stack.shape[0], dtype=np.int64), np.empty(stack.shape[0])
    turns[0], straights[0] = turn, straight
    while top > 0:
        top -= 1
        i, turn, straight = stack[top], turns[top], straights[top]
        c = branches.first[i]
        while c >= 0:
            w = tree.rate[c, 0]
            if breaks_turn_rule(turn, straight, w, scene.limits):
                return False
            length = (tree.time[c] - tree.time[i]) * 0.5 * (tree.state[c, 5] + tree.state[i, 5])
            after, flown = straight_after(turn, straight, w, length)
            enough = scene.limits.straight_min
            if after != tree.turn[c] or min(flown, enough) != min(tree.straight[c], enough):
                if top + 1 >= stack.shape[0]:
                    return False
                stack[top], turns[top], straights[top] = c, after, flown
                top += 1
            c = branches.following[c]
    return True


@nb.njit(cache=True, nogil=True)
def shift_below(
    tree: Tree, branches: Branches, b: int, cost: float, time: float, scene: Scene, stack: IntArray,
    felt: IntArray,
) -> None:  # fmt: skip
    """Carry a change of cost and time stamp at ``b`` to all nodes below it.

    Turn rule and covariance change with it; the filter forgets, and where δ_q has settled the nodes
    below keep theirs. ``stack`` and ``felt`` (N,) are scratch.
    """
    stack[0], felt[0], top = b, 1, 1
    while top > 0:
        top -= 1
        i, renew = stack[top], felt[top]
        c = branches.first[i]
        while c >= 0:
            tree.cost[c] += cost
            tree.time[c] += time
            dt = tree.time[c] - tree.time[i]
            length = dt * 0.5 * (tree.state[c, 5] + tree.state[i, 5])
            tree.turn[c], tree.straight[c] = straight_after(
                tree.turn[i], tree.straight[i], tree.rate[c, 0], length
            )
            stack[top], felt[top] = c, 0
            if renew == 1 and renewed_covariance(tree, i, c, dt, scene) > SETTLED:
                felt[top] = 1
            top += 1
            c = branches.following[c]


@nb.njit(cache=True, nogil=True)
def renewed_covariance(tree: Tree, parent: int, i: int, dt: float, scene: Scene) -> float:
    """P, Λ and δ_q of node ``i`` after an edge of ``dt`` seconds; by how much δ_q changed."""
    a = (tree.state[i, 5] - tree.state[parent, 5]) / dt
    propagate(
        tree.state[parent], a, tree.rate[i, 0], tree.rate[i, 1], dt, scene.tables, tree.cov_error[parent],
        tree.cov_estimate[parent], tree.cov_error[i], tree.cov_estimate[i],
    )  # fmt: skip
    old = tree.delta[i]
    deviation = position_deviation(tree.cov_error[i], tree.cov_estimate[i], scene.limits.dimension)
    tree.delta[i] = deviation / scene.search.unit
    return abs(tree.delta[i] - old)


@nb.njit(cache=True, nogil=True)
def lower_bound(a: FloatArray, b: FloatArray, scene: Scene, segments: FloatArray) -> float:
    """What a Dubins edge between two states costs at least by (9): its length."""
    flat = dubins.distance(a[0], a[1], a[3], b[0], b[1], b[3], scene.limits.r_min, segments)
    length = math.sqrt(flat * flat + (b[2] - a[2]) ** 2)
    # Rows are chords of the edge; on the tightest turn a chord of le is shorter than its arc.
    half = 0.5 * scene.limits.v_max * scene.limits.tau / scene.limits.r_min
    return scene.search.cost_distance * length * math.sin(half) / half / scene.search.unit


@nb.njit(cache=True, nogil=True)
def weigh_edge(
    tree: Tree, branches: Branches, scene: Scene, a: int, b: int, below: float, goal: int,
    goals: FloatArray, reach: FloatArray, states: FloatArray, times: FloatArray, rates: FloatArray,
    scratch: FloatArray, stats: IntArray,
) -> tuple[int, float]:  # fmt: skip
    """Rows of a Dubins edge from ``a`` to ``b`` and the cost of ``b`` over it; 0 rows if not worth while.

    Worth while is what costs less than ``below``, and less than the goal with the way to it as the crow
    flies added: bounds come before the edge is laid, the edge before its threats are.
    """
    model, search = scene.model, scene.search
    p, q, g = tree.state[a], tree.state[b], tree.state[goal]
    per_metre = search.cost_distance / search.unit
    below = min(below, tree.cost[goal] - per_metre * distance_to(q, g)) - GAIN
    if tree.cost[a] + per_metre * distance_to(p, q) >= below:
        return 0, math.inf
    if tree.cost[a] + lower_bound(p, q, scene, scratch[0:2].reshape(4)[:3]) >= below:
        return 0, math.inf
    n = lay_edge(tree, scene, a, b, states, times, rates, stats)
    if n == 0 or tree.count[0] + n >= tree.parent.shape[0]:
        return 0, math.inf
    cost, stage = tree.cost[a], branches.stage[a]
    for k in range(1, n):
        q = states[k]
        cost += step_cost(
            states[k - 1], q[0], q[1], q[2], tree.delta[a], scene.threats, tree.threat_point[a], reach, model,
            search, scratch,
        )  # fmt: skip
        if cost >= below:
            return 0, math.inf
        stage = next_stage(stage, q[0], q[1], q[2], goals)
    return (n, cost) if stage == branches.stage[b] else (0, math.inf)


@nb.njit(cache=True, nogil=True)
def try_edge(
    tree: Tree, branches: Branches, scene: Scene, a: int, b: int, goal: int, goals: FloatArray,
    reach: FloatArray, draws: FloatArray, states: FloatArray, times: FloatArray, rates: FloatArray,
    changed: IntArray, scratch: FloatArray, levels: FloatArray, stack: IntArray, felt: IntArray,
    stats: IntArray,
) -> bool:  # fmt: skip
    """Give ``b`` the parent ``a`` over a Dubins edge if that is cheaper, flyable and clear.

    RRT*'s choice of a parent (``b`` new) and its rewiring (``a`` new) are both this.
    """
    n, _ = weigh_edge(
        tree, branches, scene, a, b, tree.cost[b], goal, goals, reach, states, times, rates, scratch, stats
    )
    if n == 0:
        return False
    turn, straight = tree.turn[a], tree.straight[a]
    for k in range(1, n):
        length = (times[k] - times[k - 1]) * 0.5 * (states[k, 5] + states[k - 1, 5])
        turn, straight = straight_after(turn, straight, rates[k, 0], length)
    if not keeps_turn_rule_below(tree, branches, b, turn, straight, scene, stack):
        return False
    last, control = a, np.zeros(3)
    for k in range(1, n - 1):
        control[1], control[2] = rates[k, 0], rates[k, 1]
        i = grow(
            tree, scene, last, states[k], control, times[k] - times[k - 1], reach, draws, changed, scratch,
            levels, stats,
        )  # fmt: skip
        if i < 0:
            return False
        enter(tree, branches, i, goals)
        last = i
    q = tree.state[b]
    cost = tree.cost[last] + cost_distance(
        tree, last, q[0], q[1], q[2], scene.threats, reach, scene.model, scene.search, scratch
    )
    if cost >= tree.cost[b] - GAIN:
        return False
    dt = times[n - 1] - times[n - 2]
    gain, later = cost - tree.cost[b], tree.time[last] + dt - tree.time[b]
    take_down(tree, branches, b)
    tree.parent[b] = last
    tree.children[last] += 1
    hang(tree, branches, b)
    tree.cost[b], tree.time[b] = cost, tree.time[last] + dt
    tree.rate[b, 0], tree.rate[b, 1] = rates[n - 1, 0], rates[n - 1, 1]
    tree.turn[b], tree.straight[b] = turn, straight
    renewed_covariance(tree, last, b, dt, scene)
    shift_below(tree, branches, b, gain, later, scene, stack, felt)
    return True


@nb.njit(cache=True, nogil=True)
def enter(tree: Tree, branches: Branches, i: int, goals: FloatArray) -> None:
    """Enter a new node: its place among the branches, its bounds and goals passed."""
    branches.first[i], branches.upper[i] = -1, math.inf
    up = tree.parent[i]
    branches.stage[i] = next_stage(
        branches.stage[up], tree.state[i, 0], tree.state[i, 1], tree.state[i, 2], goals
    )
    hang(tree, branches, i)


@nb.njit(cache=True, nogil=True)
def path_to(tree: Tree, root: int, goal: int, path: IntArray) -> int:
    """Nodes from the goal back to ``root``, into ``path``; how many."""
    n, i = 0, goal
    while n < path.shape[0]:
        path[n] = i
        n += 1
        if i == root:
            break
        i = tree.parent[i]
    return n


@nb.njit(cache=True, nogil=True)
def remove_below(tree: Tree, branches: Branches, top_node: int, stack: IntArray) -> int:
    """Take a node and all below it out of the search; how many there were."""
    take_down(tree, branches, top_node)
    stack[0], top, n = top_node, 1, 0
    while top > 0:
        top -= 1
        i = stack[top]
        tree.active[i] = 0
        n += 1
        c = branches.first[i]
        while c >= 0:
            stack[top] = c
            top += 1
            c = branches.following[c]
    return n


@nb.njit(cache=True, nogil=True)
def tighten(
    tree: Tree, branches: Branches, scene: Scene, path: IntArray, n: int, reach: FloatArray,
    scratch: FloatArray, stack: IntArray,
) -> int:  # fmt: skip
    """Bounds and pruning after a cheaper path was found, as printed in paper 4.4.3; nodes removed.

    ``path`` (n,) leads from the goal back to Root_r. UB(q_{i-1}) falls to UB(q_i) + D_C(q_{i-1}, q_i);
    then a child of q_{i-1} off the path whose LB = D_C to the goal cannot beat it goes, with all below
    it. Where UB does not fall, the rest of the path is as it was.
    """
    goal, removed = path[0], 0
    g = tree.state[goal]
    branches.upper[goal] = 0.0
    for m in range(1, n):
        q, up = path[m - 1], path[m]
        bound = branches.upper[q] + tree.cost[q] - tree.cost[up]
        if branches.upper[up] <= bound:
            break
        branches.upper[up] = bound
        c = branches.first[up]
        while c >= 0:
            following = branches.following[c]
            if c != q:
                low = cost_distance(
                    tree, c, g[0], g[1], g[2], scene.threats, reach, scene.model, scene.search, scratch
                )
                if low + tree.cost[c] - tree.cost[up] > bound:
                    removed += remove_below(tree, branches, c, stack)
            c = following
    return removed


@nb.njit(cache=True, nogil=True)
def draw_remaining(
    draws: FloatArray, tree: Tree, scene: Scene, path: IntArray, n: int, q_s: FloatArray
) -> None:
    """A sample, into ``q_s`` (3,): in DD about a waypoint of the path, or anywhere within the bounds."""
    b, limits = scene.limits.bounds, scene.limits
    if draws[0] < 0.5:
        p = tree.state[path[int(draws[1] * n)]]
        r, angle = scene.search.domain * math.sqrt(draws[2]), 2.0 * math.pi * draws[3]
        q_s[0], q_s[1] = p[0] + r * math.cos(angle), p[1] + r * math.sin(angle)
        q_s[2] = p[2] + (2.0 * draws[7] - 1.0) * r * math.tan(limits.climb_max)
    else:
        q_s[0] = b[0] + draws[1] * (b[1] - b[0])
        q_s[1] = b[2] + draws[2] * (b[3] - b[2])
        q_s[2] = b[4] + draws[3] * (b[5] - b[4])
    q_s[0], q_s[1] = min(b[1], max(b[0], q_s[0])), min(b[3], max(b[2], q_s[1]))
    q_s[2] = min(b[5], max(b[4], q_s[2])) if limits.dimension == 3 else tree.state[path[0], 2]


@nb.njit(cache=True, nogil=True)
def can_improve(q_s: FloatArray, start: FloatArray, goal: FloatArray, cost: float, scene: Scene) -> bool:
    """Whether a path over a sample can cost less than ``cost``: its length alone must."""
    length = distance_to(start, q_s) + distance_to(goal, q_s)
    return scene.search.cost_distance * length / scene.search.unit < cost


@nb.njit(cache=True, nogil=True)
def grow_towards(
    tree: Tree, scene: Scene, q_s: FloatArray, reach: FloatArray, draws: FloatArray, control: FloatArray,
    state: FloatArray, changed: IntArray, scratch: FloatArray, levels: FloatArray, stats: IntArray,
) -> int:  # fmt: skip
    """The dynamic-domain step towards a sample, anywhere within the bounds; the new node or -1."""
    limits, search = scene.limits, scene.search
    i = choose_node(tree, q_s, scene.threats, reach, scene.model, search, limits.dimension, scratch)
    if i == OUTSIDE or (i >= 0 and distance_to(tree.state[i], q_s) > tree.domain[i]):
        stats[1] += 1
        return -1
    if i < 0:
        return -1
    centre = tree.state[i, :3].copy()
    i, outcome = extend_or_descend(tree, scene, i, q_s, centre, math.inf, control, state, stats)
    if outcome == BLOCKED:
        stats[2] += 1
        tree.blocked[i] = 1
        tree.domain[i] = min(search.domain, tree.domain[i])
    if outcome != EXTENDED:
        return -1
    return grow(tree, scene, i, state, control, limits.tau, reach, draws, changed, scratch, levels, stats)


@nb.njit(cache=True, nogil=True)
def rewire_about(
    tree: Tree, branches: Branches, scene: Scene, new: int, near: IntArray, k: int, root: int, goal: int,
    goals: FloatArray, reach: FloatArray, draws: FloatArray, states: FloatArray, times: FloatArray,
    rates: FloatArray, changed: IntArray, scratch: FloatArray, levels: FloatArray, stack: IntArray,
    felt: IntArray, stats: IntArray,
) -> int:  # fmt: skip
    """RRT*'s two steps about a new node: the best parent of ``near`` (k,) for it, then it as theirs."""
    rewired, up, least = 0, -1, tree.cost[new]
    for j in range(k):
        rows, cost = weigh_edge(
            tree, branches, scene, near[j], new, least, goal, goals, reach, states, times, rates, scratch,
            stats,
        )  # fmt: skip
        if rows > 0:
            up, least = near[j], cost
    if up >= 0 and try_edge(
        tree, branches, scene, up, new, goal, goals, reach, draws, states, times, rates, changed, scratch,
        levels, stack, felt, stats,
    ):  # fmt: skip
        rewired += 1
    for j in range(k):
        if near[j] != root and near[j] != new and try_edge(
            tree, branches, scene, new, near[j], goal, goals, reach, draws, states, times, rates, changed,
            scratch, levels, stack, felt, stats,
        ):  # fmt: skip
            rewired += 1
    return rewired


@nb.njit(cache=True, nogil=True)
def improve(
    tree: Tree, branches: Branches, scene: Scene, root: int, goal: int, goals: FloatArray,
    draws: FloatArray, stats: IntArray,
) -> tuple[int, int]:  # fmt: skip
    """RRT* iterations, one a row of ``draws`` (M, STAR_DRAWS), on the tree below ``root``.

    The tree grows by the dynamic-domain step; every new node looks for a better parent among its k
    nearest and some waypoints, and offers itself to them as one; two waypoints are tried for a short
    cut. ``goals`` (G, 4) are still to be passed on the way. Returns edges rewired and nodes pruned.
    """
    q_s, control, state = np.empty(3), np.empty(3), np.empty(6)
    states, times, rates = np.empty((MAX_ROWS, 6)), np.empty(MAX_ROWS), np.empty((MAX_ROWS, 2))
    scratch, levels = np.empty((MAX_THREATS, 2)), np.empty(scene.tables.normals.shape[0])
    changed = np.empty(4 * MAX_NEAR, dtype=np.int64)
    capacity = tree.parent.shape[0]
    stack, felt = np.empty(capacity, dtype=np.int64), np.empty(capacity, dtype=np.int64)
    best_d2, near = np.empty(MAX_K), np.empty(MAX_K + 2 * PATH_PICKS, dtype=np.int64)
    path = np.empty(MAX_PATH, dtype=np.int64)
    reach = scene.pursuers.model[:, 1].copy()
    n = path_to(tree, root, goal, path)
    rewired, pruned = 0, tighten(tree, branches, scene, path, n, reach, scratch, stack)
    for m in range(draws.shape[0]):
        row = draws[m]
        if tree.count[0] + MAX_ROWS >= capacity:
            break
        stats[3] += 1
        was = rewired
        p, q = path[int(row[8] * n)], path[int(row[9] * n)]
        if tree.cost[p] > tree.cost[q]:
            p, q = q, p
        if try_edge(
            tree, branches, scene, p, q, goal, goals, reach, row, states, times, rates, changed, scratch,
            levels, stack, felt, stats,
        ):  # fmt: skip
            rewired += 1
        draw_remaining(row, tree, scene, path, n, q_s)
        left = tree.cost[goal] - tree.cost[root]
        if can_improve(q_s, tree.state[root], tree.state[goal], left, scene):
            new = grow_towards(tree, scene, q_s, reach, row, control, state, changed, scratch, levels, stats)
            if new >= 0:
                enter(tree, branches, new, goals)
                k = near_nodes(
                    tree, tree.state[new], num_near(tree.count[0], scene.limits.dimension), best_d2, near
                )
                for pick in range(PATH_PICKS):
                    near[k] = path[int(row[10 + pick] * n)]
                    k += 1
                rewired += rewire_about(
                    tree, branches, scene, new, near, k, root, goal, goals, reach, row, states, times, rates,
                    changed, scratch, levels, stack, felt, stats,
                )  # fmt: skip
        if rewired > was:
            n = path_to(tree, root, goal, path)
            pruned += tighten(tree, branches, scene, path, n, reach, scratch, stack)
    return rewired, pruned
