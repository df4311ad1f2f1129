"""A path as arrays of rows, and its assessment: uncertainty, threat levels and risk."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.frames import FloatArray, course_from_direction, direction_from_course
from companion.kernels.search.growth import DRAWS, LEAST_CLEAR, grow
from companion.kernels.search.path_assessment import RowAssessment, assess_rows
from companion.kernels.search.path_edit import (
    JOINED,
    air_time,
    fill_air_times,
    is_clear,
    is_flyable,
    join,
    path_cost,
    retime,
)
from companion.kernels.threat.pursuit_game import threatened_rows
from companion.kernels.workspace import PathRows, empty_rows
from companion.planning.explore import Exploration
from companion.planning.problem import GoalRegion, Problem, rows_at_goals
from companion.types.path import Path
from companion.types.plan import PursuitRisk

FLOWN_SLACK_S = 0.5  # The flown path may have lost this much of the time to spare that it was planned with.
BACK_STEPS = (3, 5, 8, 12, 16, 24)  # An edge to the goal is tried from this many rows before the path's end.
SPARE_ROWS = 64
COURSE_CHANGES_RAD = (0.0, 0.35, -0.35, 0.8, -0.8)  # These offsets from the bearing to the goal are tried.


@dataclass(frozen=True)
class Route:
    """Rows of a path.

    Parameters
    ----------
    states : ndarray, shape (N, 6)
        East, north, up [m], direction and climb angle [rad], airspeed [m/s].
    times : ndarray, shape (N,)
        Clock reading at which each row is passed [s].
    rates : ndarray, shape (N, 2)
        Turn and climb rate of the edge before each row [rad/s].
    """

    states: FloatArray
    times: FloatArray
    rates: FloatArray

    @classmethod
    def of(cls, rows: PathRows, n: int) -> Route:
        """Return a copy of the first ``n`` rows."""
        return cls(rows.states[:n].copy(), rows.times[:n].copy(), rows.rates[:n].copy())

    @functools.cached_property
    def rows(self) -> PathRows:
        """The route in the kernels' form; it shares the memory."""
        return PathRows(self.states, self.times, self.rates)

    def __len__(self) -> int:
        return len(self.times)

    def until(self, row: int) -> Route:
        """Return the rows up to and including one."""
        return Route(self.states[: row + 1], self.times[: row + 1], self.rates[: row + 1])


def branch_to(exploration: Exploration, node: int) -> list[int]:
    """Return the tree's rows from the root to a node."""
    rows = []
    while node >= 0:
        rows.append(node)
        node = int(exploration.tree.parent[node])
    return rows[::-1]


def route_from_tree(exploration: Exploration, node: int) -> Route:
    """Return the branch from the root to a node."""
    tree, index = exploration.tree, np.array(branch_to(exploration, node))
    return Route(tree.state[index].copy(), tree.time[index].copy(), tree.rate[index].copy())


def route_along(exploration: Exploration, states: FloatArray) -> Route:
    """Return states, each one step in still air apart, as a route that begins at the search's start.

    Parameters
    ----------
    exploration : Exploration
        The search that it belongs to.
    states : ndarray, shape (N, 6)
        As those of :class:`Route`.
    """
    tau, num = exploration.limits.tau, len(states)
    turned = np.diff(np.unwrap(states[:, 3]), prepend=states[0, 3])
    climbed = np.diff(states[:, 4], prepend=states[0, 4])
    times = np.full(num, exploration.problem.start.stamp_s)
    route = Route(np.ascontiguousarray(states), times, np.column_stack([turned, climbed]) / tau)
    retime(route.rows, np.full(num, tau), exploration.limits)
    return route


def route_from_path(exploration: Exploration, path: Path) -> Route:
    """Return a path of an earlier plan as rows, with time stamps for the present wind.

    The rates of its first edge are not known; they are assumed to be 0.
    """
    directions = np.array([direction_from_course(float(course)) for course in path.courses_rad])
    states = np.column_stack([path.positions_enu_m, directions, path.climb_angles_rad, path.speeds_m_s])
    route = Route(np.ascontiguousarray(states), path.times_s.copy(), np.zeros((len(path), 2)))
    then = exploration.limits._replace(wind_x=path.wind_enu_m_s[0], wind_y=path.wind_enu_m_s[1])
    steps = np.ones(len(path))
    fill_air_times(route.rows, len(path), then, steps)
    route.rates[:, 0] = np.diff(np.unwrap(directions), prepend=directions[0]) / steps
    route.rates[:, 1] = np.diff(path.climb_angles_rad, prepend=path.climb_angles_rad[0]) / steps
    if path.wind_enu_m_s != exploration.problem.snapshot.wind_enu_m_s:
        retime(route.rows, steps, exploration.limits)
    return route


@dataclass(frozen=True, slots=True)
class Assessment:
    """The uncertainty (LQG-MP) and the threat levels at each row of a route.

    Parameters
    ----------
    rows : RowAssessment
        Covariances, p_c, threat levels and the DTs' nearest positions.
    """

    rows: RowAssessment

    @property
    def clear(self) -> FloatArray:
        """Probability p_c that each row is free of a collision.

        Returns
        -------
        ndarray, shape (N,)
            In [0, 1].
        """
        return self.rows.clear

    @property
    def levels(self) -> FloatArray:
        """Threat level TI of each row.

        Returns
        -------
        ndarray, shape (N,)
            In [0, 1].
        """
        return self.rows.levels

    @property
    def particle_levels(self) -> FloatArray:
        """Threat level of each particle about each row.

        Returns
        -------
        ndarray, shape (N, M)
            In [0, 1].
        """
        return self.rows.particle_levels

    def log_risk(self, first: int = 0, last: int | None = None) -> float:
        """Return −log Q of (8) over rows ``first`` to ``last``, by default over all."""
        end = None if last is None else last + 1
        return -float(np.log(np.maximum(self.clear[first:end], LEAST_CLEAR)).sum())

    @property
    def covariances(self) -> FloatArray:
        """Position part of Σ.

        Returns
        -------
        ndarray, shape (N, 3, 3)
            In m².
        """
        total: FloatArray = self.rows.errors[:, :3, :3] + self.rows.estimates[:, :3, :3]
        return total


def assess_route(
    exploration: Exploration, route: Route, known: Assessment | None = None, first: int = 0
) -> Assessment:
    """Propagate the covariance along a route and evaluate every row.

    Rows before ``first`` are copied from ``known``, the assessment of a route with the same rows there.
    """
    n, problem = len(route), exploration.problem
    num_dts, num_particles = max(len(problem.snapshot.tracks), 1), len(exploration.tables.normals)
    result = RowAssessment(
        errors=np.empty((n, 6, 6)),
        estimates=np.empty((n, 6, 6)),
        clear=np.empty(n),
        levels=np.empty(n),
        particle_levels=np.empty((n, num_particles)),
        points=np.zeros((n, num_dts, 4)),
    )
    result.errors[0], result.estimates[0] = problem.start.error_covariance, problem.start.estimate_covariance
    if known is not None:
        for new, old in zip(result, known.rows, strict=True):
            new[:first] = old[:first]
    assess_rows(route.rows, first, n, exploration.scene(), result, exploration.work)
    return Assessment(result)


def grow_pursuers_along(exploration: Exploration, route: Route) -> None:
    """Grow the pursuers' trees towards a path, so that its threat levels are known (paper 3.2.2).

    Parameters
    ----------
    exploration : Exploration
        The search that has the trees; the route replaces its path tree.
    route : Route
        Begins at the exploration's start.
    """
    exploration.reset_tree()
    scene, work, node = exploration.scene(), exploration.work, 0
    room = len(exploration.tree.parent)
    draws = exploration.rng.random((len(route), DRAWS))
    for k in range(1, min(len(route), room)):
        dt = float(air_time(route.rows, k, exploration.limits))
        gained = (route.states[k, 5] - route.states[k - 1, 5]) / dt
        control = np.array([gained, *route.rates[k]])
        node = grow(
            exploration.tree, scene, node, route.states[k], control, dt, draws[k], work.growth, work.stats
        )
        if node < 0:
            break


def cost_between(exploration: Exploration, route: Route, first: int = 1, end: int | None = None) -> float:
    """Return the sum of (9) over the edges that end in rows ``first`` to ``end - 1``, by default over all."""
    last, delta = len(route) if end is None else end, float(exploration.tree.delta[0])
    return float(path_cost(route.rows, first, last, delta, exploration.scene(), exploration.work))


def pursuit_risk(exploration: Exploration, route: Route, slack_s: float | None = None) -> PursuitRisk:
    """Return when, and for how long, DTs that know the path could threaten it.

    Parameters
    ----------
    exploration : Exploration
        The search that found the route, or one in the same world.
    route : Route
        A path.
    slack_s : float, optional
        Time by which a place must be passed before it is under threat [s]; by default the planner's.
    """
    game = exploration.game
    if slack_s is not None:
        game = game._replace(slack=slack_s)
    return PursuitRisk(
        *(float(value) for value in threatened_rows(route.states, route.times, 0, len(route), game))
    )


def path_from_route(exploration: Exploration, route: Route, assessment: Assessment) -> Path:
    """Return the route as a :class:`Path`, the type that other layers use."""
    return Path(
        times_s=route.times,
        positions_enu_m=route.states[:, :3].copy(),
        courses_rad=np.array([course_from_direction(theta) for theta in route.states[:, 3]]),
        climb_angles_rad=route.states[:, 4].copy(),
        speeds_m_s=route.states[:, 5].copy(),
        position_covariances_m2=assessment.covariances,
        collision_free=assessment.clear,
        threat_levels=assessment.levels,
        wind_enu_m_s=exploration.problem.snapshot.wind_enu_m_s,
    )


def reassessed(problem: Problem, path: Path) -> tuple[Path, PursuitRisk]:
    """Assess a path in the problem's world; return the path with that assessment, and its pursuit risk.

    It takes some milliseconds. There is no search, but a search judges its paths by the same kernels.

    Parameters
    ----------
    problem : Problem
        The aircraft's position at the path's first row, its uncertainty, and the world.
    path : Path
        The rest of a path, with the threat levels of the world that it was planned in.
    """
    exploration = Exploration(problem, np.random.default_rng(problem.seed))
    route = route_from_path(exploration, path)
    found = assess_route(exploration, route)
    as_it_is = replace(
        path,
        times_s=route.times,
        wind_enu_m_s=problem.snapshot.wind_enu_m_s,
        position_covariances_m2=found.covariances,
        collision_free=found.clear,
        threat_levels=found.levels,
    )
    return as_it_is, pursuit_risk(exploration, route, slack_s=FLOWN_SLACK_S)


def visits_goals(states: FloatArray, goals: Sequence[GoalRegion]) -> bool:
    """Return whether a path passes all goals but the last, in order, each within its radius.

    Parameters
    ----------
    states : ndarray, shape (N, ≥ 3)
        Positions of its rows in the first three columns [m].
    goals : sequence of GoalRegion
        In the order in which they are to be passed.
    """
    return len(rows_at_goals(states, goals[:-1])) == len(goals) - 1


def finished_route(
    exploration: Exploration,
    route: Route,
    goal: FloatArray,
    is_wanted: Callable[[Route], bool] = lambda _: True,
) -> Route:
    """Lead a route that ends inside the goal region to the goal's centre.

    Dubins edges to the goal are tried from a few rows before the end, with arrival courses at and near the
    bearing. The first that is wanted, flyable and clear, and that pursuers do not threaten for longer,
    replaces the end. If there is none, the route is not changed: it ends inside the region.

    Parameters
    ----------
    exploration : Exploration
        The search that found the route.
    route : Route
        Ends inside the goal region.
    goal : ndarray, shape (3,)
        Centre of the goal region [m].
    is_wanted : callable, optional
        Whether a route that leads to the centre may replace it.
    """
    risk_s = pursuit_risk(exploration, route).total_s
    limits, obstacles = exploration.limits, exploration.problem.snapshot.obstacles
    for back in BACK_STEPS:
        i = len(route) - 1 - back
        if i < 0:
            break
        bearing = math.atan2(goal[1] - route.states[i, 1], goal[0] - route.states[i, 0])
        flat = math.hypot(goal[0] - route.states[i, 0], goal[1] - route.states[i, 1])
        climb = math.atan2(goal[2] - route.states[i, 2], max(flat, 1.0))
        for change in COURSE_CHANGES_RAD:
            rows = empty_rows(i + 1 + SPARE_ROWS)
            for row, known in zip(rows, route.rows, strict=True):
                row[: i + 1] = known[: i + 1]
            pose = np.array([*goal, bearing + change, climb, route.states[i, 5]])
            status, n = join(rows, i + 1, pose, limits)
            if status != JOINED or rows.times[n - 1] > route.times[-1] + 4.0 * limits.tau:
                continue
            if is_flyable(rows, n, i + 1, limits) and is_clear(rows, i + 1, n, obstacles, limits):
                found = Route.of(rows, n)
                if is_wanted(found) and pursuit_risk(exploration, found).total_s <= risk_s:
                    return found
    return route
