"""Paths past several goals: beside the shortest one where nothing is in the way, and among walls."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.config import load_mission
from companion.config.offline_problem import offline_problem, offline_world
from companion.planning.explore import Exploration
from companion.planning.least_objective.cost_field import field_before_pursuers, least_s
from companion.planning.least_objective.prices import objective_of
from companion.planning.problem import GoalRegion
from companion.planning.solver import solve
from tests.support.exact_goals import between_m, shortest_m
from tests.support.worlds import problem, track

BOUNDS = (0.0, 4000.0, 0.0, 4000.0, 50.0, 250.0)
APART_M, HEIGHT_M, RADIUS_M, SHARE = 600.0, 150.0, 60.0, 0.75
START = (500.0, 500.0, HEIGHT_M)


def asked(places, obstacles=(), tracks=(), **changes):
    """A problem with goals at places [m]; without a least straight length between turns."""
    made = problem(obstacles, (), tracks, start=START, direction=0.0, bounds=BOUNDS, **changes)
    goals = tuple(GoalRegion((*place, HEIGHT_M), RADIUS_M) for place in places)
    return replace(made, goals=goals, vehicle=replace(made.vehicle, straight_length_min_m=0.0))


def places_of(seed, num):
    """Random places, each at least 600 m from the one before."""
    rng, places = np.random.default_rng(seed), [np.array(START[:2])]
    while len(places) <= num:
        place = rng.uniform(300.0, 3700.0, 2)
        if np.hypot(*(place - places[-1])) >= APART_M:
            places.append(place)
    return [tuple(place) for place in places[1:]]


def passed(plan, places):
    """How many of the goals a path passes, in their order."""
    num = 0
    for row in plan.path.positions_enu_m[:, :2]:
        while num < len(places) and math.dist(row, places[num]) <= RADIUS_M:
            num += 1
    return num


@pytest.mark.parametrize("num", [2, 4, 10])
def test_paths_are_hardly_longer_than_the_shortest(num):
    """At 25 m/s J is the time, and no more."""
    ratios = []
    for seed in range(4):
        places = places_of(10 * num + seed, num)
        plan = solve(asked(places, max_iterations=60_000))
        assert plan.reaches_goal
        assert passed(plan, places) == num
        circles = [(*place, SHARE * RADIUS_M) for place in places]
        ratios.append(25.0 * plan.objective_s / shortest_m((*START[:2], 0.0), circles, 125.0))
    assert np.mean(ratios) <= 1.015  # Without other ways past the goals it is 1.022 to 1.033.
    assert min(ratios) >= 0.98  # The oracle has few courses and places.


@pytest.mark.parametrize(
    "places",
    [
        [(313, 823), (1184, 1776), (485, 620), (557, 1970)],
        [(484, 325), (303, 897), (1773, 888), (1597, 1384)],
        [(484, 524), (1847, 917), (541, 554), (573, 1338), (526, 940), (1930, 865), (352, 2134), (1324, 907)],
    ],
)
def test_goals_between_walls_are_passed_one_after_the_other(places):
    mission = load_mission("mission_configs/paper-2d.yaml")
    made = offline_problem(mission, offline_world(mission).with_tracks(0.0, ()), None, 1)
    goals = tuple(GoalRegion((*map(float, place), 100.0), RADIUS_M) for place in places)
    plan = solve(replace(made, goals=goals))
    assert plan.reaches_goal
    assert passed(plan, places) == len(places)


def v_at_start_s(made):
    """V at the start where what pursuers could threaten is barred."""
    exploration = Exploration(made, np.random.default_rng(1))
    objective = objective_of(exploration)
    field = field_before_pursuers(made, objective, exploration.danger_max)
    return least_s(field, made.start.position_enu_m)


def test_behind_a_goal_pursuers_have_had_time_to_come():
    """A pursuer 2.5 km north drives 20 m/s and reaches 200 m: it needs 90 s to threaten a goal 500 m north.

    Straight there the aircraft comes in about 20 s. By way of a goal 1.5 km east, 60 s away, it comes after
    two minutes.
    """
    pursuer = track(500.0, 3000.0, speed=20.0, radius=200.0)
    north, east = (500.0, 1000.0), (2000.0, 500.0)
    assert v_at_start_s(asked([north], tracks=[pursuer])) < 60.0
    assert v_at_start_s(asked([east], tracks=[pursuer])) == pytest.approx(60.0)
    assert math.isfinite(v_at_start_s(asked([north, east], tracks=[pursuer])))
    assert math.isinf(v_at_start_s(asked([east, north], tracks=[pursuer])))


def test_without_pursuers_v_is_the_straight_line_from_goal_to_goal():
    assert v_at_start_s(asked([(1500.0, 500.0), (1500.0, 2000.0)])) == pytest.approx(100.0, rel=0.05)


def test_the_oracle_by_hand():
    """1 km straight on; half a circle of 125 m to the left, then 1 km; a quarter to the right, then 1 km."""
    ends = np.array([[1000.0, 0.0, 0.0], [-1000.0, 250.0, math.pi], [125.0, -1125.0, -math.pi / 2]])
    found = between_m(np.zeros(3), ends, 125.0)
    by_hand = [1000.0, 1000.0 + 125.0 * math.pi, 1000.0 + 62.5 * math.pi]
    assert found == pytest.approx(by_hand)
