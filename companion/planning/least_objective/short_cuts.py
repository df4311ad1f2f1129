"""Short cuts and detours: stretches of a path are replaced by Dubins edges where that lowers J."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from companion.frames import FloatArray
from companion.kernels.objective.path_changes import DETOUR, DRAWS, GOAL, ROWS_MIN, WIDTH, next_gain
from companion.kernels.objective.row_costs import AT_SURFACE, Objective, longest_seen
from companion.kernels.workspace import empty_rows
from companion.planning.explore import Exploration
from companion.planning.least_objective.prices import danger_along
from companion.planning.problem import goals_on_the_way
from companion.planning.route import SPARE_ROWS, Route, assess_route, cost_between, pursuit_risk

FOR_EACH_GOAL = 200  # Other ways past each goal that are tried.
BURST = 50  # Changes that are tried between two checks of the time.


def shortened_route(
    exploration: Exploration, objective: Objective, route: Route, should_stop: Callable[[], bool]
) -> tuple[Route, int]:
    """Replace stretches of a route by other edges where that lowers J; return it and how many were replaced.

    Stretches are drawn at random, long ones first. A route that loses well clear of another aircraft gets
    detours before short cuts: the tree follows V, and its cells are too coarse for a climb that is just steep
    enough. A route that keeps the limits is not replaced by one that breaks any.

    Parameters
    ----------
    exploration : Exploration
        Has the settings, and draws; left at the airspeed that is flown.
    objective : Objective
        J.
    route : Route
        A path.
    should_stop : callable
        Asked every few replacements whether the time is over.
    """
    problem, kept, tried = exploration.problem, 0, 0
    is_within_limits = keeps_limits(exploration, objective, route)
    risk_s = pursuit_risk(exploration, route).total_s
    has_detours = not exploration.is_pursued and loses_well_clear(objective, route)
    goals = goals_on_the_way(problem.goals)
    draws = _draws(exploration, problem.settings.smooth_iterations, has_detours, len(goals))
    while tried < len(draws) and len(route) >= ROWS_MIN and not should_stop():
        burst, out = draws[tried : tried + BURST], empty_rows(len(route) + SPARE_ROWS)
        at, num = next_gain(route.rows, len(route), burst, goals, objective, out)
        tried += min(at + 1, len(burst))
        if num == 0:
            continue
        changed = Route.of(out, num)
        other_s = pursuit_risk(exploration, changed).total_s
        if other_s <= risk_s and (not is_within_limits or keeps_limits(exploration, objective, changed)):
            route, risk_s, kept = changed, other_s, kept + 1
    return route, kept


def _draws(exploration: Exploration, num: int, has_detours: bool, num_goals: int) -> FloatArray:
    """Return ``num`` random short cuts, which become narrower, after as many detours if there are any.

    Other ways past the goals are scattered among them.

    Returns
    -------
    ndarray, shape (K, DRAWS)
        As :func:`next_gain` reads them.
    """
    draws = exploration.rng.random((2 * num if has_detours else num, DRAWS))
    draws[:-num, WIDTH] = DETOUR
    draws[-num:, WIDTH] = 1.0 - np.arange(num) / num
    if num_goals == 0:
        return draws
    past = exploration.rng.random((FOR_EACH_GOAL * num_goals, DRAWS))
    past[:, WIDTH] = GOAL
    at = np.sort(exploration.rng.integers(0, len(draws) + 1, len(past)))
    return np.insert(draws, at, past, axis=0)


def loses_well_clear(objective: Objective, route: Route) -> bool:
    """Return whether a route leads into the well clear volume of an aircraft that flies on.

    Parameters
    ----------
    objective : Objective
        J.
    route : Route
        A path that no pursuer threatens.
    """
    return danger_along(objective, route) >= AT_SURFACE


def keeps_limits(exploration: Exploration, objective: Objective, route: Route) -> bool:
    """Return whether a route keeps below the limits of time in sight, threat level and collisions.

    Parameters
    ----------
    exploration : Exploration
        Has the limits.
    objective : Objective
        Has the radars.
    route : Route
        A path.
    """
    settings = exploration.problem.settings
    seen_max_s = settings.seen_max_s
    if seen_max_s < math.inf and longest_seen(route.rows, len(route), objective.threats) > seen_max_s:
        return False
    if settings.threat_level_max < 1.0 and math.isinf(cost_between(exploration, route)):
        return False
    if settings.quality_min == 0.0:
        return True
    return math.exp(-assess_route(exploration, route).log_risk()) >= settings.quality_min
