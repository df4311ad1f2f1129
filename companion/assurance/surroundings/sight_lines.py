"""Lines of sight and straight drives that walls leave free; exact, with shapely."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from companion.assurance.surroundings.ground_heights import GroundHeights
from companion.frames import FloatArray
from companion.types.threat import Obstacle

BoolArray = NDArray[np.bool_]

GROUNDED_MAX_M = 1.0  # A wall whose base is higher hides nothing, and vehicles drive under it.
WALL_CONTACT_TOLERANCE_M = 1e-6  # A line this close to a wall's side touches the wall, and does not cross it.


class SightLines:
    """The walls of one world that stand on the ground.

    Parameters
    ----------
    walls : sequence of Obstacle
        The walls. A polygon that crosses itself is replaced by its convex hull.
    ground : GroundHeights, optional
        Ground that blocks sight, too.

    Attributes
    ----------
    grounded : list of shapely.Polygon
        The walls that stand on the ground.
    """

    def __init__(self, walls: Sequence[Obstacle], ground: GroundHeights | None = None) -> None:
        self._ground = ground
        low_walls = [wall for wall in walls if min(wall.base_m, wall.top_m) <= GROUNDED_MAX_M]
        polygons = [shapely.Polygon(wall.polygon_enu_m) for wall in low_walls]
        self.grounded = [polygon if polygon.is_valid else polygon.convex_hull for polygon in polygons]
        self._tops = np.array([max(wall.base_m, wall.top_m) for wall in low_walls], dtype=np.float64)
        inner = [polygon.buffer(-WALL_CONTACT_TOLERANCE_M) for polygon in self.grounded]
        self._polygons = np.array(inner, dtype=object)
        shapely.prepare(self._polygons)
        self._tree = shapely.STRtree(self._polygons)

    def is_free(self, eyes: FloatArray, places: FloatArray) -> BoolArray:
        """Return which straight lines pass over or beside all walls, and over the ground.

        Parameters
        ----------
        eyes, places : ndarray, shape (N, 3)
            Ends of the lines [m].

        Returns
        -------
        ndarray, shape (N,)
            Whether each line is free.
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
        if self._ground is not None and free.any():
            free[free] = self._ground.is_free(eyes[free], places[free])
        return free

    def is_drivable(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """Return which straight drives meet no wall.

        Parameters
        ----------
        starts, ends : ndarray, shape (N, 3)
            Ends of the drives [m].

        Returns
        -------
        ndarray, shape (N,)
            Whether each drive is free.
        """
        free = np.ones(len(starts), dtype=bool)
        free[self._crossings(starts, ends)[1]] = False
        return free

    def _crossings(
        self, starts: FloatArray, ends: FloatArray
    ) -> tuple[NDArray[np.object_], NDArray[np.int64], NDArray[np.int64]]:
        """Return lines (N,) from ``starts`` to ``ends`` (N, 3) [m], and line and wall of crossings (C,)."""
        nothing = np.empty(0, dtype=np.int64)
        lines: NDArray[np.object_] = shapely.linestrings(np.stack([starts[:, :2], ends[:, :2]], axis=1))
        if not len(starts) or not len(self._polygons):
            return lines, nothing, nothing
        which, wall = self._tree.query(lines, predicate="intersects")
        return lines, which, wall


def _lowest(eyes: FloatArray, places: FloatArray, within: NDArray[np.object_]) -> FloatArray:
    """Return the lowest height (C,), on parts ``within`` (C,), of lines ``eyes`` to ``places`` (C, 3) [m]."""
    points, pair = shapely.get_coordinates(within, return_index=True)
    along = places[pair, :2] - eyes[pair, :2]
    share = np.einsum("ij,ij->i", points - eyes[pair, :2], along) / np.einsum("ij,ij->i", along, along)
    lowest = np.full(len(eyes), np.inf)
    np.minimum.at(lowest, pair, eyes[pair, 2] + share * (places[pair, 2] - eyes[pair, 2]))
    return lowest
