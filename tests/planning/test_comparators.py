"""The comparators by name on the paper's maps: they find the goal, and are what they are said to be."""

from dataclasses import replace

import numpy as np
import pytest

from companion.config import load_mission
from companion.config.offline_problem import offline_problem, offline_world
from companion.planning.comparators import METHODS, Optimiser, Strategies
from companion.planning.explore import Exploration
from companion.planning.printed.sub_tasks import SubTasks
from companion.planning.route import pursuit_risk, route_from_path
from companion.planning.settings import SUB_TASK_ITERATIONS
from companion.planning.solver import solve
from tests.planning.test_solver import checker_for
from tests.sim.client import CONFIGS
from tests.support.worlds import problem, track

pytestmark = pytest.mark.compiled
OURS = Strategies()
PAPERS = ("taddrrt", "nfz-ddrrt", "rrt-star", "edbm", "probabilistic", "rrt-reach", "rrt")


def asked_of(name, method, seed=1):
    mission = load_mission(CONFIGS / f"{name}.yaml")
    return offline_problem(mission, offline_world(mission), method, seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", ["paper-2d", "paper-3d"])
@pytest.mark.parametrize("method", PAPERS)
def test_every_comparator_solves_the_papers_maps(method, name, seed):
    plan = solve(asked_of(name, method, seed))
    assert plan.reaches_goal, plan.notes
    assert plan.method == method


@pytest.mark.parametrize("method", PAPERS)
def test_no_comparator_is_denied_what_is_not_its_subject(method):
    strategies = METHODS[method]
    assert strategies.follow_field
    assert strategies.connect_straight
    chosen, ours = asked_of("paper-2d", method).settings, asked_of("paper-2d", "safe-rrt").settings
    assert chosen.sub_task_iterations == SUB_TASK_ITERATIONS > ours.sub_task_iterations
    assert chosen.stall_iterations > ours.stall_iterations
    assert chosen.max_iterations >= ours.max_iterations
    assert chosen.optimise_iterations >= ours.optimise_iterations
    kept = ("clearance_min_m", "sensing_horizon_m", "weights_cost", "tree_capacity", "smooth_iterations")
    assert [getattr(chosen, key) for key in kept] == [getattr(ours, key) for key in kept]


def test_a_comparator_differs_from_ours_by_its_subject_only():
    plain = replace(OURS, plays_game=False, may_fly_fast=False, by_objective=False)
    assert METHODS["taddrrt"] == replace(
        plain, use_uncertainty=False, use_goal_zoom=False, use_k_near=False, optimiser=Optimiser.NONE
    )
    assert METHODS["nfz-ddrrt"] == replace(METHODS["taddrrt"], plays_game=True)
    star = METHODS["rrt-star"]
    assert star.optimiser is Optimiser.RRT_STAR
    assert (star.use_dynamic_domain, star.use_uncertainty, star.use_goal_zoom) == (False, False, False)
    assert METHODS["safe-rrt"] == OURS


def no_fly(asked, **changes):
    strategies = replace(METHODS["nfz-ddrrt"], **changes)
    return replace(asked, settings=replace(asked.settings, strategies=strategies))


@pytest.mark.parametrize("dimension", [2, 3])
def test_where_dts_could_be_in_time_is_no_fly_in_space_too(dimension):
    slow = track(800.0, 700.0, speed=2.0, radius=250.0)
    asked = problem(tracks=[slow], dimension=dimension, seed=2)
    plan = solve(no_fly(asked))
    assert plan.reaches_goal
    assert plan.pursuit.total_s == 0.0
    assert checker_for(asked).check_path(plan.path) == ()
    through = solve(no_fly(asked, plays_game=False))
    assert through.reaches_goal
    judge = Exploration(no_fly(asked), np.random.default_rng(1))
    risk = pursuit_risk(judge, route_from_path(judge, through.path))
    assert risk.total_s > 0.0  # of the same search, to which the DT is only dear


def test_where_a_pursuer_bars_all_ways_it_bars_none_and_that_is_said():
    asked = no_fly(problem(tracks=[track(1000.0, 900.0, speed=24.0, radius=220.0)], seed=1))
    plan = solve(asked)
    assert plan.reaches_goal
    assert "no path that pursuers could not bar was found" in plan.notes
    ours = solve(problem(tracks=[track(1000.0, 900.0, speed=24.0, radius=220.0)], seed=1))
    assert ours.pursuit.total_s <= plan.pursuit.total_s


def test_each_try_has_a_budget_of_its_own():
    asked = no_fly(problem(tracks=[track(1000.0, 900.0, speed=24.0, radius=220.0)], max_iterations=500))
    exploration = Exploration(asked, np.random.default_rng(1))
    assert exploration.bars_pursued
    exploration.stats[3] = 500
    search = SubTasks(exploration)
    assert search.is_spent(lambda: False)
    search.allow_threatened_nodes()
    assert not search.is_spent(lambda: False)
    assert not exploration.bars_pursued
