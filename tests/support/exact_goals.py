"""The shortest flight past goals in their order, where nothing is in the way.

Dynamic programming over poses: places in each goal's circle, and courses. Between two poses that are more
than four turn radii apart a shortest path is an arc, a straight line and an arc (Dubins, 1957): here by the
common tangents of the turning circles. The module shares no code with the planner.
"""

import numpy as np

COURSES, SPOKES, RINGS = 24, 8, (0.55, 1.0)


def shortest_m(start, goals, radius_m):
    """Length from a pose through circles.

    ``start`` x, y and the direction from east to the left; ``goals`` x, y and radius of each.
    """
    poses, lengths = np.array([start]), np.zeros(1)
    for x, y, radius in goals:
        angles = 2.0 * np.pi * np.arange(SPOKES) / SPOKES
        rim = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        places = np.vstack([[[x, y]], *([x, y] + share * radius * rim for share in RINGS)])
        courses = 2.0 * np.pi * np.arange(COURSES) / COURSES
        ends = np.array([(*place, course) for place in places for course in courses])
        found = np.full(len(ends), np.inf)
        for pose, length in zip(poses, lengths, strict=True):
            found = np.minimum(found, length + between_m(pose, ends, radius_m))
        poses, lengths = ends, found
    return float(lengths.min())


def between_m(start, ends, radius_m):
    """Shortest length of arc, straight line and arc from a pose to poses, shape (N, 3)."""
    least = np.full(len(ends), np.inf)
    for first in (1.0, -1.0):  # left, right
        begin = centre(start[None], first, radius_m)
        for last in (1.0, -1.0):
            away = centre(ends, last, radius_m) - begin
            apart, bearing = np.hypot(*away.T), np.arctan2(away[:, 1], away[:, 0])
            # Between circles of opposite turns the tangent crosses the line of their centres.
            crosses = 0.0 if first == last else 2.0 * radius_m
            straight = np.sqrt(np.maximum(apart**2 - crosses**2, 0.0))
            line = bearing if first == last else bearing + first * np.arcsin(np.minimum(1.0, crosses / apart))
            arcs = (first * (line - start[2])) % (2.0 * np.pi) + (last * (ends[:, 2] - line)) % (2.0 * np.pi)
            length = radius_m * arcs + straight
            least = np.where(apart >= crosses, np.minimum(least, length), least)
    return least


def centre(poses, side, radius_m):
    """Centres of the turning circles to a side of poses, shape (N, 3)."""
    left = np.stack([-np.sin(poses[:, 2]), np.cos(poses[:, 2])], axis=1)
    return poses[:, :2] + side * radius_m * left
