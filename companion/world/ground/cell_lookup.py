"""The cells of the ground below many places at once, by the same rule as in the kernels."""

from __future__ import annotations

import numpy as np

from companion.frames import FloatArray
from companion.kernels.arrays import Ground, IntArray
from companion.kernels.geometry.ground_surface import DEEP


def has_ground(ground: Ground) -> bool:
    """Return whether there is any ground; without a map it lies too deep to matter."""
    return bool(ground.low[0, 0] > DEEP)


def cell_at(ground: Ground, east_m: float, north_m: float) -> tuple[int, int]:
    """Return the cell of one place; the nearest one beyond the grid."""
    i, j = (int(cells_along(ground, axis, np.array([at]))[0]) for axis, at in enumerate((east_m, north_m)))
    return i, j


def cells_along(ground: Ground, axis: int, at: FloatArray) -> IntArray:
    """Return the cells of coordinates along one axis; the first or last one beyond the grid.

    Parameters
    ----------
    ground : Ground
        The ground.
    axis : int
        0 for east, 1 for north.
    at : ndarray, shape (N,)
        Coordinates [m].

    Returns
    -------
    ndarray, shape (N,)
        A cell for each coordinate.
    """
    cells = np.floor((at - ground.grid[axis]) / ground.grid[2])
    return np.asarray(np.clip(cells, 0, ground.high.shape[axis] - 1), dtype=np.int64)


def left_over_ground(ground: Ground, places: FloatArray) -> FloatArray:
    """Return what is left above the lowest and below the highest height over ground [m].

    It is that of :func:`~companion.kernels.geometry.ground_surface.over_ground`; negative outside.

    Parameters
    ----------
    ground : Ground
        The ground.
    places : ndarray, shape (N, C)
        East, north, up [m] in the first three columns.

    Returns
    -------
    ndarray, shape (N,)
        What is left at each place [m].
    """
    at = cells_along(ground, 0, places[:, 0]), cells_along(ground, 1, places[:, 1])
    above = places[:, 2] - ground.high[at] - ground.least
    below = ground.low[at].astype(np.float64) + ground.most - places[:, 2]
    return np.minimum(above, below)
