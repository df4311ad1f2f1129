"""What p_c does to a plan: it costs, it is kept, and nothing where it is 1."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.config import load_mission
from companion.config.offline_problem import offline_problem, offline_world
from companion.kernels.search.growth import collision_cost
from companion.planning.explore import Exploration
from companion.planning.printed.printed_plan import worth
from companion.planning.route import assess_route, cost_between, route_from_path
from companion.planning.solver import solve
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
    path = solve(problem_of(hazy, price_collision=0.0)).path
    found = exploration_of(replace(problem, settings=replace(problem.settings, cost_collision=10.0)))
    route = route_from_path(found, path)
    known = assess_route(found, route)
    clear = known.clear
    fails, cost = worth(found, route, known)
    assert not fails
    assert cost == pytest.approx(cost_between(found, route) - 10.0 * np.log(clear).sum())
    strict = exploration_of(problem_of(hazy, cost_collision=10.0, quality_min=0.5))
    assert float(np.prod(clear)) < 0.5
    assert worth(strict, route, known)[0]


def test_what_risk_costs_buys_quality(hazy):
    """On the median of three seeds: of an aircraft that strays 10 m, among the pursuer and the walls."""
    qualities = []
    for price in (0.0, 20.0, 100.0):
        plans = [solve(problem_of(hazy, seed, price_collision=price)) for seed in (1, 2, 3)]
        qualities.append(np.median([plan.measures.quality for plan in plans]))
    assert qualities == sorted(qualities)
    assert qualities[0] < 0.3
    assert qualities[1] > 0.7
    assert qualities[2] > 0.9


def test_where_nothing_is_near_it_changes_nothing():
    mission = load_mission(CONFIGS / "paper-2d.yaml")
    told = mission, offline_world(mission)
    one, other = (solve(problem_of(told, price_collision=price)) for price in (0.0, 20.0))
    assert one.measures.quality > 0.99
    assert other.objective_s == pytest.approx(one.objective_s, rel=0.02)
