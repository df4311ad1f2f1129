"""Distance fields round obstacles, by which samples and hand-overs of the printed methods find their way."""

from __future__ import annotations

import numpy as np

from companion.frames import FloatArray
from companion.kernels.arrays import DistanceField, Limits, Obstacles
from companion.kernels.geometry.distance_field import fill_distances, fill_free
from companion.planning.settings import PlannerSettings

FIELD_CELLS = 97  # Cells along each side of the grid around a sub goal.
CELL_MIN_M, CELLS_MAX = 30.0, 256  # Cell size and number of cells of the grid over the bounds.
NO_DISTANCES = DistanceField(np.full((1, 1), np.inf), np.zeros(2), 1.0, 0.0, 0.0)


def sub_goal_distances(
    point: FloatArray, limits: Limits, settings: PlannerSettings, obstacles: Obstacles
) -> DistanceField:  # fmt: skip
    """Return the distance field of a point, over twice the sensing horizon about it.

    Parameters
    ----------
    point : ndarray, shape (3,)
        A sub goal [m].
    limits : Limits
        Margin, bounds and the length of a step.
    settings : PlannerSettings
        The sensing horizon, and how many samples follow the field.
    obstacles : Obstacles
        What is gone round.
    """
    radius = 2.0 * settings.sensing_horizon_m
    cell = 2.0 * radius / (FIELD_CELLS - 1)
    share = settings.guided_share if settings.strategies.follow_field else 0.0
    steps_m = settings.guided_steps * (limits.v_cruise * limits.tau)
    distances = DistanceField(np.empty((FIELD_CELLS, FIELD_CELLS)), point[:2] - radius, cell, share, steps_m)
    free = np.empty(distances.field.shape)
    fill_free(point, radius, limits.margin, limits.bounds, obstacles, distances, free)
    fill_distances(point, distances, free)
    return distances


def goal_distances(goal: FloatArray, limits: Limits, obstacles: Obstacles) -> DistanceField:
    """Return the distance field of a goal, over everything within the bounds.

    Parameters
    ----------
    goal : ndarray, shape (3,)
        Centre of a goal region [m].
    limits : Limits
        Margin and bounds.
    obstacles : Obstacles
        What is gone round.
    """
    distances = _over_bounds(limits)
    free = np.zeros(distances.field.shape)
    fill_free(goal, np.inf, limits.margin, limits.bounds, obstacles, distances, free)
    fill_distances(goal, distances, free)
    return distances


def _over_bounds(limits: Limits) -> DistanceField:
    """Return an empty field over everything within the bounds."""
    b = limits.bounds
    cell = max(CELL_MIN_M, max(b[1] - b[0], b[3] - b[2]) / CELLS_MAX)
    empty = np.empty((int((b[1] - b[0]) / cell) + 1, int((b[3] - b[2]) / cell) + 1))
    return DistanceField(empty, np.array([b[0], b[2]]), cell, 0.0, 0.0)


def distances_to_go(distances: DistanceField, places: FloatArray) -> FloatArray:
    """Distance to go from places near a sub goal, by the nearest node of its field.

    Parameters
    ----------
    distances : DistanceField
        Made by :func:`sub_goal_distances`.
    places : ndarray, shape (N, 2)
        East and north [m].

    Returns
    -------
    ndarray, shape (N,)
        Infinite where there is no way [m].
    """
    index = np.rint((places - distances.origin) / distances.cell).astype(np.int64)
    index = np.clip(index, 0, FIELD_CELLS - 1)
    return distances.field[index[:, 0], index[:, 1]]
