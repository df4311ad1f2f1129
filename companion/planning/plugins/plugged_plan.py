"""The plan of a path that another package's planner returns, measured by the kernels that measure ours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from companion.errors import PlannerError
from companion.frames import FloatArray
from companion.kernels.search.path_edit import retime
from companion.planning.explore import Exploration
from companion.planning.least_objective.plan_measures import (
    MIN_ROWS,
    ends_at,
    plan_along,
    shortfall,
    trace_with_pursuers,
    with_flown,
)
from companion.planning.least_objective.prices import objective_between, objective_of
from companion.planning.plugins.installed_planners import InstalledPlanner, installed_planner
from companion.planning.problem import Problem
from companion.planning.route import (
    Route,
    assess_route,
    grow_pursuers_along,
    route_from_path,
    visits_goals,
)
from companion.types.path import Path
from companion.types.plan import Measures, Plan, PlanStatus, SearchTrace

COLUMNS = 6
ROWS_MAX = 20_000  # More rows would take longer to measure than any mission takes to fly.
STEPS_APART_MAX = 1.5
TURN_MAX_RAD = 1.0  # Larger turns between two rows leave open which way the aircraft turns.
APART_MIN_M = 1e-3
START_TOLERANCES = np.array([0.1, 0.1, 0.1, 1e-3, 1e-3, 0.1])  # [m], [rad] and [m/s], by column.


def plan_by_plugin(
    exploration: Exploration, should_stop: Callable[[], bool], timer: Callable[[], float], flown: Path | None
) -> Plan:
    """Return the plan of another package's planner.

    Uncertainty, threat levels, times and costs are computed here, so that a planner is compared by the same
    measures as ours and cannot vouch for its own path.

    Parameters
    ----------
    exploration : Exploration
        The problem, and the world in which the path is measured.
    should_stop : callable
        Returns True once the time is over.
    timer : callable
        Returns seconds, for the measure PST only.
    flown : Path or None
        What is left of the path being flown; only measured, for the comparison with the new path.

    Raises
    ------
    PlannerError
        If the planner fails or does not return a path.
    """
    problem, began = exploration.problem, timer()
    installed = installed_planner(problem.settings.method)
    states = _checked_states(installed, problem, installed.states(problem, should_stop))
    searched_s = timer() - began
    if states is None:
        return Plan(
            PlanStatus.APPROXIMATE, None, Measures(path_search_time_s=searched_s), problem.seed,
            problem.settings.method, problem.snapshot.number, notes=("the planner found no path",),
            threat_trees=problem.snapshot.threat_trees,
        )  # fmt: skip
    route, objective = _route_of(exploration, states), objective_of(exploration)
    reached = ends_at(route, problem.goals[-1]) and visits_goals(states, problem.goals)
    if exploration.is_pursued:
        grow_pursuers_along(exploration, route)
    plan = plan_along(
        exploration, route, assess_route(exploration, route), objective, reached=reached,
        searched_s=searched_s, num_nodes=len(route),
        notes=() if reached else (shortfall(route, problem, len(route)),),
    )  # fmt: skip
    # J is never negative: with 0 as its bound plans are compared by J, and no gap is claimed.
    plan = replace(plan, bound_s=0.0, trace=trace_with_pursuers(exploration, SearchTrace()))
    if flown is None or len(flown) < MIN_ROWS:
        return plan
    flown_route = route_from_path(exploration, flown)
    known = assess_route(exploration, flown_route)
    return with_flown(exploration, plan, flown_route, known, objective_between(objective, flown_route))


def _checked_states(installed: InstalledPlanner, problem: Problem, found: object) -> FloatArray | None:
    """Return a copy of what a planner returned, shape (N, 6); None if it did not get beyond the start.

    Raises
    ------
    PlannerError
        If it is not what the protocol says.
    """
    if found is None:
        return None
    try:
        states = np.array(found, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise PlannerError(installed.origin, type(found).__name__, "an array of numbers, or None") from None
    got, expected = _fault_of(states, problem)
    if expected:
        raise PlannerError(installed.origin, got, expected)
    states[0] = _start_row(problem)
    return states if len(states) > 1 else None


def _fault_of(states: FloatArray, problem: Problem) -> tuple[str, str]:
    """Return what is wrong with ``states``, shape (N, 6), and what is expected; empty for a path."""
    if states.ndim != 2 or states.shape[1] != COLUMNS or not 1 <= len(states) <= ROWS_MAX:
        return f"an array of shape {states.shape}", f"shape (N, {COLUMNS}) with 1 to {ROWS_MAX} rows"
    if not np.isfinite(states).all() or (states[:, 5] <= 0.0).any():
        return "numbers that are not finite, or an airspeed of 0", "finite numbers and airspeeds above 0"
    off = np.abs(states[0] - _start_row(problem))
    off[3] = abs(np.angle(np.exp(1j * off[3])))
    if (off > START_TOLERANCES).any():
        return f"a first row {np.round(states[0], 3).tolist()}", f"the start {_start_row(problem).tolist()}"
    if len(states) == 1:
        return "", ""
    apart_m = np.linalg.norm(np.diff(states[:, :3], axis=0), axis=1)
    step_m = STEPS_APART_MAX * problem.settings.tau_s * np.maximum(states[:-1, 5], states[1:, 5])
    wrong = np.flatnonzero((apart_m < APART_MIN_M) | (apart_m > step_m))
    if len(wrong):
        row = int(wrong[0])
        return f"{apart_m[row]:.3f} m from row {row} to the next", f"{APART_MIN_M} to {step_m[row]:.1f} m"
    turned = np.abs(np.diff(np.unwrap(states[:, 3])))
    if turned.max() > TURN_MAX_RAD:
        row = int(np.argmax(turned))
        return f"a turn of {turned[row]:.2f} rad after row {row}", f"at most {TURN_MAX_RAD} rad"
    return "", ""


def _start_row(problem: Problem) -> FloatArray:
    """Return the problem's start as a row, shape (6,) [m], [rad] and [m/s]."""
    start = problem.start
    return np.array([*start.position_enu_m, start.direction_rad, start.climb_rad, start.airspeed_m_s])


def _route_of(exploration: Exploration, states: FloatArray) -> Route:
    """Return ``states``, shape (N, 6), as a route, with the times of its rows in the present wind.

    An edge is taken as an arc of a circle: its length is the chord's over the sinc of half the turn.
    """
    turned = np.diff(np.unwrap(states[:, 3]), prepend=states[0, 3])
    climbed = np.diff(states[:, 4], prepend=states[0, 4])
    chords_m = np.linalg.norm(np.diff(states[:, :3], axis=0), axis=1)
    arcs_m = chords_m / np.sinc(0.5 * turned[1:] / np.pi)
    steps_s = np.ones(len(states))
    steps_s[1:] = arcs_m / (0.5 * (states[:-1, 5] + states[1:, 5]))
    times = np.full(len(states), exploration.problem.start.stamp_s)
    route = Route(states, times, np.column_stack([turned, climbed]) / steps_s[:, None])
    retime(route.rows, steps_s, exploration.limits)
    return route
