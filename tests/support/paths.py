"""Paths made row by row for tests."""

import math

import numpy as np

from companion.assurance.check_limits import CheckLimits
from companion.types.path import Path
from companion.types.threat import Obstacle

BOUNDS = (-5000.0, 5000.0, -5000.0, 5000.0, 0.0, 500.0)


def box(name, west, south, east, north, base=0.0, top=300.0):
    polygon = np.array([[west, south], [east, south], [east, north], [west, north]], dtype=float)
    return Obstacle(name, polygon, base, top)


def check_limits(**changes):
    values = {
        "bounds": BOUNDS,
        "margin_m": 15.0,
        "deviations": 0.0,
        "turn_radius_min_m": 125.0,
        "straight_length_min_m": 125.0,
        "climb_angle_max_rad": math.radians(10.0),
        "descent_angle_max_rad": math.radians(10.0),
        "airspeed_min_m_s": 12.5,
        "airspeed_max_m_s": 37.5,
        "acceleration_max_m_s2": 0.5,
        "threat_level_max": 1.0,
        "quality_min": 0.0,
        "altitude_tolerance_m": 0.0,
    }
    return CheckLimits(**{**values, **changes})


def path_of(times, positions, courses, climbs=None, speeds=25.0, deviation=2.0, clear=1.0, levels=0.0):
    n = len(times)
    return Path(
        times_s=np.array(times, dtype=float),
        positions_enu_m=np.array(positions, dtype=float).reshape(n, 3),
        courses_rad=np.array(courses, dtype=float),
        climb_angles_rad=np.zeros(n) if climbs is None else np.array(climbs, dtype=float),
        speeds_m_s=np.full(n, speeds, dtype=float),
        position_covariances_m2=np.tile(deviation**2 * np.eye(3), (n, 1, 1)),
        collision_free=np.full(n, clear, dtype=float),
        threat_levels=np.full(n, levels, dtype=float),
    )


def flown(segments, *, speed=25.0, step_s=1.0, start=(0.0, 0.0, 100.0), course=0.0, climb=0.0, fine=50):
    """Path and its dense curve: ``segments`` are (length [m], radius [m] or 0 for straight, side ±1)."""
    total = sum(length for length, _, _ in segments)
    steps = max(1, math.ceil(total / (speed * step_s) - 1e-9))
    along = np.linspace(0.0, total, steps * fine + 1)
    poses = np.array([_pose(segments, s, course) for s in along])
    up = start[2] + along * math.tan(climb)
    curve = np.column_stack([start[0] + poses[:, 0], start[1] + poses[:, 1], up])
    times = along / (speed * math.cos(climb))
    rows = slice(None, None, fine)
    climbs = np.full(steps + 1, climb)
    return path_of(times[rows], curve[rows], poses[rows, 2], climbs, speed), curve


def _pose(segments, s, course):
    east = north = 0.0
    for length, radius, side in segments:
        part = min(s, length)
        if radius == 0.0:
            east += part * math.sin(course)
            north += part * math.cos(course)
        else:
            turn = side * part / radius
            east += side * radius * (math.cos(course) - math.cos(course + turn))
            north += side * radius * (math.sin(course + turn) - math.sin(course))
            course += turn
        s -= part
        if s <= 0.0:
            break
    return east, north, course


def straight_path(num=11, speed=25.0, start=(0.0, 0.0, 100.0), course=0.0, climb=0.0):
    path, _ = flown([(speed * (num - 1), 0.0, 0)], speed=speed, start=start, course=course, climb=climb)
    return path


def prism_distance(point, obstacle):
    """Distance of a point to a prism by plain loops over its edges: an oracle for both sides."""
    x, y, z = (float(value) for value in point)
    corners = [(float(a), float(b)) for a, b in obstacle.polygon_enu_m]
    inside, flat = False, math.inf
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            inside = not inside
        square = (bx - ax) ** 2 + (by - ay) ** 2
        t = min(1.0, max(0.0, ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / square))
        flat = min(flat, math.hypot(ax + t * (bx - ax) - x, ay + t * (by - ay) - y))
    gap = max(obstacle.base_m - z, z - obstacle.top_m, 0.0)
    return math.hypot(0.0 if inside else flat, gap)
