"""Algorithm 2: sub tasks, safety adjustment, optimisation, and the measures of the result."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from companion.kernels.geometry.prism_distance import clearance
from companion.planning.comparators import Optimiser
from companion.planning.explore import Exploration
from companion.planning.least_objective.least_plan import plan_by_objective
from companion.planning.least_objective.plan_measures import MIN_ROWS, ends_at, measures_of, shortfall
from companion.planning.least_objective.prices import objective_between, objective_of, seconds_seen
from companion.planning.optimise import is_no_worse, rrt_star_route, smoothed_route
from companion.planning.problem import Problem, StartState
from companion.planning.room import least_room, price_of_room, widened_route
from companion.planning.route import (
    FLOWN_SLACK_S,
    Assessment,
    Route,
    assess_route,
    cost_between,
    finished_route,
    least_cost,
    path_from_route,
    pursuit_risk,
    route_along,
    route_from_path,
    route_from_tree,
    weighed_between,
)
from companion.planning.safety_adjustment import adjusted_route
from companion.types.path import Path
from companion.types.plan import Measures, Plan, PlanStatus, SearchTrace
from companion.vehicle.way_out import way_out
from companion.world.pursuer_trees import grown_trees

LITTLE_ROOM = 0.75  # of what is wanted: with less another way is looked for

Found = tuple[bool, Route, int]  # whether all goals were passed, the route, and the node at its end


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
        ``INVALID_START`` without one, where there is no way out either.
    """
    exploration = Exploration(problem, np.random.default_rng(problem.seed))
    plan = None if exploration.start_is_clear else _by_way_out(exploration, should_stop, timer)
    if plan is None and exploration.goes_by_objective:
        plan = plan_by_objective(exploration, should_stop, timer, flown)
    return _by_sub_tasks(exploration, should_stop, timer, flown) if plan is None else plan


def _by_sub_tasks(
    exploration: Exploration, should_stop: Callable[[], bool], timer: Callable[[], float], flown: Path | None
) -> Plan:
    """The plan that sub tasks and races come to; its costs are those of (9)."""
    problem, method = exploration.problem, exploration.problem.settings.method
    began = timer()
    reached, route, end = _found(exploration, should_stop)
    searched, num_nodes = timer() - began, exploration.num_nodes + int(exploration.tree.count[0])
    trace = trace_of(exploration)
    notes = exploration.given_up
    assessment: Assessment | None = None
    if reached:
        route, assessment = _finished(exploration, route, end, should_stop, notes)
    flown_cost, flown_threat, flown_risk = None, None, None
    if flown is not None and len(flown) >= MIN_ROWS:
        flown_route = route_from_path(exploration, flown)
        flown_cost = cost_between(exploration, flown_route)
        known = assess_route(exploration, flown_route)
        flown_threat = float(known.levels.max())
        flown_risk = pursuit_risk(exploration, flown_route, slack_s=FLOWN_SLACK_S)
        improved, known, kept = smoothed_route(exploration, flown_route, known, should_stop)
        is_whole = ends_at(improved, problem.goals[-1])
        if is_whole and (
            assessment is None or worth(exploration, improved, known) < worth(exploration, route, assessment)
        ):
            route, reached, assessment = improved, True, known
            notes = [f"the flown path, {kept} short cuts"]
    if not reached:
        notes.append(shortfall(route, problem, num_nodes))
    exploration, route, assessment = _settled(exploration, route, assessment, should_stop, notes)
    objective = objective_of(exploration)
    return Plan(
        status=PlanStatus.EXACT if reached else PlanStatus.APPROXIMATE,
        path=path_from_route(exploration, route, assessment),
        measures=measures_of(exploration, route, assessment, searched, num_nodes),
        seed=problem.seed,
        method=method,
        snapshot_number=problem.snapshot.number,
        trace=trace,
        notes=tuple(notes),
        flown_cost=flown_cost,
        flown_threat=flown_threat,
        pursuit=pursuit_risk(exploration, route, slack_s=FLOWN_SLACK_S),
        flown_pursuit=flown_risk,
        threat_trees=grown_trees(exploration.pursuers, problem.snapshot.tracks),
        objective_s=objective_between(objective, route),
        seen_s=seconds_seen(objective, route),
    )


def _invalid_start(problem: Problem) -> Plan:
    """The answer where neither a plan nor a way out begins."""
    return Plan(
        PlanStatus.INVALID_START, None, Measures(), problem.seed, problem.settings.method,
        problem.snapshot.number, notes=("the start breaks a constraint or stands in an obstacle",),
        threat_trees=problem.snapshot.threat_trees,
    )  # fmt: skip


def _by_way_out(
    exploration: Exploration, should_stop: Callable[[], bool], timer: Callable[[], float]
) -> Plan | None:
    """The shortest way to where a plan may begin, and the plan from there.

    Where there is none it is told that the start is invalid, or None where it is only near to something.
    """
    problem, limits = exploration.problem, exploration.limits
    is_walled_in = clearance(*problem.start.position_enu_m, problem.snapshot.walls, 1.0) <= 0.0
    state, obstacles = exploration.tree.state[0].copy(), problem.snapshot.obstacle_list
    states = None if is_walled_in else way_out(state, obstacles, limits)
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


def _finished(
    exploration: Exploration, route: Route, end: int, should_stop: Callable[[], bool], notes: list[str]
) -> tuple[Route, Assessment]:
    """A route that reached the goal, joined to it, optimised and adjusted; and what is known along it."""
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
        risk = known.log_risk(), pursuit_risk(exploration, found).total_s
        if is_no_worse(exploration, *other, risk):
            chosen = min(chosen, other, key=lambda pair: worth(exploration, *pair))
    smooth, known, kept = smoothed_route(exploration, *chosen, should_stop)
    notes.append(f"{kept} short cuts")
    return min((smooth, known), chosen, key=lambda pair: worth(exploration, *pair)) if kept else chosen


def _settled(
    exploration: Exploration, route: Route, known: Assessment | None, should_stop: Callable[[], bool],
    notes: list[str],
) -> tuple[Exploration, Route, Assessment]:  # fmt: skip
    """A route that reaches the goal, and so is ``known``, given room where it lacks it, or another one.

    With it the search that it is of. One that does not reach the goal stays, and is assessed.
    """
    if known is None:
        return exploration, route, assess_route(exploration, route)
    route, known, moved = widened_route(exploration, route, known)
    if moved:
        notes.append(f"{moved} moves for room")
    other = _elsewhere(exploration, route, known, should_stop)
    if other is None:
        return exploration, route, known
    notes.append("another way, with more room")
    return other


def _elsewhere(
    exploration: Exploration, route: Route, known: Assessment, should_stop: Callable[[], bool]
) -> tuple[Exploration, Route, Assessment] | None:
    """A better way that keeps the room that is wanted throughout, where a tree's lacks much of it.

    A tree takes what it comes to first, and no move leads round the other side of something. There has to be
    so much room about the start and the goals.
    """
    problem, settings = exploration.problem, exploration.problem.settings
    wanted, obstacles = settings.room_wanted_m, problem.snapshot.obstacles
    if exploration.chase.is_raced or should_stop() or least_room(exploration, route) >= LITTLE_ROOM * wanted:
        return None
    places = (problem.start.position_enu_m, *(goal.position_enu_m for goal in problem.goals))
    margin = min(clearance(*place, obstacles, wanted) for place in places) - 1.0
    if margin < LITTLE_ROOM * wanted:
        return None
    asked = replace(settings, clearance_min_m=margin, max_iterations=settings.roomy_iterations)
    another = Exploration(replace(problem, settings=asked), np.random.default_rng(problem.seed))
    reached, way, end = _found(another, should_stop)
    if not reached:
        return None
    way, found = _finished(another, way, end, should_stop, [])
    another.stats[:] += exploration.stats  # all the checks that the plan took
    return (another, way, found) if worth(another, way, found) < worth(exploration, route, known) else None


def worth(exploration: Exploration, route: Route, known: Assessment) -> tuple[bool, float]:
    """What a route is chosen by, the least first: whether it breaks ``quality_min``, then its cost.

    The cost is (9) with what -log Q of (8), seconds that a DT could threaten, and room that is lacking cost.
    """
    settings, risk = exploration.problem.settings, known.log_risk()
    cost = weighed_between(exploration, route) + settings.weight_collision * risk
    cost += price_of_room(exploration, route)
    return math.exp(-risk) < settings.quality_min, cost


def _found(exploration: Exploration, should_stop: Callable[[], bool]) -> Found:
    """What is found with no more given up before the DTs than has to be.

    Who starts under threat has nothing to keep away from: no race but one that weighs finds the way out.
    """
    chase = exploration.chase
    while chase.is_raced and chase.is_avoided and exploration.tree.caught[0]:
        exploration.give_in(should_stop)
    found = _tried(exploration, should_stop)
    while not found[0] and chase.may_give_in:
        if not exploration.hurry(should_stop):
            exploration.give_in(should_stop)
        found = _tried(exploration, should_stop)
    return found


def _tried(exploration: Exploration, should_stop: Callable[[], bool]) -> Found:
    """What is found with as much asked of the path before the DTs as now is."""
    chase = exploration.chase
    if chase.is_raced and not chase.is_avoided:
        return _weighed(exploration, should_stop)
    is_last = bool(chase.note) and not chase.is_avoided
    return _through_goals(exploration, _patient(exploration, should_stop) if is_last else should_stop)


def _weighed(exploration: Exploration, should_stop: Callable[[], bool]) -> Found:
    """The cheapest way by (9), seconds under threat weighed, at any airspeed; one that fails where none is.

    An airspeed at which no way can be as cheap as one that was found is not tried; in a hurry neither is
    another where that of the cheapest ways comes above the limit of the threat level.
    """
    bounds = {airspeed: least_cost(exploration, airspeed) for airspeed in exploration.airspeeds_m_s}
    cheapest, best = math.inf, None
    for airspeed in sorted(bounds, key=bounds.__getitem__):
        if math.isfinite(cheapest) and (bounds[airspeed] >= cheapest or should_stop()):
            break
        exploration.start_afresh(airspeed)
        found = _through_goals(exploration, should_stop)
        cost = weighed_between(exploration, found[1]) if found[0] else math.inf
        if best is None or cost < cheapest:
            cheapest, best = cost, (found, exploration.kept())
        if exploration.is_above_limit:
            break
    assert best is not None  # cruise is always there to be tried
    best[1]()
    return best[0]


def _patient(exploration: Exploration, should_stop: Callable[[], bool]) -> Callable[[], bool]:
    """The stopping rule, but not before a search that races left no time for has had its chance.

    In a hurry it has no more than that where a race's way came above the limit of the threat level.
    """
    enough, is_hopeless = (
        exploration.iterations + exploration.problem.settings.least_iterations, exploration.is_above_limit,
    )  # fmt: skip
    return lambda: exploration.iterations >= enough and (is_hopeless or should_stop())


def _through_goals(exploration: Exploration, should_stop: Callable[[], bool]) -> Found:
    """Whether all goals were passed in order; the route there or the one that passed the most; its end.

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
            return True, route_from_tree(exploration, node), node
        if passed > most:
            most, best = passed, route_from_tree(exploration, node)
        if not exploration.is_spent(should_stop):
            exploration.reset_tree()
    return False, best, -1


def trace_of(exploration: Exploration) -> SearchTrace:
    """The trees, reach circles and sub goals as the search left them, for pictures."""
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
