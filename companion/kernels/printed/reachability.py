"""Reachability set of a DT by its tree (paper 3.2.2, Algorithm 1).

The estimator keeps, for each PathTree node, the nearest position found for each DT at the time the
aircraft gets there (see :mod:`companion.kernels.printed.intercept` for what reachable means).

Symbols: ``d`` the DT, ``j`` a TTree node, ``i`` a PathTree node, ``k`` of the k-near nodes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.kernels.arrays import (
    NUM_CELLS,
    Float1D,
    Float2D,
    GridIndex,
    Int1D,
    Obstacles,
    Pursuers,
    Tree,
)
from companion.kernels.geometry.line_of_sight import line_blocked
from companion.kernels.native.kernel import inlined, kernel, kernel_numpy_errors
from companion.kernels.printed.grid_index import cell_along, cell_size, nearest
from companion.kernels.printed.intercept import AIR_CLIMB, NUM_BEARINGS, gets_near, way_length
from companion.kernels.printed.threat_tree import (
    FLIES_ON,
    LEAST_STEP_M,
    corner_towards,
)
from companion.kernels.threat.fuzzy_threat import PASSES
from companion.kernels.workspace import MAX_NEAR, KNearest, ReachScratch

NUM_NEIGHBOURS = 4  # Neighbours of a directly reachable node that are tested, too.
SPREADS_S = 30.0  # The position of an aircraft that flies on becomes less certain up to this time ahead.
# An aircraft that flies on counts as nearer by this many standard deviations. With 2, more than twice as many
# encounters became detours in which nothing would have happened; as many lost well clear.
PASSING_STD = 1.0
NEWS_M = 15.0  # A node is listed as changed if the DT's position is nearer by at least this.
EX_RRT, RRT_REACH, RRT = 0, 1, 2


class Estimator(NamedTuple):
    """The RS estimator: ``kind`` EX_RRT, RRT_REACH or RRT; ``p_tid`` and ``k`` of Algorithm 1."""

    kind: int
    p_tid: float
    k: int


class Probe(NamedTuple):
    """The data that the estimator works on.

    ``tree`` is the PathTree, ``pursuers`` the DTs' trees, ``walls`` what stops and hides DTs. The
    ``scratch`` is overwritten.
    """

    tree: Tree
    pursuers: Pursuers
    walls: Obstacles
    scratch: ReachScratch


@kernel_numpy_errors
def gets_to(
    trees: Pursuers, d: int, j: int, x: float, y: float, z: float, time: float, prisms: Obstacles,
    out: Float1D,
) -> bool:  # fmt: skip
    """Return whether a DT gets a place into its reach through TTree node ``j`` before ``time``.

    ``out`` (6,) receives q_B, or the circle's nearest point where none is found, and where there is one
    the nearest position of the DT [m].
    """
    slack = time - trees.time[d, j]
    return gets_near(trees.position[d, j], trees.heading[d, j], trees.model[d], slack, x, y, z, prisms, out)


@kernel_numpy_errors
def connect(
    trees: Pursuers, d: int, j: int, x: float, y: float, z: float, greedy: bool, prisms: Obstacles
) -> int:
    """``Connect`` one step, or ``Greedy-Connect`` steps until the point or an obstacle.

    Ground vehicles keep their height. Returns the last node: ``j`` itself where nothing could be added.
    """
    position, heading, time, b = trees.position, trees.heading, trees.time, trees.bounds
    v, rho, step = trees.model[d, 0], trees.model[d, 2], trees.model[d, 4]
    airborne = trees.model[d, 3] > 0.0
    last, n = j, trees.count[d]
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
        trees.parent[d, n] = last
        time[d, n] = time[d, last] + needed
        last = n
        n += 1
        if not greedy or share >= 1.0:
            break
    trees.count[d] = n
    return last


@kernel
def near_pursuer_nodes(
    pursuers: Pursuers, d: int, x: float, y: float, k: int, everything: Int1D, near: KNearest
) -> int:
    """Return the ``k`` TTree nodes nearest to a point, by rising time stamp; ``everything`` (0,) is empty."""
    index = pursuers.index
    tree_index = GridIndex(index.cells[d], index.chain[d], index.places[d], index.extent[d], index.filled[d])
    found = nearest(
        tree_index, pursuers.position[d], pursuers.count[d], pursuers.bounds, everything, x, y, k, near
    )
    _sort_by(pursuers.time[d], near.rows, found)
    return found


@kernel_numpy_errors
def promising_corners(
    pursuers: Pursuers, d: int, x: float, y: float, time: float, walls: Obstacles, out: Int1D
) -> int:
    """Find the corners by which a DT comes earliest to places about (x, y); return how many are in time.

    Those of the cells in which (x, y) and the bearings of the circle about it lie, earliest first, into
    ``out`` (MAX_NEAR,).
    """
    corners, b = pursuers.corners, pursuers.bounds
    v, rd, size = pursuers.model[d, 0], pursuers.model[d, 1], cell_size(pursuers.bounds)
    found = 0
    if corners[d, 1] == 0:
        return found
    for k in range(-1, NUM_BEARINGS):
        r = rd if k >= 0 else 0.0
        angle = 2.0 * math.pi * k / NUM_BEARINGS
        i = cell_along(x + r * math.cos(angle), b[0], size)
        j = cell_along(y + r * math.sin(angle), b[2], size)
        row = pursuers.by_corner[d, i * NUM_CELLS + j]
        if row == -2:
            cx, cy = b[0] + (i + 0.5) * size, b[2] + (j + 0.5) * size
            row = corner_towards(pursuers, d, cx, cy, walls)
            pursuers.by_corner[d, i * NUM_CELLS + j] = row
        if row < 0 or found == MAX_NEAR:
            continue
        left = (
            math.sqrt((pursuers.position[d, row, 0] - x) ** 2 + (pursuers.position[d, row, 1] - y) ** 2) - rd
        )
        is_new = pursuers.time[d, row] + max(0.0, left) / v <= time
        for m in range(found):
            if out[m] == row:
                is_new = False
        if is_new:
            out[found] = row
            found += 1
    _sort_by(pursuers.time[d], out, found)
    return found


@kernel
def near_path_nodes(tree: Tree, pursuers: Pursuers, x: float, y: float, k: int, near: KNearest) -> int:
    """Return the ``k`` PathTree nodes nearest to a ground point that are searched, by rising time stamp."""
    found = nearest(
        pursuers.path_index, tree.state, tree.count[0], pursuers.bounds, tree.active, x, y, k, near
    )
    _sort_by(tree.time, near.rows, found)
    return found


@kernel
def _sort_by(keys: Float1D, out: Int1D, n: int) -> None:
    """Sort the first ``n`` indices of ``out`` (≥ n,) by their ``keys`` (N,)."""
    for i in range(1, n):
        index = out[i]
        at = i
        while at > 0 and keys[out[at - 1]] > keys[index]:
            out[at] = out[at - 1]
            at -= 1
        out[at] = index


@kernel_numpy_errors
def come_nearer(
    trees: Pursuers, d: int, j: int, place: tuple[float, float, float, float], prisms: Obstacles,
    spot: Float1D, out: Float2D,
) -> None:  # fmt: skip
    """Keep the DT's nearest position through TTree node ``j`` if it is nearer than the known one.

    ``place`` x y z and the time at which the aircraft is there; ``spot`` (6,) is overwritten; ``out`` (D, 4)
    positions [m] and 1 where one is known.
    """
    x, y, z, time = place
    if gets_to(trees, d, j, x, y, z, time, prisms, spot):
        was = (out[d, 0] - x) ** 2 + (out[d, 1] - y) ** 2 + (out[d, 2] - z) ** 2
        now = (spot[3] - x) ** 2 + (spot[4] - y) ** 2 + (spot[5] - z) ** 2
        if out[d, 3] == 0.0 or now < was:
            out[d, 0], out[d, 1], out[d, 2], out[d, 3] = spot[3], spot[4], spot[5], 1.0


@inlined
def passing_place(trees: Pursuers, d: int, time: float, last: int) -> tuple[float, float, float]:
    """Return the position at a time of an aircraft that flies on [m].

    Its rows are a second apart; from row ``last`` on it flies straight.
    """
    ahead = max(0.0, time - trees.time[d, 0])
    k = min(int(ahead), last)
    now, soon, part = trees.position[d, k], trees.position[d, k + 1], ahead - k
    return (
        now[0] + part * (soon[0] - now[0]),
        now[1] + part * (soon[1] - now[1]),
        now[2] + part * (soon[2] - now[2]),
    )


@inlined
def passing_spread(trees: Pursuers, d: int, time: float) -> float:
    """Return the standard deviation at a time of the position of an aircraft that flies on [m].

    That is :data:`PASSING_STD` times that of the place, and the radius of the circle that it flies about it.
    """
    ahead = min(time - trees.time[d, 0], SPREADS_S)
    circle = trees.model[d, 9] if time >= trees.model[d, 8] else 0.0
    return circle + PASSING_STD * math.hypot(trees.model[d, 2], trees.model[d, 4] * ahead)


@kernel_numpy_errors
def passes_by(trees: Pursuers, d: int, x: float, y: float, z: float, time: float, out: Float2D) -> None:
    """Return the position of an aircraft that flies on, nearer to a place by its deviation [m].

    ``out`` (D, 4) receives the position at the place's own height [m], and :data:`PASSES` where that is
    within its well clear volume, else 0.
    """
    spread = passing_spread(trees, d, time)
    east, north, height = passing_place(trees, d, time, trees.count[d] - 2)
    dx, dy, up = east - x, north - y, abs(height - z)
    away = math.sqrt(dx * dx + dy * dy)
    out[d, 3] = PASSES if away - spread <= trees.model[d, 1] and up <= trees.model[d, 5] else 0.0
    share = max(away - spread, 0.0) / max(away, 1.0)
    out[d, 0], out[d, 1], out[d, 2] = x + share * dx, y + share * dy, z


@kernel
def dt_positions(
    pursuers: Pursuers, x: float, y: float, z: float, time: float, k: int, walls: Obstacles, out: Float2D,
    scratch: ReachScratch,
) -> None:  # fmt: skip
    """Nearest estimated position of every DT to a place at a time, from the TTrees as they are.

    Through its root, promising corners and the ``k`` nearest TTree nodes. ``out`` (D, 4) receives
    positions [m] and 1 where the DT can be there in time.
    """
    if pursuers.count.shape[0] == 0:
        return
    near, spot, place = scratch.near, scratch.spot, (x, y, z, time)
    position, model, stamps = pursuers.position, pursuers.model, pursuers.time
    for d in range(pursuers.count.shape[0]):
        out[d, 3] = 0.0
        if model[d, 3] == FLIES_ON:
            passes_by(pursuers, d, x, y, z, time, out)
            continue
        away = math.sqrt((position[d, 0, 0] - x) ** 2 + (position[d, 0, 1] - y) ** 2)
        if away - model[d, 1] > model[d, 0] * max(0.0, time - stamps[d, 0]):
            continue
        come_nearer(pursuers, d, 0, place, walls, spot, out)
        for m in range(promising_corners(pursuers, d, x, y, time, walls, near.rows)):
            come_nearer(pursuers, d, near.rows[m], place, walls, spot, out)
        for m in range(near_pursuer_nodes(pursuers, d, x, y, k, scratch.everything, near)):
            come_nearer(pursuers, d, near.rows[m], place, walls, spot, out)


@kernel_numpy_errors
def note_reached(probe: Probe, d: int, i: int, num: int) -> int:
    """Keep the DT's position in ``scratch.spot`` for a node, and list the node, if it is news."""
    tree, out, changed = probe.tree, probe.scratch.spot, probe.scratch.changed
    points, state = tree.threat_point, tree.state
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


@kernel_numpy_errors
def test_node(probe: Probe, d: int, i: int, j: int, num: int) -> tuple[bool, int]:
    """List node ``i`` if it is reached through TTree node ``j``; return the list's length."""
    x, y, z = probe.tree.state[i, 0], probe.tree.state[i, 1], probe.tree.state[i, 2]
    time, spot = probe.tree.time[i], probe.scratch.spot
    if not gets_to(probe.pursuers, d, j, x, y, z, time, probe.walls, spot):
        return False, num
    return True, note_reached(probe, d, i, num)


@kernel
def spread_to_neighbours(probe: Probe, d: int, i: int, j: int, num: int) -> int:
    """``RSCal``: test the parent and the nearest nodes of a directly reachable one (indirect ones)."""
    tree, near = probe.tree, probe.scratch.near
    found = near_path_nodes(tree, probe.pursuers, tree.state[i, 0], tree.state[i, 1], NUM_NEIGHBOURS, near)
    if tree.parent[i] >= 0:
        near.rows[found] = tree.parent[i]
        found += 1
    for m in range(found):
        if near.rows[m] != i:
            _, num = test_node(probe, d, near.rows[m], j, num)
    return num


@kernel_numpy_errors
def goal_bias_connect(probe: Probe, d: int, i: int, j: int, num: int) -> tuple[int, int]:
    """Reach node ``i`` through TTree node ``j`` and grow to q_B greedily, else grow one step.

    Returns the TTree node at q_B, or -1 where the node was not reached, and the new length of
    ``changed``. Whoever calls tests the node's neighbours from there.
    """
    done, num = test_node(probe, d, i, j, num)
    out = probe.scratch.spot
    last = connect(probe.pursuers, d, j, out[0], out[1], out[2], done, probe.walls)
    return (last if done else -1), num


@kernel
def expand(probe: Probe, d: int, i: int, pursue: bool, k: int, num: int) -> int:
    """Algorithm 1 of one DT: ``reach`` node ``i``, or ``multi-connect`` towards ``scratch.sample``.

    ``multi-reach``: through the DT's root, through promising corners, and in pursuit through each of the
    ``k`` nearest TTree nodes. ``multi-connect``: one step of each of the k nearest TTree nodes towards the
    sample, and from there ``reach`` of the k nearest PathTree nodes, earliest first, until one is reached.

    The paper's ``reach`` tries the nearest TTree nodes only. These may have been reached by detours and
    stand too late where the DT, driving straight or round a corner, would be early: here its root and the
    corners by which it might be there earliest are tried before.
    """
    tree, pursuers, walls, scratch = probe.tree, probe.pursuers, probe.walls, probe.scratch
    x, y, z, time = tree.state[i, 0], tree.state[i, 1], tree.state[i, 2], tree.time[i]
    at, target, rows = -1, i, scratch.near.rows
    if gets_to(pursuers, d, 0, x, y, z, time, walls, scratch.spot):
        at, num = goal_bias_connect(probe, d, i, 0, num)
    if at < 0:
        for m in range(promising_corners(pursuers, d, x, y, time, walls, rows)):
            if gets_to(pursuers, d, rows[m], x, y, z, time, walls, scratch.spot):
                at, num = goal_bias_connect(probe, d, i, rows[m], num)
                break
    if at < 0 and pursue:
        for m in range(near_pursuer_nodes(pursuers, d, x, y, k, scratch.everything, scratch.near)):
            at, num = goal_bias_connect(probe, d, i, rows[m], num)
            if at >= 0:
                break
    elif at < 0:
        at, target, num = multi_connect(probe, d, k, num)
    if at >= 0:
        num = spread_to_neighbours(probe, d, target, at, num)
    return num


@kernel
def multi_connect(probe: Probe, d: int, k: int, num: int) -> tuple[int, int, int]:
    """Grow the ``k`` nearest TTree nodes towards ``scratch.sample`` until a PathTree node near by is reached.

    Returns the TTree node that reaches one, -1 where none does; the PathTree node tried last; and the new
    length of ``changed``.
    """
    pursuers, scratch, at, target = probe.pursuers, probe.scratch, -1, -1
    x, y, z = scratch.sample[0], scratch.sample[1], scratch.sample[2]
    for m in range(near_pursuer_nodes(pursuers, d, x, y, k, scratch.everything, scratch.near)):
        j = connect(pursuers, d, scratch.near.rows[m], x, y, z, False, probe.walls)
        px, py = pursuers.position[d, j, 0], pursuers.position[d, j, 1]
        for q in range(near_path_nodes(probe.tree, pursuers, px, py, k, scratch.targets)):
            target = scratch.targets.rows[q]
            at, num = goal_bias_connect(probe, d, target, j, num)
            if at >= 0:
                return at, target, num
    return at, target, num


@kernel
def explore_plainly(probe: Probe, d: int, i: int, greedy: bool, num: int) -> int:
    """The comparators' step: grow the nearest TTree node towards the sample, then test nodes near it."""
    pursuers, scratch, near = probe.pursuers, probe.scratch, probe.scratch.near
    x, y, z = scratch.sample[0], scratch.sample[1], scratch.sample[2]
    if near_pursuer_nodes(pursuers, d, x, y, 1, scratch.everything, near) == 0:
        return num
    last = connect(pursuers, d, near.rows[0], x, y, z, greedy, probe.walls)
    px, py = pursuers.position[d, last, 0], pursuers.position[d, last, 1]
    found = near_path_nodes(probe.tree, pursuers, px, py, 3, near)
    near.rows[found] = i
    for m in range(found + 1):
        _, num = test_node(probe, d, near.rows[m], last, num)
    return num


@kernel
def estimate_reachability(
    tree: Tree, pursuers: Pursuers, i: int, estimator: Estimator, bounds: Float1D, draws: Float1D,
    walls: Obstacles, scratch: ReachScratch,
) -> int:  # fmt: skip
    """Algorithm 1 for the new PathTree node ``i`` and every DT.

    ``bounds`` (6,) hold the samples [m]; ``draws`` (3,) are uniform numbers. Nodes whose DT position is
    news go to ``scratch.changed``; returns how many.
    """
    num = 0
    if pursuers.count.shape[0] == 0:
        return num
    probe, p_tid, sample = Probe(tree, pursuers, walls, scratch), estimator.p_tid, scratch.sample
    pursue = draws[0] <= p_tid
    sample[0] = bounds[0] + draws[1] * (bounds[1] - bounds[0])
    sample[1] = bounds[2] + draws[2] * (bounds[3] - bounds[2])
    # Beyond p_tid the first draw is uniform once more.
    share = 0.0 if pursue else (draws[0] - p_tid) / (1.0 - p_tid)
    sample[2] = bounds[4] + share * (bounds[5] - bounds[4])
    if pursue and estimator.kind == RRT_REACH:
        sample[:] = tree.state[i, :3]
    for d in range(pursuers.count.shape[0]):
        if pursuers.model[d, 3] == FLIES_ON:
            state = tree.state[i]
            passes_by(pursuers, d, state[0], state[1], state[2], tree.time[i], tree.threat_point[i])
        elif estimator.kind == EX_RRT:
            num = expand(probe, d, i, pursue, estimator.k, num)
        else:
            greedy = pursue and estimator.kind == RRT_REACH
            num = explore_plainly(probe, d, i, greedy, num)
    return num
