"""Every mission file that is shipped: understood, planned, and flown to its goals."""

import asyncio

import numpy as np
import pytest

from companion.assurance.checker import Checker
from companion.config import load_mission
from companion.config.compose import check_limits_of
from companion.config.offline_problem import offline_problem, offline_world
from companion.planning.solver import solve
from companion.types.events import Dialect
from sim.sitl import Flight
from tests.flights.flown import reaches, stays_inside, touches_anything, true_places
from tests.sim.client import CONFIGS

FILES = sorted(path.stem for path in CONFIGS.glob("*.yaml"))
PAGE = CONFIGS.parent / "docs" / "missions.md"


def mission_of(name):
    return load_mission(CONFIGS / f"{name}.yaml")


@pytest.mark.parametrize("name", FILES)
def test_is_planned(name):
    mission = mission_of(name)
    plan = solve(offline_problem(mission, offline_world(mission), None, 1))
    assert plan.reaches_goal
    assert Checker(mission.obstacle_list, check_limits_of(mission)).check_path(plan.path) == ()


@pytest.mark.slow
@pytest.mark.parametrize("dialect", Dialect)
@pytest.mark.parametrize("name", FILES)
def test_is_flown(name, dialect):
    flight = Flight(mission_of(name), 1, None, dialect)
    asyncio.run(flight.fly())
    places = true_places(flight)
    for goal in flight.mission.goals:
        away = np.linalg.norm(places - (goal.east_m, goal.north_m, goal.up_m), axis=1)
        assert away.min() <= goal.acceptance_radius_m
    assert reaches(flight.mission, places)
    assert not touches_anything(flight.mission, places)
    assert stays_inside(flight.mission, places)


def test_the_page_lists_every_file():
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    assert [row.split("`")[1] for row in rows] == [f"{name}.yaml" for name in FILES]
