"""Safety adjustment of a path (paper 4.4.2): waypoints drift towards their safer particles."""

from __future__ import annotations

import numpy as np

from companion.kernels.splice import JOINED, is_clear, is_flyable, splice
from companion.kernels.uncertainty import position_factor
from companion.planning.explore import Exploration
from companion.planning.route import Assessment, Route, assess_route, cost_between, visits_goals

REACH_STEPS = 8  # rows before and after a moved waypoint over which its edges are laid anew
SHIFT_MIN_M = 0.5  # smaller moves are below what is flown
EVERY = 4  # rows between waypoints that are moved: neighbours share their particles' levels


def adjusted_route(exploration: Exploration, route: Route) -> tuple[Route, int]:
    """Move waypoints, one by one, to the mean of their particles weighted by ``min(1/(k_T·TI), 1)``.

    A moved waypoint keeps its direction and is joined to the path again by Dubins edges, which keep
    turn radius, climb angles and the straight-flight rule; where they cannot, where the margin from
    obstacles is lost, p_c falls below the limit, or the cost rises, the waypoint stays.

    Returns
    -------
    Route
        The adjusted route.
    int
        How many waypoints moved.
    """
    settings = exploration.problem.settings
    assessment = assess_route(exploration, route)
    moved, k = 0, REACH_STEPS
    while k < len(route) - REACH_STEPS:
        shift = particle_shift(exploration, assessment, k)
        laid = None if np.linalg.norm(shift) < SHIFT_MIN_M else _moved(exploration, route, k, shift)
        if laid is not None:
            candidate, at = laid
            old = cost_between(exploration, route, k - REACH_STEPS + 1, k + REACH_STEPS + 1)
            new = cost_between(exploration, candidate, k - REACH_STEPS + 1, at + 1)
            if new < old:
                trial = assess_route(exploration, candidate)
                if 1.0 - trial.clear.min() <= settings.adjust_collision_max:
                    route, assessment, moved = candidate, trial, moved + 1
        k += EVERY
    return route, moved


def particle_shift(exploration: Exploration, assessment: Assessment, k: int) -> np.ndarray:
    """How far the weighted mean of row ``k``'s particles lies from their plain mean, shape (3,) [m]."""
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
    shift: np.ndarray = factor @ (weights @ exploration.tables.normals)
    return shift


def _moved(exploration: Exploration, route: Route, k: int, shift: np.ndarray) -> tuple[Route, int] | None:
    """The route with row ``k`` shifted and the row its last new edge ends in, if flyable and clear."""
    capacity = len(route) + 4 * REACH_STEPS
    states, times, rates = np.empty((capacity, 6)), np.empty(capacity), np.empty((capacity, 2))
    via = route.states[k].copy()
    via[:3] += shift
    first, last = k - REACH_STEPS, k + REACH_STEPS
    status, n, at = splice(
        route.states, route.times, route.rates, len(route), first, via, True, last, exploration.limits,
        states, times, rates,
    )  # fmt: skip
    if status != JOINED or not is_flyable(states, times, rates, n, first + 1, exploration.limits):
        return None
    obstacles, margin = exploration.problem.snapshot.obstacles, exploration.limits.margin
    if not is_clear(states, rates, times, first + 1, at + 1, obstacles, margin):
        return None
    if not visits_goals(states[:n], exploration.problem.goals):
        return None
    return Route(states[:n].copy(), times[:n].copy(), rates[:n].copy()), at
