"""A found path as flat rows, and what is known along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray, course_from_direction, direction_from_course
from companion.kernels.search.path_assessment import assess_rows
from companion.kernels.search.path_edit import path_cost
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

    def until(self, row: int) -> Route:
        """Rows up to one, that one included."""
        return Route(self.states[: row + 1], self.times[: row + 1], self.rates[: row + 1])


def branch_to(exploration: Exploration, node: int) -> list[int]:
    """Rows of the tree from the root to a node."""
    rows = []
    while node >= 0:
        rows.append(node)
        node = int(exploration.tree.parent[node])
    return rows[::-1]


def route_from_tree(exploration: Exploration, node: int) -> Route:
    """The branch from the root to a node."""
    tree, index = exploration.tree, np.array(branch_to(exploration, node))
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

    ``errors``, ``estimates`` (N, 6, 6) P and Λ; ``clear`` (N,) p_c; ``levels`` (N,) TI;
    ``particle_levels`` (N, M) TI of each particle; ``dt_points`` (N, D, 4) the DTs' nearest positions.
    """

    errors: FloatArray
    estimates: FloatArray
    clear: FloatArray
    levels: FloatArray
    particle_levels: FloatArray
    dt_points: FloatArray

    @property
    def covariances(self) -> FloatArray:
        """Position part of Σ (N, 3, 3) [m²]."""
        total: FloatArray = self.errors[:, :3, :3] + self.estimates[:, :3, :3]
        return total


def assess_route(
    exploration: Exploration, route: Route, known: Assessment | None = None, first: int = 0
) -> Assessment:
    """Propagate the covariance along a route and evaluate every row.

    With ``known``, the assessment of a route that has the same rows before ``first``, only the others.
    """
    n, problem = len(route), exploration.problem
    num_dts, num_particles = max(len(problem.snapshot.tracks), 1), len(exploration.tables.normals)
    result = Assessment(
        errors=np.empty((n, 6, 6)),
        estimates=np.empty((n, 6, 6)),
        clear=np.empty(n),
        levels=np.empty(n),
        particle_levels=np.empty((n, num_particles)),
        dt_points=np.zeros((n, num_dts, 4)),
    )
    result.errors[0], result.estimates[0] = problem.start.error_covariance, problem.start.estimate_covariance
    if known is not None:
        for name in Assessment.__slots__:
            getattr(result, name)[:first] = getattr(known, name)[:first]
    assess_rows(
        route.states, route.times, route.rates, first, n, exploration.scene(), result.errors,
        result.estimates, result.clear, result.levels, result.particle_levels, result.dt_points,
    )  # fmt: skip
    return result


def cost_between(exploration: Exploration, route: Route, first: int = 1, end: int | None = None) -> float:
    """Sum of (9) over the edges that end in rows ``first`` to ``end - 1``; by default over all."""
    problem = exploration.problem
    return float(
        path_cost(
            route.states, route.times, first, len(route) if end is None else end,
            float(exploration.tree.delta[0]), exploration.pursuers, problem.snapshot.walls,
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
