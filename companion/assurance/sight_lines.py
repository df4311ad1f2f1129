"""What walls hide, and which straight ways they leave free: exact, with shapely."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from companion.frames import FloatArray
from companion.types.threat import Obstacle

BoolArray = NDArray[np.bool_]

STANDS_M = 1.0  # higher a wall does not stand on the ground: it hides nothing, and is driven under
TOUCH_M = 1e-6  # of a wall that a line may touch


class SightLines:
    """The walls of one world that stand on the ground.

    Parameters
    ----------
    walls : sequence of Obstacle
        A polygon that crosses itself is taken as its convex hull.

    Attributes
    ----------
    standing : list of shapely.Polygon
        Those that hide.
    """

    def __init__(self, walls: Sequence[Obstacle]) -> None:
        grounded = [wall for wall in walls if min(wall.base_m, wall.top_m) <= STANDS_M]
        polygons = [shapely.Polygon(wall.polygon_enu_m) for wall in grounded]
        self.standing = [polygon if polygon.is_valid else polygon.convex_hull for polygon in polygons]
        self._tops = np.array([max(wall.base_m, wall.top_m) for wall in grounded], dtype=np.float64)
        inner = [polygon.buffer(-TOUCH_M) for polygon in self.standing]
        self._polygons = np.array(inner, dtype=object)
        shapely.prepare(self._polygons)
        self._tree = shapely.STRtree(self._polygons)

    def is_free(self, eyes: FloatArray, places: FloatArray) -> BoolArray:
        """Whether straight lines pass over or beside all walls.

        Parameters
        ----------
        eyes, places : ndarray, shape (N, 3)
            Their ends [m].

        Returns
        -------
        ndarray, shape (N,)
            One answer a line.
        """
        lines, which, wall = self._crossings(eyes, places)
        tops, ends = self._tops[wall], np.stack([eyes[which, 2], places[which, 2]])
        hides = ends.max(axis=0) < tops
        unsure = np.flatnonzero(~hides & (ends.min(axis=0) < tops))
        if len(unsure):
            within = shapely.intersection(lines[which[unsure]], self._polygons[wall[unsure]])
            lowest = _lowest(eyes[which[unsure]], places[which[unsure]], within)
            hides[unsure] = lowest < tops[unsure]
        free = np.ones(len(eyes), dtype=bool)
        free[which[hides]] = False
        return free

    def is_way_free(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """Whether what drives straight from one place to another meets no wall.

        Parameters
        ----------
        starts, ends : ndarray, shape (N, 3)
            Their ends [m].

        Returns
        -------
        ndarray, shape (N,)
            One answer a way.
        """
        free = np.ones(len(starts), dtype=bool)
        free[self._crossings(starts, ends)[1]] = False
        return free

    def _crossings(
        self, starts: FloatArray, ends: FloatArray
    ) -> tuple[NDArray[np.object_], NDArray[np.int64], NDArray[np.int64]]:
        """Lines (N,) from ``starts`` (N, 3) to ``ends`` (N, 3) [m]; which cross which wall, (C,) each."""
        nothing = np.empty(0, dtype=np.int64)
        lines: NDArray[np.object_] = shapely.linestrings(np.stack([starts[:, :2], ends[:, :2]], axis=1))
        if not len(starts) or not len(self._polygons):
            return lines, nothing, nothing
        which, wall = self._tree.query(lines, predicate="intersects")
        return lines, which, wall


def _lowest(eyes: FloatArray, places: FloatArray, within: NDArray[np.object_]) -> FloatArray:
    """Lowest height (C,) of lines from ``eyes`` (C, 3) to ``places`` (C, 3) on parts ``within`` (C,) [m]."""
    points, pair = shapely.get_coordinates(within, return_index=True)
    along = places[pair, :2] - eyes[pair, :2]
    share = np.einsum("ij,ij->i", points - eyes[pair, :2], along) / np.einsum("ij,ij->i", along, along)
    lowest = np.full(len(eyes), np.inf)
    np.minimum.at(lowest, pair, eyes[pair, 2] + share * (places[pair, 2] - eyes[pair, 2]))
    return lowest
