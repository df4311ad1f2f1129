"""Upright prisms, and the exact distance of segments from them, with shapely.

Branch and bound along each segment; nothing is sampled.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from companion.frames import FloatArray
from companion.types.threat import Obstacle

LENGTH_TOLERANCE_M = 0.2  # Tolerance of clearances: a planner that samples an edge sees corners this late.
PIECE_MIN_M = 0.05  # Shorter pieces of a climbing segment are not split further.


class Prisms:
    """The obstacles of one world, indexed.

    Parameters
    ----------
    obstacles : sequence of Obstacle
        The prisms. A polygon that crosses itself is replaced by its convex hull.

    Raises
    ------
    ValueError
        If an obstacle has a number that is not finite, or fewer than three corners.
    """

    def __init__(self, obstacles: Sequence[Obstacle]) -> None:
        self._names = [obstacle.name for obstacle in obstacles]
        heights = [(min(o.base_m, o.top_m), max(o.base_m, o.top_m)) for o in obstacles]
        self._heights = np.array(heights, dtype=np.float64).reshape(-1, 2)
        for obstacle in obstacles:
            numbers = (*obstacle.polygon_enu_m.ravel(), obstacle.base_m, obstacle.top_m)
            if len(obstacle.polygon_enu_m) < 3 or not np.isfinite(numbers).all():
                raise ValueError(f"obstacle {obstacle.name} is no polygon of finite numbers")
        polygons = [shapely.Polygon(obstacle.polygon_enu_m) for obstacle in obstacles]
        solid = [polygon if polygon.is_valid else polygon.convex_hull for polygon in polygons]
        self._polygons = np.array(solid, dtype=object)
        shapely.prepare(self._polygons)
        self._tree = shapely.STRtree(self._polygons)

    def near(
        self, starts: FloatArray, ends: FloatArray, margins: FloatArray, bulges: FloatArray
    ) -> Iterator[tuple[int, str, float]]:
        """Yield the segments that come too near to a prism.

        Parameters
        ----------
        starts, ends : ndarray, shape (N, 3)
            Ends of the segments, east, north, up [m].
        margins : ndarray, shape (N,)
            Distance to keep [m].
        bulges : ndarray, shape (N,)
            Largest distance of the flown curve from the segment [m].

        Yields
        ------
        tuple
            Number of the segment, name of the obstacle, distance less bulge [m].
        """
        if not len(starts) or not len(self._polygons):
            return
        needed = margins + bulges
        which, prism = self._tree.query(_lines(starts, ends), predicate="dwithin", distance=needed)
        distances = self._distances(starts[which], ends[which], prism, needed[which] + 1.0)
        clear = distances - bulges[which]
        hit = (clear < margins[which] - LENGTH_TOLERANCE_M) | (clear <= 0.0)
        for pair in np.flatnonzero(hit):
            yield int(which[pair]), self._names[prism[pair]], max(float(clear[pair]), 0.0)

    def _distances(
        self, starts: FloatArray, ends: FloatArray, prisms: NDArray[np.int64], limit: FloatArray
    ) -> FloatArray:
        """Return the distance (N,) of segments from prisms, or the limit if that is smaller [m].

        Segments lead from ``starts`` (N, 3) to ``ends`` (N, 3) [m]. ``prisms`` (N,) is the number of each
        one's prism, ``limit`` (N,) the limit [m].

        Branch and bound along the segment: horizontal distance and height gap of a piece bound its distance
        from below, and are exact if the height gap is constant.
        """
        result = limit.copy()
        best = limit.copy()  # upper bound of each pair's distance
        pair = np.arange(len(starts))
        low, high = np.zeros(len(starts)), np.ones(len(starts))
        lengths = np.linalg.norm(ends - starts, axis=1)
        while len(pair):
            p = starts[pair] + low[:, None] * (ends - starts)[pair]
            q = starts[pair] + high[:, None] * (ends - starts)[pair]
            polygons, heights = self._polygons[prisms[pair]], self._heights[prisms[pair]]
            gap_p, gap_q = _height_gap(p[:, 2], heights), _height_gap(q[:, 2], heights)
            # Heights change linearly, so a piece that straddles the prism's heights has a gap of 0 inside.
            straddles = (np.minimum(p[:, 2], q[:, 2]) < heights[:, 1]) & (
                np.maximum(p[:, 2], q[:, 2]) > heights[:, 0]
            )
            gap = np.where(straddles, 0.0, np.minimum(gap_p, gap_q))
            lower = np.hypot(shapely.distance(_lines(p, q), polygons), gap)
            np.minimum.at(best, pair, np.hypot(shapely.distance(shapely.points(p[:, :2]), polygons), gap_p))
            np.minimum.at(best, pair, np.hypot(shapely.distance(shapely.points(q[:, :2]), polygons), gap_q))
            is_leaf = (gap_p == gap_q) & (gap == gap_p) | ((high - low) * lengths[pair] < PIECE_MIN_M)
            np.minimum.at(result, pair[is_leaf], lower[is_leaf])
            split = ~is_leaf & (lower < best[pair])
            pair, low, high = pair[split], low[split], high[split]
            middle = 0.5 * (low + high)
            pair = np.concatenate([pair, pair])
            low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
        return np.minimum(result, best)


def _height_gap(heights: FloatArray, prisms: FloatArray) -> FloatArray:
    """Return the height (N,) of points above or below prisms, 0 between base and top [m].

    ``heights`` (N,) are the points' heights, ``prisms`` (N, 2) base and top of each one's prism [m].
    """
    gap: FloatArray = np.maximum(np.maximum(prisms[:, 0] - heights, heights - prisms[:, 1]), 0.0)
    return gap


def _lines(starts: FloatArray, ends: FloatArray) -> NDArray[np.object_]:
    """Return the horizontal projections (N,) of segments from ``starts`` to ``ends`` (N, 3) [m]."""
    lines: NDArray[np.object_] = shapely.linestrings(np.stack([starts[:, :2], ends[:, :2]], axis=1))
    return lines
