"""A vehicle that stands on the straight way in open country is flown round, with a limit or without."""

import asyncio
import itertools
import math

import pytest

from companion.config import mission_from_text
from companion.types.events import Dialect
from sim.sitl import Flight
from tests.flights.flown import miss_distance_m, reaches, true_places
from tests.sim.client import PLAIN

RADIUS_M = 250.0
PARKED = f"""
dynamic_threats:
  - {{name: parked, east_m: 1500, north_m: 0, speed_m_s: 0, max_threat_radius_m: {RADIUS_M:g}}}
simulation: {{wind_speed_m_s: 3, wind_from_deg: 240, turbulence: light}}
"""


def flown(limit, seed, dialect):
    text = PLAIN.replace("{east_m: 1750, north_m: 750", "{east_m: 3000, north_m: 0")
    text = text.replace("total_planning_time_s: 80", f"total_planning_time_s: 250{limit}")
    flight = Flight(mission_from_text(text + PARKED, "open.yaml"), seed, None, dialect)
    asyncio.run(flight.fly())
    return flight


@pytest.mark.slow
@pytest.mark.parametrize("dialect", Dialect)
@pytest.mark.parametrize("limit", ["", ", threat_level_max: 0.3"], ids=["no limit named", "0.3"])
def test_a_standing_vehicle_is_flown_round(limit, dialect):
    """Not much wider than need be: tangents to its radius from 1500 m away make the way 42 m longer."""
    for seed in (1, 2, 3):
        flight = flown(limit, seed, dialect)
        places = true_places(flight)
        assert reaches(flight.mission, places)
        assert miss_distance_m(places, 1500.0, 0.0) > RADIUS_M
        flown_m = sum(math.dist(a, b) for a, b in itertools.pairwise(places))
        assert flown_m < 3200.0
        assert not [entry for entry in flight.recorder.decisions if entry.kind == "emergency"]


@pytest.mark.slow
def test_by_threat_levels_alone_only_the_limit_keeps_away():
    """The ablation without the race of paper 2.3, which is what flies round where no limit is named."""
    by_levels = ", method: safe-rrt-rs"
    over = flown(by_levels, 1, Dialect.ARDUPILOT)
    assert miss_distance_m(true_places(over), 1500.0, 0.0) < 0.5 * RADIUS_M
    limited = flown(f"{by_levels}, threat_level_max: 0.3", 1, Dialect.ARDUPILOT)
    assert miss_distance_m(true_places(limited), 1500.0, 0.0) > 0.9 * RADIUS_M
