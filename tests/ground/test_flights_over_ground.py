"""Flights over ground in the simulator, and beside them flights that know no ground."""

import numpy as np
import pytest

from companion.config import load_mission
from companion.types.events import Dialect
from tests.sim.client import CONFIGS
from tests.support.sitl_harness import SitlHarness

BOTH = pytest.mark.parametrize("dialect", list(Dialect), ids=lambda dialect: dialect.value)


def flown(name, dialect, until_s, *, knows_ground=True):
    """The flight of a shipped mission over its ground."""
    mission = load_mission(CONFIGS / f"{name}.yaml")
    harness = SitlHarness(mission, seed=1, dialect=dialect)
    if not knows_ground:
        harness.flight.mission = mission.model_copy(update={"terrain": None})
    harness.fly(until_s)
    return mission, harness.flight


@BOTH
def test_ridges_are_passed_low_and_out_of_the_radars_sight(dialect):
    mission, flight = flown("ridge", dialect, 330.0)
    truth = flight.simulator.truth
    assert flight.goal_reached
    assert not truth.collision
    assert truth.min_ground_height_m > mission.terrain.height_min_m - 3.0
    assert flight.measures().over_all()["seconds_in_radar"] < 10.0


def test_who_knows_no_ground_flies_into_the_ridge():
    _, flight = flown("ridge", Dialect.ARDUPILOT, 330.0, knows_ground=False)
    assert flight.simulator.truth.collision


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize(("name", "until_s"), [("jacksboro", 1000.0), ("hills", 200.0), ("leeward", 300.0)])
def test_ground_is_crossed_between_both_limits(name, until_s, dialect):
    mission, flight = flown(name, dialect, until_s)
    truth = flight.simulator.truth
    assert flight.goal_reached
    assert not truth.collision
    assert truth.min_ground_height_m > mission.terrain.height_min_m - 3.0


@pytest.mark.slow
@BOTH
def test_in_range_of_the_radar_on_the_ridge_the_way_stays_out_of_its_sight(dialect):
    mission, flight = flown("leeward", dialect, 300.0)
    (radar,) = mission.radars
    places = np.array(flight.simulator.truth.path)[:, 1:4]
    away = np.linalg.norm(places - (radar.east_m, radar.north_m, radar.up_m), axis=1)
    assert (away < radar.max_threat_radius_m).mean() > 0.5
    assert flight.measures().over_all()["seconds_in_radar"] < 10.0
