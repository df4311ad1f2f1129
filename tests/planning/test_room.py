"""Paths are given room where it costs little: moves, their price, and what they never cost."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.assurance.checker import Checker
from companion.campaign.runs import offline_problem, offline_world
from companion.config import load_mission
from companion.planning import solver
from companion.planning.comparators import METHODS, Certainty, Strategies
from companion.planning.explore import Exploration
from companion.planning.room import price_of_room, widened_route
from companion.planning.route import assess_route, cost_between, pursuit_risk, route_from_tree
from companion.planning.settings import settings_for
from companion.planning.solver import _found, never, solve
from tests.support.paths import box, check_limits
from tests.support.worlds import BOUNDS, problem, track

pytestmark = pytest.mark.compiled

WALL = box("wall", 700.0, 300.0, 760.0, 1100.0)


def nearest(path, obstacles):
    """How near a path's rows come to obstacles [m], by shapely."""
    shapes = shapely.MultiPolygon([shapely.Polygon(obstacle.polygon_enu_m) for obstacle in obstacles])
    return min(shapes.distance(shapely.Point(place)) for place in path.positions_enu_m[:, :2])


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_corner_is_passed_farther_off_where_there_is_room(dimension):
    narrow, wide = (
        [
            solve(problem([WALL], dimension=dimension, seed=seed, clearance_wanted_m=wanted))
            for seed in range(1, 9)
        ]
        for wanted in (0.0, 60.0)
    )
    assert np.median([nearest(plan.path, [WALL]) for plan in narrow]) < 30.0
    assert np.median([nearest(plan.path, [WALL]) for plan in wide]) > 50.0
    costs = [np.median([plan.measures.path_cost for plan in plans]) for plans in (narrow, wide)]
    assert costs[1] < 1.04 * costs[0]
    limits = check_limits(bounds=BOUNDS, margin_m=15.0)
    checker = Checker([WALL], limits)
    assert not [entry for plan in wide for entry in checker.check_path(plan.path)]


def test_a_gap_that_is_narrower_is_flown_all_the_same():
    gates = [box("south", 700.0, 0.0, 760.0, 680.0), box("north", 700.0, 760.0, 760.0, 1500.0)]
    plan = solve(problem(gates, clearance_wanted_m=60.0))
    assert plan.reaches_goal
    assert 15.0 <= nearest(plan.path, gates) <= 40.0


def test_no_more_is_wanted_where_it_is_no_more_than_the_least():
    plans = [solve(problem([WALL], clearance_wanted_m=wanted)) for wanted in (0.0, 15.0)]
    assert np.array_equal(plans[0].path.positions_enu_m, plans[1].path.positions_enu_m)


@pytest.mark.parametrize("method", METHODS)
def test_it_belongs_to_ours_with_uncertainty(method):
    """Comparators are what was printed; who leaves uncertainty out has none to keep room for."""
    chosen = settings_for(
        method, certainty=Certainty.SHIFTED, clearance_min_m=15.0, sensing_horizon_m=600.0,
        max_iterations=1000, clearance_wanted_m=60.0,
    )  # fmt: skip
    ours = {"safe-rrt", "safe-rrt-blind", "safe-rrt-cruise", "safe-rrt-first"}
    assert chosen.room_wanted_m == (60.0 if method in ours else 0.0)


def test_the_price_by_hand():
    """A row 20 m beside a wall lacks 40 m, at 2.5 m of way each, of which a unit of 25 m costs 0.5."""
    wall = box("wall", 0.0, 0.0, 1400.0, 80.0)
    exploration = Exploration(problem([wall], clearance_wanted_m=60.0), np.random.default_rng(1))
    route = route_from_tree(exploration, 0)
    assert route.states[0, 1] == 100.0
    assert price_of_room(exploration, route) == pytest.approx(40.0 * 2.5 * 0.5 / 25.0)


@given(st.integers(0, 1000), st.sampled_from([2, 3]))
@settings(max_examples=12, deadline=None)
def test_moves_are_worth_what_they_cost(seed, dimension):
    """Cost, seconds under threat and room together get no dearer; where none need be risked, none are."""
    place = np.random.default_rng(seed).uniform(500.0, 1000.0, 2)
    asked = problem(
        [WALL], tracks=[track(*place, speed=12.0, radius=250.0)], dimension=dimension, seed=seed,
        clearance_wanted_m=60.0,
    )  # fmt: skip
    exploration = Exploration(asked, np.random.default_rng(seed))
    reached, route, _ = _found(exploration, never)
    if not reached:
        return
    known = assess_route(exploration, route)
    wide, later, moved = widened_route(exploration, route, known)
    weight = asked.settings.weight_caught(exploration.chase.pursuit)
    spent = [
        cost_between(exploration, each)
        + weight * pursuit_risk(exploration, each).total_s
        + price_of_room(exploration, each)
        for each in (route, wide)
    ]
    assert spent[1] <= spent[0] + 1e-6
    assert (moved == 0) == (wide is route)
    if exploration.chase.is_avoided:
        assert pursuit_risk(exploration, wide).total_s <= pursuit_risk(exploration, route).total_s
    again = assess_route(exploration, wide)
    assert np.array_equal(later.clear, again.clear)
    assert np.array_equal(later.levels, again.levels)


@pytest.mark.parametrize("seed", [1, 5])
def test_where_a_tree_is_led_too_near_another_way_is_looked_for(seed, monkeypatch):
    """Its way begins where no move leads out of: a search that keeps the room throughout does."""
    blocks = [
        box("middle", 560.0, 420.0, 900.0, 800.0),
        box("left", 250.0, 600.0, 420.0, 900.0),
        box("right", 800.0, 80.0, 1000.0, 300.0),
    ]
    by_tree = Strategies(by_objective=False)
    asked = problem(blocks, dimension=3, seed=seed, clearance_wanted_m=60.0, strategies=by_tree)
    plan = solve(asked)
    assert "another way, with more room" in plan.notes
    assert nearest(plan.path, blocks) > 55.0
    monkeypatch.setattr(solver, "LITTLE_ROOM", 0.0)
    first = solve(asked)
    assert "another way, with more room" not in first.notes
    assert nearest(first.path, blocks) < 45.0


def test_goals_on_the_way_stay_on_it():
    mission = load_mission("mission_configs/city-block.yaml")
    for seed in range(1, 5):
        plan = solve(offline_problem(mission, offline_world(mission), None, seed))
        assert plan.reaches_goal
        for goal in mission.goals[:-1]:
            away = np.linalg.norm(plan.path.positions_enu_m - goal.position_enu_m, axis=1).min()
            assert away <= goal.acceptance_radius_m


@pytest.mark.slow
def test_the_papers_maps_have_room_that_costs_little():
    for name, least in (("paper-2d", 40.0), ("paper-3d", 40.0)):
        mission = load_mission(f"mission_configs/{name}.yaml")
        asked = [offline_problem(mission, offline_world(mission), None, seed) for seed in range(1, 9)]
        costs = []
        for wanted in (0.0, 60.0):
            plans = [
                solve(replace(each, settings=replace(each.settings, clearance_wanted_m=wanted)))
                for each in asked
            ]
            costs.append(np.median([plan.measures.path_cost for plan in plans]))
        near = [nearest(plan.path, asked[0].snapshot.obstacle_list) for plan in plans]
        assert np.median(near) > least, name
        assert costs[1] < 1.06 * costs[0]
