"""Reachability set of a DT by its tree (paper 3.2.2, Algorithm 1).

The estimator keeps, for each PathTree node, the nearest position found for each DT at the time the
aircraft gets there (see :mod:`companion.kernels.threat.intercept` for what reachable means).

Symbols: ``d`` the DT, ``j`` a TTree node, ``i`` a PathTree node, ``k`` of the k-near nodes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba as nb
import numpy as np

from companion.kernels.arrays import NUM_CELLS, FloatArray, IntArray, Obstacles, Pursuers, Tree
from companion.kernels.borrowed import unowned
from companion.kernels.geometry.grid_index import cell_along, cell_size, nearest
from companion.kernels.geometry.line_of_sight import Prisms, line_blocked, prisms_of
from companion.kernels.threat.intercept import AIR_CLIMB, EYE_M, NUM_BEARINGS, gets_near, way_length
from companion.kernels.threat.threat_tree import LEAST_STEP_M, Drivers, corner_towards, drivers_of

__all__ = [
    "EX_RRT", "EYE_M", "MAX_NEAR", "RRT", "RRT_REACH", "connect", "dt_positions", "estimate_reachability",
    "is_reachable", "near_path_nodes", "near_pursuer_nodes", "promising_corners",
]  # fmt: skip

MAX_NEAR = 16
NUM_NEIGHBOURS = 4  # of a directly reachable node that are tested too
NEWS_M = 15.0  # a DT position nearer by this much is news
EX_RRT, RRT_REACH, RRT = 0, 1, 2


class Nodes(NamedTuple):
    """The part of the PathTree that the estimator reads, and ``points``, which it writes."""

    state: FloatArray
    parent: IntArray
    time: FloatArray
    active: IntArray
    points: FloatArray


@nb.njit(cache=True, nogil=True, error_model="numpy")
def gets_to(
    drivers: Drivers, d: int, j: int, x: float, y: float, z: float, time: float, prisms: Prisms,
    out: FloatArray,
) -> bool:  # fmt: skip
    """Whether a DT gets a place into its reach through TTree node ``j`` before ``time``; ``out`` (6,)."""
    position, model = drivers.position, drivers.model
    return gets_near(
        position[d, j, 0], position[d, j, 1], position[d, j, 2], drivers.heading[d, j], model[d, 0],
        model[d, 1], model[d, 2], model[d, 3] > 0.0, time - drivers.time[d, j], x, y, z, prisms, out,
    )  # fmt: skip


@nb.njit(cache=True, nogil=True)
def is_reachable(
    pursuers: Pursuers, d: int, j: int, x: float, y: float, z: float, time: float, obstacles: Obstacles,
    boundary: FloatArray, estimate: FloatArray,
) -> bool:  # fmt: skip
    """Whether a DT reaches a place through TTree node ``j`` before ``time`` (paper Fig. 2).

    ``boundary`` (2,) receives q_B, or the circle's nearest point where none is found; ``estimate``
    (3,) the nearest position of the DT.
    """
    out = np.empty(6)
    found = gets_to(drivers_of(pursuers), d, j, x, y, z, time, prisms_of(obstacles), out)
    boundary[0], boundary[1] = out[0], out[1]
    if found:
        estimate[0], estimate[1], estimate[2] = out[3], out[4], out[5]
    return found


@nb.njit(cache=True, nogil=True, error_model="numpy")
def connect(
    drivers: Drivers, d: int, j: int, x: float, y: float, z: float, greedy: bool, prisms: Prisms
) -> int:
    """``Connect`` one step, or ``Greedy-Connect`` steps until the point or an obstacle.

    Ground vehicles keep their height. Returns the last node: ``j`` itself where nothing could be added.
    """
    position, heading, time, b = drivers.position, drivers.heading, drivers.time, drivers.bounds
    v, rho, step = drivers.model[d, 0], drivers.model[d, 2], drivers.model[d, 4]
    airborne = drivers.model[d, 3] > 0.0
    last, n = j, drivers.count[d]
    while step > 0.0 and n < position.shape[1]:
        px, py, pz = position[d, last, 0], position[d, last, 1], position[d, last, 2]
        dx, dy = x - px, y - py
        left = math.sqrt(dx * dx + dy * dy)
        if left < LEAST_STEP_M:
            break
        share = min(1.0, step / left)
        nx, ny, nz = px + share * dx, py + share * dy, pz
        if airborne:
            rise = AIR_CLIMB * share * left
            nz = min(pz + rise, max(pz - rise, z))
        if nx < b[0] or nx > b[1] or ny < b[2] or ny > b[3]:
            break
        if line_blocked(px, py, pz, nx, ny, nz, prisms):
            break
        position[d, n, 0], position[d, n, 1], position[d, n, 2] = nx, ny, nz
        needed = way_length(px, py, pz, heading[d, last], rho, airborne, nx, ny, nz) / v
        heading[d, n] = math.atan2(dy, dx)
        drivers.parent[d, n] = last
        time[d, n] = time[d, last] + needed
        last = n
        n += 1
        if not greedy or share >= 1.0:
            break
    drivers.count[d] = n
    return last


@nb.njit(cache=True, nogil=True)
def near_pursuer_nodes(pursuers: Pursuers, d: int, x: float, y: float, k: int, out: IntArray) -> int:
    """The ``k`` TTree nodes nearest to a point, by rising time stamp, into ``out`` (MAX_NEAR,)."""
    found = nearest(
        pursuers.cells[d], pursuers.chain[d], pursuers.places[d], pursuers.extent[d], pursuers.filled, d,
        pursuers.position[d], pursuers.count[d], pursuers.bounds, np.empty(0, dtype=np.int64), x, y, k,
        np.empty(MAX_NEAR), out,
    )  # fmt: skip
    _sort_by(pursuers.time[d], out, found)
    return found


@nb.njit(cache=True, nogil=True, error_model="numpy")
def promising_corners(
    drivers: Drivers, pursuers: Pursuers, d: int, x: float, y: float, time: float, prisms: Prisms,
    out: IntArray,
) -> int:  # fmt: skip
    """The corners by which a DT comes earliest to places about (x, y), in time: into ``out`` (MAX_NEAR,).

    Those of the cells in which (x, y) and the bearings of the circle about it lie, earliest first.
    """
    corners, table, b = pursuers.corners, pursuers.by_corner, pursuers.bounds
    v, rd, size = drivers.model[d, 0], drivers.model[d, 1], cell_size(pursuers.bounds)
    found = 0
    if corners[d, 1] == 0:
        return found
    for k in range(-1, NUM_BEARINGS):
        r = rd if k >= 0 else 0.0
        angle = 2.0 * math.pi * k / NUM_BEARINGS
        i = cell_along(x + r * math.cos(angle), b[0], size)
        j = cell_along(y + r * math.sin(angle), b[2], size)
        row = table[d, i * NUM_CELLS + j]
        if row == -2:
            cx, cy = b[0] + (i + 0.5) * size, b[2] + (j + 0.5) * size
            row = corner_towards(drivers, corners, d, cx, cy, prisms)
            table[d, i * NUM_CELLS + j] = row
        if row < 0 or found == MAX_NEAR:
            continue
        left = math.sqrt((drivers.position[d, row, 0] - x) ** 2 + (drivers.position[d, row, 1] - y) ** 2) - rd
        is_new = drivers.time[d, row] + max(0.0, left) / v <= time
        for m in range(found):
            if out[m] == row:
                is_new = False
        if is_new:
            out[found] = row
            found += 1
    _sort_by(drivers.time[d], out, found)
    return found


@nb.njit(cache=True, nogil=True)
def near_path_nodes(
    nodes: Nodes, n: int, pursuers: Pursuers, x: float, y: float, k: int, out: IntArray
) -> int:
    """The ``k`` nearest to a ground point of ``n`` PathTree nodes that are searched, by rising time stamp."""
    found = nearest(
        pursuers.path_cells, pursuers.path_chain, pursuers.path_places, pursuers.path_extent,
        pursuers.path_filled, 0, nodes.state, n, pursuers.bounds, nodes.active, x, y, k, np.empty(MAX_NEAR),
        out,
    )  # fmt: skip
    _sort_by(nodes.time, out, found)
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


@nb.njit(cache=True, nogil=True, error_model="numpy")
def come_nearer(
    drivers: Drivers, d: int, j: int, x: float, y: float, z: float, time: float, prisms: Prisms,
    scratch: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Put the DT's nearest position through TTree node ``j`` into ``out[d]`` if it is nearer than that."""
    if gets_to(drivers, d, j, x, y, z, time, prisms, scratch):
        was = (out[d, 0] - x) ** 2 + (out[d, 1] - y) ** 2 + (out[d, 2] - z) ** 2
        now = (scratch[3] - x) ** 2 + (scratch[4] - y) ** 2 + (scratch[5] - z) ** 2
        if out[d, 3] == 0.0 or now < was:
            out[d, 0], out[d, 1], out[d, 2], out[d, 3] = scratch[3], scratch[4], scratch[5], 1.0


@nb.njit(cache=True, nogil=True)
def dt_positions(
    pursuers: Pursuers, x: float, y: float, z: float, time: float, k: int, obstacles: Obstacles,
    out: FloatArray,
) -> None:  # fmt: skip
    """Nearest estimated position of every DT to a place at a time, from the TTrees as they are.

    Through its root, promising corners and the ``k`` nearest TTree nodes. ``out`` (D, 4) receives
    positions and 1 where the DT can be there in time.
    """
    if pursuers.count.shape[0] == 0:
        return
    pursuers, obstacles = unowned(pursuers), unowned(obstacles)
    drivers, prisms = drivers_of(pursuers), prisms_of(obstacles)
    near, scratch = np.empty(MAX_NEAR, dtype=np.int64), np.empty(6)
    position, model, stamps = drivers.position, drivers.model, drivers.time
    for d in range(drivers.count.shape[0]):
        out[d, 3] = 0.0
        away = math.sqrt((position[d, 0, 0] - x) ** 2 + (position[d, 0, 1] - y) ** 2)
        if away - model[d, 1] > model[d, 0] * max(0.0, time - stamps[d, 0]):
            continue
        come_nearer(drivers, d, 0, x, y, z, time, prisms, scratch, out)
        for m in range(promising_corners(drivers, pursuers, d, x, y, time, prisms, near)):
            come_nearer(drivers, d, near[m], x, y, z, time, prisms, scratch, out)
        for m in range(near_pursuer_nodes(pursuers, d, x, y, k, near)):
            come_nearer(drivers, d, near[m], x, y, z, time, prisms, scratch, out)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def note_reached(nodes: Nodes, d: int, i: int, out: FloatArray, changed: IntArray, num: int) -> int:
    """Keep the DT's nearest position ``out[3:]`` for a node; list the node where that is news."""
    points, state = nodes.points, nodes.state
    if points[i, d, 3] > 0.0:
        was = now = 0.0
        for a in range(3):
            was += (points[i, d, a] - state[i, a]) ** 2
            now += (out[3 + a] - state[i, a]) ** 2
        if now >= was - NEWS_M * NEWS_M:
            return num
    points[i, d, 0], points[i, d, 1], points[i, d, 2], points[i, d, 3] = out[3], out[4], out[5], 1.0
    if num < changed.shape[0]:
        changed[num] = i
        num += 1
    return num


@nb.njit(cache=True, nogil=True, error_model="numpy")
def test_node(
    nodes: Nodes, drivers: Drivers, d: int, i: int, j: int, prisms: Prisms, out: FloatArray,
    changed: IntArray, num: int,
) -> tuple[bool, int]:  # fmt: skip
    """Whether node ``i`` is reached through TTree node ``j``, noted where it is."""
    state = nodes.state
    if not gets_to(drivers, d, j, state[i, 0], state[i, 1], state[i, 2], nodes.time[i], prisms, out):
        return False, num
    return True, note_reached(nodes, d, i, out, changed, num)


@nb.njit(cache=True, nogil=True)
def spread_to_neighbours(
    nodes: Nodes, n: int, pursuers: Pursuers, drivers: Drivers, d: int, i: int, j: int, prisms: Prisms,
    out: FloatArray, changed: IntArray, num: int,
) -> int:  # fmt: skip
    """``RSCal``: test the parent and the nearest nodes of a directly reachable one (indirect ones)."""
    near = np.empty(MAX_NEAR, dtype=np.int64)
    found = near_path_nodes(nodes, n, pursuers, nodes.state[i, 0], nodes.state[i, 1], NUM_NEIGHBOURS, near)
    if nodes.parent[i] >= 0:
        near[found] = nodes.parent[i]
        found += 1
    for m in range(found):
        if near[m] != i:
            _, num = test_node(nodes, drivers, d, near[m], j, prisms, out, changed, num)
    return num


@nb.njit(cache=True, nogil=True, error_model="numpy")
def goal_bias_connect(
    nodes: Nodes, drivers: Drivers, d: int, i: int, j: int, prisms: Prisms, out: FloatArray,
    changed: IntArray, num: int,
) -> tuple[int, int]:  # fmt: skip
    """Reach node ``i`` through TTree node ``j`` and grow to q_B greedily, else grow one step.

    Returns the TTree node at q_B, or -1 where the node was not reached, and the new length of
    ``changed``. Whoever calls tests the node's neighbours from there.
    """
    done, num = test_node(nodes, drivers, d, i, j, prisms, out, changed, num)
    last = connect(drivers, d, j, out[0], out[1], out[2], done, prisms)
    return (last if done else -1), num


@nb.njit(cache=True, nogil=True)
def expand(
    nodes: Nodes, n: int, pursuers: Pursuers, d: int, i: int, pursue: bool, sample: FloatArray, k: int,
    prisms: Prisms, changed: IntArray, num: int,
) -> int:  # fmt: skip
    """Algorithm 1 of one DT: ``reach`` node ``i``, or ``multi-connect`` towards ``sample`` (3,).

    ``reach``: the k nearest TTree nodes, earliest first, until node ``i`` is reached. ``multi-connect``:
    the k nearest to the sample grow a step towards it, and each tries ``multi-reach``, the k nearest
    PathTree nodes, earliest first, until one is reached.

    The paper's ``reach`` tries the nearest TTree nodes only. These may have been reached by detours and
    stand too late where the DT, driving straight or round a corner, would be early: here its root and the
    corners by which it might be there earliest are tried before.
    """
    drivers, out = drivers_of(pursuers), np.empty(6)
    near, targets = np.empty(MAX_NEAR, dtype=np.int64), np.empty(MAX_NEAR, dtype=np.int64)
    x, y, z = nodes.state[i, 0], nodes.state[i, 1], nodes.state[i, 2]
    at, target = -1, i
    time = nodes.time[i]
    if gets_to(drivers, d, 0, x, y, z, time, prisms, out):
        at, num = goal_bias_connect(nodes, drivers, d, i, 0, prisms, out, changed, num)
    if at < 0:
        for m in range(promising_corners(drivers, pursuers, d, x, y, time, prisms, near)):
            if gets_to(drivers, d, near[m], x, y, z, time, prisms, out):
                at, num = goal_bias_connect(nodes, drivers, d, i, near[m], prisms, out, changed, num)
                break
    if at < 0 and pursue:
        for m in range(near_pursuer_nodes(pursuers, d, x, y, k, near)):
            at, num = goal_bias_connect(nodes, drivers, d, i, near[m], prisms, out, changed, num)
            if at >= 0:
                break
    elif at < 0:
        for m in range(near_pursuer_nodes(pursuers, d, sample[0], sample[1], k, near)):
            j = connect(drivers, d, near[m], sample[0], sample[1], sample[2], False, prisms)
            px, py = drivers.position[d, j, 0], drivers.position[d, j, 1]
            for q in range(near_path_nodes(nodes, n, pursuers, px, py, k, targets)):
                target = targets[q]
                at, num = goal_bias_connect(nodes, drivers, d, target, j, prisms, out, changed, num)
                if at >= 0:
                    break
            if at >= 0:
                break
    if at >= 0:
        num = spread_to_neighbours(nodes, n, pursuers, drivers, d, target, at, prisms, out, changed, num)
    return num


@nb.njit(cache=True, nogil=True)
def explore_plainly(
    nodes: Nodes, n: int, pursuers: Pursuers, d: int, i: int, sample: FloatArray, greedy: bool,
    prisms: Prisms, changed: IntArray, num: int,
) -> int:  # fmt: skip
    """The comparators' step: grow the nearest TTree node towards ``sample``, then test nodes near it."""
    drivers, out = drivers_of(pursuers), np.empty(6)
    near = np.empty(MAX_NEAR, dtype=np.int64)
    if near_pursuer_nodes(pursuers, d, sample[0], sample[1], 1, near) == 0:
        return num
    last = connect(drivers, d, near[0], sample[0], sample[1], sample[2], greedy, prisms)
    px, py = drivers.position[d, last, 0], drivers.position[d, last, 1]
    found = near_path_nodes(nodes, n, pursuers, px, py, 3, near)
    near[found] = i
    for m in range(found + 1):
        _, num = test_node(nodes, drivers, d, near[m], last, prisms, out, changed, num)
    return num


@nb.njit(cache=True, nogil=True)
def estimate_reachability(
    tree: Tree, pursuers: Pursuers, i: int, kind: int, p_tid: float, k: int, bounds: FloatArray,
    draws: FloatArray, obstacles: Obstacles, changed: IntArray,
) -> int:  # fmt: skip
    """Algorithm 1 for the new PathTree node ``i`` and every DT.

    ``bounds`` (6,) hold the samples, ``draws`` (3,) are uniform numbers; ``changed`` receives nodes
    whose DT position is news. Returns how many.
    """
    num = 0
    if pursuers.count.shape[0] == 0:
        return num
    tree, pursuers, obstacles = unowned(tree), unowned(pursuers), unowned(obstacles)
    nodes = Nodes(tree.state, tree.parent, tree.time, tree.active, tree.threat_point)
    n, prisms = tree.count[0], prisms_of(obstacles)
    pursue = draws[0] <= p_tid
    sample = np.empty(3)
    sample[0] = bounds[0] + draws[1] * (bounds[1] - bounds[0])
    sample[1] = bounds[2] + draws[2] * (bounds[3] - bounds[2])
    # Beyond p_tid the first draw is uniform once more.
    share = 0.0 if pursue else (draws[0] - p_tid) / (1.0 - p_tid)
    sample[2] = bounds[4] + share * (bounds[5] - bounds[4])
    if pursue and kind == RRT_REACH:
        sample[:] = tree.state[i, :3]
    for d in range(pursuers.count.shape[0]):
        if kind == EX_RRT:
            num = expand(nodes, n, pursuers, d, i, pursue, sample, k, prisms, changed, num)
        else:
            greedy = pursue and kind == RRT_REACH
            num = explore_plainly(nodes, n, pursuers, d, i, sample, greedy, prisms, changed, num)
    return num
