"""The plan of the least objective J, where nothing pursues the aircraft."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from companion.planning.comparators import Optimiser
from companion.planning.explore import Exploration
from companion.planning.least_objective.least_route import best_first_route, shortened_route
from companion.planning.least_objective.plan_measures import MIN_ROWS, ends_at, measures_of
from companion.planning.least_objective.prices import objective_between, objective_of, seconds_seen
from companion.planning.route import (
    FLOWN_SLACK_S,
    assess_route,
    finished_route,
    path_from_route,
    pursuit_risk,
    route_from_path,
)
from companion.types.path import Path
from companion.types.plan import Plan, PlanStatus
from companion.world.pursuer_trees import grown_trees


def plan_by_objective(
    exploration: Exploration, should_stop: Callable[[], bool], timer: Callable[[], float], flown: Path | None
) -> Plan | None:
    """The plan with the least objective J that is found; None where no way to the last goal is found.

    Nothing but J is compared.

    Parameters
    ----------
    exploration : Exploration
        Has the problem, and counts the work.
    should_stop : callable
        Asked between bursts whether the time is over.
    timer : callable
        Seconds, for the measure PST only.
    flown : Path or None
        What is left of the path being flown; it is the plan where it can be made cheaper than the new one.
    """
    problem, began, notes = exploration.problem, timer(), list(exploration.given_up)
    objective = objective_of(exploration)
    searched = best_first_route(exploration, objective, should_stop)
    if searched is None:
        return None
    searched_s = timer() - began
    route = finished_route(exploration, searched.route, np.array(problem.goals[-1].position_enu_m))
    if problem.settings.strategies.optimiser is Optimiser.RRT_STAR:
        route, kept = shortened_route(exploration, objective, route, should_stop)
        notes.append(f"{kept} short cuts")
    flown_cost, flown_threat, flown_risk = None, None, None
    if flown is not None and len(flown) >= MIN_ROWS:
        flown_route = route_from_path(exploration, flown)
        flown_cost = objective_between(objective, flown_route)
        flown_threat = float(assess_route(exploration, flown_route).levels.max())
        flown_risk = pursuit_risk(exploration, flown_route, slack_s=FLOWN_SLACK_S)
        improved, kept = shortened_route(exploration, objective, flown_route, should_stop)
        is_cheaper = objective_between(objective, improved) < objective_between(objective, route)
        if is_cheaper and ends_at(improved, problem.goals[-1]):
            route, notes = improved, [f"the flown path, {kept} short cuts"]
    assessment = assess_route(exploration, route)
    return Plan(
        status=PlanStatus.EXACT,
        path=path_from_route(exploration, route, assessment),
        measures=measures_of(exploration, route, assessment, searched_s, searched.num_nodes),
        seed=problem.seed,
        method=problem.settings.method,
        snapshot_number=problem.snapshot.number,
        trace=searched.trace,
        notes=tuple(notes),
        flown_cost=flown_cost,
        flown_threat=flown_threat,
        pursuit=pursuit_risk(exploration, route, slack_s=FLOWN_SLACK_S),
        flown_pursuit=flown_risk,
        threat_trees=grown_trees(exploration.pursuers, problem.snapshot.tracks),
        objective_s=objective_between(objective, route),
        seen_s=seconds_seen(objective, route),
        bound_s=searched.bound_s,
    )
