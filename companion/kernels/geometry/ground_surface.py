"""The ground as square cells: height over it, what it hides, and whether a line meets it.

Each cell has two heights. A flight keeps its height over ``high``, the highest ground of the cell; a line of
sight is blocked only by ``low``, the lowest. Both err on the safe side.

Symbols: ``x, y, z`` a point; ``p, q`` ends of a segment; ``t`` the fraction along it.

References
----------
Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing", Eurographics 1987.
"""

from __future__ import annotations

import math

from companion.kernels.arrays import Float1D, Float2D, Ground
from companion.kernels.native.kernel import inlined, kernel

DEEP = -(2.0**40)  # Without any ground, it lies so deep that nothing depends on it [m]; a float32 too.
PARALLEL_M = 1e-9  # A segment that advances less than this along an axis crosses no border of that axis [m].


@inlined
def cell_along(x: float, origin: float, spacing: float, n: int) -> int:
    """Return the cell of a coordinate along one axis; the first or last one beyond the grid."""
    return min(n - 1, max(0, int(math.floor((x - origin) / spacing))))


@kernel
def over_ground(x: float, y: float, z: float, ground: Ground) -> float:
    """Height to spare above the lowest and below the highest height over ground [m]; negative outside."""
    i = cell_along(x, ground.grid[0], ground.grid[2], ground.high.shape[0])
    j = cell_along(y, ground.grid[1], ground.grid[2], ground.high.shape[1])
    return min(z - float(ground.high[i, j]) - ground.least, float(ground.low[i, j]) + ground.most - z)


@inlined
def lack_of_height(x: float, y: float, z: float, ground: Ground) -> float:
    """Return the missing share of the wanted height over ground: 1 at the lowest height, 0 at the wanted."""
    i = cell_along(x, ground.grid[0], ground.grid[2], ground.high.shape[0])
    j = cell_along(y, ground.grid[1], ground.grid[2], ground.high.shape[1])
    missing = float(ground.high[i, j]) + ground.wanted - z
    return min(1.0, missing / (ground.wanted - ground.least)) if missing > 0.0 else 0.0


@kernel
def crosses_ground(
    px: float, py: float, pz: float, qx: float, qy: float, qz: float, ground: Ground, margin: float
) -> bool:
    """Return whether p–q has less than ``margin`` to spare over ground anywhere [m], cell by cell."""
    grid, high, low = ground.grid, ground.high, ground.low
    n, m, side = high.shape[0], high.shape[1], grid[2]
    i, j = cell_along(px, grid[0], side, n), cell_along(py, grid[1], side, m)
    i_end, j_end = cell_along(qx, grid[0], side, n), cell_along(qy, grid[1], side, m)
    dx, dy, dz, t = qx - px, qy - py, qz - pz, 0.0
    while True:
        t_out, i_next, j_next = _out_of(px, py, dx, dy, grid, i, j, i_end, j_end)
        z_in, z_out = pz + t * dz, pz + t_out * dz
        if min(z_in, z_out) - float(high[i, j]) - ground.least < margin:
            return True
        if float(low[i, j]) + ground.most - max(z_in, z_out) < margin:
            return True
        if t_out >= 1.0:
            return False
        i, j, t = i_next, j_next, t_out


@kernel
def ground_hides(px: float, py: float, pz: float, qx: float, qy: float, qz: float, ground: Ground) -> bool:
    """Return whether the ground blocks the line of sight p–q: it passes below the lowest ground of a cell."""
    grid, low = ground.grid, ground.low
    n, m, side = low.shape[0], low.shape[1], grid[2]
    i, j = cell_along(px, grid[0], side, n), cell_along(py, grid[1], side, m)
    i_end, j_end = cell_along(qx, grid[0], side, n), cell_along(qy, grid[1], side, m)
    dx, dy, dz, t = qx - px, qy - py, qz - pz, 0.0
    while True:
        t_out, i_next, j_next = _out_of(px, py, dx, dy, grid, i, j, i_end, j_end)
        if max(pz + t * dz, pz + t_out * dz) < low[i, j]:
            return True
        if t_out >= 1.0:
            return False
        i, j, t = i_next, j_next, t_out


@inlined
def _out_of(
    px: float, py: float, dx: float, dy: float, grid: Float1D, i: int, j: int, i_end: int, j_end: int
) -> tuple[float, int, int]:
    """Return the fraction at which a segment leaves a cell, at most 1, and the cell that it enters there."""
    tx = _leaves(px, dx, grid[0], grid[2], i, i_end)
    ty = _leaves(py, dy, grid[1], grid[2], j, j_end)
    if tx <= ty:
        return min(tx, 1.0), i + (1 if dx > 0.0 else -1), j
    return min(ty, 1.0), i, j + (1 if dy > 0.0 else -1)


@inlined
def _leaves(p: float, d: float, origin: float, side: float, cell: int, last: int) -> float:
    """The fraction at which a segment from ``p``, ``d`` long, leaves a cell along one axis; 2 in the last."""
    if cell == last or abs(d) < PARALLEL_M:
        return 2.0
    border = origin + side * (cell + (1 if d > 0.0 else 0))
    return (border - p) / d


@kernel
def ground_shadow(rx: float, ry: float, rz: float, x: float, y: float, ground: Ground) -> float:
    """Up coordinate below which the ground hides a point over (x, y) from a radar at (rx, ry, rz) [m].

    The ground of the radar's own cell hides nothing.
    """
    grid, low = ground.grid, ground.low
    n, m, side = low.shape[0], low.shape[1], grid[2]
    i, j = cell_along(rx, grid[0], side, n), cell_along(ry, grid[1], side, m)
    i_end, j_end = cell_along(x, grid[0], side, n), cell_along(y, grid[1], side, m)
    dx, dy, rise = x - rx, y - ry, -math.inf
    t_in, i_next, j_next = _out_of(rx, ry, dx, dy, grid, i, j, i_end, j_end)
    while i != i_end or j != j_end:
        i, j = i_next, j_next
        t_out, i_next, j_next = _out_of(rx, ry, dx, dy, grid, i, j, i_end, j_end)
        over = float(low[i, j]) - rz
        rise = max(rise, over / (t_out if over > 0.0 else max(t_in, 1e-9)))
        t_in = t_out
    return rz + rise


@kernel
def fill_ground_shadows(shadows: Float2D, grid: Float1D, radar: Float1D, ground: Ground) -> None:
    """Raise a radar's shadow heights to those of the ground, in place.

    ``shadows`` (NX, NY) heights below which a node is hidden [m]; ``grid`` (3,) x0 y0 and the spacing [m];
    ``radar`` (≥ 3,) x y z [m].
    """
    for i in range(shadows.shape[0]):
        for j in range(shadows.shape[1]):
            x, y = grid[0] + i * grid[2], grid[1] + j * grid[2]
            height = ground_shadow(radar[0], radar[1], radar[2], x, y, ground)
            shadows[i, j] = max(shadows[i, j], height)
