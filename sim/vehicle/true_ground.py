"""The ground that the simulated aircraft may touch, and the heights of it that its autopilot stores."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from companion.frames import FloatArray
from companion.types.elevation import ElevationPosts

BoolArray = NDArray[np.bool_]

STEP_M = 8.0  # Lines of sight are looked at this often.
NEAR_M = 5.0
SPACING_M = 100.0  # TERRAIN_SPACING, by default.
_BLOCK_POSTS = 56 * 16  # An ArduPilot counts heights in blocks of this many.
_CLIMB_SHARE = 0.5  # It looks ahead for ground that rises faster than at this share of its climb.


class TrueGround:
    """Heights of the ground: the map's posts, bilinear in between.

    Parameters
    ----------
    posts : ElevationPosts
        The map.
    """

    def __init__(self, posts: ElevationPosts) -> None:
        self._posts = posts
        self._there = posts.frame.transformer_to(posts.crs)

    @property
    def lowest_m(self) -> float:
        """Height of the lowest post [m]."""
        return float(self._posts.up_m.min())

    def up_m(self, east_m: float, north_m: float) -> float:
        """Return the height of the ground at a place; beyond the map that of its edge [m]."""
        return float(self.ups_m(np.array([east_m]), np.array([north_m]))[0])

    def ups_m(self, east_m: FloatArray, north_m: FloatArray) -> FloatArray:
        """Return the heights (N,) of the ground at places ``east_m`` (N,), ``north_m`` (N,) [m]."""
        posts, up = self._posts, self._posts.up_m
        x, y = self._there.transform(east_m, north_m)
        across = np.clip((x - posts.first_x) / posts.step_x, 0.0, up.shape[1] - 1.0)
        along = np.clip((y - posts.first_y) / posts.step_y, 0.0, up.shape[0] - 1.0)
        column = np.minimum(across.astype(int), up.shape[1] - 2)
        row = np.minimum(along.astype(int), up.shape[0] - 2)
        u, v = across - column, along - row
        near = (1.0 - u) * up[row, column] + u * up[row, column + 1]
        far = (1.0 - u) * up[row + 1, column] + u * up[row + 1, column + 1]
        return np.asarray((1.0 - v) * near + v * far)

    def is_free(self, eyes: FloatArray, places: FloatArray) -> BoolArray:
        """Return which lines of sight pass over the ground, (N,).

        Parameters
        ----------
        eyes, places : ndarray, shape (N, 3)
            Ends of the lines [m]. The ground within 5 m of an end hides nothing.
        """
        free = np.ones(len(eyes), dtype=bool)
        lengths = np.linalg.norm(places - eyes, axis=1)
        for line, length in enumerate(lengths):
            if length > 2.0 * NEAR_M:
                share = np.arange(NEAR_M, length - NEAR_M, STEP_M)[:, None] / length
                at = eyes[line] + share * (places[line] - eyes[line])
                free[line] = bool((at[:, 2] >= self.ups_m(at[:, 0], at[:, 1])).all())
        return free

    def stored(self) -> StoredGround:
        """Return the heights that an autopilot stores of it."""
        return StoredGround(self)


class StoredGround:
    """Heights that an autopilot has on its card: whole metres, 100 m apart, bilinear in between.

    Parameters
    ----------
    ground : TrueGround
        The ground itself, of which the posts are read.
    """

    def __init__(self, ground: TrueGround) -> None:
        self._ground = ground
        self._posts: dict[tuple[int, int], float] = {}

    @property
    def num_loaded(self) -> int:
        """Number of heights in memory, as TERRAIN_REPORT counts them."""
        return min(_BLOCK_POSTS * math.ceil(len(self._posts) / _BLOCK_POSTS), 2**16 - 1)

    def up_m(self, east_m: float, north_m: float) -> float:
        """Return the height of the ground between four posts [m]."""
        i, j = math.floor(east_m / SPACING_M), math.floor(north_m / SPACING_M)
        u, v = east_m / SPACING_M - i, north_m / SPACING_M - j
        west = (1.0 - v) * self._post(i, j) + v * self._post(i, j + 1)
        east = (1.0 - v) * self._post(i + 1, j) + v * self._post(i + 1, j + 1)
        return (1.0 - u) * west + u * east

    def climb_ahead_m(
        self, here: tuple[float, float], end: tuple[float, float], look_ahead_m: float, slope: float
    ) -> float:
        """Return by how much ground ahead is higher than a climb of half a slope reaches, at least 0 [m].

        Parameters
        ----------
        here, end : tuple of float
            East and north of the aircraft and of its target [m].
        look_ahead_m : float
            TERRAIN_LOOKAHD: the ground is looked at every 100 m up to here [m].
        slope : float
            Greatest rate of climb over ground speed.
        """
        away = math.dist(here, end)
        base, most = self.up_m(*here), 0.0
        for number in range(1, math.ceil(min(away, look_ahead_m) / SPACING_M) + 1):
            share = number * SPACING_M / away
            up = self.up_m(here[0] + share * (end[0] - here[0]), here[1] + share * (end[1] - here[1]))
            most = max(most, up - base - _CLIMB_SHARE * slope * number * SPACING_M)
        return most

    def _post(self, i: int, j: int) -> float:
        up = self._posts.get((i, j))
        if up is None:
            at = self._ground.ups_m(np.array([i * SPACING_M]), np.array([j * SPACING_M]))
            up = self._posts[i, j] = float(np.round(at[0]))
        return up
