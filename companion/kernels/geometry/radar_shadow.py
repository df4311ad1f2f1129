"""Shadows: what obstacles hide from a radar.

For a prism standing on the ground, the points hidden above one ground position are all those
below a height: a line of sight that clears the prism stays clear when its end is raised. The
shadow field stores that height, so a query is a look-up instead of a ray cast. Floating prisms
(base above the radar's ground) cast no shadow in the field: a threat is never underrated for them.
"""

from __future__ import annotations

import math

from companion.kernels.arrays import Float1D, Float2D, Obstacles
from companion.kernels.geometry.prism_distance import point_in_polygon
from companion.kernels.native.kernel import kernel

NO_SHADOW = -1.0e9
NEARLY_NORTH_M = 1e-6
STANDS_M = 1.0  # A prism whose base is higher does not stand on the ground.


@kernel
def crossing_interval(
    px: float, py: float, qx: float, qy: float, obstacles: Obstacles, o: int
) -> tuple[float, float]:
    """First and last fraction of p–q (in the plane) inside prism ``o``'s polygon; (1, 0) if none."""
    box = obstacles.boxes[o]
    if max(px, qx) < box[0] or min(px, qx) > box[2] or max(py, qy) < box[1] or min(py, qy) > box[3]:
        return 1.0, 0.0
    first, last = obstacles.offsets[o], obstacles.offsets[o + 1]
    t_in, t_out = 1.0, 0.0
    if point_in_polygon(px, py, obstacles.edges, first, last):
        t_in = 0.0
        t_out = 0.0
    if point_in_polygon(qx, qy, obstacles.edges, first, last):
        t_out = 1.0
        t_in = min(t_in, 1.0)
    dx, dy = qx - px, qy - py
    for e in range(first, last):
        x0, y0, x1, y1 = obstacles.edges[e]
        ex, ey = x1 - x0, y1 - y0
        det = dx * ey - dy * ex
        if det == 0.0:
            continue
        t = ((x0 - px) * ey - (y0 - py) * ex) / det
        u = ((x0 - px) * dy - (y0 - py) * dx) / det
        if 0.0 <= t <= 1.0 and 0.0 <= u <= 1.0:
            t_in = min(t_in, t)
            t_out = max(t_out, t)
    return t_in, t_out


@kernel
def shadow_behind(rx: float, ry: float, rz: float, x: float, y: float, obstacles: Obstacles, o: int) -> float:
    """Up coordinate below which prism ``o`` hides a point over (x, y) from a radar at (rx, ry, rz) [m]."""
    t_in, t_out = crossing_interval(rx, ry, x, y, obstacles, o)
    if t_in > t_out:
        return NO_SHADOW
    top = obstacles.heights[o, 1]
    t = t_in if top >= rz else t_out
    return math.inf if t <= 1e-9 else rz + (top - rz) / t


@kernel
def casts_shadow(obstacles: Obstacles, o: int) -> bool:
    """Return whether prism ``o`` stands on the ground, so that it casts a shadow in the field."""
    return obstacles.heights[o, 0] <= STANDS_M


@kernel
def sector_behind(rx: float, ry: float, obstacles: Obstacles, o: int) -> tuple[float, float, float, float]:
    """The sector in which prism ``o`` is seen from (rx, ry): its clockwise and counter-clockwise edges [m].

    Both are vectors (east, north) to a corner of the prism; zeros where (rx, ry) is in its box, and the
    sector is all round.
    """
    box = obstacles.boxes[o]
    if box[0] <= rx <= box[2] and box[1] <= ry <= box[3]:
        return 0.0, 0.0, 0.0, 0.0
    first, last = obstacles.offsets[o], obstacles.offsets[o + 1]
    ax, ay = obstacles.edges[first, 0] - rx, obstacles.edges[first, 1] - ry
    bx, by = ax, ay
    for e in range(first + 1, last):
        vx, vy = obstacles.edges[e, 0] - rx, obstacles.edges[e, 1] - ry
        if ax * vy - ay * vx < 0.0:
            ax, ay = vx, vy
        if bx * vy - by * vx > 0.0:
            bx, by = vx, vy
    return ax, ay, bx, by


@kernel
def fill_shadows(shadows: Float2D, grid: Float1D, radar: Float1D, obstacles: Obstacles) -> None:
    """Shadow height of one radar at every node of a grid, in place.

    That of the prism that hides most; only nodes in the sector behind a prism are looked at.
    ``shadows`` (NX, NY) receives it [m]; ``grid`` (3,) x0 y0 and the spacing [m]; ``radar`` (≥ 3,) x y z [m].
    """
    rx, ry, rz, spacing = radar[0], radar[1], radar[2], grid[2]
    shadows[:] = NO_SHADOW
    for o in range(obstacles.heights.shape[0]):
        if not casts_shadow(obstacles, o):
            continue
        ax, ay, bx, by = sector_behind(rx, ry, obstacles, o)
        for i in range(shadows.shape[0]):
            x = grid[0] + i * spacing
            low, high = grid[1], grid[1] + shadows.shape[1] * spacing
            # cross(a, d) ≥ 0 and cross(b, d) ≤ 0 with d from the radar; an edge nearly along the rows' north
            # bounds no row.
            if abs(ax) > NEARLY_NORTH_M:
                bound = ry + ay * (x - rx) / ax
                low, high = (max(low, bound), high) if ax > 0.0 else (low, min(high, bound))
            if abs(bx) > NEARLY_NORTH_M:
                bound = ry + by * (x - rx) / bx
                low, high = (low, min(high, bound)) if bx > 0.0 else (max(low, bound), high)
            if low - high > 2.0 * spacing:
                continue
            first = max(int((low - grid[1]) / spacing) - 1, 0)  # One more cell allows for rounding.
            last = min(int((high - grid[1]) / spacing) + 2, shadows.shape[1] - 1)
            for j in range(first, last + 1):
                height = shadow_behind(rx, ry, rz, x, grid[1] + j * spacing, obstacles, o)
                shadows[i, j] = max(shadows[i, j], height)


@kernel
def is_hidden(x: float, y: float, z: float, shadows: Float2D, grid: Float1D) -> bool:
    """Return whether a point is in a radar's shadow: it must be below all four nodes of its cell.

    Taking the lowest corner shrinks shadows by at most a cell: masking is never claimed where the
    grid cannot show it. ``shadows`` (NX, NY) heights at the nodes [m]; ``grid`` (3,) x0 y0 and the
    spacing [m].
    """
    i, j = int(math.floor((x - grid[0]) / grid[2])), int(math.floor((y - grid[1]) / grid[2]))
    if i < 0 or j < 0 or i + 1 >= shadows.shape[0] or j + 1 >= shadows.shape[1]:
        return False
    return z < shadows[i, j] and z < shadows[i + 1, j] and z < shadows[i, j + 1] and z < shadows[i + 1, j + 1]
