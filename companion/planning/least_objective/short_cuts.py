"""Short cuts and detours: stretches of a path are replaced by Dubins edges where that lowers J."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from companion.kernels.objective.row_costs import AT_SURFACE, Objective, longest_seen
from companion.kernels.search.path_edit import fill_detour, fill_short_cut
from companion.kernels.workspace import PathRows, empty_rows
from companion.planning.explore import Exploration
from companion.planning.least_objective.prices import danger_along, objective_between
from companion.planning.route import Route, assess_route, cost_between, pursuit_risk, visits_goals

SPARE_ROWS = 64
ASIDE = 0.5  # A detour is no wider than this share of its length: 27° to one side.
LEAST_GAIN_S = 1e-9  # A change that lowers J by less than this is not kept.


def shortened_route(
    exploration: Exploration, objective: Objective, route: Route, should_stop: Callable[[], bool]
) -> tuple[Route, int]:
    """Replace stretches of a route by other edges where that lowers J; return it and how many were replaced.

    Stretches are drawn at random, wide ones first. A route that loses well clear of another aircraft gets
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
        Asked before each replacement whether the time is over.
    """
    problem, kept, out = exploration.problem, 0, room_for(route)
    rounds, risk_s = problem.settings.smooth_iterations, pursuit_risk(exploration, route).total_s
    is_within_limits = keeps_limits(exploration, objective, route)
    detours = rounds if not exploration.is_pursued and loses_well_clear(objective, route) else 0
    for iteration in range(-detours, rounds):
        n = len(route)
        if n < 4 or should_stop():
            break
        i, cut = replaced(exploration, route, iteration / rounds, out)
        if cut is None or not visits_goals(cut.states, problem.goals):
            continue
        gain_s = objective_between(objective, route, i + 1) - objective_between(objective, cut, i + 1)
        if gain_s <= LEAST_GAIN_S or (is_within_limits and not keeps_limits(exploration, objective, cut)):
            continue
        other_s = pursuit_risk(exploration, cut).total_s
        if other_s <= risk_s:
            route, risk_s, kept = Route.of(out, len(cut)), other_s, kept + 1
            out = room_for(route)
    return route, kept


def replaced(
    exploration: Exploration, route: Route, progress: float, out: PathRows
) -> tuple[int, Route | None]:
    """The first row of a random stretch, and the route with a detour or a short cut there, if it has one.

    It is a detour while ``progress`` is negative; short cuts become narrower as it rises to 1.
    """
    rng = exploration.rng
    i, j = drawn_stretch(rng, len(route), 1.0 - max(progress, 0.0))
    if progress < 0.0:
        i = int(i * rng.random() ** 2)  # Others are met soon, so most detours begin near the start.
        return i, detour(exploration, route, i, j, out)
    cut = short_cut(exploration, route, i, j, out)
    return i, None if cut is None else cut[0]


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


def detour(exploration: Exploration, route: Route, i: int, j: int, out: PathRows) -> Route | None:
    """Return the route with Dubins edges from row ``i`` over a random place to ``j``, if flyable and clear.

    The place is above, below or beside a row between them, at most as far as the aircraft can come until
    there. The route lies in ``out`` (:func:`room_for`).
    """
    rng, limits, obstacles = exploration.rng, exploration.limits, exploration.problem.snapshot.obstacles
    via = route.states[int(rng.integers(i + 1, j))].copy()
    far_m = math.sqrt(rng.random()) * float(np.linalg.norm(via[:2] - route.states[i, :2]))
    if limits.dimension == 3 and rng.random() < 0.5:
        via[2] += far_m * rng.choice([-math.tan(limits.descent_max), math.tan(limits.climb_max)])
    else:
        via[:2] += ASIDE * far_m * rng.choice([-1.0, 1.0]) * np.array([-math.sin(via[3]), math.cos(via[3])])
    via[4] = 0.0
    m = fill_detour(route.rows, len(route), i, via, j, limits, obstacles, out)
    return Route(out.states[:m], out.times[:m], out.rates[:m]) if m else None


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
    """Return the route with a Dubins edge from row ``i`` to ``j``, if that is sooner, flyable and clear.

    The second result is the row that ``j`` has become. The route lies in ``out`` (:func:`room_for`).
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
