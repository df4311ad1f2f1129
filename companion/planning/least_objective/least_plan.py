"""Plans of least objective J."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from companion.planning.explore import Exploration
from companion.planning.least_objective.least_route import LeastRouteSearch
from companion.planning.least_objective.plan_measures import (
    MIN_ROWS,
    ends_at,
    plan_along,
    shortfall,
    trace_with_pursuers,
    with_flown,
)
from companion.planning.least_objective.prices import objective_between
from companion.planning.least_objective.short_cuts import keeps_limits, shortened_route
from companion.planning.route import assess_route, grow_pursuers_along, route_from_path
from companion.types.path import Path
from companion.types.plan import Plan


def plan_by_objective(
    exploration: Exploration, should_stop: Callable[[], bool], timer: Callable[[], float], flown: Path | None
) -> Plan:
    """Return the plan of least objective J that is found. Only J is compared.

    Parameters
    ----------
    exploration : Exploration
        The problem, and the counters of work.
    should_stop : callable
        Asked between bursts of extensions whether the time is over.
    timer : callable
        Returns seconds, for the measure PST only.
    flown : Path or None
        The rest of the flown path. It becomes the plan if it keeps the limits and, once shortened, costs
        less than the new path.
    """
    problem, began = exploration.problem, timer()
    search = LeastRouteSearch(exploration, should_stop, timer)
    searched = search.run()
    searched_s = timer() - began - search.shortening_s
    objective, route, reached, cost_s = searched.objective, searched.route, searched.reached, searched.cost_s
    notes = searched.notes if reached else (shortfall(route, problem, searched.num_nodes),)
    if exploration.is_pursued:
        grow_pursuers_along(exploration, route)
    flown_route = None if flown is None or len(flown) < MIN_ROWS else route_from_path(exploration, flown)
    if flown_route is not None and (
        keeps_limits(exploration, objective, flown_route) or not keeps_limits(exploration, objective, route)
    ):
        improved, kept = shortened_route(exploration, objective, flown_route, should_stop)
        if objective_between(objective, improved) < cost_s and ends_at(improved, problem.goals[-1]):
            route, reached, notes = improved, True, (f"the flown path, {kept} short cuts",)
    plan = plan_along(
        exploration, route, assess_route(exploration, route), objective, reached=reached,
        searched_s=searched_s, num_nodes=searched.num_nodes, notes=notes,
    )  # fmt: skip
    # A passage narrower than the field's spacing may be closed in V, which then is no bound.
    bound_s = min(search.bound_s, plan.objective_s)
    plan = replace(plan, bound_s=bound_s, trace=trace_with_pursuers(exploration, searched.trace))
    if flown_route is None:
        return plan
    known, cost_s = assess_route(exploration, flown_route), objective_between(objective, flown_route)
    return with_flown(exploration, plan, flown_route, known, cost_s)
