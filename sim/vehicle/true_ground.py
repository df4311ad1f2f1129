"""The ground that the simulated aircraft may touch: the map's posts, bilinear in between."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from companion.frames import FloatArray
from companion.types.elevation import ElevationPosts

BoolArray = NDArray[np.bool_]

STEP_M = 8.0  # Lines of sight are looked at this often.
NEAR_M = 5.0


class TrueGround:
    """Heights of the ground.

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
