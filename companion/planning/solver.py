"""Algorithm 2: plans through all goals, after a recovery path if the start is too near to something."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from companion.errors import PlannerError
from companion.kernels.geometry.prism_distance import clearance
from companion.planning.comparators import METHODS
from companion.planning.explore import Exploration
from companion.planning.least_objective.least_plan import plan_by_objective
from companion.planning.plugins.plugged_plan import plan_by_plugin
from companion.planning.printed.printed_plan import plan_by_sub_tasks
from companion.planning.problem import Problem, StartState
from companion.planning.route import (
    assess_route,
    path_from_route,
    route_along,
)
from companion.types.path import Path
from companion.types.plan import Measures, Plan, PlanStatus
from companion.world.vehicle.recovery_path import recovery_path


def never() -> bool:
    """Never stop: the iteration budget ends the search."""
    return False


def solve(
    problem: Problem,
    should_stop: Callable[[], bool] = never,
    timer: Callable[[], float] = time.perf_counter,
    flown: Path | None = None,
) -> Plan:
    """Plan from the start through all goals, in order.

    Parameters
    ----------
    problem : Problem
        The problem; equal problems and stopping rules give equal plans.
    should_stop : callable
        Asked between bursts of iterations; the default leaves it to ``max_iterations``.
    timer : callable
        Returns seconds, for the measure PST only; no decision depends on it.
    flown : Path, optional
        The rest of the flown path, from the start on; its cost is computed in the same world.

    Returns
    -------
    Plan
        ``EXACT`` with a path to the last goal, ``APPROXIMATE`` with the branch that came nearest to it, or
        ``INVALID_START`` without a path, if no plan and no recovery path can begin at the start.

    Raises
    ------
    PlannerError
        If the method is another package's planner and fails.
    """
    exploration = Exploration(problem, np.random.default_rng(problem.seed))
    plan = None if exploration.start_is_clear else _by_recovery_path(exploration, should_stop, timer)
    if plan is not None:
        return plan
    if problem.settings.method not in METHODS:
        return plan_by_plugin(exploration, should_stop, timer, flown)
    by_objective = problem.settings.strategies.by_objective
    return (plan_by_objective if by_objective else plan_by_sub_tasks)(exploration, should_stop, timer, flown)


def solve_in_flight(problem: Problem, should_stop: Callable[[], bool], flown: Path | None = None) -> Plan:
    """Plan as :func:`solve` does; if another package's planner fails, there is no path, and a note says why.

    Parameters
    ----------
    problem : Problem
        The problem.
    should_stop : callable
        Returns True once the time is over.
    flown : Path, optional
        What is left of the path being flown.
    """
    try:
        return solve(problem, should_stop, flown=flown)
    except PlannerError as error:
        return _without_path(problem, PlanStatus.APPROXIMATE, str(error))


def _without_path(problem: Problem, status: PlanStatus, note: str) -> Plan:
    """Return the answer without a path."""
    return Plan(
        status, None, Measures(), problem.seed, problem.settings.method, problem.snapshot.number,
        notes=(note,), threat_trees=problem.snapshot.threat_trees,
    )  # fmt: skip


def _invalid_start(problem: Problem) -> Plan:
    """Return the answer if neither a plan nor a recovery path can begin."""
    note = "the start breaks a constraint or stands in an obstacle"
    return _without_path(problem, PlanStatus.INVALID_START, note)


def _by_recovery_path(
    exploration: Exploration, should_stop: Callable[[], bool], timer: Callable[[], float]
) -> Plan | None:
    """Return the shortest path to a place where a plan can begin, followed by the plan from there.

    If there is no such path, the result says that the start is invalid, or is None if the start is only near
    to something.
    """
    problem, limits = exploration.problem, exploration.limits
    is_walled_in = clearance(*problem.start.position_enu_m, problem.snapshot.walls, 1.0) <= 0.0
    state, obstacles = exploration.tree.state[0].copy(), problem.snapshot.obstacle_list
    states = (
        None if is_walled_in else recovery_path(state, obstacles, limits, problem.snapshot.obstacles.ground)
    )
    if states is None:
        return None if exploration.start_is_valid else _invalid_start(problem)
    route = route_along(exploration, states)
    known = assess_route(exploration, route)
    east, north, up, direction, climb, airspeed = (float(value) for value in states[-1])
    begin = StartState(
        float(route.times[-1]), (east, north, up), direction, climb, airspeed,
        known.rows.errors[-1], known.rows.estimates[-1],
    )  # fmt: skip
    plan = solve(replace(problem, start=begin), should_stop, timer)
    if plan.path is None:
        return plan
    path = path_from_route(exploration, route, known).followed_by(plan.path)
    note = f"the way out, {len(states) - 1} s, first"
    return replace(plan, path=path, snapshot_number=problem.snapshot.number, notes=(note, *plan.notes))
