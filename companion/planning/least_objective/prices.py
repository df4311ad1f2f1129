"""The objective J of a plan: what its kernels read, and what a route costs by it."""

from __future__ import annotations

import numpy as np

from companion.frames import FloatArray
from companion.kernels.objective.row_costs import (
    Objective,
    Prices,
    fill_deviations,
    most_danger,
    rows_cost,
    rows_seen,
)
from companion.kernels.workspace import filter_scratch
from companion.planning.explore import Exploration
from companion.planning.problem import Problem
from companion.planning.route import Route

DEVIATION_STEPS = 64  # The filter has settled after this many steps.


def prices_of(problem: Problem) -> Prices:
    """Return the prices of J; a price is 0 if the method ignores what it is for.

    Parameters
    ----------
    problem : Problem
        Has the settings.
    """
    settings = problem.settings
    wanted_m = settings.soft_clearance_m
    return Prices(
        seen=settings.price_seen,
        pursued=settings.price_pursued,
        near=settings.price_near,
        energy=settings.price_energy,
        collision=settings.price_collision if settings.strategies.use_uncertainty else 0.0,
        wanted=wanted_m,
        cruise=problem.vehicle.airspeed_cruise_m_s,
    )


def objective_of(exploration: Exploration) -> Objective:
    """Return J for paths from the exploration's start on.

    Parameters
    ----------
    exploration : Exploration
        Has the start, the world and the limits.
    """
    problem, limits = exploration.problem, exploration.limits
    return Objective(
        prices=prices_of(problem),
        obstacles=problem.snapshot.obstacles,
        threats=problem.snapshot.threats,
        game=exploration.game,
        pursuers=exploration.pursuers,
        limits=limits,
        deviations=_deviations(exploration),
        start=problem.start.stamp_s,
    )


def _deviations(exploration: Exploration) -> FloatArray:
    """Standard deviations of straight flight from the start.

    Returns
    -------
    ndarray, shape (DEVIATION_STEPS,)
        A step apart [m].
    """
    start, limits = exploration.problem.start, exploration.limits
    errors, estimates = np.zeros((2, 6, 6)), np.zeros((2, 6, 6))
    errors[0], estimates[0] = start.error_covariance, start.estimate_covariance
    deviations = np.empty(DEVIATION_STEPS)
    fill_deviations(
        exploration.tree.state[0], errors, estimates, exploration.tables, limits.tau, limits.dimension,
        deviations, filter_scratch(),
    )  # fmt: skip
    return deviations


def objective_between(objective: Objective, route: Route, first: int = 1, end: int | None = None) -> float:
    """J of the edges that end in rows ``first`` to ``end - 1``, by default of all [s].

    Parameters
    ----------
    objective : Objective
        J.
    route : Route
        A path.
    first, end : int
        Rows that count.
    """
    return float(rows_cost(route.rows, first, len(route) if end is None else end, objective))


def danger_along(objective: Objective, route: Route) -> float:
    """Return the largest danger from pursuers and from aircraft that fly on (g of J) on a route."""
    return float(most_danger(route.rows, len(route), objective))


def seconds_seen(objective: Objective, route: Route) -> float:
    """Return the integral over a route of m = 1 − Π(1 − μ) of the known radars [s].

    Parameters
    ----------
    objective : Objective
        Has the radars.
    route : Route
        A path.
    """
    return float(rows_seen(route.rows, len(route), objective.threats))
