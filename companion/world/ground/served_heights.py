"""Heights above the sea by latitude and longitude; they are unknown beyond the map and in its holes."""

from __future__ import annotations

import numpy as np

from companion.frames import FloatArray, transformer_between
from companion.types.elevation import ElevationPosts
from companion.world.ground.bilinear import bilinear


class ServedHeights:
    """Heights of a map, which may have holes.

    Parameters
    ----------
    posts : ElevationPosts
        The map; what is unknown is not a number.
    """

    def __init__(self, posts: ElevationPosts) -> None:
        self._posts = posts
        self._there = transformer_between("EPSG:4326", posts.crs)

    def __call__(self, latitude_deg: FloatArray, longitude_deg: FloatArray) -> FloatArray:
        """Return the heights (N,) above mean sea level [m], not a number where they are unknown.

        Parameters
        ----------
        latitude_deg, longitude_deg : ndarray, shape (N,)
            Places, WGS84 [deg].
        """
        posts = self._posts
        x, y = self._there.transform(longitude_deg, latitude_deg)
        rows, columns = (y - posts.first_y) / posts.step_y, (x - posts.first_x) / posts.step_x
        up = bilinear(posts.up_m, rows, columns) + posts.frame.altitude_amsl_m
        last = np.array(posts.up_m.shape) - 1
        is_beyond = (rows < 0.0) | (columns < 0.0) | (rows > last[0]) | (columns > last[1])
        return np.where(is_beyond, np.nan, up)
