"""Flights over ground in the simulator, and beside them flights that know no ground."""

import collections
import re

import numpy as np
import pytest
import rasterio
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import load_mission
from companion.config.sections.terrain_map import posts_of
from companion.types.events import Dialect
from tests.ground.ground_flights import LEAST_M, fly
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


def test_ridges_are_passed_by_waypoints_over_ground():
    mission = load_mission(CONFIGS / "ridge.yaml")
    terrain = mission.terrain.model_copy(update={"item_frame": "terrain"})
    harness = SitlHarness(mission.model_copy(update={"terrain": terrain}), seed=1)
    harness.fly(230.0)  # It flies 4.9 km at 25 m/s, without circling on the way.
    truth = harness.simulator.truth
    assert harness.flight.goal_reached
    assert truth.min_ground_height_m > terrain.height_min_m - 3.0
    sent = [message for _, message in harness.said("MISSION_ITEM_INT") if message.command == 16]
    frames = collections.Counter(message.frame for message in sent)
    assert frames[mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT] > 0.8 * frames.total()
    assert not {"ground", "emergency"} & set(harness.kinds())


@pytest.mark.parametrize("shift_m", [0.0, 40.0])
def test_a_map_that_is_40_m_too_high_is_told_and_the_right_one_is_not(tmp_path, shift_m):
    """The autopilot has the ridges on its card, and reports their heights in the first half minute."""
    mission = load_mission(CONFIGS / "ridge.yaml")
    posts = posts_of(mission)
    rows, columns = posts.up_m.shape
    left, top = posts.first_x - 0.5 * posts.step_x, posts.first_y + (rows - 0.5) * posts.step_y
    profile = {"driver": "GTiff", "count": 1, "dtype": "float64", "crs": posts.crs}
    affine = rasterio.Affine(posts.step_x, 0.0, left, 0.0, -posts.step_y, top)
    with rasterio.open(
        tmp_path / "map.tif", "w", height=rows, width=columns, transform=affine, **profile
    ) as out:
        out.write(posts.up_m[::-1] + posts.frame.altitude_amsl_m + shift_m, 1)
    terrain = mission.terrain.model_copy(update={"generated": None, "file": str(tmp_path / "map.tif")})
    harness = SitlHarness(mission, seed=1)
    harness.flight.mission = mission.model_copy(update={"terrain": terrain})
    harness.fly(30.0)
    told = [message.text for _, message in harness.said("STATUSTEXT") if message.text.startswith("GROUND")]
    assert len(told) == (2 if shift_m > 0.0 else 0)  # One by its stored heights, one by its range finder.
    for text in told:
        theirs, ours = (int(number) for number in re.findall(r"(\d+) m", text))
        assert ours - theirs == pytest.approx(40.0, abs=10.0)


@pytest.mark.slow
def test_a_step_down_that_arduplane_makes_at_once_keeps_the_least_height():
    """Judged on the slope of its leg, this flight's mission descended by 13 m at once, to 53 m."""
    flight = fly(6024)
    assert flight.reached
    assert flight.least_m > LEAST_M - 3.0


@pytest.mark.thorough
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
