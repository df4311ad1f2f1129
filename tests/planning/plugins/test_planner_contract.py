"""What holds for every planner: ours, the comparators, and the one in docs/example-planner."""

import copy
import math

import numpy as np
import pytest

from companion.planning.comparators import METHODS
from companion.planning.problem import GoalRegion
from companion.planning.solver import solve
from companion.types.plan import PlanStatus
from tests.planning.test_solver import checker_for
from tests.support.paths import box
from tests.support.worlds import problem

pytestmark = pytest.mark.compiled
AWAY = (box("away", 900.0, 100.0, 1200.0, 400.0),)
ALL = (*METHODS, "beeline")


@pytest.fixture(autouse=True)
def _example(packages):
    assert set(packages.install_example()) == {"beeline"}


def asked_of(method, **changes):
    strategies = METHODS.get(method, METHODS["safe-rrt"])
    return problem(AWAY, method=method, strategies=strategies, **changes)


@pytest.mark.parametrize("method", ALL)
def test_a_plan_is_a_path_from_the_start_to_the_goal_that_the_check_passes(method):
    asked = asked_of(method)
    plan = solve(asked)
    assert (plan.status, plan.method, plan.seed) == (PlanStatus.EXACT, method, asked.seed)
    path, goal = plan.path, asked.goals[-1]
    assert tuple(path.positions_enu_m[0]) == asked.start.position_enu_m
    assert path.times_s[0] == asked.start.stamp_s
    assert (np.diff(path.times_s) > 0.0).all()
    assert math.dist(path.positions_enu_m[-1], goal.position_enu_m) <= goal.acceptance_radius_m
    assert plan.measures.quality > 0.99
    assert math.isfinite(plan.objective_s)
    reached = {"goal_enu_m": goal.position_enu_m, "acceptance_radius_m": goal.acceptance_radius_m}
    assert checker_for(asked).check_path(path, **reached) == ()


@pytest.mark.parametrize("method", ALL)
def test_equal_problems_give_equal_paths_and_a_problem_stays_as_it_is(method):
    asked = asked_of(method, seed=3)
    before = copy.deepcopy(asked)
    first, again = solve(asked), solve(asked_of(method, seed=3))
    assert first.path.rows() == again.path.rows()
    assert first.cost == again.cost
    assert asked.start.position_enu_m == before.start.position_enu_m
    np.testing.assert_array_equal(asked.start.error_covariance, before.start.error_covariance)
    for now, then in ((asked.snapshot.threats, before.snapshot.threats), (asked.goals, before.goals)):
        assert str(now) == str(then)


@pytest.mark.parametrize("method", ALL)
def test_a_planner_stops_when_it_is_told(method):
    plan = solve(asked_of(method), should_stop=lambda: True)
    assert plan.path is None or len(plan.path) >= 1


@pytest.mark.parametrize("method", ["safe-rrt", "rrt-star", "beeline"])
def test_goals_are_passed_in_their_order(method):
    first, last = GoalRegion((400.0, 1000.0, 150.0), 60.0), GoalRegion((1350.0, 1350.0, 150.0), 60.0)
    asked = asked_of(method)
    plan = solve(type(asked)(asked.start, (first, last), *list(_rest(asked))))
    assert plan.reaches_goal
    away = [np.linalg.norm(plan.path.positions_enu_m - goal.position_enu_m, axis=1) for goal in (first, last)]
    assert away[0].min() <= 60.0
    assert np.argmin(away[0]) < np.argmin(away[1])


def _rest(asked):
    return asked.snapshot, asked.vehicle, asked.settings, asked.seed


@pytest.mark.parametrize("method", ["safe-rrt", "beeline"])
def test_a_plan_beside_a_flown_path_knows_what_that_costs(method):
    asked = asked_of(method)
    flown = solve(asked).path
    plan = solve(asked, flown=flown)
    assert plan.flown_cost == pytest.approx(plan.cost, rel=0.05)
    assert plan.flown_threat == 0.0
    assert plan.flown_pursuit.total_s == 0.0
