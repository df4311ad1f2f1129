"""Sub goals on the boundary of the sensing horizon (paper 4.2, formulas (4)–(6))."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray
from companion.kernels.arrays import DistanceField, Limits, Scene
from companion.kernels.geometry.distance_field import distance_to_go
from companion.kernels.printed.sub_goals import (
    CONSTRAINED,
    FREE,
    HIGH_RISK,
    Candidates,
    SubGoalWeights,
    score,
)
from companion.planning.comparators import SubGoalRule
from companion.planning.settings import PlannerSettings

GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
DETOUR_SHARE = 0.15  # A sub goal may lengthen the remaining distance by this share of the horizon.
REPEATED_SHARE = 0.25  # Candidates within this share of the horizon of an earlier sub goal come last.


@dataclass(frozen=True, slots=True)
class SubGoal:
    """A sub goal.

    Parameters
    ----------
    position_enu_m : ndarray, shape (3,)
        East, north, up [m].
    note : str
        Which rule this sub goal breaks, '' if none.
    """

    position_enu_m: FloatArray
    note: str = ""


def horizon_points(centre: FloatArray, radius_m: float, count: int, limits: Limits) -> FloatArray:
    """Candidates on the horizon's boundary.

    A circle in the plane. In space a band of the sphere: heights evenly spread over what climb and
    descent angle and the altitude limits allow, bearings by the golden angle, which spreads them
    nearly uniformly (Swinbank, Purser, Q. J. R. Meteorol. Soc. 132, 2006).

    Parameters
    ----------
    centre : ndarray, shape (3,)
        Where the aircraft is [m].
    radius_m : float
        The sensing horizon.
    count : int
        How many candidates.
    limits : Limits
        Dimension, climb and descent angle, altitudes.

    Returns
    -------
    ndarray, shape (count, 3)
        East, north, up [m].
    """
    index = np.arange(count)
    if limits.dimension == 2:
        angle = 2.0 * math.pi * index / count
        flat = np.column_stack([radius_m * np.cos(angle), radius_m * np.sin(angle), np.zeros(count)])
        return np.ascontiguousarray(centre + flat, dtype=np.float64)
    low = max(limits.bounds[4], centre[2] - radius_m * math.sin(limits.descent_max))
    high = min(limits.bounds[5], centre[2] + radius_m * math.sin(limits.climb_max))
    up = low + (index + 0.5) / count * max(high - low, 0.0) - centre[2]
    flat_radius = np.sqrt(np.maximum(radius_m**2 - up**2, 0.0))
    bearing = index * GOLDEN_ANGLE
    return np.ascontiguousarray(
        centre + np.column_stack([flat_radius * np.cos(bearing), flat_radius * np.sin(bearing), up]),
        dtype=np.float64,
    )


def choose_sub_goal(
    *,
    end: FloatArray,
    goal: FloatArray,
    elapsed_s: float,
    scene: Scene,
    settings: PlannerSettings,
    home: DistanceField,
    used: list[FloatArray],
) -> SubGoal:
    """Return the cheapest point of the horizon about the path's end, or the goal where it lies inside.

    Removed after those that :func:`score` removes: points from which the distance to go is longer than from
    the path's end by more than ``DETOUR_SHARE`` of the horizon. They lead into dead ends, which the
    straight line of (6) does not see.

    Points near one that was chosen before come last: the formula alone would lead back into a trap.
    If every point is removed, the cheapest one that is clear of obstacles is taken, with a note.

    Parameters
    ----------
    end : ndarray, shape (6,)
        State in which the path ends so far.
    goal : ndarray, shape (3,)
        Centre of the goal region [m].
    elapsed_s : float
        Time from the plan's start to the path's end.
    scene : Scene
        Obstacles, threats, DTs and limits.
    settings : PlannerSettings
        Weights and the sensing horizon.
    home : DistanceField
        The goal's distance field.
    used : list of ndarray, shape (3,)
        Sub goals chosen before [m].
    """
    radius, limits = settings.sensing_horizon_m, scene.limits
    if np.linalg.norm(goal - end[:3]) <= radius:
        return SubGoal(goal)
    points = horizon_points(end[:3], radius, settings.num_sub_goal_points, limits)
    weights = settings.weights_obstacles_2d if limits.dimension == 2 else settings.weights_obstacles_3d
    gamma = settings.weights_sub_goal
    if settings.strategies.sub_goal is SubGoalRule.EUCLIDEAN:
        gamma, weights = (gamma[0], gamma[1], 0.0, 0.0), (1.0, 0.0, 0.0)
    costs = np.empty(len(points))
    reasons = np.empty(len(points), dtype=np.int64)
    rule = SubGoalWeights(np.array(gamma), np.array(weights), settings.sub_goal_level_max)
    score(Candidates(points, costs, reasons), end, goal, elapsed_s, rule, scene)
    to_go = np.array([distance_to_go(home, x, y) for x, y, _ in points])
    limit = distance_to_go(home, end[0], end[1]) + DETOUR_SHARE * radius
    reasons[(reasons == FREE) & (to_go > limit)] = CONSTRAINED
    for point in used:
        costs[np.linalg.norm(points - point, axis=1) < REPEATED_SHARE * radius] += 1e6
    free = reasons == FREE
    if free.any():
        return SubGoal(points[np.argmin(np.where(free, costs, np.inf))])
    risky = free | (reasons == HIGH_RISK)
    if risky.any():
        return SubGoal(points[np.argmin(np.where(risky, costs, np.inf))], "every sub goal is at high risk")
    return SubGoal(points[np.argmin(costs)], "no sub goal is free of obstacles and constraints")
