"""Short cuts: stretches of a path are replaced by Dubins edges where that lowers J."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from companion.kernels.objective.row_costs import Objective, longest_seen
from companion.kernels.search.path_edit import JOINED, is_clear, is_flyable, splice
from companion.kernels.workspace import empty_rows
from companion.planning.explore import Exploration
from companion.planning.least_objective.prices import objective_between
from companion.planning.route import Route, assess_route, cost_between, pursuit_risk, visits_goals

SPARE_ROWS = 64
SPEED_SPARE_M_S = 0.1  # A short cut may be faster than the row that it leads to by this much.
NOWHERE = np.zeros(6)  # Stands for a pose that is not given.
LEAST_GAIN_S = 1e-9  # A short cut that lowers J by less gains nothing.


def shortened_route(
    exploration: Exploration, objective: Objective, route: Route, should_stop: Callable[[], bool]
) -> tuple[Route, int]:
    """Replace stretches of a route by Dubins edges where that lowers J; the route, and how many were.

    Stretches are drawn at random, wide ones first. A route that keeps the limits is not replaced by one that
    breaks any.

    Parameters
    ----------
    exploration : Exploration
        Has the settings, and draws; left at the airspeed that is flown.
    objective : Objective
        J.
    route : Route
        A path.
    should_stop : callable
        Asked before each short cut whether the time is over.
    """
    problem, kept = exploration.problem, 0
    rounds, risk_s = problem.settings.smooth_iterations, pursuit_risk(exploration, route).total_s
    is_within_limits = keeps_limits(exploration, objective, route)
    for iteration in range(rounds):
        n = len(route)
        if n < 4 or should_stop():
            break
        i, j = drawn_stretch(exploration.rng, n, 1.0 - iteration / rounds)
        cut = short_cut(exploration, route, i, j)
        if cut is None or not visits_goals(cut[0].states, problem.goals):
            continue
        gain_s = objective_between(objective, route, i + 1) - objective_between(objective, cut[0], i + 1)
        if gain_s <= LEAST_GAIN_S or (is_within_limits and not keeps_limits(exploration, objective, cut[0])):
            continue
        other_s = pursuit_risk(exploration, cut[0]).total_s
        if other_s <= risk_s:
            route, risk_s, kept = Route.of(cut[0].rows, len(cut[0])), other_s, kept + 1
    return route, kept


def drawn_stretch(rng: np.random.Generator, num_rows: int, share: float) -> tuple[int, int]:
    """First and last row of a random stretch of a route, which is as long as a share of it at most."""
    widest = max(4, int(num_rows * share))
    first = int(rng.integers(0, num_rows - 3))
    return first, min(num_rows - 1, first + 3 + int(rng.integers(0, widest)))


def short_cut(exploration: Exploration, route: Route, i: int, j: int) -> tuple[Route, int] | None:
    """The route with a Dubins edge from row ``i`` to ``j``, if that is sooner, flyable and clear.

    With it the row that ``j`` has become.
    """
    limits, obstacles = exploration.limits, exploration.problem.snapshot.obstacles
    n, states = len(route), route.states
    if states[i, 5] > states[j, 5] + SPEED_SPARE_M_S:  # it would be as fast to its end
        return None
    rows = empty_rows(n + SPARE_ROWS)
    status, m, at = splice(route.rows, n, i, NOWHERE, False, j, limits, rows)
    if status != JOINED or rows.times[at] >= route.times[j]:
        return None
    if not is_flyable(rows, m, i + 1, limits):
        return None
    if not is_clear(rows, i + 1, at + 1, obstacles, limits):
        return None
    return Route(rows.states[:m], rows.times[:m], rows.rates[:m]), at


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
