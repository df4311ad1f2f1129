"""Flights below radars' sight: what is just below it is not flown so exactly."""

import asyncio

import pytest

from companion.types.events import Dialect
from sim.sitl import Flight
from tests.flights.flown import mission_named


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_radar_valley_is_flown_below_the_radar_with_a_margin(seed):
    """A path along the boundary of its sight is seen for 22 and 25 s in these two flights."""
    flight = Flight(mission_named("radar-valley"), seed, None, (Dialect.ARDUPILOT, Dialect.PX4)[seed - 1])
    asyncio.run(flight.fly())
    assert flight.goal_reached
    assert flight.measures().over_all()["seconds_in_radar"] < 5.0
