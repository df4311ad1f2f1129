"""Nearest nodes of a growing tree: its places sorted into square cells.

A tree grows at its end and is cut back at its end, so its index follows lazily: a query first takes in what
has been added and lets go of what was taken away (:func:`follow`). The answers are the same as if all nodes
were compared: the ``k`` nearest in the plane, equal distances by row.

Symbols: ``rows`` (N, ≥ 2) the tree's places as they are [m]; ``bounds`` (4,) x_min x_max y_min y_max [m].
"""

from __future__ import annotations

from companion.kernels.arrays import NUM_CELLS, Float1D, Float2D, GridIndex, Int1D
from companion.kernels.native.kernel import inlined_numpy_errors, kernel_numpy_errors
from companion.kernels.workspace import KNearest

FEW = 48  # Up to this many rows, comparing all of them is faster than the grid.


@inlined_numpy_errors
def cell_size(bounds: Float1D) -> float:
    """Side of a cell [m]: square cells that cover ``bounds`` (4,)."""
    return max(bounds[1] - bounds[0], bounds[3] - bounds[2], 1e-9) / NUM_CELLS


@inlined_numpy_errors
def cell_along(value: float, low: float, size: float) -> int:
    """Cell along one axis; those at the rim reach on outwards without end, what is no number is in 0."""
    at = (value - low) / size
    if at >= NUM_CELLS:
        return NUM_CELLS - 1
    return int(at) if at > 0.0 else 0


@inlined_numpy_errors
def cell_of(x: float, y: float, bounds: Float1D, size: float) -> int:
    """Number of a place's cell; ``bounds`` (4,) of all cells [m]."""
    return cell_along(x, bounds[0], size) * NUM_CELLS + cell_along(y, bounds[2], size)


@kernel_numpy_errors
def follow(index: GridIndex, filled: int, rows: Float2D, n: int, bounds: Float1D) -> None:
    """Bring an index of ``filled`` rows up to a tree of ``n``.

    Since it was asked last the tree may have grown or been cut back, or its last rows may have been
    replaced; rows below one that has kept its place are not looked at again. The extent only grows
    while rows come and go, and starts afresh with an empty index.

    ``rows`` (N, ≥ 2) the tree's places [m]; ``bounds`` (4,) of the cells [m].
    """
    cells, chain, places, extent = index.cells, index.chain, index.places, index.extent
    size = cell_size(bounds)
    while filled > 0 and (
        filled > n
        or places[filled - 1, 0] != rows[filled - 1, 0]
        or places[filled - 1, 1] != rows[filled - 1, 1]
    ):
        filled -= 1
        cells[cell_of(places[filled, 0], places[filled, 1], bounds, size)] = chain[filled]
    if filled == 0:
        extent[0], extent[1], extent[2], extent[3] = NUM_CELLS, -1, NUM_CELLS, -1
    while filled < n:
        x, y = rows[filled, 0], rows[filled, 1]
        places[filled, 0], places[filled, 1] = x, y
        i, j = cell_along(x, bounds[0], size), cell_along(y, bounds[2], size)
        extent[0], extent[1] = min(extent[0], i), max(extent[1], i)
        extent[2], extent[3] = min(extent[2], j), max(extent[3], j)
        chain[filled] = cells[i * NUM_CELLS + j]
        cells[i * NUM_CELLS + j] = filled
        filled += 1
    index.filled[0] = filled


@inlined_numpy_errors
def keep(near: KNearest, found: int, k: int, square: float, row: int) -> int:
    """Keep the ``k`` smallest (square, row) of ``near``, sorted; returns how many there are."""
    squares, rows = near.squares, near.rows
    if found == k:
        if square > squares[k - 1] or (square == squares[k - 1] and row > rows[k - 1]):
            return found
    else:
        found += 1
    at = found - 1
    while at > 0 and (squares[at - 1] > square or (squares[at - 1] == square and rows[at - 1] > row)):
        squares[at], rows[at] = squares[at - 1], rows[at - 1]
        at -= 1
    squares[at], rows[at] = square, row
    return found


@kernel_numpy_errors
def nearest_of_all(rows: Float2D, n: int, active: Int1D, x: float, y: float, k: int, near: KNearest) -> int:
    """Find the ``k`` nearest of ``n`` rows by looking at each; return how many there are.

    ``rows`` (N, ≥ 2) places [m]; ``active`` (N,) marks those that count, empty: all do.
    """
    found = 0
    for i in range(n):
        if active.shape[0] > 0 and active[i] == 0:
            continue
        d2 = (rows[i, 0] - x) ** 2 + (rows[i, 1] - y) ** 2
        if found < k or d2 < near.squares[k - 1]:
            found = keep(near, found, k, d2, i)
    return found


@inlined_numpy_errors
def least_distance(value: float, low: float, size: float, cell: int) -> float:
    """Least distance along one axis from a value to a cell's places [m]; 0 towards cells without end."""
    if cell > 0 and value < low + cell * size:
        return low + cell * size - value
    if cell < NUM_CELLS - 1 and value > low + (cell + 1) * size:
        return value - low - (cell + 1) * size
    return 0.0


@kernel_numpy_errors
def keep_chain(
    index: GridIndex, row: int, rows: Float2D, active: Int1D, x: float, y: float, found: int, k: int,
    near: KNearest,
) -> int:  # fmt: skip
    """Keep of one cell's rows, from ``row`` on, those nearest to a place; -1 where one is stale.

    ``rows`` (N, ≥ 2) the tree's places [m]; ``active`` (N,) marks those that count, empty: all do.
    """
    chain, places, squares = index.chain, index.places, near.squares
    while row >= 0:
        if active.shape[0] == 0 or active[row] == 1:
            d2 = (places[row, 0] - x) ** 2 + (places[row, 1] - y) ** 2
            if found < k or d2 <= squares[k - 1]:
                if places[row, 0] != rows[row, 0] or places[row, 1] != rows[row, 1]:
                    return -1
                found = keep(near, found, k, d2, row)
        row = chain[row]
    return found


@kernel_numpy_errors
def nearest_by_cells(
    index: GridIndex, rows: Float2D, bounds: Float1D, active: Int1D, x: float, y: float, k: int,
    near: KNearest,
) -> int:  # fmt: skip
    """Return the ``k`` nearest rows of an index, ring by ring of cells about the place; -1 where it is stale.

    Stale is an index that gives a row which is no longer there: the tree was rearranged meanwhile.
    Rings begin and end with the extent of what there is. Beyond ring ``r`` everything is at least ``r``
    cells away.

    ``rows`` (N, ≥ 2) the tree's places [m]; ``bounds`` (4,) of the cells [m]; ``active`` (N,) marks those
    that count, empty: all do.
    """
    cells, extent, squares = index.cells, index.extent, near.squares
    size = cell_size(bounds)
    i0, j0 = cell_along(x, bounds[0], size), cell_along(y, bounds[2], size)
    first = max(extent[0] - i0, i0 - extent[1], extent[2] - j0, j0 - extent[3], 0)
    last = max(i0 - extent[0], extent[1] - i0, j0 - extent[2], extent[3] - j0)
    found = 0
    for ring in range(first, last + 1):
        if found == k and squares[k - 1] < (max(ring - 1, 0) * size) ** 2:
            break
        for i in range(max(extent[0], i0 - ring), min(extent[1], i0 + ring) + 1):
            inner = abs(i - i0) < ring  # Only the two ends of such a column are on the ring.
            dx = least_distance(x, bounds[0], size, i)
            for j in range(j0 - ring, j0 + ring + 1, 2 * ring if inner else 1):
                if j < extent[2] or j > extent[3]:
                    continue
                row = cells[i * NUM_CELLS + j]
                if row < 0:
                    continue
                dy = least_distance(y, bounds[2], size, j)
                if found == k and dx * dx + dy * dy > squares[k - 1]:
                    continue
                found = keep_chain(index, row, rows, active, x, y, found, k, near)
                if found < 0:
                    return -1
    return found


@kernel_numpy_errors
def nearest(
    index: GridIndex, rows: Float2D, n: int, bounds: Float1D, active: Int1D, x: float, y: float,
    k: int, near: KNearest,
) -> int:  # fmt: skip
    """Find the ``k`` nearest of ``n`` rows after bringing the index up to date; return how many there are.

    ``rows`` (N, ≥ 2) the tree's places [m]; ``bounds`` (4,) of the cells [m]; ``active`` (N,) marks those
    that count, empty: all do.
    """
    if n <= FEW or n > index.chain.shape[0]:
        return nearest_of_all(rows, n, active, x, y, k, near)
    follow(index, index.filled[0], rows, n, bounds)
    found = nearest_by_cells(index, rows, bounds, active, x, y, k, near)
    if found < 0:
        index.cells[:] = -1
        follow(index, 0, rows, n, bounds)
        found = nearest_by_cells(index, rows, bounds, active, x, y, k, near)
    return found
