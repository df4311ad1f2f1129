"""The autopilot's geofences as obstacles.

An exclusion zone is an obstacle itself. Of the inclusion zones, all of which contain the aircraft, the part
of the mission's bounds outside them is an obstacle. Fences that are parameters, a circle about home and a
ceiling, are an inclusion zone and the space above the ceiling.

References
----------
MAVLink common.xml: NAV_FENCE_POLYGON_VERTEX_INCLUSION and _EXCLUSION (parameter 1 is the number of the
polygon's vertices), NAV_FENCE_CIRCLE_INCLUSION and _EXCLUSION (parameter 1 is the radius).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from companion.frames import FloatArray, LocalFrame
from companion.types.mission import Command, MissionItem
from companion.types.threat import Obstacle

RETURN_POINT = Command.NAV_FENCE_RETURN_POINT
POLYGON_IN, POLYGON_OUT = (
    Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
)
CIRCLE_IN, CIRCLE_OUT = Command.NAV_FENCE_CIRCLE_INCLUSION, Command.NAV_FENCE_CIRCLE_EXCLUSION
CIRCLE_SIDES = 24  # A circle is approximated by a polygon of this many sides.
AREA_MIN_M2 = 1.0  # A smaller polygon encloses nothing.
ABOVE_AND_BELOW_M = 1000.0  # A fence has no top or bottom: its prism extends this far beyond the bounds.
VERTICES_MAX = 2_000  # Longer fence lists are refused, because of the time that they take to process.

Bounds = tuple[float, float, float, float, float, float]


class FenceError(ValueError):
    """A fence that cannot be interpreted. The pilot is informed, and the previous fences stay in use."""


@dataclass(frozen=True, slots=True)
class Fences:
    """The zones of a fence list, as polygons of east and north [m].

    Parameters
    ----------
    exclusions, inclusions : tuple of ndarray, shape (N, 2)
        Open polygons. A circle's polygon contains an excluded circle, and lies inside an included one.
    ceiling_m : float or None
        Height above the mission's origin that the aircraft must stay below [m].
    """

    exclusions: tuple[FloatArray, ...] = ()
    inclusions: tuple[FloatArray, ...] = ()
    ceiling_m: float | None = None


@dataclass(frozen=True, slots=True)
class FenceLimits:
    """Fences that are parameters: FENCE_RADIUS and FENCE_ALT_MAX, GF_MAX_HOR_DIST and GF_MAX_VER_DIST.

    Parameters
    ----------
    home_enu_m : tuple of float
        Position of home [m].
    radius_m : float or None
        Largest distance from home [m]; None if there is no limit.
    height_m : float or None
        Largest height above home [m]; None if there is no limit.
    """

    home_enu_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius_m: float | None = None
    height_m: float | None = None

    def __str__(self) -> str:
        radius = "" if self.radius_m is None else f", within {self.radius_m:.0f} m of home"
        return radius + ("" if self.height_m is None else f", below {self.height_m:.0f} m")

    def added_to(self, fences: Fences) -> Fences:
        """Return fences with these limits added."""
        east, north, up = self.home_enu_m
        if self.radius_m is not None:
            circle = _round(np.array([east, north]), self.radius_m)
            fences = replace(fences, inclusions=(*fences.inclusions, circle))
        return fences if self.height_m is None else replace(fences, ceiling_m=up + self.height_m)


def fences_of(items: Sequence[MissionItem], frame: LocalFrame) -> Fences:
    """Return the zones of a fence list as read from the autopilot.

    Raises
    ------
    FenceError
        If a polygon does not have the announced number of vertices, or encloses nothing.
    """
    if len(items) > VERTICES_MAX:
        raise FenceError(f"{len(items)} items are more than {VERTICES_MAX}")
    zones: dict[bool, list[FloatArray]] = {True: [], False: []}
    index = 0
    while index < len(items):
        item = items[index]
        if item.command in (CIRCLE_IN, CIRCLE_OUT):
            is_inside = item.command == CIRCLE_IN
            zones[is_inside].append(_circle(item, frame, is_inside=is_inside))
            index += 1
        elif item.command in (POLYGON_IN, POLYGON_OUT):
            corners = _corners_at(items, index)
            zones[item.command == POLYGON_IN].append(_polygon(corners, frame, index))
            index += len(corners)
        elif item.command == RETURN_POINT:
            index += 1
        else:
            raise FenceError(f"item {index}: command {item.command} is no fence")
    return Fences(tuple(zones[False]), tuple(zones[True]))


def _corners_at(items: Sequence[MissionItem], index: int) -> Sequence[MissionItem]:
    """Return the items of the polygon that begins at an index.

    Raises
    ------
    FenceError
        If the polygon does not have the announced number of vertices.
    """
    command, count = items[index].command, int(items[index].parameters[0] or 0.0)
    corners = items[index : index + max(count, 1)]
    is_whole = len(corners) == count and all(
        corner.command == command and int(corner.parameters[0] or 0.0) == count for corner in corners
    )
    if count < 3 or not is_whole:
        raise FenceError(f"item {index}: a polygon of {count} vertices is not complete")
    return corners


def _place(item: MissionItem, frame: LocalFrame) -> tuple[float, float]:
    east, north, _ = frame.local_from_global(
        item.latitude_e7 * 1e-7, item.longitude_e7 * 1e-7, frame.altitude_amsl_m
    )
    return east, north


def _polygon(corners: Sequence[MissionItem], frame: LocalFrame, index: int) -> FloatArray:
    """Return east and north of a polygon's corners, (N, 2) [m]."""
    points = np.array([_place(corner, frame) for corner in corners])
    shape = shapely.Polygon(points)
    if not shape.is_valid or shape.area < AREA_MIN_M2:
        raise FenceError(f"item {index}: a polygon that crosses itself or encloses nothing")
    return points


def _circle(item: MissionItem, frame: LocalFrame, *, is_inside: bool) -> FloatArray:
    """Return a polygon (N, 2) around an excluded circle, or inside an included one: east, north [m]."""
    radius = item.parameters[0] or 0.0
    if not 0.0 < radius < 1e6:
        raise FenceError(f"item {item.sequence}: a circle of radius {radius:g} m")
    reach = radius if is_inside else radius / math.cos(math.pi / CIRCLE_SIDES)
    return _round(np.array(_place(item, frame)), reach)


def _round(centre: FloatArray, reach_m: float) -> FloatArray:
    """Return a polygon (N, 2) with corners at a distance from ``centre`` (2,): east and north [m]."""
    angles = np.arange(CIRCLE_SIDES) * 2.0 * math.pi / CIRCLE_SIDES
    return np.asarray(centre + reach_m * np.column_stack([np.sin(angles), np.cos(angles)]))


def fence_obstacles(fences: Fences, bounds: Bounds) -> tuple[Obstacle, ...]:
    """Return upright prisms that cover where the aircraft must not be.

    Parameters
    ----------
    fences : Fences
        Zones of the autopilot's fence list.
    bounds : tuple of float
        East, north, up of the mission's bounds, each low and high [m].
    """
    base, top = bounds[4] - ABOVE_AND_BELOW_M, bounds[5] + ABOVE_AND_BELOW_M
    excluded = (points for zone in fences.exclusions for points in without_holes(shapely.Polygon(zone)))
    polygons = itertools.chain(excluded, _outside(fences.inclusions, bounds))
    walls = tuple(Obstacle(f"fence {n}", points, base, top) for n, points in enumerate(polygons, 1))
    if fences.ceiling_m is None or fences.ceiling_m >= bounds[5]:
        return walls
    everywhere = np.array(_with_rim(bounds).exterior.coords)[:-1]
    return (*walls, Obstacle("fence ceiling", everywhere, fences.ceiling_m, top))


def _outside(inclusions: Sequence[FloatArray], bounds: Bounds) -> Iterator[FloatArray]:
    """Yield the part of the bounds, with a rim, outside ``inclusions`` (N, 2), as polygons (M, 2) [m]."""
    if not inclusions:
        return
    inside = shapely.intersection_all([shapely.Polygon(zone) for zone in inclusions])
    yield from without_holes(_with_rim(bounds).difference(inside))


def _with_rim(bounds: Bounds) -> shapely.Polygon:
    """Return the bounds' rectangle, extended by a tenth of its longer side."""
    rim = 0.1 * max(bounds[1] - bounds[0], bounds[3] - bounds[2])
    return shapely.box(bounds[0] - rim, bounds[2] - rim, bounds[1] + rim, bounds[3] + rim)


def without_holes(shape: shapely.Geometry) -> Iterator[FloatArray]:
    """Yield a shape as polygons (N, 2) [m] without holes: itself, or triangles if it has holes."""
    for part in shapely.get_parts(shape):
        if part.area < AREA_MIN_M2:
            continue
        if not part.interiors:
            yield np.array(part.exterior.coords)[:-1]
            continue
        for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(part)):
            if triangle.area >= AREA_MIN_M2:
                yield np.array(triangle.exterior.coords)[:-1]
