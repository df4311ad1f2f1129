"""Short cuts: stretches of a path are replaced by Dubins edges where that lowers J."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from companion.kernels.objective.row_costs import Objective, longest_seen
from companion.kernels.search.path_edit import fill_short_cut
from companion.kernels.workspace import PathRows, empty_rows
from companion.planning.explore import Exploration
from companion.planning.least_objective.prices import objective_between
from companion.planning.route import Route, assess_route, cost_between, pursuit_risk, visits_goals

SPARE_ROWS = 64
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
    problem, kept, out = exploration.problem, 0, room_for(route)
    rounds, risk_s = problem.settings.smooth_iterations, pursuit_risk(exploration, route).total_s
    is_within_limits = keeps_limits(exploration, objective, route)
    for iteration in range(rounds):
        n = len(route)
        if n < 4 or should_stop():
            break
        i, j = drawn_stretch(exploration.rng, n, 1.0 - iteration / rounds)
        cut = short_cut(exploration, route, i, j, out)
        if cut is None or not visits_goals(cut[0].states, problem.goals):
            continue
        gain_s = objective_between(objective, route, i + 1) - objective_between(objective, cut[0], i + 1)
        if gain_s <= LEAST_GAIN_S or (is_within_limits and not keeps_limits(exploration, objective, cut[0])):
            continue
        other_s = pursuit_risk(exploration, cut[0]).total_s
        if other_s <= risk_s:
            route, risk_s, kept = Route.of(out, len(cut[0])), other_s, kept + 1
            out = room_for(route)
    return route, kept


def drawn_stretch(rng: np.random.Generator, num_rows: int, share: float) -> tuple[int, int]:
    """First and last row of a random stretch of a route, which is as long as a share of it at most."""
    widest = max(4, int(num_rows * share))
    first = int(rng.integers(0, num_rows - 3))
    return first, min(num_rows - 1, first + 3 + int(rng.integers(0, widest)))


def room_for(route: Route) -> PathRows:
    """Room for a route with a short cut."""
    return empty_rows(len(route) + SPARE_ROWS)


def short_cut(
    exploration: Exploration, route: Route, i: int, j: int, out: PathRows
) -> tuple[Route, int] | None:
    """The route with a Dubins edge from row ``i`` to ``j``, if that is sooner, flyable and clear.

    With it the row that ``j`` has become. It lies in ``out`` (:func:`room_for`).
    """
    obstacles = exploration.problem.snapshot.obstacles
    m, at = fill_short_cut(route.rows, len(route), i, j, exploration.limits, obstacles, out)
    return (Route(out.states[:m], out.times[:m], out.rates[:m]), at) if m else None


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
