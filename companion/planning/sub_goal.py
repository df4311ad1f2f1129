"""Sub goals on the boundary of the sensing horizon (paper 4.2, formulas (4)–(6))."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray
from companion.kernels.arrays import Guide, Limits, Obstacles, Pursuers, ThreatModel, Threats
from companion.kernels.geometry.distance_field import way_at
from companion.kernels.search.sub_goals import CONSTRAINED, FREE, HIGH_RISK, score
from companion.planning.settings import PlannerSettings, SubGoalRule

GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
DETOUR_SHARE = 0.15  # of the horizon: what a sub goal may lengthen the way to the goal by
REPEATED_SHARE = 0.25  # of the horizon: candidates this near to a sub goal used before come last


@dataclass(frozen=True, slots=True)
class SubGoal:
    """A sub goal [m], and what had to be given up to have one ('' if nothing)."""

    position_enu_m: FloatArray
    note: str = ""


def horizon_points(centre: FloatArray, radius_m: float, count: int, limits: Limits) -> FloatArray:
    """Candidates on the horizon's boundary, shape (count, 3) [m].

    A circle in the plane. In space a band of the sphere: heights evenly spread over what climb and
    descent angle and the altitude limits allow, bearings by the golden angle, which spreads them
    nearly uniformly (Swinbank, Purser, Q. J. R. Meteorol. Soc. 132, 2006).
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
    obstacles: Obstacles,
    threats: Threats,
    pursuers: Pursuers,
    model: ThreatModel,
    limits: Limits,
    settings: PlannerSettings,
    home: Guide,
    used: list[FloatArray],
) -> SubGoal:
    """The cheapest point of the horizon about ``end`` (6,), or the goal where it lies inside.

    Removed besides what :func:`score` removes: points from which the way round obstacles to the goal,
    ``home``, is longer than from ``end`` by more than ``DETOUR_SHARE`` of the horizon. They lead into
    dead ends, which the straight line of (6) does not see.

    Points near one that was chosen before come last: the formula alone would lead back into a trap.
    Where every point is removed, the least-cost one clear of obstacles is taken and said so.
    """
    radius = settings.sensing_horizon_m
    if np.linalg.norm(goal - end[:3]) <= radius:
        return SubGoal(goal)
    points = horizon_points(end[:3], radius, settings.num_sub_goal_points, limits)
    dts = np.zeros((len(pursuers.count), 5))
    for d, row in enumerate(dts):
        row[:3], row[3:] = pursuers.position[d, 0], pursuers.model[d, :2]
    euclidean = settings.strategies.sub_goal is SubGoalRule.EUCLIDEAN
    weights = settings.weights_obstacles_2d if limits.dimension == 2 else settings.weights_obstacles_3d
    gamma = settings.weights_sub_goal
    if euclidean:
        gamma, weights = (gamma[0], gamma[1], 0.0, 0.0), (1.0, 0.0, 0.0)
    costs = np.empty(len(points))
    reasons = np.empty(len(points), dtype=np.int64)
    score(
        points, end, goal, elapsed_s, obstacles, threats, dts, model, limits, np.array(gamma),
        np.array(weights), settings.sub_goal_level_max, costs, reasons,
    )  # fmt: skip
    ways = np.array([way_at(home, x, y) for x, y, _ in points])
    limit = way_at(home, end[0], end[1]) + DETOUR_SHARE * radius
    reasons[(reasons == FREE) & (ways > limit)] = CONSTRAINED
    for point in used:
        costs[np.linalg.norm(points - point, axis=1) < REPEATED_SHARE * radius] += 1e6
    free = reasons == FREE
    if free.any():
        return SubGoal(points[np.argmin(np.where(free, costs, np.inf))])
    risky = free | (reasons == HIGH_RISK)
    if risky.any():
        return SubGoal(points[np.argmin(np.where(risky, costs, np.inf))], "every sub goal is at high risk")
    return SubGoal(points[np.argmin(costs)], "no sub goal is free of obstacles and constraints")
