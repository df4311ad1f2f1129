"""The DTs' trees: their corners, and their update by a new observation (paper 3.2.2, Fig. 1).

Symbols: ``d`` the DT, ``j`` a TTree node, ``v`` the DT's speed.
"""

from __future__ import annotations

import math

import numpy as np

from companion.kernels.arrays import Float1D, Float2D, Int1D, Obstacles, Pursuers
from companion.kernels.geometry.line_of_sight import line_blocked
from companion.kernels.geometry.prism_distance import point_in_polygon
from companion.kernels.native.kernel import kernel, kernel_numpy_errors, local_floats, local_ints, local_table
from companion.kernels.native.struct import Struct
from companion.kernels.printed.intercept import way_length

FLIES_ON = 2.0  # Value of the airborne flag for an aircraft that only passes and pursues nobody.
LEAST_STEP_M = 1.0  # Shorter edges are not added to a tree.
CORNER_GAP_M = 3.0  # Distance between an obstacle's corner and the node beside it.
MAX_CORNERS = 400


@kernel_numpy_errors
def corners_of(z: float, prisms: Obstacles, bounds: Float1D, out: Float2D) -> int:
    """Places just outside the corners of the obstacles that stand at height ``z``; returns how many.

    A shortest way round obstacles turns nowhere else. ``bounds`` (≥ 4,) x_min x_max y_min y_max that they
    lie in [m]; ``out`` (MAX_CORNERS, 2) receives them [m].
    """
    edges, offsets, heights = prisms.edges, prisms.offsets, prisms.heights
    n = 0
    for o in range(heights.shape[0]):
        if z < heights[o, 0] or z > heights[o, 1]:
            continue
        first, last = offsets[o], offsets[o + 1]
        for e in range(first, last):
            f = e + 1 if e + 1 < last else first  # edges e and f meet at the corner
            ax, ay = edges[e, 2] - edges[e, 0], edges[e, 3] - edges[e, 1]
            bx, by = edges[f, 2] - edges[f, 0], edges[f, 3] - edges[f, 1]
            la, lb = math.sqrt(ax * ax + ay * ay), math.sqrt(bx * bx + by * by)
            if la == 0.0 or lb == 0.0:
                continue
            ux, uy = ax / la - bx / lb, ay / la - by / lb  # out of a convex corner
            length = math.sqrt(ux * ux + uy * uy)
            if length < 1e-6:
                continue
            x, y = edges[e, 2] + CORNER_GAP_M * ux / length, edges[e, 3] + CORNER_GAP_M * uy / length
            if x < bounds[0] or x > bounds[1] or y < bounds[2] or y > bounds[3] or n == out.shape[0]:
                continue
            if not is_inside(x, y, z, prisms):
                out[n, 0], out[n, 1] = x, y
                n += 1
    return n


@kernel_numpy_errors
def is_inside(x: float, y: float, z: float, prisms: Obstacles) -> bool:
    """Return whether a place lies in a prism."""
    edges, offsets, heights = prisms.edges, prisms.offsets, prisms.heights
    for p in range(heights.shape[0]):
        if heights[p, 0] <= z <= heights[p, 1] and point_in_polygon(x, y, edges, offsets[p], offsets[p + 1]):
            return True
    return False


@kernel_numpy_errors
def add_corners(trees: Pursuers, d: int, prisms: Obstacles) -> int:
    """Add the corners that a ground vehicle can drive to from its root, each by its shortest way.

    Dijkstra's algorithm over the lines of free ground between corners; nodes come by rising time stamp.
    Returns how many there are.
    """
    position, time, heading = trees.position, trees.time, trees.heading
    places = local_table(MAX_CORNERS, 2)
    num = corners_of(position[d, 0, 2], prisms, trees.bounds, places)
    arrival, parent, is_done = (
        local_floats(MAX_CORNERS)[:num],
        local_ints(MAX_CORNERS),
        local_ints(MAX_CORNERS),
    )
    arrival[:], is_done[:] = math.inf, 0
    first, row = trees.count[d], 0
    while trees.count[d] < position.shape[1]:
        _go_on_to_corners(trees, d, row, prisms, places, arrival, parent, is_done)
        best = -1
        for c in range(num):
            if is_done[c] == 0 and arrival[c] < math.inf and (best < 0 or arrival[c] < arrival[best]):
                best = c
        if best < 0:
            break
        is_done[best] = 1
        row = trees.count[d]
        x, y = places[best, 0], places[best, 1]
        position[d, row, 0], position[d, row, 1], position[d, row, 2] = x, y, position[d, 0, 2]
        up = parent[best]
        heading[d, row] = math.atan2(y - position[d, up, 1], x - position[d, up, 0])
        trees.parent[d, row], time[d, row] = up, arrival[best]
        trees.count[d] = row + 1
    return int(trees.count[d] - first)


@kernel_numpy_errors
def _go_on_to_corners(
    trees: Pursuers, d: int, row: int, prisms: Obstacles, places: Float2D, arrival: Float1D,
    parent: Int1D, is_done: Int1D,
) -> None:  # fmt: skip
    """Go on from node ``row`` to each corner that is reached sooner through it.

    ``places`` (C, 2) the corners [m]; ``arrival`` (C,) earliest so far [s], through the node ``parent``
    (C,); ``is_done`` (C,) those that have their node already.
    """
    position, time, v = trees.position, trees.time, trees.model[d, 0]
    px, py, z = position[d, row, 0], position[d, row, 1], position[d, 0, 2]
    heading, rho = trees.heading[d, row], trees.model[d, 2]
    for c in range(arrival.shape[0]):
        x, y = places[c, 0], places[c, 1]
        if is_done[c] == 1 or time[d, row] + math.sqrt((x - px) ** 2 + (y - py) ** 2) / v >= arrival[c]:
            continue
        at = time[d, row] + way_length(px, py, z, heading, rho, False, x, y, z) / v
        if at < arrival[c] and not line_blocked(px, py, z, x, y, z, prisms):
            arrival[c], parent[c] = at, row


@kernel_numpy_errors
def corner_towards(trees: Pursuers, d: int, x: float, y: float, prisms: Obstacles) -> int:
    """Return the corner through which a place is reached earliest on a free line; -1 where there is none."""
    position, time, corners, v = trees.position, trees.time, trees.corners, trees.model[d, 0]
    best, arrival = -1, math.inf
    for j in range(corners[d, 0], corners[d, 0] + corners[d, 1]):
        if time[d, j] >= arrival:
            break  # they come by rising time stamp
        px, py, pz = position[d, j, 0], position[d, j, 1], position[d, j, 2]
        at = time[d, j] + math.sqrt((x - px) ** 2 + (y - py) ** 2) / v
        if at < arrival and not line_blocked(px, py, pz, x, y, pz, prisms):
            best, arrival = j, at
    return best


class KeptNodes(Struct):
    """The nodes of a tree of N that stay when its root changes.

    ``poses`` (N, 4) are x y z heading [m, rad], ``parents`` (N,) rows of the new tree. ``rows`` (N,) and
    ``where`` (N + 2,) are overwritten.
    """

    poses: Float2D
    parents: Int1D
    rows: Int1D
    where: Int1D


def re_root(
    pursuers: Pursuers, d: int, root: tuple[float, float, float], heading: float, time: float, ahead: float,
    with_corners: bool, walls: Obstacles,
) -> None:  # fmt: skip
    """Update a TTree by a new observation (paper Fig. 1), in place.

    The root moves to the observation, its one child lies ``ahead`` metres along the predicted
    ``heading`` (less where an obstacle stops it). Nodes whose time stamp is not later than the
    child's are dropped; what remains is attached below the child and stamped anew.

    Beyond the paper, and for ground vehicles only: ``with_corners`` puts the corners of obstacles next
    to it, each reached by its shortest way (:func:`add_corners`).
    """
    n = int(pursuers.count[d])
    rows = [np.empty(n + more, dtype=np.int64) for more in (0, 0, 2)]
    change_root(
        pursuers, d, root, heading, time, ahead, with_corners, walls, KeptNodes(np.empty((n, 4)), *rows)
    )


@kernel
def change_root(
    pursuers: Pursuers, d: int, root: tuple[float, float, float], heading: float, time: float, ahead: float,
    with_corners: bool, walls: Obstacles, kept: KeptNodes,
) -> None:  # fmt: skip
    """:func:`re_root` with room for what stays: as many as the tree has nodes."""
    v = pursuers.model[d, 0]
    ahead = free_way_ahead(root, heading, ahead, walls)
    has_child = v > 0.0 and ahead >= LEAST_STEP_M
    first_time = time + ahead / v if has_child else time
    base = 2 if has_child else 1
    if v == 0.0:  # The vehicle drove when these nodes were grown, and stands now.
        pursuers.count[d] = 0
    num_kept = _keep_later(pursuers, d, first_time, base, kept)
    x, y, z = root
    pursuers.position[d, 0, 0], pursuers.position[d, 0, 1], pursuers.position[d, 0, 2] = x, y, z
    pursuers.heading[d, 0], pursuers.parent[d, 0], pursuers.time[d, 0] = heading, -1, time
    if has_child:
        pursuers.position[d, 1, 0] = x + ahead * math.cos(heading)
        pursuers.position[d, 1, 1] = y + ahead * math.sin(heading)
        pursuers.position[d, 1, 2] = z
        pursuers.heading[d, 1], pursuers.parent[d, 1], pursuers.time[d, 1] = heading, 0, first_time
    pursuers.count[d], pursuers.index.filled[d, 0] = base, 0
    pursuers.index.cells[d] = -1
    pursuers.corners[d, 0], pursuers.corners[d, 1] = base, 0
    pursuers.by_corner[d] = -2
    if with_corners and v > 0.0 and pursuers.model[d, 3] == 0.0:
        pursuers.corners[d, 1] = add_corners(pursuers, d, walls)
    _attach_again(pursuers, d, base, pursuers.corners[d, 1], num_kept, kept, walls)


@kernel
def free_way_ahead(
    root: tuple[float, float, float], heading: float, ahead: float, prisms: Obstacles
) -> float:
    """Return ``ahead`` [m], halved until that distance is free; 0 if a twentieth is not."""
    x, y, z = root
    share = 1.0
    while share > 0.05 and line_blocked(
        x, y, z, x + share * ahead * math.cos(heading), y + share * ahead * math.sin(heading), z, prisms
    ):
        share *= 0.5
    return ahead * share if share > 0.05 else 0.0


@kernel
def _keep_later(trees: Pursuers, d: int, stamp: float, base: int, kept: KeptNodes) -> int:
    """Keep nodes later than ``stamp`` and their parents behind ``base`` others; return how many are kept.

    A dropped parent's row is the last of the ``base``.
    """
    n_old, n, new_index = trees.count[d], base, kept.rows
    new_index[:] = -1
    for j in range(n_old):  # parents come before children, so one pass renumbers
        if j > 0 and trees.time[d, j] > stamp and n < trees.position.shape[1]:
            new_index[j] = n
            n += 1
    for j in range(n_old):
        if new_index[j] >= 0:
            row = new_index[j] - base
            kept.poses[row, :3] = trees.position[d, j]
            kept.poses[row, 3] = trees.heading[d, j]
            up = trees.parent[d, j]
            kept.parents[row] = new_index[up] if up >= 0 and new_index[up] >= 0 else base - 1
    return int(n - base)


@kernel
def _attach_again(
    trees: Pursuers, d: int, base: int, num_corners: int, num_kept: int, kept: KeptNodes, prisms: Obstacles
) -> None:
    """Append ``num_kept`` nodes whose line to their parent is free; the others fall away with their branches.

    A kept node at a corner that already has a node gives its branches to that node.
    """
    position, heading, time = trees.position, trees.heading, trees.time
    airborne = trees.model[d, 3] > 0.0
    poses, parents, where = kept.poses, kept.parents, kept.where
    where[:] = -1
    for b in range(base):
        where[b] = b
    for row in range(num_kept):
        x, y, z = poses[row, 0], poses[row, 1], poses[row, 2]
        for c in range(base, base + num_corners):
            if position[d, c, 0] == x and position[d, c, 1] == y:
                where[base + row] = c
        up = where[parents[row]]
        if up < 0 or where[base + row] >= 0 or trees.count[d] == position.shape[1]:
            continue
        px, py, pz = position[d, up, 0], position[d, up, 1], position[d, up, 2]
        if not airborne:
            z = pz
        if x == px and y == py and z == pz:  # The new parent is at the same place: one node is enough.
            where[base + row] = up
            continue
        if line_blocked(px, py, pz, x, y, z, prisms):
            continue
        n = trees.count[d]
        where[base + row] = n
        position[d, n, 0], position[d, n, 1], position[d, n, 2] = x, y, z
        heading[d, n] = math.atan2(y - py, x - px)
        trees.parent[d, n] = up
        needed = way_length(px, py, pz, heading[d, up], trees.model[d, 2], airborne, x, y, z)
        time[d, n] = time[d, up] + needed / trees.model[d, 0]
        trees.count[d] = n + 1
