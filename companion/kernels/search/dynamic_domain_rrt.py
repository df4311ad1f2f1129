"""TreeExplore: the threat- and uncertainty-based dynamic-domain RRT (paper 4.4.1, formulas (7), (9)).

Symbols: ``q_s`` a sample, ``q_n`` the node extended, ``i`` a node's row.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from companion.kernels.aircraft.lqg_mp import collision_free, position_deviation, position_factor, propagate
from companion.kernels.aircraft.motion import OK, advance, state_status, steer, straight_after, wrapped
from companion.kernels.arrays import (
    FloatArray,
    IntArray,
    Limits,
    Obstacles,
    Scene,
    Search,
    ThreatModel,
    Threats,
    Tree,
    Uncertainty,
)
from companion.kernels.geometry.distance_field import FIRST_PICK, PICKS, draw_on_the_way, way_at
from companion.kernels.geometry.prism_distance import clearance, segment_blocked, segment_clear
from companion.kernels.threat.fuzzy_threat import MAX_THREATS, line_threat, node_threat, point_threat
from companion.kernels.threat.reachability import EYE_M, MAX_NEAR, estimate_reachability

RUNNING, REACHED, FULL = 0, 1, 2
DROPPED, BLOCKED, LEFT_HORIZON, REPEATED, EXTENDED = 0, 1, 2, 3, 4
MAX_K = 64
NONE, OUTSIDE = -1, -2  # no node is searched; the sample is in no near node's domain
MAX_DESCENT = 8  # children followed where the control towards a sample was tried already
MAX_STRAIGHT = 64  # steps of a greedy connection to the sub goal
TURN_STEPS = 12  # of them for the turn towards it
DRAWS = FIRST_PICK + PICKS  # uniform numbers an iteration uses
FAR = 1.0e4  # clearance beyond which p_c is 1 anyhow [m]


@nb.njit(cache=True, nogil=True)
def draw_sample(
    draws: FloatArray, zoom: float, centre: FloatArray, horizon: float, sub_goal: FloatArray, nearest: float,
    limits: Limits, q_s: FloatArray,
) -> None:  # fmt: skip
    """A sample in the horizon, or (GoalZoom) in the ball about the sub goal, into ``q_s`` (3,).

    Uniform in the disc (radius by the square root); in space its height is uniform over the wedge
    that climb and descent angle leave from the origin, within the ball: what lies outside cannot be
    flown to in this horizon.
    """
    zooming = draws[0] < zoom
    radius = nearest if zooming else horizon
    r = radius * math.sqrt(draws[1])
    angle = 2.0 * math.pi * draws[2]
    b = limits.bounds
    origin = sub_goal if zooming else centre
    q_s[0] = min(b[1], max(b[0], origin[0] + r * math.cos(angle)))
    q_s[1] = min(b[3], max(b[2], origin[1] + r * math.sin(angle)))
    q_s[2] = origin[2]
    if limits.dimension == 3:
        up, down = limits.climb_max, limits.descent_max
        if zooming:  # towards the sub goal the wedge opens backwards
            up, down = down, up
        high, low = math.tan(up) * r, -math.tan(down) * r
        q_s[2] = min(b[5], max(b[4], origin[2] + low + draws[3] * (high - low)))


@nb.njit(cache=True, nogil=True)
def turn_cost(state: FloatArray, x: float, y: float, z: float) -> float:
    """P_y of (9): absolute course change plus climb angle to a point; descent is free [rad]."""
    dx, dy, dz = x - state[0], y - state[1], z - state[2]
    flat = math.sqrt(dx * dx + dy * dy)
    yaw = abs(wrapped(math.atan2(dy, dx) - state[3]))
    return min(math.pi, yaw + max(0.0, math.atan2(dz, flat)))


@nb.njit(cache=True, nogil=True)
def step_cost(
    p: FloatArray, x: float, y: float, z: float, delta: float, threats: Threats, points: FloatArray,
    reach: FloatArray, model: ThreatModel, search: Search, scratch: FloatArray,
) -> float:  # fmt: skip
    """D_C of (9) from the state ``p`` (6,) to a point, lengths in planning units."""
    d = math.sqrt((x - p[0]) ** 2 + (y - p[1]) ** 2 + (z - p[2]) ** 2) / search.unit
    level = line_threat(
        p[0], p[1], p[2], x, y, z, p[5], delta, threats, points, reach, model, search.secondary, scratch
    )
    return search.cost_distance * d + search.cost_turn * turn_cost(p, x, y, z) + search.cost_threat * level


@nb.njit(cache=True, nogil=True)
def cost_distance(
    tree: Tree, i: int, x: float, y: float, z: float, threats: Threats, reach: FloatArray,
    model: ThreatModel, search: Search, scratch: FloatArray,
) -> float:  # fmt: skip
    """:func:`step_cost` from node ``i``."""
    return step_cost(
        tree.state[i], x, y, z, tree.delta[i], threats, tree.threat_point[i], reach, model, search, scratch
    )


@nb.njit(cache=True, nogil=True)
def near_nodes(tree: Tree, q_s: FloatArray, k: int, best_d2: FloatArray, near: IntArray) -> int:
    """The ``k`` searched nodes nearest to a point, by rising distance, into ``best_d2`` and ``near``."""
    state, active = tree.state, tree.active
    x, y, z = q_s[0], q_s[1], q_s[2]
    found = 0
    for i in range(tree.count[0]):
        if active[i] == 0:
            continue
        d2 = (state[i, 0] - x) ** 2 + (state[i, 1] - y) ** 2 + (state[i, 2] - z) ** 2
        if found == k and d2 >= best_d2[k - 1]:
            continue
        if found < k:
            found += 1
        at = found - 1
        while at > 0 and best_d2[at - 1] > d2:
            best_d2[at], near[at] = best_d2[at - 1], near[at - 1]
            at -= 1
        best_d2[at], near[at] = d2, i
    return found


@nb.njit(cache=True, nogil=True)
def num_near(n: int, dimension: int) -> int:
    """Number of neighbours, max(3, ceil(e·(1 + 1/d)·ln n)), of a tree of n nodes (Karaman, Frazzoli 2011)."""
    return min(MAX_K, max(3, int(math.ceil(math.e * (1.0 + 1.0 / dimension) * math.log(max(n, 2))))))


@nb.njit(cache=True, nogil=True)
def choose_node(
    tree: Tree, q_s: FloatArray, threats: Threats, reach: FloatArray, model: ThreatModel, search: Search,
    dimension: int, scratch: FloatArray,
) -> int:  # fmt: skip
    """Of the k nearest searched nodes the one with the least cost distance.

    k is :func:`num_near`, or 1 without the k-near strategy. ``NONE``
    where no node is searched, ``OUTSIDE`` where the sample lies in the domain of none of the k: it
    would be dropped whichever was chosen.
    """
    k = num_near(tree.count[0], dimension) if search.use_k_near == 1 else 1
    best_d2, near = np.empty(MAX_K), np.empty(MAX_K, dtype=np.int64)
    found = near_nodes(tree, q_s, k, best_d2, near)
    if found == 0:
        return NONE
    inside = False
    for m in range(found):
        inside = inside or best_d2[m] <= tree.domain[near[m]] ** 2
    if not inside:
        return OUTSIDE
    if search.use_k_near == 0:
        return int(near[0])
    best, chosen = math.inf, -1
    for m in range(found):
        i = near[m]
        bound = search.cost_distance * math.sqrt(best_d2[m]) / search.unit
        if bound >= best:
            break  # nodes come by distance, which bounds their cost from below
        if bound + search.cost_turn * turn_cost(tree.state[i], q_s[0], q_s[1], q_s[2]) >= best:
            continue
        cost = cost_distance(tree, i, q_s[0], q_s[1], q_s[2], threats, reach, model, search, scratch)
        if cost < best:
            best, chosen = cost, i
    return int(chosen)


@nb.njit(cache=True, nogil=True)
def domain_radius(clear: float, level: float, blocked: int, search: Search) -> float:
    """TUDD of (7) [m].

    A node never blocked has no limit from DD alone: its uncertainty limits it only where p_c is
    below ``search.certain``, its threat wherever TI > 0.
    """
    if search.use_domain == 0:
        return math.inf
    radius = math.inf
    p_c = clear if search.use_uncertainty == 1 else 1.0
    if blocked == 1 or p_c < search.certain:
        radius = search.k_clear * p_c * search.domain
    if level > 0.0:
        radius = min(radius, search.domain / (search.k_threat * level))
    return min(radius, search.domain) if blocked == 1 else radius


@nb.njit(cache=True, nogil=True)
def child_by(tree: Tree, i: int, w: float, wp: float) -> int:
    """The child node ``i`` already has by the same control, or -1."""
    if tree.children[i] > 0:
        for c in range(i + 1, tree.count[0]):
            if tree.parent[c] == i and abs(tree.rate[c, 0] - w) < 1e-6 and abs(tree.rate[c, 1] - wp) < 1e-6:
                return c
    return -1


@nb.njit(cache=True, nogil=True)
def extend(
    tree: Tree, i: int, q_s: FloatArray, centre: FloatArray, horizon: float, obstacles: Obstacles,
    limits: Limits, control: FloatArray, out: FloatArray, stats: IntArray,
) -> int:  # fmt: skip
    """One step from node ``i`` towards a sample: its control (3,) and end state (6,), or why not.

    ``stats[0]`` counts collision checks (NCDC).
    """
    state = tree.state[i]
    a, w, wp = steer(state, tree.turn[i], tree.straight[i], q_s[0], q_s[1], q_s[2], limits)
    control[0], control[1], control[2] = a, w, wp
    if child_by(tree, i, w, wp) >= 0:
        return REPEATED
    advance(state, a, w, wp, limits.tau, out)
    if state_status(out, limits) != OK:
        return BLOCKED
    away = (out[0] - centre[0]) ** 2 + (out[1] - centre[1]) ** 2 + (out[2] - centre[2]) ** 2
    if away > horizon * horizon:
        return LEFT_HORIZON
    stats[0] += 1
    return EXTENDED if is_edge_clear(state, out, w, obstacles, limits) else BLOCKED


@nb.njit(cache=True, nogil=True)
def is_edge_clear(state: FloatArray, out: FloatArray, w: float, obstacles: Obstacles, limits: Limits) -> bool:
    """Whether one step keeps the margin: its chord does, widened by the arc's sagitta."""
    sagitta = 0.125 * distance_to(state, out) * abs(w) * limits.tau
    return segment_clear(
        state[0], state[1], state[2], out[0], out[1], out[2], obstacles, limits.margin + sagitta
    )


@nb.njit(cache=True, nogil=True)
def assess(
    tree: Tree, i: int, threats: Threats, reach: FloatArray, model: ThreatModel, normals: FloatArray,
    search: Search, dimension: int, scratch: FloatArray, levels: FloatArray,
) -> None:  # fmt: skip
    """Threat level and TUDD of a node, from its covariance and the DTs' present estimate."""
    factor = np.empty((3, 3))
    if search.use_uncertainty == 1:
        position_factor(tree.cov_error[i], tree.cov_estimate[i], dimension, factor)
        tree.level[i] = node_threat(
            tree.state[i], factor, tree.delta[i], threats, tree.threat_point[i], reach, model, normals,
            scratch, levels,
        )  # fmt: skip
    else:
        factor[:] = 0.0
        tree.level[i] = node_threat(
            tree.state[i], factor, 0.0, threats, tree.threat_point[i], reach, model, normals[:1], scratch,
            levels,
        )  # fmt: skip
    tree.domain[i] = domain_radius(tree.clear[i], tree.level[i], tree.blocked[i], search)
    if search.no_fly == 1:
        for d in range(reach.shape[0]):
            if tree.threat_point[i, d, 3] > 0.0:
                tree.domain[i] = 0.0


@nb.njit(cache=True, nogil=True)
def add_node(
    tree: Tree, parent: int, state: FloatArray, control: FloatArray, dt: float, obstacles: Obstacles,
    limits: Limits, tables: Uncertainty, search: Search,
) -> int:  # fmt: skip
    """Append a node with its time, turn rule, covariance and clearance; returns its row.

    ``control`` (3,) a, w, wp act for ``dt`` seconds.
    """
    i = tree.count[0]
    tree.count[0] = i + 1
    tree.state[i] = state
    tree.parent[i] = parent
    tree.children[parent] += 1
    tree.children[i] = 0
    tree.time[i] = tree.time[parent] + dt
    tree.rate[i, 0], tree.rate[i, 1] = control[1], control[2]
    length = dt * 0.5 * (state[5] + tree.state[parent, 5])
    tree.turn[i], tree.straight[i] = straight_after(
        tree.turn[parent], tree.straight[parent], control[1], length
    )
    propagate(
        tree.state[parent], control[0], control[1], control[2], dt, tables, tree.cov_error[parent],
        tree.cov_estimate[parent], tree.cov_error[i], tree.cov_estimate[i],
    )  # fmt: skip
    deviation = position_deviation(tree.cov_error[i], tree.cov_estimate[i], limits.dimension)
    tree.delta[i] = deviation / search.unit
    free = clearance(state[0], state[1], state[2], obstacles, FAR)
    tree.clear[i] = collision_free(free, deviation, limits.dimension)
    tree.blocked[i] = 0
    tree.active[i] = 1
    tree.threat_point[i] = 0.0
    return int(i)


@nb.njit(cache=True, nogil=True)
def drop_last(tree: Tree, parent: int) -> None:
    """Take back the node added last."""
    tree.count[0] -= 1
    tree.active[tree.count[0]] = 0
    tree.children[parent] -= 1


@nb.njit(cache=True, nogil=True)
def inherit_threats(tree: Tree, i: int, parent: int, walls: Obstacles) -> None:
    """A DT that could be somewhere for the parent can wait there for the child, if it sees it."""
    for d in range(tree.threat_point.shape[1]):
        point = tree.threat_point[parent, d]
        if point[3] > 0.0 and not segment_blocked(
            point[0],
            point[1],
            point[2] + EYE_M,
            tree.state[i, 0],
            tree.state[i, 1],
            tree.state[i, 2],
            walls,
        ):
            tree.threat_point[i, d] = point


@nb.njit(cache=True, nogil=True)
def extend_or_descend(
    tree: Tree, scene: Scene, q_n: int, q_s: FloatArray, centre: FloatArray, horizon: float,
    control: FloatArray, state: FloatArray, stats: IntArray,
) -> tuple[int, int]:  # fmt: skip
    """:func:`extend`, following children that were made by the same control; the node and the outcome."""
    outcome = REPEATED
    for _ in range(MAX_DESCENT + 1):
        outcome = extend(
            tree, q_n, q_s, centre, horizon, scene.obstacles, scene.limits, control, state, stats
        )
        if outcome != REPEATED:
            break
        child = child_by(tree, q_n, control[1], control[2])
        if tree.active[child] == 0 or distance_to(tree.state[child], q_s) > tree.domain[child]:
            break
        q_n = child
    return q_n, outcome


@nb.njit(cache=True, nogil=True)
def grow(
    tree: Tree, scene: Scene, q_n: int, state: FloatArray, control: FloatArray, dt: float,
    reach: FloatArray, draws: FloatArray, changed: IntArray, scratch: FloatArray, levels: FloatArray,
    stats: IntArray,
) -> int:  # fmt: skip
    """Add a node below ``q_n`` and all that is known of it (Algorithm 2, lines 9 to 16).

    Returns its row, or -1 where its threat level passes ``level_max``; ways out of a threat already
    entered stay open.
    """
    threats, model, limits, search = scene.threats, scene.model, scene.limits, scene.search
    i = add_node(tree, q_n, state, control, dt, scene.obstacles, limits, scene.tables, search)
    inherit_threats(tree, i, q_n, scene.walls)
    num = estimate_reachability(
        tree, scene.pursuers, i, search.estimator, search.p_tid, search.k_pursuer, limits.bounds,
        draws[4:7], scene.walls, changed,
    )  # fmt: skip
    assess(tree, i, threats, reach, model, scene.tables.normals, search, limits.dimension, scratch, levels)
    if tree.level[i] > search.level_max and tree.level[i] >= tree.level[q_n]:
        drop_last(tree, q_n)
        stats[2] += 1
        return -1
    for c in range(num):
        if changed[c] != i:
            assess(
                tree, changed[c], threats, reach, model, scene.tables.normals, search, limits.dimension,
                scratch, levels,
            )  # fmt: skip
    tree.cost[i] = tree.cost[q_n] + cost_distance(
        tree, q_n, state[0], state[1], state[2], threats, reach, model, search, scratch
    )
    tree.way[i] = way_at(scene.guide, state[0], state[1])
    return i


@nb.njit(cache=True, nogil=True)
def lay_straight_in(
    tree: Tree, scene: Scene, i: int, centre: FloatArray, horizon: float, sub_goal: FloatArray,
    reach: FloatArray, states: FloatArray, controls: FloatArray, scratch: FloatArray, stats: IntArray,
) -> int:  # fmt: skip
    """Steps from node ``i`` to the sub goal, each with the sub goal in its domain; 0 where there are none.

    ``Greedy-Connect`` (paper 3.2.2) for the aircraft: what (7) allows one step it allows the next. The
    domain is judged from the threat at the step itself; ``states`` (MAX_STRAIGHT, 6) and ``controls``
    (MAX_STRAIGHT, 3) receive the steps.
    """
    limits, search = scene.limits, scene.search
    left = distance_to(tree.state[i], sub_goal)
    if left > tree.domain[i] or left <= search.tolerance:
        return 0
    stats[0] += 1
    x, y, z = tree.state[i, 0], tree.state[i, 1], tree.state[i, 2]
    if segment_blocked(x, y, z, sub_goal[0], sub_goal[1], sub_goal[2], scene.obstacles):
        return 0
    most = min(MAX_STRAIGHT, int(left / (limits.v_min * limits.tau)) + TURN_STEPS)
    turn, straight, state = tree.turn[i], tree.straight[i], tree.state[i]
    for k in range(most):
        out, control = states[k], controls[k]
        a, w, wp = steer(state, turn, straight, sub_goal[0], sub_goal[1], sub_goal[2], limits)
        control[0], control[1], control[2] = a, w, wp
        advance(state, a, w, wp, limits.tau, out)
        if state_status(out, limits) != OK or distance_to(out, centre) > horizon:
            return 0
        stats[0] += 1
        if not is_edge_clear(state, out, w, scene.obstacles, limits):
            return 0
        left = distance_to(out, sub_goal)
        if left <= search.tolerance:
            return k + 1
        mu, nu = point_threat(
            out[0], out[1], out[2], out[3], out[4], out[5], tree.delta[i], scene.threats,
            tree.threat_point[i], reach, scene.model, scratch,
        )  # fmt: skip
        if left > domain_radius(1.0, max(0.0, mu - nu), 0, search):
            return 0
        turn, straight = straight_after(turn, straight, w, limits.tau * 0.5 * (out[5] + state[5]))
        state = out
    return 0


@nb.njit(cache=True, nogil=True)
def explore(
    tree: Tree, scene: Scene, centre: FloatArray, horizon: float, sub_goal: FloatArray, draws: FloatArray,
    stats: IntArray,
) -> tuple[int, int]:  # fmt: skip
    """Grow the tree by one iteration a row of ``draws`` (M, DRAWS), until the sub goal is reached.

    ``stats`` counts [0] collision checks, [1] samples dropped by TUDD, [2] failed extensions,
    [3] iterations. Returns ``REACHED`` and the node, else ``RUNNING`` or ``FULL`` and -1.
    """
    search, guide, limits = scene.search, scene.guide, scene.limits
    q_s, control, state = np.empty(3), np.empty(3), np.empty(6)
    states, controls = np.empty((MAX_STRAIGHT, 6)), np.empty((MAX_STRAIGHT, 3))
    scratch, levels = np.empty((MAX_THREATS, 2)), np.empty(scene.tables.normals.shape[0])
    changed = np.empty(4 * MAX_NEAR, dtype=np.int64)
    reach = scene.pursuers.model[:, 1].copy()
    nearest = math.inf
    for i in range(tree.count[0]):
        if tree.active[i] == 1:
            nearest = min(nearest, distance_to(tree.state[i], sub_goal))
            tree.way[i] = way_at(guide, tree.state[i, 0], tree.state[i, 1])
    for m in range(draws.shape[0]):
        if tree.count[0] + MAX_STRAIGHT >= tree.parent.shape[0]:
            return FULL, -1
        stats[3] += 1
        follows = draws[m, 0] > 1.0 - guide.share
        if not (follows and draw_on_the_way(draws[m], tree, guide, sub_goal, limits, q_s)):
            draw_sample(draws[m], search.zoom, centre, horizon, sub_goal, nearest, limits, q_s)
        q_n = choose_node(tree, q_s, scene.threats, reach, scene.model, search, limits.dimension, scratch)
        if q_n == NONE:
            return RUNNING, -1
        if q_n == OUTSIDE or distance_to(tree.state[q_n], q_s) > tree.domain[q_n]:
            stats[1] += 1
            continue
        q_n, outcome = extend_or_descend(tree, scene, q_n, q_s, centre, horizon, control, state, stats)
        if outcome == BLOCKED:
            stats[2] += 1
            tree.blocked[q_n] = 1
            tree.domain[q_n] = min(search.domain, tree.domain[q_n]) if search.use_domain == 1 else math.inf
        if outcome != EXTENDED:
            continue
        i = grow(
            tree, scene, q_n, state, control, limits.tau, reach, draws[m], changed, scratch, levels, stats
        )
        if i < 0:
            continue
        if search.straight_in == 1:
            steps = lay_straight_in(
                tree, scene, i, centre, horizon, sub_goal, reach, states, controls, scratch, stats
            )
            for k in range(steps):
                nearest = min(nearest, distance_to(tree.state[i], sub_goal))
                if distance_to(tree.state[i], sub_goal) > tree.domain[i]:
                    break
                added = grow(
                    tree, scene, i, states[k], controls[k], limits.tau, reach, draws[m], changed, scratch,
                    levels, stats,
                )  # fmt: skip
                if added < 0:
                    break
                i = added
        away = distance_to(tree.state[i], sub_goal)
        nearest = min(nearest, away)
        if away <= search.tolerance:
            return REACHED, i
    return RUNNING, -1


@nb.njit(cache=True, nogil=True)
def distance_to(state: FloatArray, point: FloatArray) -> float:
    """Distance of a state's position to a point [m]."""
    return math.sqrt((state[0] - point[0]) ** 2 + (state[1] - point[1]) ** 2 + (state[2] - point[2]) ** 2)
