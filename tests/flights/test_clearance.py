"""Tight turns in a strong tailwind: both autopilots keep the distance that the mission asks for."""

import asyncio
from pathlib import Path

import pytest

from companion.config import load_mission
from companion.types.events import Dialect
from sim.sitl import Flight
from tests.flights.flown import reaches, true_places

TAILWIND = Path(__file__).parents[1] / "data" / "tailwind.yaml"
GUST_M = 2.5  # of clearance_min_m, in moderate turbulence


@pytest.mark.parametrize("seed", [42, 44, 45])
@pytest.mark.parametrize("dialect", list(Dialect), ids=lambda dialect: dialect.value)
@pytest.mark.thorough
def test_corners_are_flown_clear_of_walls(dialect, seed):
    mission = load_mission(TAILWIND)
    flight = Flight(mission, seed, dialect=dialect)
    asyncio.run(flight.fly())
    assert reaches(mission, true_places(flight))
    assert flight.simulator.truth.min_obstacle_clearance_m > mission.planning.clearance_min_m - GUST_M
