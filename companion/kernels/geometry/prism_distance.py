"""Distances and intersections with upright prisms, and what is left over ground.

Symbols: ``x, y, z`` a point; ``p, q`` ends of a segment; ``t`` the fraction along it.

References
----------
Ericson, *Real-Time Collision Detection* (2005), 5.1.2 (point to segment), 5.3.8 (slab clipping).
Franklin, *PNPOLY* (ray casting with half-open edges).
"""

from __future__ import annotations

import math

import numpy as np

from companion.kernels.arrays import Float1D, Float2D, Float3D, FloatArray, Obstacles
from companion.kernels.geometry.ground_surface import crosses_ground, over_ground
from companion.kernels.native.kernel import inlined, kernel


@kernel
def point_in_polygon(x: float, y: float, edges: Float2D, first: int, last: int) -> bool:
    """Return whether a point is inside the polygon of ``edges`` (E, 4) ``first`` to ``last - 1`` [m]."""
    inside = False
    for e in range(first, last):
        x0, y0, x1, y1 = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
        if (y0 > y) != (y1 > y) and x < (x1 - x0) * (y - y0) / (y1 - y0) + x0:
            inside = not inside
    return inside


@inlined
def distance_to_edge_squared(x: float, y: float, x0: float, y0: float, x1: float, y1: float) -> float:
    """Squared distance of a point to a segment in the plane [m²]."""
    dx, dy = x1 - x0, y1 - y0
    length_squared = dx * dx + dy * dy
    t = 0.0
    if length_squared > 0.0:
        t = min(1.0, max(0.0, ((x - x0) * dx + (y - y0) * dy) / length_squared))
    ex, ey = x0 + t * dx - x, y0 + t * dy - y
    return ex * ex + ey * ey


@kernel
def clearance(x: float, y: float, z: float, obstacles: Obstacles, limit: float) -> float:
    """Distance of a point to the nearest prism [m], 0 inside; ``limit`` if nothing is nearer.

    What is left over ground counts as such a distance.
    """
    left = over_ground(x, y, z, obstacles.ground)
    return 0.0 if left <= 0.0 else prism_clearance(x, y, z, obstacles, min(limit, left))


@kernel
def prism_clearance(x: float, y: float, z: float, obstacles: Obstacles, limit: float) -> float:
    """:func:`clearance` of prisms alone."""
    best = limit * limit
    boxes, heights = obstacles.boxes, obstacles.heights
    for o in range(heights.shape[0]):
        bx = max(boxes[o, 0] - x, 0.0, x - boxes[o, 2])
        by = max(boxes[o, 1] - y, 0.0, y - boxes[o, 3])
        bz = max(heights[o, 0] - z, 0.0, z - heights[o, 1])
        if bx * bx + by * by + bz * bz >= best:
            continue
        first, last = obstacles.offsets[o], obstacles.offsets[o + 1]
        if point_in_polygon(x, y, obstacles.edges, first, last):
            flat = 0.0
        else:
            flat = best
            for e in range(first, last):
                d2 = distance_to_edge_squared(
                    x, y, obstacles.edges[e, 0], obstacles.edges[e, 1],
                    obstacles.edges[e, 2], obstacles.edges[e, 3],
                )  # fmt: skip
                flat = min(flat, d2)
        best = min(best, flat + bz * bz)
    return math.sqrt(best)


@kernel
def clearance_bound(x: float, y: float, z: float, obstacles: Obstacles) -> float:
    """Lower bound of the clearance from the distance field and the ground [m]; 0 outside the field's grid."""
    return max(0.0, min(prism_bound(x, y, z, obstacles), over_ground(x, y, z, obstacles.ground)))


@kernel
def prism_bound(x: float, y: float, z: float, obstacles: Obstacles) -> float:
    """Lower bound of the clearance of prisms from their distance field [m]; 0 outside its grid.

    The distance is 1-Lipschitz, so the value at the nearest grid node less the way to it is a bound.
    """
    g = obstacles.grid
    i = int(round((x - g[0]) / g[3]))
    j = int(round((y - g[1]) / g[4]))
    k = int(round((z - g[2]) / g[5]))
    n = obstacles.field.shape
    if i < 0 or j < 0 or k < 0 or i >= n[0] or j >= n[1] or k >= n[2]:
        return 0.0
    ex, ey, ez = x - (g[0] + i * g[3]), y - (g[1] + j * g[4]), z - (g[2] + k * g[5])
    return max(0.0, float(obstacles.field[i, j, k]) - math.sqrt(ex * ex + ey * ey + ez * ez))


@kernel
def fill_field(field: Float3D, grid: Float1D, obstacles: Obstacles) -> None:
    """Distance to the nearest prism at every node of a grid, in place.

    ``field`` (NX, NY, NZ) receives it [m]; ``grid`` (6,) x0 y0 z0 and the spacings dx dy dz [m].
    """
    for i in range(field.shape[0]):
        for j in range(field.shape[1]):
            for k in range(field.shape[2]):
                field[i, j, k] = prism_clearance(
                    grid[0] + i * grid[3], grid[1] + j * grid[4], grid[2] + k * grid[5], obstacles, 1e6
                )


@kernel
def edges_cross(
    px: float, py: float, qx: float, qy: float, x0: float, y0: float, x1: float, y1: float
) -> bool:
    """Return whether two segments of the plane share a point; touching counts."""
    d1 = (qx - px) * (y0 - py) - (qy - py) * (x0 - px)
    d2 = (qx - px) * (y1 - py) - (qy - py) * (x1 - px)
    d3 = (x1 - x0) * (py - y0) - (y1 - y0) * (px - x0)
    d4 = (x1 - x0) * (qy - y0) - (y1 - y0) * (qx - x0)
    if (d1 > 0.0 and d2 > 0.0) or (d1 < 0.0 and d2 < 0.0):
        return False
    if (d3 > 0.0 and d4 > 0.0) or (d3 < 0.0 and d4 < 0.0):
        return False
    if d1 == 0.0 and d2 == 0.0:  # one line: they share a point if their boxes do
        return (
            max(px, qx) >= min(x0, x1)
            and max(x0, x1) >= min(px, qx)
            and max(py, qy) >= min(y0, y1)
            and max(y0, y1) >= min(py, qy)
        )
    return True


@kernel
def segment_clear(
    px: float, py: float, pz: float, qx: float, qy: float, qz: float, obstacles: Obstacles, margin: float
) -> bool:
    """Return whether every point of p–q is at least ``margin`` from every prism, and as high over ground.

    Conservative advancement: the distance of prisms is 1-Lipschitz, so a point with clearance ``c`` proves
    ``c - margin`` of the way. Steps below 0.5 m are refused as blocked.
    """
    if crosses_ground(px, py, pz, qx, qy, qz, obstacles.ground, margin):
        return False
    length = math.sqrt((qx - px) ** 2 + (qy - py) ** 2 + (qz - pz) ** 2)
    s = 0.0
    while True:
        t = s / length if length > 0.0 else 0.0
        x, y, z = px + t * (qx - px), py + t * (qy - py), pz + t * (qz - pz)
        free = prism_bound(x, y, z, obstacles) - margin
        if free < 5.0:
            free = prism_clearance(x, y, z, obstacles, margin + length + 1.0) - margin
        if free < 0.0:
            return False
        s += max(free, 0.5)
        if s >= length:
            return prism_clearance(qx, qy, qz, obstacles, margin + 1.0) >= margin


@kernel
def boxes_on_segment(
    px: float, py: float, pz: float, qx: float, qy: float, qz: float, obstacles: Obstacles, out: Float2D
) -> int:
    """Heights and widths of the bounding boxes a segment crosses, as (6) wants them [m].

    ``out`` (O, 2) receives, for each box crossed, its height and the width of its projection across
    the segment. Returns how many.
    """
    dx, dy = qx - px, qy - py
    length = math.sqrt(dx * dx + dy * dy)
    nx, ny = (-dy / length, dx / length) if length > 0.0 else (0.0, 1.0)
    count = 0
    for o in range(obstacles.heights.shape[0]):
        box = obstacles.boxes[o]
        t0, t1 = 0.0, 1.0
        t0, t1 = _clip(px, dx, box[0], box[2], t0, t1)
        t0, t1 = _clip(py, dy, box[1], box[3], t0, t1)
        t0, t1 = _clip(pz, qz - pz, obstacles.heights[o, 0], obstacles.heights[o, 1], t0, t1)
        if t0 > t1:
            continue
        out[count, 0] = obstacles.heights[o, 1] - obstacles.heights[o, 0]
        out[count, 1] = abs(nx) * (box[2] - box[0]) + abs(ny) * (box[3] - box[1])
        count += 1
    return count


@kernel
def _clip(p: float, d: float, low: float, high: float, t0: float, t1: float) -> tuple[float, float]:
    """Clip the interval of a line's fraction to one slab; an empty one comes back reversed."""
    if d == 0.0:
        if p < low or p > high:
            return 1.0, 0.0
        return t0, t1
    ta, tb = (low - p) / d, (high - p) / d
    return max(t0, min(ta, tb)), min(t1, max(ta, tb))


def no_field() -> tuple[FloatArray, FloatArray]:
    """Return an empty distance field (0, 0, 0) [m], whose bound is 0 everywhere, and its grid (6,) [m]."""
    return np.zeros((0, 0, 0)), np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
