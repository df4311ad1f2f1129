"""A real ArduPlane over real ground: ``pytest -m real``, where ARDUPLANE names a binary and GROUND a map.

Heights over ground are computed by the test from the map's file.
"""

import os

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.real.flights_pool import Binaries
from tests.real.rig.course import Item
from tests.real.rig.mapped_ground import GroundFlight, OverGround, near, tile_named

TAKEOFF = Item(mavlink.MAV_CMD_NAV_TAKEOFF, (12.0, 0.0, 0.0, 0.0), (0.0, 700.0, 120.0))
# A straight line over a hill that rises by 130 m on 400 m, steeper than ArduPlane climbs. The second place is
# its foot, where a survey turns to the next leg; the third lies behind the hill.
BEFORE, FOOT, BEHIND = (-1836.0, -1580.0), (-3120.0, -1785.0), (-4502.0, -2007.0)
LEAST_M, TOLERANCE_M = 50.0, 3.0
HIT_M = 20.0


@pytest.fixture
def flight_to(tmp_path):
    """Makes flights, and ends them."""
    binaries, tile = Binaries.named(os.environ), tile_named(os.environ)
    if binaries.arduplane is None:
        pytest.skip("ARDUPLANE names no binary of your own")
    if tile is None:
        pytest.skip("GROUND names no map: the SRTM tile S36E149")
    begun = []

    def make(*goals, **options):
        folder = tmp_path if "REAL_OUT" not in os.environ else tile_named({"GROUND": os.environ["REAL_OUT"]})
        folder = folder / f"{os.environ['PYTEST_CURRENT_TEST'].split('::')[-1].split(' ')[0]}-{len(begun)}"
        begun.append(GroundFlight(binaries.arduplane, binaries.parameters, tile, folder, goals, **options))
        return begun[-1]

    yield make
    for flight in begun:
        flight.close()


def way(ground, *places):
    """The operator's mission: takeoff, and places 50 m over ground."""
    return [TAKEOFF, *(OverGround(mavlink.MAV_CMD_NAV_WAYPOINT, place=(*place, LEAST_M)) for place in places)]


@pytest.mark.real
def test_an_arduplane_that_is_served_has_all_heights_and_flies_waypoints_over_ground(flight_to):
    ground = flight_to((*BEHIND, 200.0)).ground
    goal = ground.over(*BEHIND, 100.0)
    flight = flight_to(goal)
    flight.open(serves=True)
    flight.station.wait(flight.has_all, 120.0, "all heights")
    items = [TAKEOFF, Item(mavlink.MAV_CMD_NAV_WAYPOINT, place=goal)]
    assert flight.fly(items, near(goal, 100.0), 500.0)
    heights = flight.heights_m(1000.0)
    assert heights.min() > LEAST_M - TOLERANCE_M


@pytest.mark.real
def test_a_hill_that_an_arduplane_flies_into_is_crossed_with_the_service(flight_to):
    ground = flight_to((*BEHIND, 200.0)).ground
    alone = flight_to((*BEHIND, 200.0))
    alone.open(supplies=True)
    alone.station.wait(alone.has_all, 120.0, "all heights")
    alone.fly(way(ground, BEFORE, FOOT, BEHIND), near(BEHIND, 300.0), 500.0)
    least = float(alone.heights_m(1000.0).min())
    assert least < HIT_M

    served = flight_to(*(ground.over(*place, 90.0) for place in (BEFORE, FOOT, BEHIND)))
    served.open(serves=True)
    served.station.wait(served.has_all, 120.0, "all heights")
    items = [TAKEOFF, Item(mavlink.MAV_CMD_NAV_WAYPOINT, place=ground.over(*BEHIND, 90.0))]
    assert served.fly(items, near(BEHIND, 100.0), 600.0)
    least = float(served.heights_m(1000.0).min())
    assert least > LEAST_M - TOLERANCE_M
