"""Obstacles in kernel form, with their distance field."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np

from companion.kernels.arrays import FloatArray, Ground, Obstacles
from companion.kernels.geometry.ground_surface import DEEP
from companion.kernels.geometry.prism_distance import fill_field, no_field
from companion.types.threat import Obstacle

FIELD_NODES = (161, 161, 13)  # The most nodes of the distance field: east, north, up.
FAR_M = 1e7  # Without any ground, one cell reaches this far in each direction.
CACHED_WORLDS_MAX = 4  # This many packed worlds stay in memory, of about three megabytes each.
NOWHERE_M = np.full((1, 1), DEEP, dtype=np.float32)
# Ground that lies too deep to matter, and above which no height is too great.
NO_GROUND = Ground(
    NOWHERE_M, NOWHERE_M, np.array([-FAR_M, -FAR_M, 2.0 * FAR_M]), 0.0, 0.0, math.inf, math.inf
)


def packed_obstacles(
    obstacles: Sequence[Obstacle],
    bounds: tuple[float, float, float, float, float, float],
    ground: Ground | None = None,
) -> Obstacles:
    """Return the flat arrays of all prisms with the distance field over the bounds.

    The arrays are shared and read-only: the most recent results are cached. A world that takes seconds to
    pack is therefore packed in a thread, and found in the cache by the event loop.

    Parameters
    ----------
    obstacles : sequence of Obstacle
        The prisms; none is allowed.
    bounds : tuple of float
        The field's east, north and up, each low and high [m].
    ground : Ground, optional
        The ground; by default there is none.
    """
    shapes = tuple(
        (np.asarray(entry.polygon_enu_m, dtype=np.float64).tobytes(), entry.base_m, entry.top_m)
        for entry in obstacles
    )
    packed = _packed(shapes, tuple(bounds))
    return packed if ground is None else packed._replace(ground=ground)


def packed_with(
    packed: Obstacles,
    obstacles: Sequence[Obstacle],
    bounds: tuple[float, float, float, float, float, float],
) -> Obstacles:
    """Return packed prisms and a few more; this takes far less time than packing all of them.

    Parameters
    ----------
    packed : Obstacles
        Packed prisms.
    obstacles : sequence of Obstacle
        More prisms.
    bounds : tuple of float
        The bounds with which ``packed`` was packed [m].
    """
    more = _pack([(entry.polygon_enu_m, entry.base_m, entry.top_m) for entry in obstacles], bounds)
    if not len(packed.heights) or not len(more.heights):
        return more._replace(ground=packed.ground) if len(more.heights) else packed
    return Obstacles(
        np.vstack([packed.edges, more.edges]),
        np.concatenate([packed.offsets, packed.offsets[-1] + more.offsets[1:]]),
        np.vstack([packed.heights, more.heights]),
        np.vstack([packed.boxes, more.boxes]),
        np.minimum(packed.field, more.field),
        packed.grid,
        packed.ground,
    )


@functools.lru_cache(maxsize=CACHED_WORLDS_MAX)
def _packed(shapes: tuple[tuple[bytes, float, float], ...], bounds: tuple[float, ...]) -> Obstacles:
    """Pack prisms that are given by hashable values: the bytes of their corners, base and top [m]."""
    return _pack(
        [(np.frombuffer(corners).reshape(-1, 2), base_m, top_m) for corners, base_m, top_m in shapes], bounds
    )


def _pack(shapes: Sequence[tuple[FloatArray, float, float]], bounds: tuple[float, ...]) -> Obstacles:
    """Pack prisms that are given by ``shapes``, their corners (N, 2), base and top [m]."""
    polygons = [polygon for polygon, _, _ in shapes]
    sizes = [len(polygon) for polygon in polygons]
    edges = np.zeros((sum(sizes), 4))
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    for polygon, first, last in zip(polygons, offsets[:-1], offsets[1:], strict=True):
        edges[first:last, :2] = polygon
        edges[first:last, 2:] = np.roll(polygon, -1, axis=0)
    heights = np.array([[base_m, top_m] for _, base_m, top_m in shapes], dtype=np.float64).reshape(-1, 2)
    boxes = np.array([[*p.min(axis=0), *p.max(axis=0)] for p in polygons], dtype=np.float64).reshape(-1, 4)
    field, grid = no_field()
    packed = Obstacles(edges, offsets, heights, boxes, field, grid, NO_GROUND)
    if not polygons:
        return packed
    low, high = np.array(bounds[0::2]), np.array(bounds[1::2])
    nodes = np.array(FIELD_NODES)
    spacing = np.maximum((high - low) / (nodes - 1), 1.0)
    shape = tuple(int(n) for n in np.minimum(nodes, np.ceil((high - low) / spacing).astype(int) + 1))
    field, grid = np.zeros(shape), np.concatenate([low, spacing])
    fill_field(field, grid, packed)
    return packed._replace(field=field, grid=grid)
