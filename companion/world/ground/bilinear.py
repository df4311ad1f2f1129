"""Values between the posts of a grid, bilinear between four."""

from __future__ import annotations

import numpy as np

from companion.frames import FloatArray, SingleArray


def bilinear(values: FloatArray | SingleArray, rows: FloatArray, columns: FloatArray) -> FloatArray:
    """Return values at places within a grid.

    Parameters
    ----------
    values : ndarray, shape (R, C)
        Values at the posts, two at least along each side.
    rows, columns : ndarray, shape (N,)
        Places in rows and columns; those beyond the grid count as on its edge.

    Returns
    -------
    ndarray, shape (N,)
        Not a number where a post with any weight is.
    """
    v, u = np.clip(rows, 0.0, values.shape[0] - 1.0), np.clip(columns, 0.0, values.shape[1] - 1.0)
    j, i = (np.minimum(at.astype(np.int64), values.shape[axis] - 2) for axis, at in enumerate((v, u)))
    v, u = v - j, u - i
    total = np.zeros(np.shape(rows))
    for dj, di in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = (v if dj else 1.0 - v) * (u if di else 1.0 - u)
        total += np.where(weight > 0.0, weight * values[j + dj, i + di], 0.0)
    return total
