"""A fence as a mission file can hold it: a box about it, and walls in the box where the fence ends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from companion.frames import FloatArray
from companion.mission.fences import AREA_MIN_M2, without_holes

Box = tuple[float, float, float, float]
RIM_SHARE = 0.1  # Walls reach this share of the box's longer side beyond it.


def common_area(inclusions: Sequence[FloatArray]) -> shapely.Geometry | None:
    """Return the area within all inclusion fences; None if they have none in common.

    Parameters
    ----------
    inclusions : sequence of ndarray, shape (N, 2)
        Corners of each fence, east and north [m].
    """
    polygons = [shapely.Polygon(corners) for corners in inclusions]
    if not all(polygon.is_valid for polygon in polygons):
        return None
    inside = shapely.intersection_all(polygons)
    return inside if inside.area >= AREA_MIN_M2 else None


def walls_about(inside: shapely.Geometry, box: Box) -> list[FloatArray]:
    """Return what lies in a box, and a rim about it, outside of an area.

    The rim makes the planner keep its clearance where the fence runs along the box's own sides. The ring
    about the area is cut in four, since an obstacle has no hole.

    Parameters
    ----------
    inside : shapely.Geometry
        The area within the fences, east and north [m].
    box : tuple of float
        West, east, south and north of the bounds [m].

    Returns
    -------
    list of ndarray, shape (N, 2)
        Corners of each wall, east and north [m].
    """
    west, east, south, north = box
    rim = RIM_SHARE * max(east - west, north - south)
    outer = (west - rim, south - rim, east + rim, north + rim)
    ring = shapely.box(*outer).difference(inside)
    middle = inside.representative_point()
    walls: list[FloatArray] = []
    for left, right in ((outer[0], middle.x), (middle.x, outer[2])):
        for bottom, top in ((outer[1], middle.y), (middle.y, outer[3])):
            quarter = ring.intersection(shapely.box(left, bottom, right, top))
            polygons = [part for part in shapely.get_parts(quarter) if part.geom_type == "Polygon"]
            for polygon in polygons:
                walls += [np.asarray(corners) for corners in without_holes(polygon)]
    return walls
