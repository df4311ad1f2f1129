"""Algorithm 2: sub tasks, safety adjustment, optimisation, and the measures of the result."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from companion.kernels.threat import membership, success_over_exposures
from companion.kernels.visibility import is_hidden
from companion.planning.explore import Exploration
from companion.planning.finish import finished_route
from companion.planning.optimise import optimised_route
from companion.planning.problem import GoalRegion, Problem
from companion.planning.route import (
    Assessment,
    Route,
    assess_route,
    cost_between,
    path_from_route,
    route_from_path,
    route_from_tree,
)
from companion.planning.safety_adjustment import adjusted_route
from companion.planning.settings import Optimiser
from companion.types.path import Path
from companion.types.plan import Measures, Plan, PlanStatus, SearchTrace

HIGH_THREAT = 0.5
MIN_ROWS = 4
NUM_SECONDARY = 10


def never() -> bool:
    """A stopping rule that leaves the end to the iteration budget."""
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
        What is to be planned; equal problems and stopping rules give equal plans.
    should_stop : callable
        Asked between bursts of iterations; the default leaves it to ``max_iterations``.
    timer : callable
        Seconds, for the measure PST only; nothing is decided by it.
    flown : Path, optional
        What is left of the path being flown, from the start on; costed in the same world.

    Returns
    -------
    Plan
        ``EXACT`` with a path to the last goal; ``APPROXIMATE`` with the branch that came nearest;
        ``INVALID_START`` without one.
    """
    exploration = Exploration(problem, np.random.default_rng(problem.seed))
    method = problem.settings.method
    if not exploration.start_is_valid:
        return Plan(
            PlanStatus.INVALID_START, None, Measures(), problem.seed, method, problem.snapshot.number,
            notes=("the start breaks a constraint or stands in an obstacle",),
        )  # fmt: skip
    began = timer()
    reached, route = _through_goals(exploration, should_stop)
    searched = timer() - began
    notes = list(exploration.notes)
    if reached:
        route = finished_route(exploration, route, np.array(problem.goals[-1].position_enu_m))
    if reached and problem.settings.strategies.optimiser is Optimiser.RRT_STAR:
        route, kept = optimised_route(exploration, route, should_stop)
        notes.append(f"{kept} rewirings")
    if reached and problem.settings.strategies.use_safety_adjustment:
        route, moved = adjusted_route(exploration, route)
        notes.append(f"{moved} waypoints adjusted")
    flown_cost, flown_threat = None, None
    if flown is not None and len(flown) >= MIN_ROWS:
        flown_route = route_from_path(flown)
        flown_cost = cost_between(exploration, flown_route)
        flown_threat = float(assess_route(exploration, flown_route).levels.max())
        improved, kept = optimised_route(exploration, flown_route, should_stop)
        is_whole = _ends_at(improved, problem.goals[-1])
        if is_whole and (
            not reached or cost_between(exploration, improved) < cost_between(exploration, route)
        ):
            route, reached = improved, True
            notes = [f"the flown path, {kept} rewirings"]
    assessment = assess_route(exploration, route)
    return Plan(
        status=PlanStatus.EXACT if reached else PlanStatus.APPROXIMATE,
        path=path_from_route(route, assessment),
        measures=measures_of(exploration, route, assessment, searched),
        seed=problem.seed,
        method=method,
        snapshot_number=problem.snapshot.number,
        trace=trace_of(exploration),
        notes=tuple(notes),
        flown_cost=flown_cost,
        flown_threat=flown_threat,
    )


def _through_goals(exploration: Exploration, should_stop: Callable[[], bool]) -> tuple[bool, Route]:
    """Whether all goals were passed in order, and the route there or the one that passed the most.

    A goal can be reached in a pose from which the next one cannot be; then the search starts afresh.
    """
    most, best = -1, None
    while best is None or not exploration.is_spent(should_stop):
        node, reached, passed = 0, True, 0
        for goal in exploration.problem.goals:
            position = np.array(goal.position_enu_m, dtype=np.float64)
            reached, node = exploration.reach_goal(position, goal.acceptance_radius_m, node, should_stop)
            if not reached:
                break
            passed += 1
        if reached:
            return True, route_from_tree(exploration, node)
        if passed > most:
            most, best = passed, route_from_tree(exploration, node)
        if not exploration.is_spent(should_stop):
            exploration.plant()
    return False, best


def _ends_at(route: Route, goal: GoalRegion) -> bool:
    """Whether a route ends in a goal region."""
    away = np.linalg.norm(route.states[-1, :3] - goal.position_enu_m)
    return bool(away <= goal.acceptance_radius_m)


def measures_of(
    exploration: Exploration, route: Route, assessment: Assessment, searched_s: float
) -> Measures:
    """The measures of the paper's tables (its 5.3), over the radars known to the planner."""
    waypoint, secondary = radar_memberships(exploration, route)
    total = waypoint.sum() + secondary.sum()
    free = np.prod((1.0 - waypoint) ** (1.0 / len(route)))
    return Measures(
        path_search_time_s=searched_s,
        num_collision_checks=int(exploration.stats[0]),
        num_tree_nodes=int(exploration.tree.count[0]) + exploration.num_nodes,
        path_cost=cost_between(exploration, route),
        quality=float(np.prod(assessment.clear)),
        total_threat_amount=float(total),
        aggregated_threat=float(1.0 - free),
        num_high_threat_waypoints=int((assessment.levels > HIGH_THREAT).sum()),
        penetration_success=float(success_over_exposures(assessment.levels)),
    )


def radar_memberships(exploration: Exploration, route: Route) -> tuple[np.ndarray, np.ndarray]:
    """Sum of radar membership at every row (N,) and at 10 points between rows (N - 1, 10)."""
    positions = route.states[:, :3]
    share = (np.arange(NUM_SECONDARY) + 1.0) / (NUM_SECONDARY + 1.0)
    between = positions[:-1, None] + share[None, :, None] * np.diff(positions, axis=0)[:, None]
    flat = np.array([_membership_at(exploration, p) for p in positions])
    inner = np.array([_membership_at(exploration, p) for p in between.reshape(-1, 3)])
    return np.minimum(flat, 1.0), inner.reshape(len(route) - 1, NUM_SECONDARY)


def _membership_at(exploration: Exploration, position: np.ndarray) -> float:
    """Sum of (1) over all radars at a point, with masking."""
    threats, total = exploration.problem.snapshot.threats, 0.0
    for radar, shadow in zip(threats.radars, threats.shadows, strict=True):
        away = position - radar[:3]
        if is_hidden(position[0], position[1], position[2], shadow, threats.grid):
            continue
        total += membership(
            float(np.linalg.norm(away)), float(away[2]), float(np.hypot(away[0], away[1])), radar[3], radar[4]
        )
    return total


def trace_of(exploration: Exploration) -> SearchTrace:
    """The trees, reach circles and sub goals, for pictures."""
    tree, n = exploration.tree, int(exploration.tree.count[0])
    pursuers = exploration.pursuers
    nodes, parents, offset = [], [], 0
    for d, count in enumerate(pursuers.count):
        nodes.append(pursuers.position[d, :count, :2])
        up = pursuers.parent[d, :count]
        parents.append(np.where(up >= 0, up + offset, -1))
        offset += int(count)
    known = tree.threat_point[:n, :, 3] > 0.0
    rows, which = np.nonzero(known[:, : len(pursuers.count)])
    circles = np.column_stack([tree.state[rows, 0], tree.state[rows, 1], pursuers.model[which, 1]])
    return SearchTrace(
        tree_enu_m=tree.state[:n, :3].copy(),
        tree_parents=tree.parent[:n].copy(),
        threat_tree_enu_m=np.concatenate(nodes) if nodes else np.empty((0, 2)),
        threat_tree_parents=np.concatenate(parents) if parents else np.empty(0, dtype=np.int64),
        reach_circles_enu_m=circles,
        sub_goals_enu_m=np.array(exploration.sub_goals).reshape(-1, 3),
        horizon_centres_enu_m=np.array(exploration.centres).reshape(-1, 3),
    )
