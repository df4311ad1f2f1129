"""Whole flights with the real planner, and a judge of them that shares nothing with the simulator's."""

import asyncio
import functools
import itertools
import math

import numpy as np
import shapely

from companion.config import load_mission
from sim.sitl import Flight
from tests.sim.client import CONFIGS


def fly(mission, seed):
    flight = Flight(mission, seed)
    asyncio.run(flight.fly())
    return flight


def mission_named(name, **changes):
    return load_mission(CONFIGS / f"{name}.yaml").model_copy(update=changes)


@functools.cache
def shipped(name, seed):
    """A flight of a shipped mission; made once, for all tests that look at it."""
    return fly(mission_named(name), seed)


def true_places(flight):
    """East, north, up (N, 3) of the aircraft at 10 Hz [m]."""
    return np.array(flight.document()["true_path"])[:, 1:4]


def touches_anything(mission, places):
    """Whether the flown line meets an obstacle between its base and top, or the ground."""
    if places[:, 2].min() <= 0.0:
        return True
    for obstacle in mission.obstacles:
        polygon = shapely.Polygon(obstacle.polygon_enu_m)
        for start, end in itertools.pairwise(places):
            low, high = sorted((start[2], end[2]))
            is_level = low <= obstacle.top_m and high >= obstacle.base_m
            if is_level and polygon.intersects(shapely.LineString([start[:2], end[:2]])):
                return True
    return False


def reaches(mission, places):
    goal = mission.goals[-1]
    away = np.linalg.norm(places - (goal.east_m, goal.north_m, goal.up_m), axis=1)
    return bool(away.min() <= goal.acceptance_radius_m)


def miss_distance_m(places, east, north):
    """Smallest horizontal distance of the flown line to a place that does not move."""
    return float(shapely.LineString(places[:, :2]).distance(shapely.Point(east, north)))


def seconds_in_reach(flight, mission):
    """Seconds with the first moving threat within its slant reach and in sight of the aircraft."""
    rows, threat = np.array(flight.simulator.truth.path), np.array(flight.simulator.truth.dt_path)
    ground = [np.interp(rows[:, 0], threat[:, 0], threat[:, axis]) for axis in (1, 2)]
    there = np.column_stack([*ground, np.zeros(len(rows))])
    near = np.linalg.norm(rows[:, 1:4] - there, axis=1) <= mission.dynamic_threats[0].max_threat_radius_m
    walls = [(shapely.Polygon(wall.polygon_enu_m), wall.base_m, wall.top_m) for wall in mission.obstacles]
    return sum(
        float(rows[row + 1, 0] - rows[row, 0])
        for row in np.flatnonzero(near[:-1])
        if not any(hides(there[row], rows[row, 1:4], *wall) for wall in walls)
    )


def hides(low, high, polygon, base_m, top_m):
    """Whether a prism meets the line from ``low`` to ``high`` (east, north, up)."""
    part = polygon.intersection(shapely.LineString([low[:2], high[:2]]))
    if part.is_empty:
        return False
    flat = math.dist(low[:2], high[:2])
    share = [math.dist(low[:2], place) / flat for place in shapely.get_coordinates(part)]
    heights = [low[2] + step * (high[2] - low[2]) for step in share]
    return min(heights) <= top_m and max(heights) >= base_m


def uploads_in_flight(flight):
    """How many missions were entered while the aircraft flew, each with its place and time."""
    uploaded = flight.recorder.missions
    assert len(uploaded) == flight.document()["missions_uploaded"]
    assert all(math.isfinite(entry.stamp_s) and entry.stamp_s > 0.0 for entry in uploaded)
    return len(uploaded)


def stays_inside(mission, places, margin_m=30.0):
    bounds = mission.bounds
    low = np.array([bounds.east_m[0], bounds.north_m[0]]) - margin_m
    high = np.array([bounds.east_m[1], bounds.north_m[1]]) + margin_m
    return bool((places[:, :2] >= low).all() and (places[:, :2] <= high).all())
