"""RRT* on the remaining path tree, with upper and lower cost bounds (paper 4.4.3).

Symbols: ``q_new`` a new node, ``a`` an earlier and ``b`` a later end of a new edge. Edges that join two
given nodes are Dubins edges, laid in steps of at most le; the steps become nodes of the tree.

References
----------
Karaman, Frazzoli, "Sampling-based algorithms for optimal motion planning", IJRR 30(7), 2011.
"""

from __future__ import annotations

import math

from companion.kernels.aircraft import dubins
from companion.kernels.aircraft.motion import distance_to, straight_after
from companion.kernels.arrays import Branches, Float1D, Float2D, Int1D, Limits, Scene, Search, Tree
from companion.kernels.native.kernel import kernel
from companion.kernels.printed.branches import (
    attach_child,
    change_of_delta,
    detach_child,
    enter,
    keeps_turn_rule_below,
    path_to,
    remove_below,
    shift_below,
)
from companion.kernels.printed.extension import BLOCKED, EXTENDED, extend_or_descend
from companion.kernels.printed.near_nodes import OUTSIDE, choose_node, near_nodes, num_near
from companion.kernels.search.costs import cost_distance, step_cost, threats_at
from companion.kernels.search.growth import collision_cost, grow, next_stage
from companion.kernels.search.path_edit import JOINED, air_time, is_clear, is_flyable_after, join
from companion.kernels.workspace import MAX_ROWS, PATH_PICKS, EdgeScratch, PathRows, Workspace

STAR_DRAWS = 16  # Uniform random numbers that an iteration uses.
GAIN = 1e-6  # An edge that lowers the cost by less than this is not used.


@kernel
def lay_edge(tree: Tree, scene: Scene, a: int, b: int, rows: PathRows, stats: Int1D) -> int:
    """A Dubins edge from node ``a`` to the pose of node ``b``: its rows, ``a`` first; 0 if there is none.

    ``stats`` (4,): the first counts collision checks.
    """
    limits = scene.limits
    rows.states[0], rows.times[0] = tree.state[a], tree.time[a]
    status, n = join(rows, 1, tree.state[b], limits)
    if status != JOINED or n < 2:
        return 0
    if not is_flyable_after(tree.turn[a], tree.straight[a], rows, n, 1, limits):
        return 0
    stats[0] += n - 1
    if not is_clear(rows, 1, n, scene.obstacles, limits):
        return 0
    return n


@kernel
def lower_bound(a: Float1D, b: Float1D, scene: Scene, segments: Float1D) -> float:
    """Return the least cost by (9) of a Dubins edge from state ``a`` (6,) to ``b`` (6,): its length.

    ``segments`` (3,) is overwritten.
    """
    flat = dubins.distance(a[0], a[1], a[3], b[0], b[1], b[3], scene.limits.r_min, segments)
    length = math.sqrt(flat * flat + (b[2] - a[2]) ** 2)
    # Rows are chords of the edge; on the tightest turn a chord of le is shorter than its arc.
    half = 0.5 * scene.limits.v_max * scene.limits.tau / scene.limits.r_min
    return scene.search.cost_distance * length * math.sin(half) / half / scene.search.unit


@kernel
def bound_of(tree: Tree, b: int, below: float, goal: int, search: Search) -> float:
    """Return the cost of ``b`` above which an edge to it is of no use.

    Less than ``below``, and less than the goal with the way to it as the crow flies added.
    """
    per_metre = search.cost_distance / search.unit
    left = per_metre * distance_to(tree.state[b], tree.state[goal])
    return min(below, tree.cost[goal] - left) - GAIN


@kernel
def may_gain(tree: Tree, a: int, b: int, below: float, goal: int, search: Search) -> bool:
    """Return whether an edge from ``a`` to ``b`` would be worth while if it were straight."""
    per_metre = search.cost_distance / search.unit
    length = per_metre * distance_to(tree.state[a], tree.state[b])
    return not tree.cost[a] + length >= bound_of(tree, b, below, goal, search)


@kernel
def weigh_edge(
    tree: Tree, branches: Branches, scene: Scene, a: int, b: int, below: float, goal: int,
    edge: EdgeScratch, stats: Int1D,
) -> tuple[int, float]:  # fmt: skip
    """Rows of a Dubins edge from ``a`` to ``b`` and the cost of ``b`` over it; 0 rows if not worth while.

    Worth while is what costs less than :func:`bound_of`: bounds come before the edge is laid, the edge
    before its threats are. ``stats`` (4,): the first counts collision checks.
    """
    search, states = scene.search, edge.rows.states
    if not may_gain(tree, a, b, below, goal, search):
        return 0, math.inf
    below = bound_of(tree, b, below, goal, search)
    if tree.cost[a] + lower_bound(tree.state[a], tree.state[b], scene, edge.segments) >= below:
        return 0, math.inf
    n = lay_edge(tree, scene, a, b, edge.rows, stats)
    if n == 0 or tree.count[0] + n >= tree.parent.shape[0]:
        return 0, math.inf
    cost, stage = tree.cost[a], branches.stage[a]
    threats = threats_at(scene, tree.threat_point[a], edge.threat)
    for k in range(1, n):
        x, y, z = states[k, 0], states[k, 1], states[k, 2]
        cost += step_cost(states[k - 1], x, y, z, tree.delta[a], search, threats)
        if cost >= below:
            return 0, math.inf
        stage = next_stage(stage, x, y, z, branches.goals)
    return (n, cost) if stage == branches.stage[b] else (0, math.inf)


@kernel
def turn_at_end(tree: Tree, a: int, n: int, rows: PathRows, limits: Limits) -> tuple[int, float]:
    """Turn sign and straight length after an edge of ``n`` rows from ``a``."""
    turn, straight = tree.turn[a], tree.straight[a]
    for k in range(1, n):
        length = air_time(rows, k, limits) * 0.5 * (rows.states[k, 5] + rows.states[k - 1, 5])
        turn, straight = straight_after(turn, straight, rows.rates[k, 0], length)
    return turn, straight


@kernel
def grow_edge(
    tree: Tree, branches: Branches, scene: Scene, a: int, n: int, draws: Float1D, work: Workspace
) -> int:
    """Add the inner rows of ``work.edge`` below ``a``; return the last one's node, or -1 if one is too risky.

    ``draws`` (≥ 7,) uniform numbers.
    """
    rows, control, last = work.edge.rows, work.step.control, a
    for k in range(1, n - 1):
        dt = air_time(rows, k, scene.limits)
        control[0] = (rows.states[k, 5] - rows.states[k - 1, 5]) / dt
        control[1], control[2] = rows.rates[k, 0], rows.rates[k, 1]
        i = grow(tree, scene, last, rows.states[k], control, dt, draws, work.growth, work.stats)
        if i < 0:
            return -1
        enter(tree, branches, i)
        last = i
    return last


@kernel
def try_edge(
    tree: Tree, branches: Branches, scene: Scene, a: int, b: int, goal: int, draws: Float1D,
    work: Workspace,
) -> bool:  # fmt: skip
    """Give ``b`` the parent ``a`` over a Dubins edge if that is cheaper, flyable and clear.

    RRT*'s choice of a parent (``b`` new) and its rewiring (``a`` new) are both this. ``draws`` (≥ 7,)
    uniform numbers.
    """
    n, _ = weigh_edge(tree, branches, scene, a, b, tree.cost[b], goal, work.edge, work.stats)
    if n == 0:
        return False
    turn, straight = turn_at_end(tree, a, n, work.edge.rows, scene.limits)
    if not keeps_turn_rule_below(tree, branches, b, turn, straight, scene.limits, work.walk):
        return False
    last = grow_edge(tree, branches, scene, a, n, draws, work)
    if last < 0:
        return False
    q, times, rates = tree.state[b], work.edge.rows.times, work.edge.rows.rates
    threats = threats_at(scene, work.points, work.edge.threat)
    cost = tree.cost[last] + cost_distance(tree, last, q[0], q[1], q[2], scene.search, threats)
    stamp = tree.time[last] + (times[n - 1] - times[n - 2])
    cost += collision_cost(scene.search, tree.clear[b])
    gain, later = cost - tree.cost[b], stamp - tree.time[b]
    if gain > -GAIN:
        return False
    detach_child(tree, branches, b)
    tree.parent[b] = last
    tree.children[last] += 1
    attach_child(tree, branches, b)
    tree.cost[b], tree.time[b] = cost, stamp
    tree.rate[b, 0], tree.rate[b, 1] = rates[n - 1, 0], rates[n - 1, 1]
    tree.turn[b], tree.straight[b] = turn, straight
    dt = air_time(work.edge.rows, n - 1, scene.limits)
    change_of_delta(tree, last, b, dt, scene, work.growth.lqg)
    shift_below(tree, branches, b, gain, later, scene, work.walk, work.growth.lqg)
    return True


@kernel
def prune_by_bounds(
    tree: Tree, branches: Branches, scene: Scene, path: Int1D, n: int, work: Workspace
) -> int:
    """Prune by bounds after a cheaper path was found (paper 4.4.3); return how many nodes were removed.

    ``path`` (≥ n,) leads from the goal back to Root_r. UB(q_{i-1}) falls to UB(q_i) + D_C(q_{i-1}, q_i);
    then a child of q_{i-1} off the path whose LB = D_C to the goal cannot beat it goes, with all below
    it. Where UB does not fall, the rest of the path is as it was.
    """
    goal, removed = path[0], 0
    g, threats = tree.state[goal], threats_at(scene, work.points, work.edge.threat)
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
                low = cost_distance(tree, c, g[0], g[1], g[2], scene.search, threats)
                if low + tree.cost[c] - tree.cost[up] > bound:
                    removed += remove_below(tree, branches, c, work.walk.stack)
            c = following
    return removed


@kernel
def draw_remaining(draws: Float1D, tree: Tree, scene: Scene, path: Int1D, n: int, q_s: Float1D) -> None:
    """A sample in DD about a waypoint of a path, or anywhere within the bounds, into ``q_s`` (3,) [m].

    ``draws`` (≥ 8,) uniform numbers; ``path`` (≥ n,) nodes from the goal back.
    """
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


@kernel
def can_improve(q_s: Float1D, start: Float1D, goal: Float1D, cost: float, scene: Scene) -> bool:
    """Return whether a path over a sample can cost less than ``cost``: its length alone must.

    ``q_s`` (3,) the sample, ``start`` (≥ 3,) and ``goal`` (≥ 3,) the path's ends [m].
    """
    length = distance_to(start, q_s) + distance_to(goal, q_s)
    return scene.search.cost_distance * length / scene.search.unit < cost


@kernel
def grow_towards(tree: Tree, scene: Scene, q_s: Float1D, draws: Float1D, work: Workspace) -> int:
    """Take the dynamic-domain step towards ``q_s`` (3,) [m] within the bounds; return the new node or -1.

    ``draws`` (≥ 7,) uniform numbers.
    """
    limits, search, step, stats = scene.limits, scene.search, work.step, work.stats
    threats = threats_at(scene, work.points, work.growth.threat)
    i = choose_node(tree, q_s, search, limits.dimension, threats, work.near)
    if i == OUTSIDE or (i >= 0 and distance_to(tree.state[i], q_s) > tree.domain[i]):
        stats[1] += 1
        return -1
    if i < 0:
        return -1
    centre = tree.state[i, :3]
    i, outcome = extend_or_descend(tree, i, q_s, centre, math.inf, scene.obstacles, limits, step, stats)
    if outcome == BLOCKED:
        stats[2] += 1
        tree.blocked[i] = 1
        tree.domain[i] = min(search.domain, tree.domain[i])
    if outcome != EXTENDED:
        return -1
    return grow(tree, scene, i, step.state, step.control, limits.tau, draws, work.growth, stats)


@kernel
def rewire_about(
    tree: Tree, branches: Branches, scene: Scene, new: int, k: int, root: int, goal: int, draws: Float1D,
    work: Workspace,
) -> int:  # fmt: skip
    """RRT*'s two steps about a new node: the best parent of the ``k`` near ones for it, then it as theirs.

    They are in ``work.near``; ``draws`` (≥ 7,) uniform numbers. Returns how many edges were rewired.
    """
    near, rewired, up, least, search = work.near.rows, 0, -1, tree.cost[new], scene.search
    for j in range(k):
        i = near[j]
        if may_gain(tree, i, new, least, goal, search):
            rows, cost = weigh_edge(tree, branches, scene, i, new, least, goal, work.edge, work.stats)
            if rows > 0:
                up, least = i, cost
    if up >= 0 and try_edge(tree, branches, scene, up, new, goal, draws, work):
        rewired += 1
    for j in range(k):
        i = near[j]
        if i in (root, new) or not may_gain(tree, new, i, tree.cost[i], goal, search):
            continue
        if try_edge(tree, branches, scene, new, i, goal, draws, work):
            rewired += 1
    return rewired


@kernel
def short_cut(
    tree: Tree, branches: Branches, scene: Scene, n: int, goal: int, draws: Float1D, work: Workspace
) -> int:
    """Join two of ``n`` waypoints of ``work.path`` if it pays; the edges rewired. ``draws`` (STAR_DRAWS,)."""
    p, q = work.path[int(draws[8] * n)], work.path[int(draws[9] * n)]
    if tree.cost[p] > tree.cost[q]:
        p, q = q, p
    return 1 if try_edge(tree, branches, scene, p, q, goal, draws, work) else 0


@kernel
def grow_and_rewire(
    tree: Tree, branches: Branches, scene: Scene, n: int, root: int, goal: int, draws: Float1D,
    work: Workspace,
) -> int:  # fmt: skip
    """Grow at most one node, and rewire the edges about it.

    ``n`` waypoints are in ``work.path``; ``draws`` (STAR_DRAWS,) uniform numbers.
    """
    path, near, q_s = work.path, work.near, work.sample
    draw_remaining(draws, tree, scene, path, n, q_s)
    left = tree.cost[goal] - tree.cost[root]
    if not can_improve(q_s, tree.state[root], tree.state[goal], left, scene):
        return 0
    new = grow_towards(tree, scene, q_s, draws, work)
    if new < 0:
        return 0
    enter(tree, branches, new)
    k = near_nodes(tree, tree.state[new], num_near(tree.count[0], scene.limits.dimension), near)
    for pick in range(PATH_PICKS):
        near.rows[k] = path[int(draws[10 + pick] * n)]
        k += 1
    return rewire_about(tree, branches, scene, new, k, root, goal, draws, work)


@kernel
def rrt_star(
    tree: Tree, branches: Branches, scene: Scene, root: int, goal: int, draws: Float2D, work: Workspace
) -> tuple[int, int]:
    """RRT* iterations, one a row of ``draws`` (M, STAR_DRAWS), on the tree below ``root``.

    The tree grows by the dynamic-domain step; every new node looks for a better parent among its k
    nearest and some waypoints, and offers itself to them as one; two waypoints are tried for a short
    cut. Goals of ``branches`` are still to be passed on the way. Returns edges rewired and nodes pruned.
    """
    path, capacity = work.path, tree.parent.shape[0]
    n = path_to(tree, root, goal, path)
    rewired, pruned = 0, prune_by_bounds(tree, branches, scene, path, n, work)
    for m in range(draws.shape[0]):
        if tree.count[0] + MAX_ROWS >= capacity:
            break
        work.stats[3] += 1
        more = short_cut(tree, branches, scene, n, goal, draws[m], work)
        more += grow_and_rewire(tree, branches, scene, n, root, goal, draws[m], work)
        if more > 0:
            rewired += more
            n = path_to(tree, root, goal, path)
            pruned += prune_by_bounds(tree, branches, scene, path, n, work)
    return rewired, pruned
