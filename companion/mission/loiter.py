"""Where to circle when the last waypoint is reached."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry import Point, Polygon

from companion.frames import FloatArray
from companion.types.threat import Obstacle


class Circle(NamedTuple):
    """A circle that a mission may end in.

    Parameters
    ----------
    centre_enu_m : ndarray, shape (3,)
        Middle of the circle [m].
    direction : float
        +1 clockwise (to the right), -1 counter-clockwise: the sign ArduPlane wants on the radius.
    is_moved : bool
        Whether it was moved into the bounds, so that the last leg is no tangent of it.
    """

    centre_enu_m: FloatArray
    direction: float
    is_moved: bool


def circles_beside(
    positions_enu_m: FloatArray,
    course_rad: float,
    radius_m: float,
    obstacles: Sequence[Obstacle],
    bounds: tuple[float, float, float, float, float, float],
) -> list[Circle]:
    """Circles that the last leg runs into along its tangent, the one on the freer side first.

    An aircraft sent to circle the point it is just passing overshoots by half a radius; a circle
    beside it is joined without. One that would leave the bounds is moved inside them, and may be flown
    either way round, first that in which the leg meets it.

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
    list of Circle
        Two to four.
    """
    end = positions_enu_m[-1]
    course = course_rad
    if len(positions_enu_m) > 1:
        along = end - positions_enu_m[-2]
        course = math.atan2(along[0], along[1])
    right = np.array([math.cos(course), -math.sin(course), 0.0])
    found: list[tuple[float, list[Circle]]] = []
    for side in (1.0, -1.0):
        bearing = course + side * 0.5 * math.pi
        touching = end + radius_m * np.array([math.sin(bearing), math.cos(bearing), 0.0])
        centre = touching.copy()
        for axis in (0, 1):
            low, high = bounds[2 * axis] + radius_m, bounds[2 * axis + 1] - radius_m
            centre[axis] = min(high, max(low, centre[axis]))
        circles = [Circle(centre, side, is_moved=False)]
        if bool((centre != touching).any()):
            met = math.copysign(1.0, float((centre - end) @ right))
            circles = [Circle(centre, direction, is_moved=True) for direction in (met, -met)]
        found.append((_room_about(centre, obstacles, bounds), circles))
    found.sort(key=lambda entry: -entry[0])
    return [circle for _, circles in found for circle in circles]


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
