"""Obstacles in kernel form, with their distance field."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from companion.kernels.arrays import Obstacles
from companion.kernels.geometry.prism_distance import fill_field, no_field
from companion.types.threat import Obstacle

FIELD_NODES = (161, 161, 13)


def packed_obstacles(
    obstacles: Sequence[Obstacle], bounds: tuple[float, float, float, float, float, float]
) -> Obstacles:
    """Flat arrays of all prisms, and the distance field over the bounds.

    Parameters
    ----------
    obstacles : sequence of Obstacle
        May be empty.
    bounds : tuple of float
        East, north, up of the field, each low and high [m].
    """
    polygons = [obstacle.polygon_enu_m for obstacle in obstacles]
    sizes = [len(polygon) for polygon in polygons]
    edges = np.zeros((sum(sizes), 4))
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    for polygon, first, last in zip(polygons, offsets[:-1], offsets[1:], strict=True):
        edges[first:last, :2] = polygon
        edges[first:last, 2:] = np.roll(polygon, -1, axis=0)
    heights = np.array([[o.base_m, o.top_m] for o in obstacles], dtype=np.float64).reshape(-1, 2)
    boxes = np.array([[*p.min(axis=0), *p.max(axis=0)] for p in polygons], dtype=np.float64).reshape(-1, 4)
    field, grid = no_field()
    packed = Obstacles(edges, offsets, heights, boxes, field, grid)
    if not polygons:
        return packed
    low, high = np.array(bounds[0::2]), np.array(bounds[1::2])
    nodes = np.array(FIELD_NODES)
    spacing = np.maximum((high - low) / (nodes - 1), 1.0)
    shape = tuple(int(n) for n in np.minimum(nodes, np.ceil((high - low) / spacing).astype(int) + 1))
    field, grid = np.zeros(shape), np.concatenate([low, spacing])
    fill_field(field, grid, packed)
    return packed._replace(field=field, grid=grid)
