"""A planner that turns towards each goal and flies straight at it, through whatever is in the way.

It is a pattern to copy, and a test of the service: no path of it through a wall may reach an autopilot.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from companion.planning.problem import Problem

ROWS_MAX = 2_000  # A goal inside the circle of the tightest turn is never reached by turning towards it.


def beeline(problem: Problem, should_stop: Callable[[], bool]) -> NDArray[np.float64]:
    """Return a path that turns towards each goal as tightly as allowed.

    Parameters
    ----------
    problem : Problem
        The start, the goals and the aircraft.
    should_stop : callable
        Returns True once the time is over.

    Returns
    -------
    ndarray, shape (N, 6)
        East, north, up [m], direction counter-clockwise from east [rad], climb angle [rad], airspeed [m/s].
    """
    start, tau_s = problem.start, problem.settings.tau_s
    wind_m_s, speed = math.hypot(*problem.snapshot.wind_enu_m_s), start.airspeed_m_s
    vehicle = problem.vehicle.at_speed(speed)  # An aircraft that is fast at the start turns wider.
    turn_max = speed * tau_s / vehicle.turn_radius_in(wind_m_s)
    steepest = vehicle.climb_angle_max_rad, vehicle.descent_angle_max_rad
    rows = [(*start.position_enu_m, start.direction_rad, start.climb_rad, speed)]
    for goal in problem.goals:
        while math.dist(rows[-1][:3], goal.position_enu_m) > 0.5 * goal.acceptance_radius_m:
            if should_stop() or len(rows) >= ROWS_MAX:
                return np.array(rows)
            east, north, up, direction, _, _ = rows[-1]
            to_east, to_north, to_up = np.subtract(goal.position_enu_m, (east, north, up))
            left = math.remainder(math.atan2(to_north, to_east) - direction, 2.0 * math.pi)
            turn = min(max(left, -turn_max), turn_max)
            climb = math.atan2(to_up, math.hypot(to_east, to_north))
            climb = min(max(climb, -steepest[1]), steepest[0])
            # The step is the chord of an arc, along the direction in its middle.
            chord = speed * tau_s * (math.sin(0.5 * turn) / (0.5 * turn) if turn else 1.0)
            along = direction + 0.5 * turn
            rows.append(
                (
                    east + chord * math.cos(climb) * math.cos(along),
                    north + chord * math.cos(climb) * math.sin(along),
                    up + chord * math.sin(climb),
                    direction + turn,
                    climb,
                    speed,
                )
            )
    return np.array(rows)
