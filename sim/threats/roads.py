"""Paths of a ground vehicle: shortest paths around the obstacles by a visibility graph."""

from __future__ import annotations

import itertools
import math

import numpy as np
import shapely
from scipy.sparse.csgraph import dijkstra
from shapely.geometry import Polygon, box
from shapely.geometry.base import BaseGeometry

from companion.frames import FloatArray
from companion.types.threat import Obstacle

_GROUND_M = 2.0


class Roads:
    """Visibility graph over the corners of the obstacles that stand on the ground.

    Parameters
    ----------
    obstacles : sequence of Obstacle
        Obstacles; a vehicle drives under those whose base is above two metres.
    bounds : tuple of float
        West, south, east, north limits [m].
    clearance_m : float
        Distance of paths from obstacles.
    """

    def __init__(
        self, obstacles: tuple[Obstacle, ...], bounds: tuple[float, float, float, float], clearance_m: float
    ) -> None:
        standing = [Polygon(entry.polygon_enu_m) for entry in obstacles if entry.base_m < _GROUND_M]
        self.walls: BaseGeometry = shapely.unary_union(standing)
        self._blocked = self.walls.buffer(clearance_m - 0.05, join_style="mitre", mitre_limit=1.6)
        corridor = self.walls.buffer(clearance_m, join_style="mitre", mitre_limit=1.6)
        shapely.prepare(self.walls)
        shapely.prepare(self._blocked)
        corners = shapely.get_coordinates(corridor)
        is_inside = shapely.contains_xy(box(*bounds), corners[:, 0], corners[:, 1])
        self.corners: FloatArray = np.unique(corners[is_inside], axis=0)
        count = len(self.corners)
        lengths = np.full((count, count), np.inf)
        for index in range(count):
            lengths[index] = self.distances(self.corners[index], self.corners)
        np.fill_diagonal(lengths, 0.0)
        self._lengths, self._previous = np.zeros((0, 0)), np.zeros((0, 0), dtype=np.int64)
        if count:
            graph = np.where(np.isfinite(lengths), np.maximum(lengths, 1e-9), 0.0)
            self._lengths, self._previous = dijkstra(graph, directed=False, return_predecessors=True)

    def is_free(self, east_m: float, north_m: float) -> bool:
        """Return whether a point is off every obstacle, without the clearance."""
        return not bool(shapely.intersects_xy(self.walls, east_m, north_m))

    def is_clear(self, points: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return which of ``points`` (N, 2) [m] keep the clearance, (N,)."""
        return ~np.asarray(shapely.intersects_xy(self._blocked, points[:, 0], points[:, 1]))

    def distances(self, origin: FloatArray, points: FloatArray) -> FloatArray:
        """Straight distances (N,) from ``origin`` (2,) to ``points`` (N, 2) [m].

        Infinite where a wall lies between.
        """
        if len(points) == 0:
            return np.zeros(0)
        segments = np.empty((len(points), 2, 2))
        segments[:, 0], segments[:, 1] = origin, points
        is_blocked = shapely.intersects(self._blocked, shapely.linestrings(segments))
        lengths = np.hypot(*(points - origin).T)
        return np.where(is_blocked, np.inf, lengths)

    def reach(self, origin: FloatArray) -> tuple[FloatArray, np.ndarray[tuple[int], np.dtype[np.int64]]]:
        """Distances of all corners from ``origin`` (2,), (C,) [m], and the corners first driven to, (C,)."""
        if len(self.corners) == 0:
            return np.zeros(0), np.zeros(0, dtype=np.int64)
        first = self.distances(origin, self.corners)
        if not np.isfinite(first).any():  # Within the clearance of a wall: leave by the nearest corner.
            gaps = np.hypot(*(self.corners - origin).T)
            first = np.where(gaps <= gaps.min() + 1e-6, gaps, np.inf)
        totals = first[:, None] + self._lengths
        entry = np.argmin(totals, axis=0)
        return totals[entry, np.arange(len(entry))], entry

    def way(self, entry: int, exit_corner: int) -> list[tuple[float, float]]:
        """Corners from an entry to an exit, both included."""
        chain = [exit_corner]
        while chain[-1] != entry:
            step = int(self._previous[entry, chain[-1]])
            if step < 0:
                break
            chain.append(step)
        return [(float(self.corners[index, 0]), float(self.corners[index, 1])) for index in reversed(chain)]


def polyline_points(corners: list[tuple[float, float]], spacing_m: float) -> FloatArray:
    """Points along a polyline at most a spacing apart, (N, 2) [m], its corners among them."""
    points = [corners[0]]
    for start, end in itertools.pairwise(corners):
        count = max(1, math.ceil(math.dist(start, end) / spacing_m))
        for step in range(1, count + 1):
            part = step / count
            points.append((start[0] + part * (end[0] - start[0]), start[1] + part * (end[1] - start[1])))
    return np.array(points)
