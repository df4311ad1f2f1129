"""A found path as flat rows, and what is known along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray, course_from_direction, direction_from_course
from companion.kernels.geometry import clearance
from companion.kernels.splice import dt_positions, path_cost
from companion.kernels.threat import MAX_THREATS, node_threat
from companion.kernels.uncertainty import collision_free, position_deviation, position_factor, propagate
from companion.planning.explore import Exploration
from companion.planning.problem import GoalRegion
from companion.types.path import Path


@dataclass(frozen=True, slots=True)
class Route:
    """Rows of a path: ``states`` (N, 6), ``times`` (N,) and ``rates`` (N, 2) of the edges before them."""

    states: FloatArray
    times: FloatArray
    rates: FloatArray

    def __len__(self) -> int:
        return len(self.times)


def route_from_tree(exploration: Exploration, node: int) -> Route:
    """The branch from the root to a node."""
    tree, rows = exploration.tree, []
    while node >= 0:
        rows.append(node)
        node = int(tree.parent[node])
    index = np.array(rows[::-1])
    return Route(tree.state[index].copy(), tree.time[index].copy(), tree.rate[index].copy())


def route_from_path(path: Path) -> Route:
    """A path of an earlier plan as rows; the rates of its first edge are not known and taken as 0."""
    directions = np.array([direction_from_course(float(course)) for course in path.courses_rad])
    states = np.column_stack([path.positions_enu_m, directions, path.climb_angles_rad, path.speeds_m_s])
    steps = np.diff(path.times_s, prepend=path.times_s[0] - 1.0)
    turns = np.diff(np.unwrap(directions), prepend=directions[0]) / steps
    climbs = np.diff(path.climb_angles_rad, prepend=path.climb_angles_rad[0]) / steps
    return Route(np.ascontiguousarray(states), path.times_s.copy(), np.column_stack([turns, climbs]))


@dataclass(frozen=True, slots=True)
class Assessment:
    """What LQG-MP and the threat model say of each row of a route.

    ``covariances`` (N, 3, 3) position part of Σ [m²]; ``clear`` (N,) p_c; ``levels`` (N,) TI;
    ``particle_levels`` (N, M) TI of each particle; ``dt_points`` (N, D, 4) the DTs' nearest positions.
    """

    covariances: FloatArray
    clear: FloatArray
    levels: FloatArray
    particle_levels: FloatArray
    dt_points: FloatArray


def assess_route(exploration: Exploration, route: Route) -> Assessment:
    """Propagate the covariance along a route and evaluate every row."""
    problem, n = exploration.problem, len(route)
    snapshot, tables = problem.snapshot, exploration.tables
    num_dts = len(snapshot.tracks)
    error, estimate = problem.start.error_covariance.copy(), problem.start.estimate_covariance.copy()
    result = Assessment(
        covariances=np.empty((n, 3, 3)),
        clear=np.empty(n),
        levels=np.empty(n),
        particle_levels=np.empty((n, len(tables.normals))),
        dt_points=np.zeros((n, max(num_dts, 1), 4)),
    )
    factor, scratch = np.empty((3, 3)), np.empty((MAX_THREATS, 2))
    reach = exploration.pursuers.model[:, 1].copy()
    for k in range(n):
        if k > 0:
            dt = float(route.times[k] - route.times[k - 1])
            next_error, next_estimate = np.empty((6, 6)), np.empty((6, 6))
            a = float(route.states[k, 5] - route.states[k - 1, 5]) / dt
            propagate(
                route.states[k - 1], a, route.rates[k, 0], route.rates[k, 1], dt, tables, error, estimate,
                next_error, next_estimate,
            )  # fmt: skip
            error, estimate = next_error, next_estimate
        x, y, z = route.states[k, :3]
        deviation = position_deviation(error, estimate, snapshot.dimension)
        result.covariances[k] = error[:3, :3] + estimate[:3, :3]
        result.clear[k] = collision_free(
            clearance(x, y, z, snapshot.obstacles, 1e4), deviation, snapshot.dimension
        )
        dt_positions(
            exploration.pursuers, x, y, z, route.times[k], problem.settings.k_pursuer, snapshot.obstacles,
            result.dt_points[k],
        )  # fmt: skip
        position_factor(error, estimate, snapshot.dimension, factor)
        if not problem.settings.strategies.use_uncertainty:
            factor[:] = 0.0
        result.levels[k] = node_threat(
            route.states[k], factor, deviation / snapshot.unit_m, exploration.threats, result.dt_points[k],
            reach, exploration.model, tables.normals, scratch, result.particle_levels[k],
        )  # fmt: skip
    return result


def cost_between(exploration: Exploration, route: Route, first: int = 1, end: int | None = None) -> float:
    """Sum of (9) over the edges that end in rows ``first`` to ``end - 1``; by default over all."""
    problem = exploration.problem
    return float(
        path_cost(
            route.states, route.times, first, len(route) if end is None else end,
            float(exploration.tree.delta[0]), exploration.pursuers, problem.snapshot.obstacles,
            exploration.threats, exploration.model,
            problem.settings.search(exploration.limits, problem.snapshot.unit_m, 0.0),
        )
    )  # fmt: skip


def path_from_route(route: Route, assessment: Assessment) -> Path:
    """The route as other layers take it."""
    return Path(
        times_s=route.times,
        positions_enu_m=route.states[:, :3].copy(),
        courses_rad=np.array([course_from_direction(theta) for theta in route.states[:, 3]]),
        climb_angles_rad=route.states[:, 4].copy(),
        speeds_m_s=route.states[:, 5].copy(),
        position_covariances_m2=assessment.covariances,
        collision_free=assessment.clear,
        threat_levels=assessment.levels,
    )


def visits_goals(states: FloatArray, goals: Sequence[GoalRegion]) -> bool:
    """Whether rows (N, 6) pass all goals but the last, in order, each within its radius."""
    first = 0
    for goal in goals[:-1]:
        away = np.linalg.norm(states[first:, :3] - np.asarray(goal.position_enu_m), axis=1)
        near = np.flatnonzero(away <= goal.acceptance_radius_m)
        if not len(near):
            return False
        first += int(near[0])
    return True
