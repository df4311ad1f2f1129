"""Reports about a route: the measures of the paper's tables, and how far a search got."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from companion.frames import FloatArray
from companion.kernels.objective.row_costs import Objective
from companion.kernels.search.path_assessment import radar_memberships
from companion.kernels.threat.fuzzy_threat import success_over_exposures
from companion.planning.explore import Exploration
from companion.planning.least_objective.prices import objective_between, seconds_seen
from companion.planning.problem import GoalRegion, Problem
from companion.planning.route import (
    FLOWN_SLACK_S,
    Assessment,
    Route,
    cost_between,
    path_from_route,
    pursuit_risk,
)
from companion.types.plan import Measures, Plan, PlanStatus, SearchTrace
from companion.world.pursuer_trees import grown_trees

HIGH_THREAT = 0.5
MIN_ROWS = 4  # A path with fewer rows is not improved.
NUM_SECONDARY = 10


def shortfall(route: Route, problem: Problem, num_nodes: int) -> str:
    """Return in words how far a search got that found no path.

    Parameters
    ----------
    route : Route
        The branch that came nearest to the last goal.
    problem : Problem
        The problem, with its goals.
    num_nodes : int
        Number of nodes that were grown.
    """
    away = float(np.linalg.norm(route.states[-1, :3] - problem.goals[-1].position_enu_m))
    return f"ends {away:.0f} m from the last goal after {num_nodes} nodes"


def ends_at(route: Route, goal: GoalRegion) -> bool:
    """Return whether a route ends in a goal region.

    Parameters
    ----------
    route : Route
        A path.
    goal : GoalRegion
        The goal region.
    """
    away = np.linalg.norm(route.states[-1, :3] - goal.position_enu_m)
    return bool(away <= goal.acceptance_radius_m)


def measures_of(
    exploration: Exploration, route: Route, assessment: Assessment, searched_s: float, num_nodes: int
) -> Measures:
    """Return the measures of the paper's tables (its 5.3), over the radars known to the planner."""
    # A copy: of a route of one row a part of its columns is an array of another type, and would compile anew.
    positions = np.ascontiguousarray(route.states[:, :3])
    waypoint, secondary = radar_memberships(positions, NUM_SECONDARY, exploration.problem.snapshot.threats)
    total = waypoint.sum() + secondary.sum()
    free = np.prod((1.0 - np.minimum(waypoint, 1.0)) ** (1.0 / len(route)))
    return Measures(
        path_search_time_s=searched_s,
        num_collision_checks=int(exploration.stats[0]),
        num_tree_nodes=num_nodes,
        path_cost=cost_between(exploration, route),
        quality=float(np.prod(assessment.clear)),
        total_threat_amount=float(total),
        aggregated_threat=float(1.0 - free),
        num_high_threat_waypoints=int((assessment.levels > HIGH_THREAT).sum()),
        penetration_success=float(success_over_exposures(exposures(assessment.levels))),
    )


def exposures(levels: FloatArray) -> FloatArray:
    """Return the exposures that (3) multiplies: each stretch under threat is one, with its highest level.

    The paper does not say what an exposure is. If each second were one, no path would have a chance.

    Parameters
    ----------
    levels : ndarray, shape (N,)
        Threat level of each row.

    Returns
    -------
    ndarray, shape (E,)
        One element for each stretch.
    """
    threatened = levels > 0.0
    begins = np.flatnonzero(threatened & ~np.append(False, threatened[:-1]))
    ends = np.flatnonzero(threatened & ~np.append(threatened[1:], False))
    return np.array([levels[first : last + 1].max() for first, last in zip(begins, ends, strict=True)])


def trace_with_pursuers(exploration: Exploration, trace: SearchTrace) -> SearchTrace:
    """Return a search's trace with the pursuers' trees, and the circles from which they reach path nodes.

    Parameters
    ----------
    exploration : Exploration
        The search that has the trees.
    trace : SearchTrace
        The path tree.
    """
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
    return replace(
        trace,
        threat_tree_enu_m=np.concatenate(nodes) if nodes else np.empty((0, 2)),
        threat_tree_parents=np.concatenate(parents) if parents else np.empty(0, dtype=np.int64),
        reach_circles_enu_m=circles,
    )


def plan_along(
    exploration: Exploration, route: Route, assessment: Assessment, objective: Objective, *, reached: bool,
    searched_s: float, num_nodes: int, notes: Sequence[str],
) -> Plan:  # fmt: skip
    """Return a plan with a route, its assessment and its measures.

    Parameters
    ----------
    exploration : Exploration
        The search that found it.
    route : Route
        A path.
    assessment : Assessment
        The assessment of the route.
    objective : Objective
        J.
    reached : bool
        Whether the route leads to the last goal.
    searched_s : float
        Duration of the search [s].
    num_nodes : int
        Number of nodes of the search.
    notes : sequence of str
        Remarks about the plan.
    """
    problem = exploration.problem
    return Plan(
        status=PlanStatus.EXACT if reached else PlanStatus.APPROXIMATE,
        path=path_from_route(exploration, route, assessment),
        measures=measures_of(exploration, route, assessment, searched_s, num_nodes),
        seed=problem.seed,
        method=problem.settings.method,
        snapshot_number=problem.snapshot.number,
        notes=tuple(notes),
        pursuit=pursuit_risk(exploration, route, slack_s=FLOWN_SLACK_S),
        threat_trees=grown_trees(exploration.pursuers, problem.snapshot.tracks),
        objective_s=objective_between(objective, route),
        seen_s=seconds_seen(objective, route),
    )


def with_flown(exploration: Exploration, plan: Plan, flown: Route, known: Assessment, cost: float) -> Plan:
    """Return a plan with the cost and risk of the flown path, for comparison.

    Parameters
    ----------
    exploration : Exploration
        The search that found the plan.
    plan : Plan
        The new plan.
    flown : Route
        The rest of the flown path.
    known : Assessment
        The assessment of the rest.
    cost : float
        The cost of the rest, of the same kind as :attr:`~companion.types.plan.Plan.cost`.
    """
    risk = pursuit_risk(exploration, flown, slack_s=FLOWN_SLACK_S)
    return replace(plan, flown_cost=cost, flown_threat=float(known.levels.max()), flown_pursuit=risk)
