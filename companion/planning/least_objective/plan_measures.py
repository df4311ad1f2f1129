"""What is told of a route: the measures of the paper's tables, and how far a search got."""

from __future__ import annotations

import numpy as np

from companion.frames import FloatArray
from companion.kernels.search.path_assessment import radar_memberships
from companion.kernels.threat.fuzzy_threat import success_over_exposures
from companion.planning.explore import Exploration
from companion.planning.problem import GoalRegion, Problem
from companion.planning.route import Assessment, Route, cost_between
from companion.types.plan import Measures

HIGH_THREAT = 0.5
MIN_ROWS = 4  # of a path that is worth improving
NUM_SECONDARY = 10


def shortfall(route: Route, problem: Problem, num_nodes: int) -> str:
    """How far a search got, for who asks why there is no path.

    Parameters
    ----------
    route : Route
        The branch that came nearest.
    problem : Problem
        Has the goals.
    num_nodes : int
        How many nodes were grown.
    """
    away = float(np.linalg.norm(route.states[-1, :3] - problem.goals[-1].position_enu_m))
    return f"ends {away:.0f} m from the last goal after {num_nodes} nodes"


def ends_at(route: Route, goal: GoalRegion) -> bool:
    """Whether a route ends in a goal region.

    Parameters
    ----------
    route : Route
        A path.
    goal : GoalRegion
        Where it should end.
    """
    away = np.linalg.norm(route.states[-1, :3] - goal.position_enu_m)
    return bool(away <= goal.acceptance_radius_m)


def measures_of(
    exploration: Exploration, route: Route, assessment: Assessment, searched_s: float, num_nodes: int
) -> Measures:
    """The measures of the paper's tables (its 5.3), over the radars known to the planner."""
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
    """What (3) multiplies: a stretch under threat is one exposure, its highest level the damage.

    The paper does not say what an exposure is; were each second one, no path would have a chance.

    Parameters
    ----------
    levels : ndarray, shape (N,)
        Threat level of each row.

    Returns
    -------
    ndarray, shape (E,)
        One element a stretch.
    """
    threatened = levels > 0.0
    begins = np.flatnonzero(threatened & ~np.append(False, threatened[:-1]))
    ends = np.flatnonzero(threatened & ~np.append(threatened[1:], False))
    return np.array([levels[first : last + 1].max() for first, last in zip(begins, ends, strict=True)])
