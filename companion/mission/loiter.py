"""Where to circle when the last waypoint is reached."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry import Point, Polygon

from companion.frames import FloatArray
from companion.types.threat import Obstacle


def loiter_beside(
    positions_enu_m: FloatArray,
    course_rad: float,
    radius_m: float,
    obstacles: Sequence[Obstacle],
    bounds: tuple[float, float, float, float, float, float],
) -> tuple[FloatArray, float]:
    """Centre of a circle that the last leg runs into along its tangent, on the freer side.

    An aircraft sent to circle the point it is just passing overshoots by half a radius; a circle
    beside it is joined without.

    Parameters
    ----------
    positions_enu_m : ndarray, shape (K, 3)
        Waypoints; the last is the point reached.
    course_rad : float
        Course there if there is one waypoint only, clockwise from north.
    radius_m : float
        Radius of the circle [m].

    Returns
    -------
    ndarray, shape (3,)
        Centre of the circle [m].
    float
        +1 clockwise (to the right), -1 counter-clockwise: the sign ArduPlane wants on the radius.
    """
    end = positions_enu_m[-1]
    course = course_rad
    if len(positions_enu_m) > 1:
        along = end - positions_enu_m[-2]
        course = math.atan2(along[0], along[1])
    best, chosen = -math.inf, (end.copy(), 1.0)
    for side in (1.0, -1.0):
        bearing = course + side * 0.5 * math.pi
        centre = end + radius_m * np.array([math.sin(bearing), math.cos(bearing), 0.0])
        for axis in (0, 1):  # a circle that would leave the bounds is moved inside them
            low, high = bounds[2 * axis] + radius_m, bounds[2 * axis + 1] - radius_m
            centre[axis] = min(high, max(low, centre[axis]))
        room = _room_about(centre, obstacles, bounds)
        if room > best:
            best, chosen = room, (centre, side)
    return chosen


def _room_about(
    centre: FloatArray, obstacles: Sequence[Obstacle], bounds: tuple[float, float, float, float, float, float]
) -> float:
    """Distance of ``centre`` (3,) to the nearest obstacle at its height and to the bounds [m]."""
    x, y, z = (float(value) for value in centre)
    room = min(x - bounds[0], bounds[1] - x, y - bounds[2], bounds[3] - y)
    for obstacle in obstacles:
        if obstacle.base_m - 20.0 <= z <= obstacle.top_m + 20.0:
            room = min(room, float(shapely.distance(Polygon(obstacle.polygon_enu_m), Point(x, y))))
    return room
