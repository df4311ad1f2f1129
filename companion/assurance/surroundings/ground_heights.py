"""The ground as the check reads it: the map's posts, interpolated between the four about a place.

It shares no code with the cells over which plans are made.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from companion.assurance.violation import Violation
from companion.frames import FloatArray
from companion.types.elevation import ElevationPosts

BoolArray = NDArray[np.bool_]

SAMPLES_A_POST = 4  # A line has this many samples from one post to the next.
SAMPLE_MIN_M = 2.0  # Samples are at least this far apart.
TOLERANCE_M = 3.0  # A height over ground may fall short of the limit by this much.
TRACK_TOLERANCE_M = 1.0  # A simulated track may fall short by this much; the aircraft strays from it.
NEAR_EYE_M = 5.0  # Ground this near to either end of a line hides nothing: posts do not show it.


class GroundHeights:
    """Heights over ground, and their limits.

    Parameters
    ----------
    posts : ElevationPosts
        The map.
    height_min_m, height_max_m : float
        Limits of the height over ground of paths and missions [m].
    """

    def __init__(self, posts: ElevationPosts, height_min_m: float, height_max_m: float) -> None:
        self.posts, self.height_min_m, self.height_max_m = posts, height_min_m, height_max_m
        self._there = there = posts.frame.transformer_to(posts.crs)
        middle = 0.5 * np.array(posts.up_m.shape)
        x = posts.first_x + posts.step_x * middle[1]
        y = posts.first_y + posts.step_y * np.array([middle[0], middle[0] + 1.0])
        east, north = there.transform(np.array([x, x]), y, direction="INVERSE")
        apart = float(np.hypot(east[1] - east[0], north[1] - north[0]))
        self._sample_m = max(apart / SAMPLES_A_POST, SAMPLE_MIN_M)

    def up_m(self, places_enu_m: FloatArray) -> FloatArray:
        """Return the height of the ground below places, (N,) [m].

        Parameters
        ----------
        places_enu_m : ndarray, shape (N, 2) or (N, 3)
            Places; beyond the map the ground of its edge counts [m].
        """
        posts = self.posts
        x, y = self._there.transform(places_enu_m[:, 0], places_enu_m[:, 1])
        count = posts.up_m.shape
        row = np.clip((y - posts.first_y) / posts.step_y, 0.0, count[0] - 1.0)
        column = np.clip((x - posts.first_x) / posts.step_x, 0.0, count[1] - 1.0)
        j, i = np.minimum(np.floor([row, column]).astype(int), [[count[0] - 2], [count[1] - 2]])
        low, high = posts.up_m[j, i], posts.up_m[j + 1, i]
        low = low + (column - i) * (posts.up_m[j, i + 1] - low)
        high = high + (column - i) * (posts.up_m[j + 1, i + 1] - high)
        return np.asarray(low + (row - j) * (high - low))

    def profile(self, places_enu_m: FloatArray) -> FloatArray:
        """Return the heights of a line and of the ground below it, close together along the line.

        Parameters
        ----------
        places_enu_m : ndarray, shape (N, 3)
            The corners of the line, two at least [m].

        Returns
        -------
        ndarray, shape (S, 3)
            Horizontal distance along the line, height of the line, and height of the ground [m].
        """
        begins, ends = places_enu_m[:-1], places_enu_m[1:]
        at, which = self._samples(begins, ends)
        lengths = np.hypot(*(ends - begins)[:, :2].T)
        passed = np.cumsum(lengths) - lengths
        along = passed[which] + np.hypot(*(at - begins[which])[:, :2].T)
        return np.column_stack([along, at[:, 2], self.up_m(at)])

    def violations(
        self, starts: FloatArray, ends: FloatArray, least_m: FloatArray, rows: NDArray[np.int64],
        tolerance_m: float,
    ) -> Iterator[Violation]:  # fmt: skip
        """Yield the segments that are lower or higher somewhere than they may.

        Parameters
        ----------
        starts, ends : ndarray, shape (N, 3)
            Ends of the segments [m].
        least_m : ndarray, shape (N,)
            Height over ground to keep [m].
        rows : ndarray, shape (N,)
            The reported row of each segment.
        tolerance_m : float
            The greatest height over ground may be passed by this [m].
        """
        for segment, over in self._too_near(starts, ends, least_m):
            row, limit = int(rows[segment]), float(least_m[segment])
            yield Violation("clearance", row, over, limit, "distance to the ground [m]")
        for segment, over in self._too_high(starts, ends, tolerance_m):
            yield Violation("bounds", int(rows[segment]), over, self.height_max_m, "height over ground [m]")

    def track_violations(self, positions_enu_m: FloatArray, tolerance_m: float) -> tuple[Violation, ...]:
        """Return where a track breaks the limits of height over ground after it has been within them.

        Parameters
        ----------
        positions_enu_m : ndarray, shape (K, 3)
            Positions close together [m].
        tolerance_m : float
            The greatest height over ground may be passed by this [m].
        """
        least, starts, ends = self.height_min_m - TRACK_TOLERANCE_M, positions_enu_m[:-1], positions_enu_m[1:]
        over = positions_enu_m[:, 2] - self.up_m(positions_enu_m)
        within = np.flatnonzero((over >= least) & (over <= self.height_max_m + tolerance_m))
        rows = np.arange(1, len(positions_enu_m))
        found = self.violations(starts, ends, np.full(len(starts), least), rows, tolerance_m)
        return tuple(entry for entry in found if len(within) and entry.row > within[0])

    def _too_near(
        self, starts: FloatArray, ends: FloatArray, heights_m: FloatArray
    ) -> Iterator[tuple[int, float]]:
        """Yield number and least height over ground [m] of segments that are lower somewhere than they may.

        ``starts`` and ``ends`` (N, 3) are those of the segments, ``heights_m`` (N,) the heights to keep [m].
        """
        over, which = self._along(starts, ends)
        least = np.full(len(starts), np.inf)
        np.minimum.at(least, which, over)
        for segment in np.flatnonzero(least < heights_m):
            yield int(segment), float(least[segment])

    def _too_high(
        self, starts: FloatArray, ends: FloatArray, tolerance_m: float
    ) -> Iterator[tuple[int, float]]:
        """Yield number and greatest height over ground [m] of segments above the highest that is allowed.

        ``starts`` and ``ends`` (N, 3) are those of the segments; the limit may be passed by ``tolerance_m``.
        """
        if np.isinf(self.height_max_m + tolerance_m):
            return
        over, which = self._along(starts, ends)
        most = np.full(len(starts), -np.inf)
        np.maximum.at(most, which, over)
        for segment in np.flatnonzero(most > self.height_max_m + tolerance_m):
            yield int(segment), float(most[segment])

    def is_free(self, eyes: FloatArray, places: FloatArray) -> BoolArray:
        """Return which lines of sight pass over the ground, (N,).

        Parameters
        ----------
        eyes, places : ndarray, shape (N, 3)
            Ends of the lines [m].
        """
        at, which = self._samples(eyes, places)
        ends = np.minimum(
            np.linalg.norm(at - eyes[which], axis=1), np.linalg.norm(at - places[which], axis=1)
        )
        hides = (at[:, 2] < self.up_m(at)) & (ends > NEAR_EYE_M)
        free = np.ones(len(eyes), dtype=bool)
        free[which[hides]] = False
        return free

    def _along(self, starts: FloatArray, ends: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
        """Return heights over ground (S,) [m] along segments, and the segment (S,) of each.

        They lead from ``starts`` to ``ends`` (N, 3) [m].
        """
        at, which = self._samples(starts, ends)
        return at[:, 2] - self.up_m(at), which

    def _samples(self, starts: FloatArray, ends: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
        """Return places (S, 3) along segments, both ends among them, and the segment (S,) of each.

        They lead from ``starts`` to ``ends`` (N, 3) [m].
        """
        lengths = np.linalg.norm((ends - starts)[:, :2], axis=1)
        counts = np.ceil(lengths / self._sample_m).astype(np.int64) + 1
        which = np.repeat(np.arange(len(starts)), counts)
        number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        share = (number / np.maximum(counts[which] - 1, 1))[:, None]
        return starts[which] + share * (ends - starts)[which], which
