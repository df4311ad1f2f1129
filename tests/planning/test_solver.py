"""Whole plans on small maps: every path is checked by the independent checker; equal seeds, equal plans."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from companion.assurance.checker import Checker
from companion.planning.comparators import METHODS, Estimator, Optimiser, Strategies
from companion.planning.least_objective.plan_measures import exposures
from companion.planning.problem import GoalRegion
from companion.planning.solver import solve
from companion.types.plan import PlanStatus
from companion.types.threat import Radar
from tests.support.paths import box, check_limits, prism_distance
from tests.support.worlds import BOUNDS, problem, track


def checker_for(asked):
    limits = check_limits(bounds=asked.snapshot.bounds, margin_m=asked.settings.clearance_min_m)
    return Checker(asked.snapshot.obstacle_list, limits)


def random_obstacles(rng, count, ceiling):
    """Boxes that leave start and goal alone."""
    obstacles = []
    while len(obstacles) < count:
        west, south = rng.uniform(0.0, 1350.0, 2)
        width, height = rng.uniform(20.0, 250.0, 2)
        candidate = box(
            f"b{len(obstacles)}", west, south, west + width, south + height, 0.0, rng.uniform(60.0, ceiling)
        )
        ends = ((100.0, 100.0, 0.0), (1350.0, 1350.0, 0.0))
        if min(prism_distance(end, candidate) for end in ends) > 150.0:
            obstacles.append(candidate)
    return obstacles


def random_problem(seed, dimension):
    rng = np.random.default_rng(1000 + seed)
    obstacles = random_obstacles(rng, int(rng.integers(2, 9)), 300.0 if dimension == 2 else 200.0)
    radars = [Radar("r", (*rng.uniform(300.0, 1200.0, 2), 0.0), 400.0, 0.0 if dimension == 2 else 0.001)]
    tracks = [track(*rng.uniform(200.0, 1300.0, 2), radius=150.0)] if seed % 2 else []
    return problem(obstacles, radars, tracks, dimension=dimension, seed=seed)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", range(15))
def test_every_path_returned_passes_the_independent_checker(seed, dimension):
    asked = random_problem(seed, dimension)
    plan = solve(asked)
    goal = asked.goals[0]
    assert plan.path is not None
    assert plan.status in (PlanStatus.EXACT, PlanStatus.APPROXIMATE)
    reached = {"goal_enu_m": goal.position_enu_m, "acceptance_radius_m": goal.acceptance_radius_m}
    found = checker_for(asked).check_path(plan.path, **(reached if plan.reaches_goal else {}))
    assert [str(violation) for violation in found] == []


def test_most_random_maps_are_solved():
    plans = [solve(random_problem(seed, 2)) for seed in range(6)]
    assert sum(plan.reaches_goal for plan in plans) >= 4


WALL = (box("wall", 0.0, 700.0, 1100.0, 740.0),)
RADARS = (Radar("r", (900.0, 500.0, 0.0), 350.0),)


def arrays(plan):
    path = plan.path
    return [getattr(path, name) for name in type(path).__slots__]


def test_equal_seeds_give_equal_plans_to_the_last_bit():
    first, second = (solve(problem(WALL, RADARS, [track(700.0, 300.0)], seed=5)) for _ in range(2))
    for a, b in zip(arrays(first), arrays(second), strict=True):
        assert np.array_equal(a, b)
    assert first.notes == second.notes
    assert replace(first.measures, path_search_time_s=0.0) == replace(second.measures, path_search_time_s=0.0)
    other = solve(problem(WALL, RADARS, [track(700.0, 300.0)], seed=6))
    assert len(other.path) != len(first.path) or not np.array_equal(
        other.path.positions_enu_m, first.path.positions_enu_m
    )


def test_time_is_not_what_decides():
    slow, fast = iter(range(10**6)), iter(np.arange(10**6) * 1e-6)
    asked = problem(WALL, RADARS, seed=5)
    first, second = (
        solve(asked, timer=lambda: float(next(slow))),
        solve(asked, timer=lambda: float(next(fast))),
    )
    assert np.array_equal(first.path.positions_enu_m, second.path.positions_enu_m)
    ratio = first.measures.path_search_time_s / second.measures.path_search_time_s
    assert ratio == pytest.approx(1e6)


@pytest.mark.parametrize(
    "strategies",
    [
        Strategies(use_dynamic_domain=False),
        Strategies(use_uncertainty=False, use_goal_zoom=False, use_k_near=False, optimiser=Optimiser.NONE),
        Strategies(dts_are_no_fly=True),
        Strategies(estimator=Estimator.RRT_REACH),
        Strategies(estimator=Estimator.RRT, use_safety_adjustment=False),
    ],
)
def test_every_composition_keeps_the_constraints(strategies):
    asked = problem(WALL, RADARS, [track(700.0, 300.0, radius=120.0)], seed=3, strategies=strategies)
    plan = solve(asked)
    assert plan.path is not None
    assert checker_for(asked).check_path(plan.path) == ()


def test_a_start_in_an_obstacle_is_said_so_and_out_of_bounds_it_is_come_back_from():
    inside = solve(problem((box("b", 50.0, 50.0, 150.0, 150.0),)))
    assert (inside.status, inside.path) == (PlanStatus.INVALID_START, None)
    outside = solve(problem(start=(-10.0, 100.0, 150.0)))
    assert outside.status is PlanStatus.EXACT
    assert outside.notes[0].startswith("the way out")
    far = solve(problem(start=(-9_000.0, 100.0, 150.0)))
    assert (far.status, far.path) == (PlanStatus.INVALID_START, None)


def test_a_solver_told_to_stop_stops_and_says_that_the_goal_is_not_reached():
    calls = []

    def stop():
        calls.append(1)
        return len(calls) > 3

    plan = solve(problem(WALL, RADARS, strategies=Strategies(by_objective=False)), should_stop=stop)
    assert plan.status is PlanStatus.APPROXIMATE
    assert plan.measures.num_collision_checks < 1000


def test_an_open_map_is_flown_nearly_straight():
    plan = solve(problem())
    assert plan.reaches_goal
    # Straight on it is 1767.8 m less the acceptance radius of 60 m; a tenth more is granted.
    straight = 1250.0 * math.sqrt(2.0) - 60.0
    assert straight - 1e-6 <= plan.path.length_m <= 1.1 * straight
    assert plan.path.threat_levels.max() == 0.0
    assert plan.measures.quality == pytest.approx(1.0)


def test_goals_are_visited_in_their_order():
    asked = problem(goal=(1350.0, 300.0, 150.0))
    asked = replace(asked, goals=(*asked.goals, GoalRegion((300.0, 1300.0, 150.0), 60.0)))
    plan = solve(asked)
    assert plan.reaches_goal
    first = np.linalg.norm(plan.path.positions_enu_m - np.array((1350.0, 300.0, 150.0)), axis=1)
    assert first.min() <= 60.0
    assert np.linalg.norm(plan.path.positions_enu_m[-1] - np.array((300.0, 1300.0, 150.0))) <= 60.0 + 1e-6
    assert checker_for(asked).check_path(plan.path) == ()


def test_rewiring_and_adjustment_leave_no_goal_out():
    # The short way from the start to the last goal leaves the other two far aside.
    for seed in range(3):
        asked = problem(goal=(1150.0, 300.0, 150.0), radars=RADARS, seed=seed)
        more = [GoalRegion((east, north, 150.0), 60.0) for east, north in ((1150.0, 1100.0), (300.0, 1200.0))]
        goals = (*asked.goals, *more)
        plan = solve(replace(asked, goals=goals))
        assert plan.reaches_goal
        rows = [
            int(np.argmin(np.linalg.norm(plan.path.positions_enu_m - goal.position_enu_m, axis=1)))
            for goal in goals
        ]
        passed = plan.path.positions_enu_m[rows]
        away = [math.dist(point, goal.position_enu_m) for point, goal in zip(passed, goals, strict=True)]
        assert max(away) <= 60.0 + 1e-6
        assert rows == sorted(rows)


def test_a_route_that_misses_goals_passes_as_many_as_it_can():
    # The second goal lies in a closed yard: the first is still on the way.
    yard = [
        box("s", 900.0, 900.0, 1400.0, 910.0), box("n", 900.0, 1390.0, 1400.0, 1400.0),
        box("w", 900.0, 900.0, 910.0, 1400.0), box("e", 1390.0, 900.0, 1400.0, 1400.0),
    ]  # fmt: skip
    asked = problem(yard, goal=(700.0, 300.0, 150.0), max_iterations=4000)
    plan = solve(replace(asked, goals=(*asked.goals, GoalRegion((1150.0, 1150.0, 150.0), 60.0))))
    assert plan.status is PlanStatus.APPROXIMATE
    away = np.linalg.norm(plan.path.positions_enu_m - np.array((700.0, 300.0, 150.0)), axis=1)
    assert away.min() <= 60.0
    assert checker_for(asked).check_path(plan.path) == ()
    told = re.fullmatch(r"ends (\d+) m from the last goal after (\d+) nodes", plan.notes[-1])
    missing = np.linalg.norm(plan.path.positions_enu_m[-1] - (1150.0, 1150.0, 150.0))
    assert float(told[1]) == pytest.approx(missing, abs=0.5)
    assert int(told[2]) == plan.measures.num_tree_nodes


def test_a_plane_plan_keeps_its_height_and_a_space_plan_may_not():
    flat = solve(random_problem(2, 2))
    assert np.ptp(flat.path.positions_enu_m[:, 2]) == 0.0
    climb = solve(problem(dimension=3, goal=(1350.0, 1350.0, 230.0)))
    assert climb.reaches_goal
    assert np.ptp(climb.path.positions_enu_m[:, 2]) > 10.0


def test_the_path_being_flown_is_costed_in_the_same_world():
    asked = problem(WALL, RADARS, seed=5)
    plan = solve(asked)
    again = solve(asked, flown=plan.path)
    assert again.flown_cost == pytest.approx(plan.cost, rel=0.02)
    assert again.flown_threat == pytest.approx(plan.path.threat_levels.max(), abs=0.02)
    assert plan.flown_cost is None


def test_shortening_never_makes_a_path_cost_more():
    for seed in range(4):
        plain, shortened = (
            solve(problem(WALL, RADARS, seed=seed, strategies=chosen)).objective_s
            for chosen in (Strategies(optimiser=Optimiser.NONE), Strategies())
        )
        assert shortened <= plain + 1e-6


def test_rewiring_and_adjustment_never_make_a_path_dearer():
    """By (9), in the methods that go by it."""
    printed = METHODS["safe-rrt-rs"]
    plain = replace(printed, optimiser=Optimiser.NONE, use_safety_adjustment=False)
    rewired = replace(printed, use_safety_adjustment=False)
    for seed in range(4):
        costs = [
            solve(problem(WALL, RADARS, seed=seed, strategies=chosen)).measures.path_cost
            for chosen in (plain, rewired, printed)
        ]
        assert costs[1] <= costs[0] + 1e-6
        assert costs[2] <= costs[1] + 1e-6


def test_the_trace_hangs_together():
    trace = solve(problem(WALL, RADARS, [track(700.0, 300.0), track(200.0, 900.0)], seed=5)).trace
    assert len(trace.tree_enu_m) == len(trace.tree_parents)
    assert (trace.tree_parents[1:] < np.arange(1, len(trace.tree_parents))).all()
    roots = np.flatnonzero(trace.threat_tree_parents == -1)
    assert len(roots) == 2
    assert (trace.threat_tree_parents < np.arange(len(trace.threat_tree_parents))).all()
    assert len(trace.sub_goals_enu_m) == len(trace.horizon_centres_enu_m)
    assert BOUNDS[0] <= trace.tree_enu_m[:, 0].min()


def test_exposures_are_stretches_under_threat_by_hand():
    levels = np.array([0.2, 0.0, 0.1, 0.4, 0.3, 0.0, 0.0, 0.5])
    assert exposures(levels).tolist() == [0.2, 0.4, 0.5]
    assert exposures(np.zeros(3)).tolist() == exposures(np.zeros(0)).tolist() == []
    assert exposures(np.full(4, 0.7)).tolist() == [0.7]
