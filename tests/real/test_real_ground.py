"""A real ArduPlane over real ground: ``pytest -m real``, where ARDUPLANE names a binary and GROUND a map.

Heights over ground are computed by the test from the map's file.
"""

import os
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.real.flights_pool import Binaries
from tests.real.rig.course import Item
from tests.real.rig.mapped_ground import GroundFlight, OverGround, OwnGround, near, tile_named

TAKEOFF = Item(mavlink.MAV_CMD_NAV_TAKEOFF, (12.0, 0.0, 0.0, 0.0), (0.0, 700.0, 120.0))
# A straight line over a hill that rises by 130 m on 400 m, steeper than ArduPlane climbs. The second place is
# its foot, where a survey turns to the next leg; the third lies behind the hill.
BEFORE, FOOT, BEHIND = (-1836.0, -1580.0), (-3120.0, -1785.0), (-4502.0, -2007.0)
LEAST_M, TOLERANCE_M = 50.0, 3.0
HIT_M = 20.0
GOAL_M = 90.0  # Goals lie so high over ground.


@pytest.fixture
def flight_to(tmp_path):
    """Makes flights with the service's goals at heights over ground."""
    binaries, tile = Binaries.named(os.environ), tile_named(os.environ)
    if binaries.arduplane is None:
        pytest.skip("ARDUPLANE names no binary of your own")
    if tile is None:
        pytest.skip("GROUND names no map: the SRTM tile S36E149")
    instance = 1 + int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
    folder, ground = Path(os.environ.get("REAL_OUT", tmp_path)).resolve(), OwnGround(tile)

    def make(name, *places):
        goals = [ground.over(*place, GOAL_M) for place in places]
        return GroundFlight(binaries.arduplane, binaries.parameters, tile, folder / name, goals, instance)

    return make


def way(*places):
    """The operator's mission: takeoff, and places 50 m over ground."""
    return [TAKEOFF, *(OverGround(mavlink.MAV_CMD_NAV_WAYPOINT, place=(*place, LEAST_M)) for place in places)]


@pytest.mark.real
def test_an_arduplane_that_is_served_has_all_heights_and_flies_waypoints_over_ground(flight_to):
    with flight_to("served", BEHIND) as flight:
        flight.open(serves=True)
        flight.station.wait(flight.has_all, 120.0, "all heights")
        assert flight.fly(way(BEHIND), near(BEHIND, 100.0), 500.0)
        assert flight.heights_m(1000.0).min() > LEAST_M - TOLERANCE_M
        flight.service.stop()
        frames = flight.frames()
        assert frames[mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT] > 0.5 * frames.total() > 0


@pytest.mark.real
def test_a_hill_that_an_arduplane_flies_into_is_crossed_with_the_service(flight_to):
    with flight_to("alone", BEHIND) as alone:
        alone.open(supplies=True)
        alone.station.wait(alone.has_all, 120.0, "all heights")
        alone.fly(way(BEFORE, FOOT, BEHIND), near(BEHIND, 300.0), 500.0)
        assert alone.heights_m(1000.0).min() < HIT_M
    with flight_to("with-service", BEFORE, FOOT, BEHIND) as served:
        served.open(serves=True)
        served.station.wait(served.has_all, 120.0, "all heights")
        assert served.fly(way(BEFORE, FOOT, BEHIND), near(BEHIND, 100.0), 600.0)
        assert served.heights_m(1000.0).min() > LEAST_M - TOLERANCE_M
