"""What p_c does to a plan: it costs, it is kept, and nothing where it is 1."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.campaign.runs import offline_problem, offline_world
from companion.config import load_mission
from companion.kernels.search.growth import collision_cost
from companion.planning.explore import Exploration
from companion.planning.route import assess_route, route_from_path, weighed_between
from companion.planning.solver import solve, worth
from tests.proofs.test_uncertainty_pays import noisy
from tests.sim.client import CONFIGS


def problem_of(told, seed=1, **changes):
    problem = offline_problem(*told, None, seed)
    return replace(problem, settings=replace(problem.settings, **changes))


@pytest.fixture(scope="module")
def hazy():
    """A mission and its world, whose radars' shadows take a second."""
    mission = noisy(load_mission(CONFIGS / "paper-2d.yaml"))
    return mission, offline_world(mission)


def exploration_of(problem):
    return Exploration(problem, np.random.default_rng(problem.seed))


def test_the_cost_of_a_node_by_hand(hazy):
    search = exploration_of(problem_of(hazy, cost_collision=10.0)).scene().search
    assert collision_cost(search, 1.0) == 0.0
    assert collision_cost(search, 0.9) == pytest.approx(1.0536051565782627)
    assert collision_cost(search, 0.0) == pytest.approx(10.0 * 12.0 * math.log(10.0))
    assert collision_cost(search._replace(cost_collision=0.0), 0.5) == 0.0


def test_a_route_is_worth_its_cost_and_its_risk_and_first_of_all_that_it_keeps_the_limit(hazy):
    problem = problem_of(hazy, cost_collision=0.0, optimise_iterations=20)
    path = solve(problem).path
    found = exploration_of(replace(problem, settings=replace(problem.settings, cost_collision=10.0)))
    route = route_from_path(found, path)
    known = assess_route(found, route)
    clear = known.clear
    fails, cost = worth(found, route, known)
    assert not fails
    assert cost == pytest.approx(weighed_between(found, route) - 10.0 * np.log(clear).sum())
    strict = exploration_of(problem_of(hazy, cost_collision=10.0, quality_min=0.5))
    assert float(np.prod(clear)) < 0.5
    assert worth(strict, route, known)[0]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_risk_costs_buys_quality(hazy, seed):
    without, with_it = (solve(problem_of(hazy, seed, cost_collision=cost)) for cost in (0.0, 10.0))
    assert with_it.measures.quality > 0.9
    assert without.measures.quality < 0.5
    assert math.log(with_it.measures.quality) > 0.05 * math.log(without.measures.quality)  # the risk of (8)
    assert with_it.measures.path_cost < 1.1 * without.measures.path_cost


def test_where_nothing_is_near_it_changes_nothing():
    mission = load_mission(CONFIGS / "paper-2d.yaml")
    told = mission, offline_world(mission)
    one, other = (solve(problem_of(told, cost_collision=cost)) for cost in (0.0, 10.0))
    assert np.array_equal(one.path.positions_enu_m, other.path.positions_enu_m)
