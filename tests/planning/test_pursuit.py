"""Plans against a DT that knows the path (paper 2.3), beside plans without that game."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.campaign.runs import offline_problem, offline_world
from companion.config import load_mission, mission_from_text
from companion.planning.comparators import Strategies
from companion.planning.problem import GoalRegion
from companion.planning.solver import solve
from companion.types.plan import PlanStatus, PursuitRisk
from companion.types.threat import Obstacle
from tests.games.generator import random_game
from tests.games.oracle import first_caught_s, game_of
from tests.support.exact_pursuit import Pursued
from tests.support.worlds import problem, track

pytestmark = pytest.mark.compiled

WALL = Obstacle(
    "wall", np.array([(700.0, 300.0), (760.0, 300.0), (760.0, 1100.0), (700.0, 1100.0)]), 0.0, 300.0
)


def without_game(asked):
    """The same problem for a planner that goes by threat levels alone."""
    chosen = replace(asked.settings.strategies, plays_game=False)
    return replace(asked, settings=replace(asked.settings, strategies=chosen))


def rows_of(plan):
    return np.column_stack([plan.path.times_s, plan.path.positions_enu_m[:, :2]])


@pytest.mark.parametrize("seed", [9, 13, 16, 22])
def test_a_game_that_can_be_won_is_won_and_lost_by_a_planner_that_does_not_play(seed):
    mission = mission_from_text(random_game(seed, "route"), "game.yaml")
    game = game_of(mission)
    asked = offline_problem(mission, offline_world(mission), None, 1)
    plan, plain = solve(asked), solve(without_game(asked))
    assert plan.reaches_goal
    assert plan.pursuit == PursuitRisk(math.inf, 0.0)
    assert first_caught_s(rows_of(plan), game) == math.inf  # says who has not computed it
    assert first_caught_s(rows_of(plain), game) < math.inf


def test_the_numbers_of_a_path_under_threat():
    """A DT that stands on the way: the path that minds it not is in its reach meanwhile."""
    standing = track(725.0, 725.0, speed=0.0, radius=200.0)
    plan = solve(problem(tracks=[standing]))
    assert plan.pursuit.total_s == 0.0
    away = np.hypot(*(plan.path.positions_enu_m[:, :2] - 725.0).T)
    assert away.min() > 200.0
    flown = solve(problem()).path
    seen = solve(problem(tracks=[standing]), flown=flown)
    within = np.hypot(*(flown.positions_enu_m[:, :2] - 725.0).T) <= 202.0
    assert seen.flown_pursuit.total_s == pytest.approx(within.sum(), abs=2.0)
    assert seen.flown_pursuit.first_s == pytest.approx(flown.times_s[within][0], abs=1.0)
    assert seen.pursuit.total_s == 0.0


def test_out_of_a_threat_the_shortest_way_is_taken():
    """The start lies in the reach of a DT that stands: out of it, and then not into it again."""
    plan = solve(problem(tracks=[track(250.0, 100.0, speed=0.0, radius=220.0)]))
    away = np.hypot(*(plan.path.positions_enu_m[:, :2] - (250.0, 100.0)).T)
    inside = away <= 220.0
    assert plan.reaches_goal
    assert inside[0]
    assert not inside[np.argmin(inside) :].any()
    assert inside.sum() < 15


def test_where_nothing_is_safe_there_is_a_plan_all_the_same():
    plan = solve(problem(tracks=[track(1300.0, 1300.0, speed=20.0, radius=200.0)]))
    assert plan.status is PlanStatus.EXACT
    assert plan.pursuit.total_s > 0.0
    assert any("pursuers could not bar" in note for note in plan.notes)


def test_goals_on_the_way_are_passed_in_their_order():
    asked = problem([WALL], tracks=[track(1200.0, 100.0, speed=3.0, radius=150.0)])
    first = GoalRegion((300.0, 1200.0, 150.0), 60.0)
    plan = solve(replace(asked, goals=(first, *asked.goals)))
    assert plan.reaches_goal
    assert plan.pursuit.total_s == 0.0
    away = np.hypot(*(plan.path.positions_enu_m[:, :2] - first.position_enu_m[:2]).T)
    assert away.min() <= 60.0


def test_in_space_a_pursuer_is_avoided_too():
    asked = problem(tracks=[track(725.0, 725.0, speed=2.0, radius=250.0)], dimension=3)
    plan, plain = solve(asked), solve(asked, flown=solve(without_game(asked)).path)
    assert plan.reaches_goal
    assert plan.pursuit.total_s == 0.0
    assert plain.flown_pursuit.total_s > 0.0


def test_on_the_papers_map_in_space_no_path_is_within_reach():
    """A path above 500 m is out of the pursuer's reach; the planner that does not play is within it."""
    mission = load_mission("mission_configs/paper-3d.yaml")
    asked = offline_problem(mission, offline_world(mission), None, 1)
    plan = solve(asked, flown=solve(without_game(asked)).path)
    assert plan.pursuit.total_s == 0.0
    assert plan.flown_pursuit.total_s > 30.0


@given(st.integers(0, 1000))
@settings(max_examples=12, deadline=None)
def test_shortening_never_leads_into_a_threat(seed):
    rng = np.random.default_rng(seed)
    place = rng.uniform(500.0, 1000.0, 2)
    asked = problem([WALL], tracks=[track(*place, speed=rng.uniform(0.0, 8.0), radius=150.0)], seed=seed)
    plain = solve(replace(asked, settings=replace(asked.settings, smooth_iterations=0)))
    plan = solve(asked)
    assert plan.objective_s <= plain.objective_s + 1e-6
    assert plan.pursuit.total_s <= plain.pursuit.total_s + 1e-6


@pytest.mark.parametrize(
    ("east", "north", "speed", "radius"),
    [
        (1300.0, 1300.0, 20.0, 200.0),  # it can wait at the goal: no way is safe
        (725.0, 725.0, 0.0, 200.0),  # it stands on the straight way
        (900.0, 500.0, 8.0, 250.0),
        (1300.0, 700.0, 15.0, 150.0),
    ],
)
def test_before_a_pursuer_j_is_nearly_the_least_of_an_exact_search(east, north, speed, radius):
    """In open country, at cruise; the exact search knows no turns, and danger of 5/6 bars no way there."""
    pursuer = track(east, north, speed=speed, radius=radius)
    asked = problem(tracks=[pursuer], strategies=replace(Strategies(), may_hurry=False))
    plan = solve(asked)
    exact = Pursued(
        side=1500.0, spacing=62.5, speed=25.0, pursuer=(east, north), pursuer_speed=speed, reach=radius,
        price=3.0, slack=3.0,
    ).least((125.0, 125.0), (1312.5, 1312.5))  # fmt: skip
    ends_s = (
        math.dist((100.0, 100.0), (125.0, 125.0)) + math.dist((1350.0, 1350.0), (1312.5, 1312.5))
    ) / 25.0
    assert plan.reaches_goal
    assert plan.objective_s <= 1.15 * (exact + 4.0 * ends_s)
    assert plan.objective_s >= 0.9 * exact
