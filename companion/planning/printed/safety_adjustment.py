"""Safety adjustment of a path (paper 4.4.2): waypoints drift towards their safer particles."""

from __future__ import annotations

import numpy as np

from companion.frames import FloatArray
from companion.kernels.aircraft.lqg_mp import position_factor
from companion.kernels.search.path_edit import JOINED, is_clear, is_flyable, splice
from companion.kernels.workspace import empty_rows
from companion.planning.explore import Exploration
from companion.planning.route import Assessment, Route, assess_route, visits_goals

REACHES = (
    (8, 8),
    (12, 12),
    (8, 16),
    (16, 8),
    (16, 16),
    (24, 24),
)  # rows relaid before and after, tried in turn
SHIFT_MIN_M = 0.2  # Smaller moves of a waypoint make no difference in flight.
RISK_SAME = 1e-3  # A move may raise −log Q by this much.
EVERY = 4  # One row in this many is moved: neighbours share their particles' threat levels.


def adjusted_route(
    exploration: Exploration, route: Route, assessment: Assessment
) -> tuple[Route, int, Assessment]:
    """Move waypoints, one by one, to the mean of their particles weighted by ``min(1/(k_T·TI), 1)``.

    A moved waypoint keeps its direction and is joined to the path again by Dubins edges, which keep
    turn radius, climb angles and the straight-flight rule; where none of ``REACHES`` can, where the
    margin from obstacles is lost, p_c falls below the limit, or the path's threat does not fall, the
    waypoint stays.

    Returns
    -------
    Route
        The adjusted route.
    int
        How many waypoints moved.
    Assessment
        The assessment of the adjusted route.
    """
    collision_max = exploration.problem.settings.adjust_collision_max
    moved, k = 0, 0
    while k < len(route):
        shift = particle_shift(exploration, assessment, k)
        if np.linalg.norm(shift) >= SHIFT_MIN_M:
            for before, after in REACHES:
                laid = _moved(exploration, route, k, shift, before, after)
                if laid is None:
                    continue
                candidate, end = laid
                first = k - before + 1
                relaid = candidate.until(end)
                trial = assess_route(exploration, relaid, assessment, first)
                was = _threat(route, assessment, first, k + after)
                if (
                    trial.clear.min() >= 1.0 - collision_max
                    and _threat(relaid, trial, first, end) < was
                    and trial.log_risk(first, end) <= assessment.log_risk(first, k + after) + RISK_SAME
                ):
                    assessment = assess_route(exploration, candidate, trial, end + 1)
                    route, moved = candidate, moved + 1
                    break
        k += EVERY
    return route, moved, assessment


def _threat(route: Route, assessment: Assessment, first: int, last: int) -> float:
    """Threat level integrated over time from one row to another [s]."""
    rows = slice(first, last + 1)
    return float(assessment.levels[rows] @ np.diff(route.times, prepend=0.0)[rows])


def particle_shift(exploration: Exploration, assessment: Assessment, k: int) -> FloatArray:
    """Return the offset of the weighted mean of row ``k``'s particles from their plain mean.

    Returns
    -------
    ndarray, shape (3,)
        East, north, up [m].
    """
    levels = assessment.particle_levels[k]
    if levels.max() <= 0.0:
        return np.zeros(3)
    k_threat = exploration.problem.settings.k_threat
    weights = np.minimum(1.0 / np.maximum(k_threat * levels, 1e-12), 1.0)
    weights /= weights.sum()
    factor = np.empty((3, 3))
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = assessment.covariances[k]
    position_factor(covariance, np.zeros((6, 6)), exploration.limits.dimension, factor)
    shift: FloatArray = factor @ (weights @ exploration.tables.normals)
    return shift


def _moved(
    exploration: Exploration, route: Route, k: int, shift: FloatArray, before: int, after: int
) -> tuple[Route, int] | None:
    """Return the route with row ``k`` shifted and joined to rows before and after it, if flyable and clear.

    The second result is the row at which the new edges end.

    Parameters
    ----------
    exploration : Exploration
        The search that found the route.
    route : Route
        Stays as it is.
    k : int
        The row to move.
    shift : ndarray, shape (3,)
        By how much [m].
    before, after : int
        Rows laid anew before and after it.
    """
    first, last = k - before, k + after
    if first < 0 or last >= len(route):
        return None
    rows = empty_rows(len(route) + 4 * (before + after))
    via = route.states[k].copy()
    via[:3] += shift
    status, n, at = splice(route.rows, len(route), first, via, True, last, exploration.limits, rows)
    if status != JOINED or not is_flyable(rows, n, first + 1, exploration.limits):
        return None
    obstacles = exploration.problem.snapshot.obstacles
    if not is_clear(rows, first + 1, at + 1, obstacles, exploration.limits):
        return None
    if not visits_goals(rows.states[:n], exploration.problem.goals):
        return None
    return Route.of(rows, n), at
