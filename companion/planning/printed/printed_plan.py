"""The plan by the paper's own operators: sub tasks, RRT*, safety adjustment (Algorithm 2)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from companion.planning.comparators import Optimiser
from companion.planning.explore import Exploration
from companion.planning.least_objective.plan_measures import (
    MIN_ROWS,
    ends_at,
    plan_along,
    shortfall,
    trace_with_pursuers,
    with_flown,
)
from companion.planning.least_objective.prices import objective_of
from companion.planning.printed.optimise import is_no_worse, rrt_star_route, smoothed_route
from companion.planning.printed.safety_adjustment import adjusted_route
from companion.planning.printed.sub_tasks import SubTasks
from companion.planning.route import (
    Assessment,
    Route,
    assess_route,
    cost_between,
    finished_route,
    route_from_path,
)
from companion.types.path import Path
from companion.types.plan import Plan, SearchTrace


def plan_by_sub_tasks(
    exploration: Exploration, should_stop: Callable[[], bool], timer: Callable[[], float], flown: Path | None
) -> Plan:
    """Return the plan that sub tasks find, as the paper prints it; its costs are those of (9).

    Parameters
    ----------
    exploration : Exploration
        Has the problem, and counts the work.
    should_stop : callable
        Asked between bursts whether the time is over.
    timer : callable
        Seconds, for the measure PST only.
    flown : Path or None
        The rest of the flown path. It becomes the plan if, once shortened, it costs less than the new one.
    """
    problem, began = exploration.problem, timer()
    search = SubTasks(exploration)
    reached, route, end = search.through_goals(should_stop)
    if not reached and exploration.bars_pursued:
        search.allow_threatened_nodes()
        reached, route, end = search.through_goals(should_stop)
    searched, num_nodes = timer() - began, exploration.num_nodes + int(exploration.tree.count[0])
    trace, notes = trace_of(search), list(search.notes)
    if reached:
        route, assessment = _finished(exploration, route, end, should_stop, notes)
    else:
        assessment = assess_route(exploration, route)
    flown_route = None if flown is None or len(flown) < MIN_ROWS else route_from_path(exploration, flown)
    if flown_route is not None:
        flown_known = assess_route(exploration, flown_route)
        improved, known, kept = smoothed_route(exploration, flown_route, flown_known, should_stop)
        is_better = not reached or worth(exploration, improved, known) < worth(exploration, route, assessment)
        if ends_at(improved, problem.goals[-1]) and is_better:
            route, reached, assessment = improved, True, known
            notes = [f"the flown path, {kept} short cuts"]
    if not reached:
        notes.append(shortfall(route, problem, num_nodes))
    plan = plan_along(
        exploration, route, assessment, objective_of(exploration), reached=reached, searched_s=searched,
        num_nodes=num_nodes, notes=notes,
    )  # fmt: skip
    plan = replace(plan, trace=trace)
    if flown_route is None:
        return plan
    return with_flown(exploration, plan, flown_route, flown_known, cost_between(exploration, flown_route))


def _finished(
    exploration: Exploration, route: Route, end: int, should_stop: Callable[[], bool], notes: list[str]
) -> tuple[Route, Assessment]:
    """Return a route to the goal, led to its centre, optimised and adjusted, and its assessment."""
    problem = exploration.problem
    route = finished_route(exploration, route, np.array(problem.goals[-1].position_enu_m))
    if problem.settings.strategies.optimiser is Optimiser.RRT_STAR:
        route, assessment = _optimised(exploration, route, end, should_stop, notes)
    else:
        assessment = assess_route(exploration, route)
    if not problem.settings.strategies.use_safety_adjustment:
        return route, assessment
    route, moved, assessment = adjusted_route(exploration, route, assessment)
    notes.append(f"{moved} waypoints adjusted")
    return route, assessment


def _optimised(
    exploration: Exploration, found: Route, end: int, should_stop: Callable[[], bool], notes: list[str]
) -> tuple[Route, Assessment]:
    """RRT* and smoothing; the result is judged anew, with each DT where it can be at each row's time."""
    best = rrt_star_route(exploration, found, end, should_stop)
    notes.append(f"RRT*: {best.num_rewired} edges rewired, {best.num_pruned} nodes pruned")
    known = assess_route(exploration, found)
    chosen = found, known
    if best.route is not found:
        other = best.route, assess_route(exploration, best.route)
        if is_no_worse(exploration, other[1], known.log_risk()):
            chosen = min(chosen, other, key=lambda pair: worth(exploration, *pair))
    smooth, known, kept = smoothed_route(exploration, *chosen, should_stop)
    notes.append(f"{kept} short cuts")
    return min((smooth, known), chosen, key=lambda pair: worth(exploration, *pair)) if kept else chosen


def worth(exploration: Exploration, route: Route, known: Assessment) -> tuple[bool, float]:
    """Return the key by which routes are compared: whether ``quality_min`` is broken, then the cost.

    The cost is (9) with what -log Q of (8) costs.
    """
    settings, risk = exploration.problem.settings, known.log_risk()
    cost = cost_between(exploration, route) + settings.weight_collision * risk
    return math.exp(-risk) < settings.quality_min, cost


def trace_of(search: SubTasks) -> SearchTrace:
    """Return the trees, reach circles and sub goals as the search left them, for pictures."""
    exploration = search.exploration
    tree, n = exploration.tree, int(exploration.tree.count[0])
    grown = SearchTrace(
        tree_enu_m=tree.state[:n, :3].copy(),
        tree_parents=tree.parent[:n].copy(),
        sub_goals_enu_m=np.array(search.sub_goals).reshape(-1, 3),
        horizon_centres_enu_m=np.array(search.centres).reshape(-1, 3),
    )
    return trace_with_pursuers(exploration, grown)
