"""The last edge: from near the goal to the goal itself."""

from __future__ import annotations

import math

import numpy as np

from companion.frames import FloatArray
from companion.kernels.search.path_edit import JOINED, is_clear, is_flyable, join
from companion.kernels.workspace import empty_rows
from companion.planning.explore import Exploration
from companion.planning.route import Route, pursuit_risk

BACK_STEPS = (3, 5, 8, 12, 16, 24)
SPARE_ROWS = 64
COURSE_CHANGES_RAD = (0.0, 0.35, -0.35, 0.8, -0.8)  # tried on the bearing to the goal


def finished_route(exploration: Exploration, route: Route, goal: FloatArray) -> Route:
    """Lead a route that ends inside the goal region to the goal's centre.

    From a few rows back a Dubins edge to the goal is tried, arriving along the bearing or a little
    turned from it; the first that is flyable and clear replaces the end. Where none is, the route
    stays as it is: it ends inside the region.

    Parameters
    ----------
    exploration : Exploration
        The search that found the route.
    route : Route
        Ends inside the goal region.
    goal : ndarray, shape (3,)
        Centre of the goal region [m].
    """
    limits, obstacles = exploration.limits, exploration.problem.snapshot.obstacles
    for back in BACK_STEPS:
        i = len(route) - 1 - back
        if i < 0:
            break
        bearing = math.atan2(goal[1] - route.states[i, 1], goal[0] - route.states[i, 0])
        flat = math.hypot(goal[0] - route.states[i, 0], goal[1] - route.states[i, 1])
        climb = math.atan2(goal[2] - route.states[i, 2], max(flat, 1.0))
        for change in COURSE_CHANGES_RAD:
            rows = empty_rows(i + 1 + SPARE_ROWS)
            for row, known in zip(rows, route.rows, strict=True):
                row[: i + 1] = known[: i + 1]
            pose = np.array([*goal, bearing + change, climb, route.states[i, 5]])
            status, n = join(rows, i + 1, pose, limits)
            if status != JOINED or rows.times[n - 1] > route.times[-1] + 4.0 * limits.tau:
                continue
            if is_flyable(rows, n, i + 1, limits) and is_clear(rows, i + 1, n, obstacles, limits):
                found = Route.of(rows, n)
                if pursuit_risk(exploration, found).total_s <= pursuit_risk(exploration, route).total_s:
                    return found
    return route
