"""RRT* and short cuts: they go on while they gain, and are paid for by nothing but time."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config import load_mission
from companion.config.offline_problem import offline_problem, offline_world
from companion.planning.explore import Exploration
from companion.planning.printed.optimise import is_no_worse, rrt_star_route, smoothed_route
from companion.planning.printed.sub_tasks import SubTasks
from companion.planning.route import Assessment, assess_route
from companion.planning.solver import never, solve
from tests.support.paths import box
from tests.support.worlds import problem

pytestmark = pytest.mark.compiled

WALL = box("wall", 700.0, 300.0, 760.0, 1100.0)


def searched(asked):
    """What is found without any optimising."""
    exploration = Exploration(asked, np.random.default_rng(asked.seed))
    reached, route, end = SubTasks(exploration).through_goals(never)
    assert reached
    return exploration, route, end


def bursts_of(asked):
    """How many times RRT* asked whether to go on."""
    asks = []
    rrt_star_route(*searched(asked), lambda: bool(asks.append(1)))
    return len(asks)


def test_it_ends_without_gain_and_goes_on_with_it():
    """In bursts of 100; the last question is asked before it is seen that the iterations are used up."""
    assert bursts_of(problem(dimension=3, optimise_iterations=0)) == 0
    assert bursts_of(problem(dimension=3, optimise_iterations=60, optimise_iterations_max=60)) == 2
    none, most = problem(dimension=3, optimise_iterations_max=3_000), 1 + 1 + 30
    assert 1 + 2 <= bursts_of(none) < most / 2


@pytest.mark.slow
def test_what_it_goes_on_for_is_a_shorter_way():
    mission = load_mission("mission_configs/paper-3d.yaml")
    least, most = [], []
    for seed in range(1, 9):
        asked = offline_problem(mission, offline_world(mission), "safe-rrt-rs", seed)
        urgent = replace(asked, settings=replace(asked.settings, optimise_iterations_max=80))
        least.append(solve(urgent).measures.path_cost)
        most.append(solve(asked).measures.path_cost)
    assert np.median(most) < 0.98 * np.median(least)


def test_it_ends_when_it_is_told_to():
    asks = []
    rrt_star_route(*searched(problem([WALL], dimension=3)), lambda: bool(asks.append(1)) or len(asks) > 2)
    assert len(asks) == 3


@given(st.integers(0, 1000), st.sampled_from([2, 3]))
@settings(max_examples=10, deadline=None)
def test_no_short_cut_costs_quality(seed, dimension):
    asked = problem([WALL], dimension=dimension, seed=seed, clearance_min_m=4.0)
    exploration = Exploration(asked, np.random.default_rng(seed))
    reached, route, _ = SubTasks(exploration).through_goals(never)
    assert reached
    known = assess_route(exploration, route)
    smooth, later, kept = smoothed_route(exploration, route, known, never)
    assert later.log_risk() <= known.log_risk() + 1e-3 + 1e-9
    assert kept == 0 or smooth.times[-1] < route.times[-1]


def test_a_route_that_costs_quality_is_worse_where_quality_counts():
    exploration, route, _ = searched(problem())
    known = assess_route(exploration, route)
    risk = known.log_risk()
    hazy = Assessment(known.rows._replace(clear=np.full(len(route), 0.99)))
    assert is_no_worse(exploration, known, risk)
    assert not is_no_worse(exploration, hazy, risk)
    careless, _, _ = searched(problem(cost_collision=0.0))
    assert is_no_worse(careless, hazy, risk)
