"""One flight of each of the paper's maps, and what their pursuer is to one that does not know of it."""

import asyncio

import numpy as np
import pytest
import shapely

from companion.types.events import Dialect
from sim.faults import FaultyLink, LinkFaults
from sim.sitl import Flight
from sim.threats.adsb_source import SOURCE_SYSTEM
from tests.flights.flown import (
    hides,
    mission_named,
    reaches,
    seconds_in_reach,
    shipped,
    stays_inside,
    touches_anything,
    true_places,
    uploads_in_flight,
)

pytestmark = pytest.mark.xdist_group("shipped flights")  # they share flights that are made once a process

MAPS = ("paper-2d", "paper-3d")
SENDER = 5  # place of the system id in a MAVLink 2 frame


def blind(name, seed):
    """The flight of a service that is told of no moving threat; the simulated one drives all the same."""
    flight = Flight(mission_named(name), seed, None, Dialect.ARDUPILOT)
    flight.mission = mission_named(name, dynamic_threats=())
    flight.wire = FaultyLink(flight.simulator, LinkFaults(), seed=seed)
    flight.wire.watch = lambda frame, from_client: from_client or frame[SENDER] != SOURCE_SYSTEM
    asyncio.run(flight.fly())
    return flight


@pytest.mark.slow
@pytest.mark.parametrize("name", MAPS)
def test_reaches_the_goal_past_radars_walls_and_a_pursuer(name):
    flight = shipped(name, 1)
    places = true_places(flight)
    assert reaches(flight.mission, places)
    assert not touches_anything(flight.mission, places)
    assert stays_inside(flight.mission, places)
    assert uploads_in_flight(flight) >= 2
    assert flight.document()["success"] is True


@pytest.mark.slow
@pytest.mark.parametrize("name", MAPS)
def test_the_pursuer_drives_as_fast_as_it_can_and_through_no_wall(name):
    """The flight would prove little against a threat that stands or is stuck."""
    flight = shipped(name, 1)
    rows = np.array(flight.document()["dt_path"])
    steps = np.hypot(*np.diff(rows[:, 1:], axis=0).T)
    assert steps.max() <= 25.0 * 0.1 + 0.01
    assert steps.sum() > 200.0
    ground = [entry for entry in flight.mission.obstacles if entry.base_m <= 0.0]
    for polygon in (np.array(entry.polygon_enu_m) for entry in ground):
        low, high = polygon.min(axis=0), polygon.max(axis=0)
        is_box = len(polygon) == 4 and len(np.unique(polygon[:, 0])) == len(np.unique(polygon[:, 1])) == 2
        if is_box:
            assert not ((rows[:, 1:] > low + 0.1) & (rows[:, 1:] < high - 0.1)).all(axis=1).any()


def test_what_hides_by_hand():
    """From the ground to 400 m up, 100 m east: a wall in the middle meets the line at 160 to 240 m."""
    wall = shapely.box(40.0, -5.0, 60.0, 5.0)
    line = (0.0, 0.0, 0.0), (100.0, 0.0, 400.0)
    assert hides(*line, wall, 0.0, 161.0)
    assert not hides(*line, wall, 0.0, 159.0)
    assert hides(*line, wall, 239.0, 300.0)
    assert not hides(*line, wall, 241.0, 300.0)
    assert not hides(*line, shapely.box(40.0, 1.0, 60.0, 5.0), 0.0, 300.0)


@pytest.mark.thorough
def test_in_space_radars_that_are_sensed_on_the_way_are_hidden_from():
    """A planner by the paper's (9) was seen for 102 s; one that held any path out of reach, for 32 s."""
    flight = shipped("paper-3d", 1)
    assert flight.document()["success"]
    assert flight.document()["seconds_in_radar"] < 20.0


@pytest.mark.slow
def test_in_space_the_pursuer_matters_to_one_that_does_not_know_of_it():
    seeds = (1, 2, 4)
    mission = mission_named("paper-3d")
    unaware = [seconds_in_reach(blind("paper-3d", seed), mission) for seed in seeds]
    aware = [seconds_in_reach(shipped("paper-3d", seed), mission) for seed in seeds]
    assert min(unaware) > 60.0, unaware
    assert sum(aware) < 0.1 * sum(unaware), (aware, unaware)
