"""Distance fields round obstacles to a sub goal, and samples that follow them.

GoalZoom (paper 4.4.1) samples the ball about the sub goal that the tree has not entered yet. Behind a
wall that ball is the wrong place: what counts there is the distance round it. A field on a
grid holds that distance. A share of the samples is drawn a little ahead of nodes that have come far, in the
direction in which the distance falls.
"""

from __future__ import annotations

import math

import numpy as np

from companion.kernels.arrays import DistanceField, Float1D, Float2D, Limits, Obstacles, Tree
from companion.kernels.geometry.prism_distance import clearance, clearance_bound
from companion.kernels.native.kernel import kernel

FIRST_PICK = 8  # Nodes are picked by the random numbers from this column on.
PICKS = 8  # Nodes that are compared; the one farthest ahead is followed.
SPREAD = 0.5  # A sample is drawn from a disc whose radius is this share of its distance ahead.


def fill_distance_field(
    point: Float1D,
    radius: float,
    margin: float,
    bounds: Float1D,
    obstacles: Obstacles,
    distances: DistanceField,
) -> None:
    """Distance of ``point`` (≥ 3,) round obstacles at its height from every cell of its field, in place [m].

    Cells beyond ``radius`` from the point or outside ``bounds`` (≥ 4,) x_min x_max y_min y_max [m], or
    nearer than ``margin`` to an obstacle, stay infinite; the point's own cell is free in any case. Sweeps
    there and back until nothing changes (Zhao, "A fast sweeping method for Eikonal equations", 2005, on the
    8-neighbour graph).
    """
    free = np.zeros(distances.field.shape)
    fill_free(point, radius, margin, bounds, obstacles, distances, free)
    fill_distances(point, distances, free)


@kernel
def fill_free(
    point: Float1D, radius: float, margin: float, bounds: Float1D, obstacles: Obstacles,
    distances: DistanceField, free: Float2D,
) -> None:  # fmt: skip
    """Set ``free`` (N, M) to 1 in cells that are free at the height of ``point`` (≥ 3,), to 0 in others.

    The rest as in :func:`fill_distance_field`; ``bounds`` (≥ 4,).
    """
    x, y, z = point[0], point[1], point[2]
    origin, cell = distances.origin, distances.cell
    for i in range(free.shape[0]):
        for j in range(free.shape[1]):
            free[i, j] = 0.0
            cx, cy = origin[0] + i * cell, origin[1] + j * cell
            inside = (cx - x) ** 2 + (cy - y) ** 2 <= (radius + cell) ** 2
            if inside and bounds[0] <= cx <= bounds[1] and bounds[2] <= cy <= bounds[3]:
                near = clearance_bound(cx, cy, z, obstacles) < margin
                is_free = not near or clearance(cx, cy, z, obstacles, margin + 1.0) >= margin
                free[i, j] = 1.0 if is_free else 0.0


@kernel
def fill_distances(point: Float1D, distances: DistanceField, free: Float2D) -> None:
    """Distance of ``point`` (≥ 2,) over the cells that are ``free`` (N, M), into ``distances.field`` [m].

    A cell's ``free`` is how many times its length a way over it counts, 0 where none leads. The point's own
    cell is free in any case, and is changed to that.
    """
    field, origin, cell = distances.field, distances.origin, distances.cell
    x, y = point[0], point[1]
    field[:] = math.inf
    i, j = int(round((x - origin[0]) / cell)), int(round((y - origin[1]) / cell))
    if i < 0 or j < 0 or i >= field.shape[0] or j >= field.shape[1]:
        return
    field[i, j], free[i, j] = 0.0, 1.0
    while _sweep(field, free, cell, 1) | _sweep(field, free, cell, -1):
        pass


@kernel
def _sweep(field: Float2D, free: Float2D, cell: float, step: int) -> bool:
    """Sweep over all rows, each in both directions; return whether anything changed.

    ``field`` (N, M) distances so far [m]; ``free`` (N, M) as in :func:`fill_distances`.
    """
    rows, n = field.shape
    aslant = cell * math.sqrt(2.0)
    changed = False
    for a in range(rows):
        i = a if step > 0 else rows - 1 - a
        behind = i - step
        for turn in range(2):
            for b in range(n):
                j = b if turn == 0 else n - 1 - b
                if free[i, j] == 0.0:
                    continue
                best, cost = field[i, j], free[i, j]
                if 0 <= behind < rows:
                    best = min(best, field[behind, j] + cost * cell)
                    if j > 0:
                        best = min(best, field[behind, j - 1] + cost * aslant)
                    if j < n - 1:
                        best = min(best, field[behind, j + 1] + cost * aslant)
                adjacent = j - 1 if turn == 0 else j + 1
                if 0 <= adjacent < n:
                    best = min(best, field[i, adjacent] + cost * cell)
                if best < field[i, j] - 1e-9:
                    field[i, j] = best
                    changed = True
    return changed


@kernel
def distance_to_go(distances: DistanceField, x: float, y: float) -> float:
    """Distance from a place round obstacles to the field's point [m]; infinite outside the grid."""
    i = int(round((x - distances.origin[0]) / distances.cell))
    j = int(round((y - distances.origin[1]) / distances.cell))
    if i < 0 or j < 0 or i >= distances.field.shape[0] or j >= distances.field.shape[1]:
        return math.inf
    return float(distances.field[i, j])


@kernel
def draw_ahead(
    draws: Float1D, tree: Tree, distances: DistanceField, sub_goal: Float1D, limits: Limits, q_s: Float1D
) -> bool:
    """Draw a sample ahead of a node that has come far; return False if no way leads from any node.

    Of ``PICKS`` nodes drawn from the tree, the one with the least distance to go is followed, up to
    ``distances.ahead`` metres down the field, and the sample is uniform in a disc there. Its height lies
    between the node's and the sub goal's, within what can be climbed.

    ``draws`` (≥ 16,) uniform numbers; ``sub_goal`` (3,) [m]; ``q_s`` (3,) receives the sample [m].
    """
    best, node = math.inf, -1
    for t in range(PICKS):
        i = int(draws[FIRST_PICK + t] * tree.count[0])
        if tree.active[i] == 1 and tree.to_go[i] < best:
            best, node = tree.to_go[i], i
    if node < 0:
        return False
    x, y, z = tree.state[node, 0], tree.state[node, 1], tree.state[node, 2]
    i, j = _down_the_field(distances, x, y, best - min(best, draws[1] * distances.ahead))
    gone = best - distances.field[i, j]
    spread, angle = SPREAD * gone * math.sqrt(draws[2]), 2.0 * math.pi * draws[3]
    box = limits.bounds
    q_s[0] = min(box[1], max(box[0], distances.origin[0] + i * distances.cell + spread * math.cos(angle)))
    q_s[1] = min(box[3], max(box[2], distances.origin[1] + j * distances.cell + spread * math.sin(angle)))
    q_s[2] = sub_goal[2]
    if limits.dimension == 3:
        offset = (2.0 * draws[7] - 1.0) * SPREAD * gone * math.tan(limits.climb_max)
        level = z + (sub_goal[2] - z) * gone / max(best, 1.0)
        q_s[2] = min(box[5], max(box[4], level + offset))
    return True


@kernel
def _down_the_field(distances: DistanceField, x: float, y: float, wanted: float) -> tuple[int, int]:
    """Return the first cell with at most ``wanted`` metres to go, from neighbour to nearest neighbour."""
    field = distances.field
    i, j = (
        int(round((x - distances.origin[0]) / distances.cell)),
        int(round((y - distances.origin[1]) / distances.cell)),
    )
    while field[i, j] > wanted:
        u, w = i, j
        for a in range(max(0, i - 1), min(field.shape[0], i + 2)):
            for b in range(max(0, j - 1), min(field.shape[1], j + 2)):
                if field[a, b] < field[u, w]:
                    u, w = a, b
        i, j = u, w
    return i, j
