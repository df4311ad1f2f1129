"""Lines among upright prisms, for callers that ask thousands of times a plan.

A line is clipped to a prism's box before its polygon is looked at, and where the polygon is its own box
that settles it.

References
----------
Ericson, *Real-Time Collision Detection* (2005), 5.3.3 (segment against a box by slabs).
"""

from __future__ import annotations

from companion.kernels.arrays import Float2D, Obstacles
from companion.kernels.geometry.ground_surface import ground_hides
from companion.kernels.geometry.prism_distance import edges_cross, point_in_polygon
from companion.kernels.native.kernel import kernel_numpy_errors

LEVEL_M = 1e-9  # Ends whose coordinates differ by less lie at the same one.


@kernel_numpy_errors
def is_rectangle(edges: Float2D, first: int, last: int) -> bool:
    """Return whether a polygon has four sides, all along the axes: then it fills its box.

    It is rows ``first`` to ``last - 1`` of ``edges`` (E, 4) [m].
    """
    if last - first != 4:
        return False
    upright = edges[first, 0] == edges[first, 2]
    for e in range(first, last):  # upright and level sides in turn
        if edges[e, 0 if upright else 1] != edges[e, 2 if upright else 3]:
            return False
        upright = not upright
    return True


@kernel_numpy_errors
def polygon_hit(ax: float, ay: float, bx: float, by: float, edges: Float2D, first: int, last: int) -> bool:
    """Return whether a polygon, rows ``first`` to ``last - 1`` of ``edges`` (E, 4) [m], meets a–b."""
    if point_in_polygon(ax, ay, edges, first, last):
        return True
    for e in range(first, last):
        if edges_cross(ax, ay, bx, by, edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]):
            return True
    return False


@kernel_numpy_errors
def line_blocked(px: float, py: float, pz: float, qx: float, qy: float, qz: float, prisms: Obstacles) -> bool:
    """Return whether any prism meets the segment p–q: line of sight, and ground lines at constant z."""
    boxes, heights, edges, offsets = prisms.boxes, prisms.heights, prisms.edges, prisms.offsets
    x_low, x_high = min(px, qx), max(px, qx)
    y_low, y_high = min(py, qy), max(py, qy)
    z_low, z_high = min(pz, qz), max(pz, qz)
    dx, dy, dz = qx - px, qy - py, qz - pz
    for o in range(heights.shape[0]):
        if x_high < boxes[o, 0] or x_low > boxes[o, 2] or y_high < boxes[o, 1] or y_low > boxes[o, 3]:
            continue
        if z_high < heights[o, 0] or z_low > heights[o, 1]:
            continue
        t0, t1 = 0.0, 1.0
        if abs(dz) > LEVEL_M:  # otherwise the line lies in the slab, because the boxes overlap
            ta, tb = (heights[o, 0] - pz) / dz, (heights[o, 1] - pz) / dz
            t0, t1 = max(t0, min(ta, tb)), min(t1, max(ta, tb))
        s0, s1 = t0, t1  # The piece between base and top.
        if abs(dx) > LEVEL_M:
            ta, tb = (boxes[o, 0] - px) / dx, (boxes[o, 2] - px) / dx
            t0, t1 = max(t0, min(ta, tb)), min(t1, max(ta, tb))
        if abs(dy) > LEVEL_M:
            ta, tb = (boxes[o, 1] - py) / dy, (boxes[o, 3] - py) / dy
            t0, t1 = max(t0, min(ta, tb)), min(t1, max(ta, tb))
        if t0 > t1:
            continue
        first, last = offsets[o], offsets[o + 1]
        if is_rectangle(edges, first, last) or polygon_hit(
            px + s0 * dx, py + s0 * dy, px + s1 * dx, py + s1 * dy, edges, first, last
        ):
            return True
    return False


@kernel_numpy_errors
def sight_blocked(px: float, py: float, pz: float, qx: float, qy: float, qz: float, walls: Obstacles) -> bool:
    """Return whether a prism or the ground blocks the line of sight p–q."""
    return ground_hides(px, py, pz, qx, qy, qz, walls.ground) or line_blocked(px, py, pz, qx, qy, qz, walls)
