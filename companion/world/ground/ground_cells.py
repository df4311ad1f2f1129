"""The ground as the planner's cells, each with the highest and the lowest ground in it.

Between four posts the ground is bilinear, so that it lies between the highest and the lowest of them. Where
posts are far apart, more are put between them on the same surface, and cells are as small. Each square of
posts is entered in every cell that its bounding box touches.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.frames import SingleArray
from companion.kernels.arrays import Ground, IntArray
from companion.types.elevation import ElevationPosts
from companion.world.ground.bilinear import bilinear
from companion.world.ground.elevation_file import TerrainError, posts_over

FINE_M = 12.5  # Posts farther apart than this have others between them.
CELLS_MAX = 2_000  # Most cells along the longer side of the bounds.
BLOCK_ROWS = 50  # Rows of posts that are entered at once.


def spacing_m(posts: ElevationPosts, bounds: tuple[float, ...]) -> float:
    """Return the distance of neighbouring posts in the middle of the bounds, the larger of both ways [m].

    Parameters
    ----------
    posts : ElevationPosts
        The posts.
    bounds : tuple of float
        East and north, each low and high [m].
    """
    there = posts.frame.transformer_to(posts.crs)
    x, y = there.transform(0.5 * (bounds[0] + bounds[1]), 0.5 * (bounds[2] + bounds[3]))
    xs, ys = np.array([x, x + posts.step_x, x]), np.array([y, y, y + posts.step_y])
    east, north = there.transform(xs, ys, direction="INVERSE")
    return float(np.hypot(east[1:] - east[0], north[1:] - north[0]).max())


def ground_cells(
    posts: ElevationPosts, bounds: tuple[float, ...], *, least_m: float, wanted_m: float, most_m: float,
    drivable: float,
) -> Ground:  # fmt: skip
    """Return the ground over the bounds.

    Parameters
    ----------
    posts : ElevationPosts
        Posts that cover the bounds.
    bounds : tuple of float
        East and north, each low and high [m].
    least_m, wanted_m, most_m, drivable : float
        As in :class:`~companion.kernels.arrays.Ground`.

    Raises
    ------
    TerrainError
        If the posts do not cover the bounds.
    """
    west, east, south, north = bounds[:4]
    posts = posts_over(posts, bounds)
    apart, least_side = spacing_m(posts, bounds), max(east - west, north - south) / CELLS_MAX
    parts = max(1, math.ceil(apart / max(FINE_M, least_side) - 0.5))
    posts, side = _divided(posts, parts), max(apart / parts, least_side)
    shape = (math.ceil((east - west) / side) + 1, math.ceil((north - south) / side) + 1)
    high, low = (np.full(shape, height, dtype=np.float32) for height in (-math.inf, math.inf))
    there = posts.frame.transformer_to(posts.crs)
    x = posts.first_x + posts.step_x * np.arange(posts.up_m.shape[1])
    for first in range(0, posts.up_m.shape[0] - 1, BLOCK_ROWS):
        up = posts.up_m[first : first + BLOCK_ROWS + 1]
        y = posts.first_y + posts.step_y * (first + np.arange(len(up)))
        xs, ys = np.meshgrid(x, y)
        places = np.stack(there.transform(xs, ys, direction="INVERSE"))
        cells = np.floor((places - np.array([west, south]).reshape(2, 1, 1)) / side).astype(np.int64)
        _enter(high, low, up, cells)
    if not np.isfinite(low).all():
        raise TerrainError(posts.name, "posts that cover the bounds")
    return Ground(high, low, np.array([west, south, side]), least_m, wanted_m, most_m, drivable)


def _divided(posts: ElevationPosts, parts: int) -> ElevationPosts:
    """Return posts on the same surface, ``parts`` for each."""
    if parts == 1:
        return posts
    rows, columns = ((count - 1) * parts + 1 for count in posts.up_m.shape)
    at = np.meshgrid(np.arange(rows) / parts, np.arange(columns) / parts, indexing="ij")
    up = bilinear(posts.up_m, *at).astype(np.float32)
    return replace(posts, up_m=up, step_x=posts.step_x / parts, step_y=posts.step_y / parts)


def _enter(high: SingleArray, low: SingleArray, up: SingleArray, cells: IntArray) -> None:
    """Enter the squares between posts into cells, in place.

    ``high`` and ``low`` (GX, GY) are of the cells; ``up`` (R, C) of the posts [m], ``cells`` (2, R, C) their
    cells, also beyond the grid.
    """
    most, least = _over_squares(np.maximum, up), _over_squares(np.minimum, up)
    begins = [_over_squares(np.minimum, axis) for axis in cells]
    spans = [_over_squares(np.maximum, axis) - begin for axis, begin in zip(cells, begins, strict=True)]
    for across, along in np.ndindex(*(int(span.max()) + 1 for span in spans)):
        i, j = begins[0] + across, begins[1] + along
        touched = (across <= spans[0]) & (along <= spans[1])
        touched &= (i >= 0) & (i < high.shape[0]) & (j >= 0) & (j < high.shape[1])
        np.maximum.at(high, (i[touched], j[touched]), most[touched])
        np.minimum.at(low, (i[touched], j[touched]), least[touched])


def _over_squares(combine: np.ufunc, values: NDArray[Any]) -> NDArray[Any]:
    """Return a function of the four corners of every square, (R - 1, C - 1), of ``values`` (R, C)."""
    sides = combine(values[:-1], values[1:])
    return np.asarray(combine(sides[:, :-1], sides[:, 1:]))
