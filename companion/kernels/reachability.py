"""Reachability set of a DT by its tree (paper 3.2.2, Algorithm 1).

A PathTree node is *reachable* through a TTree node when some point ``q_B`` on the horizontal
circle of radius RD_max about it is seen from it, lies on a free ground line from the TTree node and
is reached in time. The estimator keeps, for each node, the nearest position found for the DT at the
time the aircraft gets there.

Symbols: ``d`` the DT, ``j`` a TTree node, ``i`` a PathTree node, ``rd`` RD_max, ``v`` the DT's speed.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from companion.kernels.dubins import distance_to_point
from companion.kernels.geometry import segment_blocked
from companion.kernels.layout import FloatArray, IntArray, Obstacles, Pursuers, Tree

NUM_BEARINGS = 16
TRIED_BEARINGS = 9  # those of the half circle towards the TTree node; the far half is reached later
MAX_NEAR = 16
NEWS_M = 15.0  # a DT position nearer by this much is news
EYE_M = 2.0  # sight lines start this far above the ground
EX_RRT, RRT_REACH, RRT = 0, 1, 2


@nb.njit(cache=True, nogil=True)
def is_way_blocked(
    x0: float, y0: float, z0: float, x1: float, y1: float, z1: float, airborne: bool, obstacles: Obstacles
) -> bool:
    """Whether a DT cannot go straight from one point to another; ground vehicles stay on the ground."""
    if airborne:
        return segment_blocked(x0, y0, z0, x1, y1, z1, obstacles)
    return segment_blocked(x0, y0, z0, x1, y1, z0, obstacles)


@nb.njit(cache=True, nogil=True)
def travel_time(pursuers: Pursuers, d: int, j: int, x: float, y: float, z: float) -> float:
    """Earliest time from a TTree node to a point, by Dubins distance over speed [s]."""
    v = pursuers.model[d, 0]
    if v <= 0.0:
        return math.inf
    px, py, pz = pursuers.position[d, j]
    flat = distance_to_point(px, py, pursuers.heading[d, j], x, y, pursuers.model[d, 2])
    if pursuers.model[d, 3] > 0.0:
        flat = math.sqrt(flat * flat + (z - pz) ** 2)
    return flat / v


@nb.njit(cache=True, nogil=True)
def nearest_position(
    pursuers: Pursuers, d: int, j: int, bx: float, by: float, x: float, y: float, z: float, spare: float,
    obstacles: Obstacles, out: FloatArray,
) -> None:  # fmt: skip
    """Where the DT can be when the aircraft is at (x, y, z): from q_B on towards it.

    ``spare`` is the way [m] the DT has left on reaching q_B. It goes on towards the point below the
    aircraft as far as that is free and the aircraft stays in sight; else it waits at q_B. ``out`` (3,).
    """
    airborne = pursuers.model[d, 3] > 0.0
    ground = pursuers.position[d, j, 2]
    out[0], out[1], out[2] = bx, by, ground
    bz = ground
    if airborne:
        rise = z - ground
        step = min(abs(rise), spare)
        bz = ground + math.copysign(step, rise)
        out[2] = bz
    dx, dy = x - bx, y - by
    left = math.sqrt(dx * dx + dy * dy)
    if left == 0.0:
        return
    share = min(1.0, spare / left)
    while share > 0.1:
        nx, ny = bx + share * dx, by + share * dy
        if not is_way_blocked(bx, by, bz, nx, ny, bz, airborne, obstacles) and not segment_blocked(
            nx, ny, bz + EYE_M, x, y, z, obstacles
        ):
            out[0], out[1] = nx, ny
            return
        share *= 0.5


@nb.njit(cache=True, nogil=True)
def is_reachable(
    pursuers: Pursuers, d: int, j: int, x: float, y: float, z: float, time: float, obstacles: Obstacles,
    boundary: FloatArray, estimate: FloatArray,
) -> bool:  # fmt: skip
    """Whether a DT reaches a node through TTree node ``j`` before ``time`` (paper Fig. 2).

    ``boundary`` (2,) receives q_B, or the circle's nearest point where none is found; ``estimate``
    (3,) the nearest position of the DT. A TTree node inside the circle is its own q_B.
    """
    rd, v = pursuers.model[d, 1], pursuers.model[d, 0]
    airborne = pursuers.model[d, 3] > 0.0
    px, py, pz = pursuers.position[d, j]
    dx, dy = px - x, py - y
    away = math.sqrt(dx * dx + dy * dy)
    base = math.atan2(dy, dx)
    slack = time - pursuers.time[d, j]
    inside = away <= rd
    boundary[0], boundary[1] = (px, py) if inside else (x + rd * math.cos(base), y + rd * math.sin(base))
    if slack < 0.0 or away - rd > v * slack:
        return False
    if inside and not segment_blocked(px, py, pz + EYE_M, x, y, z, obstacles):
        nearest_position(pursuers, d, j, px, py, x, y, z, v * slack, obstacles, estimate)
        return True
    for k in range(TRIED_BEARINGS):
        turn = ((k + 1) // 2) * (1.0 if k % 2 == 1 else -1.0)
        angle = base + turn * 2.0 * math.pi / NUM_BEARINGS
        bx, by = x + rd * math.cos(angle), y + rd * math.sin(angle)
        if math.hypot(bx - px, by - py) > v * slack:
            if not inside:
                return False  # bearings go outwards: the rest is farther still
            continue
        needed = travel_time(pursuers, d, j, bx, by, z)
        if needed > slack or segment_blocked(bx, by, pz + EYE_M, x, y, z, obstacles):
            continue
        if is_way_blocked(px, py, pz, bx, by, pz, airborne, obstacles):
            continue
        boundary[0], boundary[1] = bx, by
        nearest_position(pursuers, d, j, bx, by, x, y, z, v * (slack - needed), obstacles, estimate)
        return True
    return False


@nb.njit(cache=True, nogil=True)
def connect(
    pursuers: Pursuers, d: int, j: int, x: float, y: float, greedy: bool, obstacles: Obstacles
) -> int:
    """``Connect`` one step, or ``Greedy-Connect`` steps until (x, y) or an obstacle.

    Returns the last node: ``j`` itself where nothing could be added.
    """
    step = pursuers.model[d, 4]
    airborne = pursuers.model[d, 3] > 0.0
    last = j
    while step > 0.0 and pursuers.count[d] < pursuers.position.shape[1]:
        px, py, pz = pursuers.position[d, last]
        dx, dy = x - px, y - py
        left = math.sqrt(dx * dx + dy * dy)
        if left < 1.0:
            break
        share = min(1.0, step / left)
        nx, ny = px + share * dx, py + share * dy
        b = pursuers.bounds
        if nx < b[0] or nx > b[1] or ny < b[2] or ny > b[3]:
            break
        if is_way_blocked(px, py, pz, nx, ny, pz, airborne, obstacles):
            break
        n = pursuers.count[d]
        pursuers.position[d, n, 0], pursuers.position[d, n, 1], pursuers.position[d, n, 2] = nx, ny, pz
        pursuers.heading[d, n] = math.atan2(dy, dx)
        pursuers.parent[d, n] = last
        pursuers.time[d, n] = pursuers.time[d, last] + travel_time(pursuers, d, last, nx, ny, pz)
        pursuers.count[d] = n + 1
        last = n
        if not greedy or share >= 1.0:
            break
    return last


@nb.njit(cache=True, nogil=True)
def near_pursuer_nodes(pursuers: Pursuers, d: int, x: float, y: float, k: int, out: IntArray) -> int:
    """The ``k`` TTree nodes nearest to a point, by rising time stamp, into ``out`` (MAX_NEAR,)."""
    best = np.full(MAX_NEAR, np.inf)
    position = pursuers.position[d]  # held locally: numba counts references at every field access
    found = 0
    for j in range(pursuers.count[d]):
        d2 = (position[j, 0] - x) ** 2 + (position[j, 1] - y) ** 2
        if found < k or d2 < best[k - 1]:
            found = _insert(best, out, found, k, d2, j)
    _sort_by(pursuers.time[d], out, found)
    return found


@nb.njit(cache=True, nogil=True)
def near_path_nodes(tree: Tree, x: float, y: float, k: int, out: IntArray) -> int:
    """The ``k`` searched PathTree nodes nearest to a ground point, by rising time stamp."""
    best = np.full(MAX_NEAR, np.inf)
    state, active = tree.state, tree.active
    found = 0
    for i in range(tree.count[0]):
        if active[i] == 1:
            d2 = (state[i, 0] - x) ** 2 + (state[i, 1] - y) ** 2
            if found < k or d2 < best[k - 1]:
                found = _insert(best, out, found, k, d2, i)
    _sort_by(tree.time, out, found)
    return found


@nb.njit(cache=True, nogil=True)
def _insert(best: FloatArray, out: IntArray, found: int, k: int, value: float, index: int) -> int:
    """Keep the ``k`` smallest values, sorted, with their indices."""
    if found == k and value >= best[k - 1]:
        return found
    if found < k:
        found += 1
    at = found - 1
    while at > 0 and best[at - 1] > value:
        best[at], out[at] = best[at - 1], out[at - 1]
        at -= 1
    best[at], out[at] = value, index
    return found


@nb.njit(cache=True, nogil=True)
def _sort_by(keys: FloatArray, out: IntArray, n: int) -> None:
    """Sort the first ``n`` indices by their keys."""
    for i in range(1, n):
        index = out[i]
        at = i
        while at > 0 and keys[out[at - 1]] > keys[index]:
            out[at] = out[at - 1]
            at -= 1
        out[at] = index


@nb.njit(cache=True, nogil=True)
def note_reached(tree: Tree, d: int, i: int, estimate: FloatArray, changed: IntArray, num: int) -> int:
    """Keep the DT's nearest position for a node; list the node in ``changed`` where it is news."""
    old = tree.threat_point[i, d]
    if old[3] > 0.0:
        was = (old[0] - tree.state[i, 0]) ** 2 + (old[1] - tree.state[i, 1]) ** 2
        now = (estimate[0] - tree.state[i, 0]) ** 2 + (estimate[1] - tree.state[i, 1]) ** 2
        if now >= was - NEWS_M * NEWS_M:
            return num
    old[0], old[1], old[2], old[3] = estimate[0], estimate[1], estimate[2], 1.0
    if num < changed.shape[0]:
        changed[num] = i
        num += 1
    return num


@nb.njit(cache=True, nogil=True)
def spread_to_neighbours(
    tree: Tree, pursuers: Pursuers, d: int, i: int, j: int, obstacles: Obstacles, changed: IntArray, num: int
) -> int:
    """``RSCal``: test the parent and the nearest nodes of a directly reachable one (indirect ones)."""
    near = np.empty(MAX_NEAR, dtype=np.int64)
    boundary, estimate = np.empty(2), np.empty(3)
    found = near_path_nodes(tree, tree.state[i, 0], tree.state[i, 1], 4, near)
    if tree.parent[i] >= 0 and found < MAX_NEAR:
        near[found] = tree.parent[i]
        found += 1
    for n in range(found):
        q = near[n]
        if q != i and is_reachable(
            pursuers, d, j, tree.state[q, 0], tree.state[q, 1], tree.state[q, 2], tree.time[q], obstacles,
            boundary, estimate,
        ):  # fmt: skip
            num = note_reached(tree, d, q, estimate, changed, num)
    return num


@nb.njit(cache=True, nogil=True)
def goal_bias_connect(
    tree: Tree, pursuers: Pursuers, d: int, i: int, j: int, obstacles: Obstacles, changed: IntArray, num: int
) -> tuple[bool, int]:
    """Reach node ``i`` through TTree node ``j`` and grow to q_B greedily, else grow one step.

    Returns whether it was reached, and the new length of ``changed``.
    """
    boundary, estimate = np.empty(2), np.empty(3)
    x, y, z = tree.state[i, 0], tree.state[i, 1], tree.state[i, 2]
    if is_reachable(pursuers, d, j, x, y, z, tree.time[i], obstacles, boundary, estimate):
        last = connect(pursuers, d, j, boundary[0], boundary[1], True, obstacles)
        num = note_reached(tree, d, i, estimate, changed, num)
        return True, spread_to_neighbours(tree, pursuers, d, i, last, obstacles, changed, num)
    connect(pursuers, d, j, boundary[0], boundary[1], False, obstacles)
    return False, num


@nb.njit(cache=True, nogil=True)
def reach(
    tree: Tree, pursuers: Pursuers, d: int, i: int, k: int, obstacles: Obstacles, changed: IntArray, num: int
) -> int:
    """``reach``: the k nearest TTree nodes, earliest first, until node ``i`` is reached."""
    near = np.empty(MAX_NEAR, dtype=np.int64)
    for n in range(near_pursuer_nodes(pursuers, d, tree.state[i, 0], tree.state[i, 1], k, near)):
        done, num = goal_bias_connect(tree, pursuers, d, i, near[n], obstacles, changed, num)
        if done:
            break
    return num


@nb.njit(cache=True, nogil=True)
def reach_from_root(
    tree: Tree, pursuers: Pursuers, d: int, i: int, obstacles: Obstacles, changed: IntArray, num: int
) -> tuple[bool, int]:
    """Reach node ``i`` straight from where the DT is now, which is the earliest it can be anywhere."""
    boundary, estimate = np.empty(2), np.empty(3)
    x, y, z = tree.state[i, 0], tree.state[i, 1], tree.state[i, 2]
    if not is_reachable(pursuers, d, 0, x, y, z, tree.time[i], obstacles, boundary, estimate):
        return False, num
    return goal_bias_connect(tree, pursuers, d, i, 0, obstacles, changed, num)


@nb.njit(cache=True, nogil=True)
def multi_connect(
    tree: Tree, pursuers: Pursuers, d: int, x: float, y: float, k: int, obstacles: Obstacles,
    changed: IntArray, num: int,
) -> int:  # fmt: skip
    """``multi-connect``: explore towards a sample, then ``multi-reach`` from each new node."""
    near, targets = np.empty(MAX_NEAR, dtype=np.int64), np.empty(MAX_NEAR, dtype=np.int64)
    for n in range(near_pursuer_nodes(pursuers, d, x, y, k, near)):
        near[n] = connect(pursuers, d, near[n], x, y, False, obstacles)
        px, py = pursuers.position[d, near[n], 0], pursuers.position[d, near[n], 1]
        for m in range(near_path_nodes(tree, px, py, k, targets)):
            done, num = goal_bias_connect(tree, pursuers, d, targets[m], near[n], obstacles, changed, num)
            if done:
                return num
    return num


@nb.njit(cache=True, nogil=True)
def explore_plainly(
    tree: Tree, pursuers: Pursuers, d: int, i: int, x: float, y: float, greedy: bool, obstacles: Obstacles,
    changed: IntArray, num: int,
) -> int:  # fmt: skip
    """The comparators' step: grow the nearest TTree node towards (x, y), then test nodes near it."""
    near = np.empty(MAX_NEAR, dtype=np.int64)
    boundary, estimate = np.empty(2), np.empty(3)
    if near_pursuer_nodes(pursuers, d, x, y, 1, near) == 0:
        return num
    last = connect(pursuers, d, near[0], x, y, greedy, obstacles)
    px, py = pursuers.position[d, last, 0], pursuers.position[d, last, 1]
    found = near_path_nodes(tree, px, py, 3, near)
    near[found] = i
    for n in range(found + 1):
        q = near[n]
        if is_reachable(
            pursuers, d, last, tree.state[q, 0], tree.state[q, 1], tree.state[q, 2], tree.time[q],
            obstacles, boundary, estimate,
        ):  # fmt: skip
            num = note_reached(tree, d, q, estimate, changed, num)
    return num


@nb.njit(cache=True, nogil=True)
def estimate_reachability(
    tree: Tree, pursuers: Pursuers, i: int, kind: int, p_tid: float, k: int, bounds: FloatArray,
    draws: FloatArray, obstacles: Obstacles, changed: IntArray,
) -> int:  # fmt: skip
    """Algorithm 1 for the new PathTree node ``i`` and every DT.

    The paper's ``reach`` tries the nearest TTree nodes only. These may have been reached by detours and
    stand too late where the DT, driving straight, would be early: here its root is tried before.

    ``draws`` (3,) uniform numbers; ``changed`` receives nodes whose DT position is news. Returns
    how many.
    """
    num = 0
    x = bounds[0] + draws[1] * (bounds[1] - bounds[0])
    y = bounds[2] + draws[2] * (bounds[3] - bounds[2])
    for d in range(pursuers.count.shape[0]):
        pursue = draws[0] <= p_tid
        if kind == EX_RRT:
            found, num = reach_from_root(tree, pursuers, d, i, obstacles, changed, num)
            if found:
                continue
            if pursue:
                num = reach(tree, pursuers, d, i, k, obstacles, changed, num)
            else:
                num = multi_connect(tree, pursuers, d, x, y, k, obstacles, changed, num)
        elif kind == RRT_REACH and pursue:
            num = explore_plainly(
                tree, pursuers, d, i, tree.state[i, 0], tree.state[i, 1], True, obstacles, changed, num
            )
        else:
            num = explore_plainly(tree, pursuers, d, i, x, y, False, obstacles, changed, num)
    return num


@nb.njit(cache=True, nogil=True)
def re_root(
    pursuers: Pursuers, d: int, x: float, y: float, z: float, heading: float, time: float,
    ahead: float, obstacles: Obstacles,
) -> None:  # fmt: skip
    """Update a TTree by a new observation (paper Fig. 1), in place.

    The root moves to the observation, its one child lies ``ahead`` metres along the predicted
    ``heading`` (less where an obstacle stops it). Nodes whose time stamp is not later than the
    child's are dropped; what remains is hung below the child and stamped anew.
    """
    n_old = pursuers.count[d]
    v = pursuers.model[d, 0]
    airborne = pursuers.model[d, 3] > 0.0
    share = 1.0
    while share > 0.05 and is_way_blocked(
        x, y, z, x + share * ahead * math.cos(heading), y + share * ahead * math.sin(heading), z, airborne,
        obstacles,
    ):  # fmt: skip
        share *= 0.5
    ahead = ahead * share if share > 0.05 else 0.0
    cx, cy = x + ahead * math.cos(heading), y + ahead * math.sin(heading)
    has_child = v > 0.0 and ahead > 0.0
    first_time = time + ahead / v if has_child else time
    new_index = np.full(n_old, -1, dtype=np.int64)
    base = 2 if has_child else 1
    n = base
    for j in range(n_old):  # parents come before children, so one pass renumbers
        if j > 0 and pursuers.time[d, j] > first_time and n < pursuers.position.shape[1]:
            new_index[j] = n
            n += 1
    kept = np.empty((n - base, 4))
    parents = np.empty(n - base, dtype=np.int64)
    for j in range(n_old):
        if new_index[j] >= 0:
            row = new_index[j] - base
            kept[row, :3] = pursuers.position[d, j]
            kept[row, 3] = pursuers.heading[d, j]
            up = pursuers.parent[d, j]
            parents[row] = new_index[up] if up >= 0 and new_index[up] >= 0 else base - 1
    pursuers.position[d, 0, 0], pursuers.position[d, 0, 1], pursuers.position[d, 0, 2] = x, y, z
    pursuers.heading[d, 0], pursuers.parent[d, 0], pursuers.time[d, 0] = heading, -1, time
    if has_child:
        pursuers.position[d, 1, 0], pursuers.position[d, 1, 1], pursuers.position[d, 1, 2] = cx, cy, z
        pursuers.heading[d, 1], pursuers.parent[d, 1], pursuers.time[d, 1] = heading, 0, first_time
    pursuers.count[d] = base
    _hang_again(pursuers, d, base, kept, parents, airborne, obstacles)


@nb.njit(cache=True, nogil=True)
def _hang_again(
    pursuers: Pursuers, d: int, base: int, kept: FloatArray, parents: IntArray, airborne: bool,
    obstacles: Obstacles,
) -> None:  # fmt: skip
    """Append kept nodes whose line to their parent is free; the others fall away with their branches."""
    where = np.full(base + kept.shape[0], -1, dtype=np.int64)
    for b in range(base):
        where[b] = b
    for row in range(kept.shape[0]):
        up = where[parents[row]]
        if up < 0:
            continue
        px, py, pz = pursuers.position[d, up]
        if is_way_blocked(px, py, pz, kept[row, 0], kept[row, 1], kept[row, 2], airborne, obstacles):
            continue
        n = pursuers.count[d]
        where[base + row] = n
        pursuers.position[d, n] = kept[row, :3]
        pursuers.heading[d, n] = math.atan2(kept[row, 1] - py, kept[row, 0] - px)
        pursuers.parent[d, n] = up
        pursuers.time[d, n] = pursuers.time[d, up] + travel_time(
            pursuers, d, up, kept[row, 0], kept[row, 1], kept[row, 2]
        )
        pursuers.count[d] = n + 1
