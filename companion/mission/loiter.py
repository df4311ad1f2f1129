"""Circles in which a mission may end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from companion.frames import FloatArray
from companion.types.threat import Obstacle

HEIGHT_MARGIN_M = 20.0  # An obstacle farther above or below a circle is ignored.
# A circle may fall short of the clearance by this much: the checker measures it exactly.
FIT_TOLERANCE_M = 0.1
# Offsets of the centre from a path, to the right, as shares of the radius: circles that touch the path, and
# circles round it.
TOUCHING = (1.0, -1.0)
ROUND_PATH = (0.5, -0.5, 0.0)


class Circle(NamedTuple):
    """A circle in which a mission may end.

    Parameters
    ----------
    centre_enu_m : ndarray, shape (3,)
        Middle of the circle [m].
    radius_m : float
        Radius that the circle is checked with [m].
    direction : float
        +1 clockwise (to the right), -1 counter-clockwise: ArduPlane's sign of the radius.
    """

    centre_enu_m: FloatArray
    radius_m: float
    direction: float


def circles_along(
    positions_enu_m: FloatArray, courses_rad: FloatArray, radius_m: float, obstacles: Sequence[Obstacle],
    bounds: tuple[float, float, float, float, float, float], margin_m: float, *,
    offsets: Sequence[float] = TOUCHING,
) -> list[list[Circle]]:  # fmt: skip
    """Return circles that touch a path at given points, or lie round them, as far as they are clear.

    An aircraft that is sent to circle the point that it is passing overshoots by half a radius. It joins a
    circle beside that point without turning back. Circles with other ``offsets`` lie round the point, and an
    aircraft joins them from inside. A circle that would leave the bounds is moved inside them. Such a
    circle may be flown in either direction, and so may one at whose centre the path ends.

    Parameters
    ----------
    positions_enu_m : ndarray, shape (N, 3)
        Points of the path [m].
    courses_rad : ndarray, shape (N,)
        Courses at the points, clockwise from north.
    radius_m : float
        Radius of the circles [m].
    obstacles : sequence of Obstacle
        What the circles keep clear of.
    bounds : tuple of float
        East, north and up, lowest and highest each [m].
    margin_m : float
        Distance to keep from obstacles [m].
    offsets : sequence of float
        Offsets of the circles' centres from the path, to the right, as shares of the radius.

    Returns
    -------
    list of list of Circle
        At most two circles for each point and offset, the one with the largest clearance first.
    """
    right = np.column_stack([np.cos(courses_rad), -np.sin(courses_rad)])
    wanted = positions_enu_m[:, None, :2] + radius_m * np.array(offsets)[:, None] * right[:, None]
    low, high = np.array([bounds[0], bounds[2]]) + radius_m, np.array([bounds[1], bounds[3]]) - radius_m
    centres = np.minimum(high, np.maximum(low, wanted))
    clearance = np.minimum(centres - low, high - centres).min(axis=2)
    points, heights = shapely.points(centres), positions_enu_m[:, 2]
    for obstacle in obstacles:
        overlaps = (heights >= obstacle.base_m - HEIGHT_MARGIN_M) & (
            heights <= obstacle.top_m + HEIGHT_MARGIN_M
        )
        polygon = shapely.Polygon(obstacle.polygon_enu_m)
        shapely.prepare(polygon)
        away = shapely.distance(polygon, points[overlaps]) - radius_m - margin_m
        clearance[overlaps] = np.minimum(clearance[overlaps], away)
    found = []
    for row, place in enumerate(positions_enu_m):
        at_row = []
        for k in np.argsort(-clearance[row], kind="stable"):
            if clearance[row, k] < -FIT_TOLERANCE_M:
                continue
            centre = centres[row, k]
            directions = [math.copysign(1.0, offsets[k])]
            if not offsets[k] or (centre != wanted[row, k]).any():
                nearer = math.copysign(1.0, float((centre - place[:2]) @ right[row]))
                directions = [nearer, -nearer]
            at_row += [Circle(np.append(centre, place[2]), radius_m, direction) for direction in directions]
        found.append(at_row)
    return found
