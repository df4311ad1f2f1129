"""The operator's mission at a flight's start: a circle near the start, and a landing."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry import LineString, Point, Polygon

from companion.config import MissionConfig
from companion.config.compose import vehicle_of
from companion.config.sections.terrain_map import posts_of
from companion.types.mission import Command, MavFrame, MissionItem
from companion.types.threat import Obstacle
from ..projection import FastProjection
from ..vehicle.true_ground import TrueGround
from .arduplane.arduplane import home_item
from .telemetry import Home

Place = tuple[float, float, float]

_AHEAD_M = (400.0, 300.0, 200.0, 500.0)
_BEARINGS_DEG = (0.0, 20.0, -20.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0)
_MARGIN_M = 40.0
_GROUND_M = 40.0  # Height of the circle over ground.
_OVERSHOOT_M = 40.0  # A circle that is entered from its centre is flown this much wider at first.
_HEIGHT_MARGIN_M = 20.0
_BEYOND_M = 500.0  # The aircraft flies straight for this distance behind the last goal.
_LANDING_M = (1000.0, 750.0)  # Distances of the landing's circle from the runway.
_PATTERN_HEIGHT_M = 60.0  # Height of that circle.
_LANDING_SIDES = 8  # Directions of the landing that are looked at, the first from north.


def ground_of(mission: MissionConfig) -> tuple[TrueGround | None, float]:
    """Return the ground of a mission file's map, and its height at the start [m].

    Without a map there is none, and it is flat at the origin's height.
    """
    posts = posts_of(mission)
    if posts is None:
        return None, 0.0
    ground = TrueGround(posts)
    return ground, ground.up_m(float(mission.start.east_m), float(mission.start.north_m))


def safe_loiter(
    mission: MissionConfig, start: Place, course_rad: float, ground: TrueGround | None
) -> tuple[float, float]:
    """East and north [m] of a circle near the start that can be flown to and round without hitting anything.

    The circle lies straight ahead if that is clear, else to one side, else where obstacles are farthest. It
    is as wide as the tightest turn that is possible on all courses in the mission's wind.
    """
    east, north, up = start
    radius_m = vehicle_of(mission).turn_radius_in(mission.simulation.wind_speed_m_s)
    level = [
        Polygon(entry.polygon_enu_m)
        for entry in mission.obstacle_list
        if entry.base_m - _HEIGHT_MARGIN_M <= up <= entry.top_m + _HEIGHT_MARGIN_M
    ]
    walls = shapely.unary_union(level)
    best, best_gap = (east, north), -math.inf
    tries = [(bearing, ahead) for bearing in _BEARINGS_DEG for ahead in _AHEAD_M]
    for bearing_deg, ahead_m in [*tries, (0.0, 100.0), (0.0, 0.0)]:
        bearing = course_rad + math.radians(bearing_deg)
        centre = (east + ahead_m * math.sin(bearing), north + ahead_m * math.cos(bearing))
        gap = walls.distance(Point(centre)) - radius_m - _OVERSHOOT_M if level else math.inf
        way = walls.distance(LineString([(east, north), centre])) if level else math.inf
        gap = min(gap, way)
        if ground is not None and _over_ground_m(ground, start, centre, radius_m) < _GROUND_M:
            gap = min(gap, 0.0)
        if gap >= _MARGIN_M:
            return centre
        if gap > best_gap:
            best, best_gap = centre, gap
    return best


def _over_ground_m(ground: TrueGround, start: Place, centre: tuple[float, float], radius_m: float) -> float:
    """Least height over ground on the way to a circle and on it, flown level [m]."""
    angles = np.linspace(0.0, 2.0 * math.pi, 36)
    share = np.linspace(0.0, 1.0, 20)
    east = np.append(centre[0] + radius_m * np.sin(angles), start[0] + share * (centre[0] - start[0]))
    north = np.append(centre[1] + radius_m * np.cos(angles), start[1] + share * (centre[1] - start[1]))
    return start[2] - float(ground.ups_m(east, north).max())


def operator_mission(
    home: Home, projection: FastProjection, centre: tuple[float, float], height_m: float, radius_m: float
) -> list[MissionItem]:
    """Make the operator's mission: home, a waypoint, and a loiter there."""
    latitude, longitude = projection.degrees(*centre)
    place = (round(latitude * 1e7), round(longitude * 1e7), height_m)
    frame = MavFrame.GLOBAL_RELATIVE_ALT
    return [
        home_item(home),
        MissionItem(1, Command.NAV_WAYPOINT, frame, (0.0, 0.0, 0.0, 0.0), *place),
        MissionItem(2, Command.NAV_LOITER_UNLIM, frame, (0.0, 0.0, round(radius_m), 0.0), *place),
    ]


def landing_circle(
    obstacles: Sequence[Obstacle], bounds: Sequence[tuple[float, float]], home: Home, radius_m: float
) -> tuple[float, float]:
    """East and north [m] of the circle from which a landing at home begins, where the way down is free.

    The landing comes from the first direction, from north on, that is free and within ``bounds``, east and
    north [m]; else from the freest.
    """
    area = shapely.box(bounds[0][0], bounds[1][0], bounds[0][1], bounds[1][1])
    walls = shapely.unary_union([Polygon(obstacle.polygon_enu_m) for obstacle in obstacles])
    best, best_gap = (home.east_m, home.north_m + _LANDING_M[0]), -math.inf
    for away, number in itertools.product(_LANDING_M, range(_LANDING_SIDES)):
        angle = 2.0 * math.pi * number / _LANDING_SIDES
        centre = (home.east_m + away * math.sin(angle), home.north_m + away * math.cos(angle))
        way = LineString([centre, (home.east_m, home.north_m)])
        gap = -area.distance(Point(centre)) or math.inf
        if obstacles:
            gap = min(gap, walls.distance(way), walls.distance(Point(centre)) - radius_m - _OVERSHOOT_M)
            gap = -math.inf if walls.intersects(way) else gap
        if gap >= _MARGIN_M:
            return centre
        if gap > best_gap:
            best, best_gap = centre, gap
    return best


def px4_operator_mission(
    home: Home,
    projection: FastProjection,
    centre: tuple[float, float],
    begins: tuple[float, float],
    height_m: float,
    radius_m: float,
) -> list[MissionItem]:
    """Make the operator's mission for PX4: takeoff, a waypoint, a loiter there, and a landing at home."""
    relative, nothing = MavFrame.GLOBAL_RELATIVE_ALT_INT, (0.0, 0.0, 0.0, None)

    def place(east: float, north: float, height: float) -> tuple[int, int, float]:
        latitude, longitude = projection.degrees(east, north)
        return round(latitude * 1e7), round(longitude * 1e7), height

    circle = place(*centre, height_m)
    pattern = place(*begins, _PATTERN_HEIGHT_M)
    touchdown = place(home.east_m, home.north_m, 0.0)
    return [
        MissionItem(0, Command.NAV_TAKEOFF, relative, nothing, *touchdown[:2], height_m),
        MissionItem(1, Command.NAV_WAYPOINT, relative, nothing, *circle),
        MissionItem(2, Command.NAV_LOITER_UNLIM, relative, (0.0, 0.0, round(radius_m), None), *circle),
        MissionItem(3, Command.DO_LAND_START, MavFrame.MISSION, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0),
        MissionItem(4, Command.NAV_LOITER_TO_ALT, relative, (1.0, round(radius_m), 0.0, 1.0), *pattern),
        MissionItem(5, Command.NAV_LAND, relative, nothing, *touchdown),
    ]


def mission_over(
    items: list[MissionItem],
    route_enu_m: Sequence[Place],
    start: Place,
    projection: FastProjection,
    radius_m: float,
) -> list[MissionItem]:
    """The operator's list with a way over places and straight on, and a circle there, for its own circle.

    The last leg goes on, so that no circle is begun before its end.
    """
    last, end = [start, *route_enu_m][-2], route_enu_m[-1]
    share = _BEYOND_M / (math.dist(last[:2], end[:2]) or 1.0)
    beyond = (end[0] + share * (end[0] - last[0]), end[1] + share * (end[1] - last[1]), end[2])
    frame, flown = items[1].frame, list[MissionItem]()
    for east, north, up in [*route_enu_m, beyond, beyond]:
        is_last = len(flown) == len(route_enu_m) + 1
        latitude, longitude = projection.degrees(east, north)
        command = Command.NAV_LOITER_UNLIM if is_last else Command.NAV_WAYPOINT
        parameters = (0.0, 0.0, float(round(radius_m)) if is_last else 0.0, 0.0)
        place = (round(latitude * 1e7), round(longitude * 1e7), up)
        flown.append(MissionItem(0, command, frame, parameters, *place))
    whole = [*items[:1], *flown, *items[3:]]
    return [replace(item, sequence=number) for number, item in enumerate(whole)]
