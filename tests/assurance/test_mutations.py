"""Each constraint of the planner taken away in turn: the checker, which shares no code with it, notices.

A mutant plans for an aircraft, a world or a goal that is not the real one; the checker judges its paths
by the real ones. For every mutation some path must break the rule that guards it, and none of the
unchanged planner may.
"""

import math
from dataclasses import replace

import pytest

from companion.assurance.checker import Checker
from companion.planning.problem import GoalRegion
from companion.planning.solver import solve
from tests.planning.test_solver import random_problem
from tests.support.paths import check_limits
from tests.support.worlds import VEHICLE, packed

SEEDS = range(8)


def another_aircraft(**changes):
    return lambda asked: replace(asked, vehicle=replace(VEHICLE, **changes))


def other_settings(**changes):
    return lambda asked: replace(asked, settings=replace(asked.settings, **changes))


def steep(**changes):
    """Optimised briefly: a path that is optimised for longer climbs no steeper than it has to."""
    aircraft, settings = another_aircraft(**changes), other_settings(optimise_iterations_max=80)
    return lambda asked: settings(aircraft(asked))


def no_obstacles(asked):
    snapshot = asked.snapshot
    return replace(asked, snapshot=replace(snapshot, obstacle_list=(), obstacles=packed([], snapshot.bounds)))


def no_bounds(asked):
    """Bounds 1 km wider, and a goal just outside the real ones."""
    low_e, high_e, low_n, high_n, low, high = asked.snapshot.bounds
    wide = (low_e - 1e3, high_e + 1e3, low_n - 1e3, high_n + 1e3, low, high)
    return replace(asked, snapshot=replace(asked.snapshot, bounds=wide), goals=(goal_at(1540.0, 1300.0),))


def no_ceiling(asked):
    *flat, low, high = asked.snapshot.bounds
    goal = goal_at(1350.0, 1350.0, high + 60.0)
    return replace(asked, snapshot=replace(asked.snapshot, bounds=(*flat, low, high + 300.0)), goals=(goal,))


def goal_at(east, north, up=150.0):
    return GoalRegion((east, north, up), 60.0)


MUTATIONS = {
    "turn radius": (2, another_aircraft(turn_radius_min_m=60.0), "turn_radius"),
    "straight flight": (2, another_aircraft(straight_length_min_m=0.0), "straight"),
    "climb angle": (3, steep(climb_angle_max_rad=math.radians(25.0)), "climb"),
    "descent angle": (3, steep(descent_angle_max_rad=math.radians(25.0)), "climb"),
    "least airspeed": (
        2, another_aircraft(airspeed_min_m_s=8.0, airspeed_cruise_m_s=10.0, acceleration_max_m_s2=5.0),
        "speed",
    ),
    "greatest airspeed": (
        2, another_aircraft(airspeed_max_m_s=60.0, airspeed_cruise_m_s=50.0, acceleration_max_m_s2=9.0),
        "speed",
    ),
    "acceleration": (
        2, another_aircraft(airspeed_cruise_m_s=30.0, acceleration_max_m_s2=2.0), "acceleration",
    ),
    "margin": (2, other_settings(clearance_min_m=-40.0), "clearance"),
    "obstacles": (2, no_obstacles, "clearance"),
    "bounds": (2, no_bounds, "bounds"),
    "ceiling": (3, no_ceiling, "bounds"),
    "goal": (2, lambda asked: replace(asked, goals=(goal_at(900.0, 1350.0),)), "goal"),
    "threat level": (2, lambda asked: asked, "threat"),
    "quality": (2, other_settings(clearance_min_m=0.5), "quality"),
}  # fmt: skip
TIGHT = {"threat level": {"threat_level_max": 0.05}, "quality": {"quality_min": 0.9999}}


def broken_rules(seed, dimension, mutate, **tight):
    asked = random_problem(seed, dimension)
    path = solve(mutate(asked)).path
    limits = check_limits(bounds=asked.snapshot.bounds, margin_m=asked.settings.clearance_min_m, **tight)
    goal = asked.goals[0]
    found = Checker(asked.snapshot.obstacle_list, limits).check_path(
        path, goal_enu_m=goal.position_enu_m, acceptance_radius_m=goal.acceptance_radius_m
    )
    return {violation.rule for violation in found}


@pytest.mark.parametrize("name", MUTATIONS)
def test_a_planner_without_a_constraint_is_found_out(name):
    dimension, mutate, rule = MUTATIONS[name]
    found = set()
    for seed in SEEDS:
        found |= broken_rules(seed, dimension, mutate, **TIGHT.get(name, {}))
        if rule in found:
            break
    assert rule in found


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_planner_as_it_is_breaks_none(dimension):
    assert all(not broken_rules(seed, dimension, lambda asked: asked) for seed in SEEDS)
