"""Answers to an autopilot that asks for heights of the ground.

An ArduPilot with TERRAIN_ENABLE asks for squares of 4 by 4 heights, 56 of them in a request, and asks again
until it has all. It asks whoever is on the link; usually a ground station answers.

References
----------
MAVLink ``common.xml``, TERRAIN_REQUEST, TERRAIN_DATA; ArduPilot ``AP_Terrain``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice

import numpy as np

from companion.frames import FloatArray, offset_places
from companion.link.messages.codec import Codec
from companion.link.wire.decoded_frame import Request

SIDE = 4  # Heights along each side of a square.
ACROSS, SQUARES = 8, 56  # A request has squares in rows of eight from west to east.
AT_ONCE = 16  # Most squares that are sent at once.
SPACING_M = range(1, 1_001)  # Other distances between heights are not served.
INT16 = 32_767.0
EAST = np.arange(SIDE)
Heights = Callable[[FloatArray, FloatArray], FloatArray]


class TerrainServer:
    """Serves heights.

    Parameters
    ----------
    heights : callable
        Takes latitudes and longitudes (N,) [deg]; returns heights above mean sea level (N,) [m], not a number
        where they are unknown.
    """

    def __init__(self, heights: Heights) -> None:
        self._heights = heights
        self._first = 0

    def answer(self, request: Request, codec: Codec) -> bytes:
        """Return TERRAIN_DATA for some of the squares that a TERRAIN_REQUEST asks for.

        A square with an unknown height is left out. Requests are repeated, so that each begins with another.
        """
        latitude_e7, longitude_e7, spacing_m = (int(value) for value in request.parameters)
        if spacing_m not in SPACING_M or abs(latitude_e7) > 850_000_000:
            codec.counters["refused_terrain"] += 1
            return b""
        said = b""
        squares = self._known(latitude_e7, longitude_e7, spacing_m, request.number)
        for square, heights in islice(squares, AT_ONCE):
            said += codec.terrain_data(latitude_e7, longitude_e7, spacing_m, square, heights)
            self._first = (square + 1) % SQUARES
        return said

    def _known(
        self, latitude_e7: int, longitude_e7: int, spacing_m: int, mask: int
    ) -> Iterator[tuple[int, list[int]]]:
        """Yield the squares of a mask with known heights, from the next one on, and these heights."""
        for number in range(self._first, self._first + SQUARES):
            square = number % SQUARES
            if not mask >> square & 1:
                continue
            heights = self._square(latitude_e7, longitude_e7, spacing_m, square)
            if np.isfinite(heights).all() and float(np.abs(heights).max()) < INT16:
                yield square, [round(float(height)) for height in heights]

    def _square(self, latitude_e7: int, longitude_e7: int, spacing_m: int, square: int) -> FloatArray:
        """Return heights (16,) [m], row by row from the south, each from west to east."""
        north = spacing_m * (SIDE * (square // ACROSS) + np.repeat(EAST, SIDE))
        east = spacing_m * (SIDE * (square % ACROSS) + np.tile(EAST, SIDE))
        return self._heights(*offset_places(1e-7 * latitude_e7, 1e-7 * longitude_e7, north, east))
