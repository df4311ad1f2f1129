"""Fences uploaded before and in flight, through the whole service."""

from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import LineString, Point

from companion.config import mission_from_text
from companion.flight.state.modes import Mode
from companion.types.events import Dialect
from companion.types.mission import MavFrame, MissionItem
from sim.mission_types import MissionKind
from tests.flight.construction.test_cycle import BLOCK
from tests.flight.test_app import at
from tests.sim.client import PLAIN
from tests.support.operator_places import home_at, put
from tests.support.sitl_harness import SitlHarness

CIRCLE_OUT, POLYGON_OUT = 5004, 5002
TEXT = PLAIN.replace("{east_m: 1750, north_m: 750, up_m: 100}", "{east_m: 1750, north_m: 0, up_m: 100}")
BOTH = pytest.mark.parametrize("dialect", list(Dialect), ids=lambda dialect: dialect.value)


def vertex(harness, command, value, east, north):
    latitude, longitude = harness.simulator.autopilot.projection.degrees(east, north)
    place = round(latitude * 1e7), round(longitude * 1e7)
    return MissionItem(0, command, MavFrame.GLOBAL_RELATIVE_ALT, (value, 0.0, 0.0, 0.0), *place, 0.0)


def fence(harness, *vertices):
    """Put a fence into the autopilot."""
    items = [replace(vertex(harness, *entry), sequence=n) for n, entry in enumerate(vertices)]
    put(harness, MissionKind.FENCE, items)


def deck_of(dialect):
    return SitlHarness(mission_from_text(TEXT, "fence.yaml"), dialect=dialect)


def flown(harness, since_s=0.0):
    rows = np.array(harness.simulator.truth.path)
    return LineString(rows[rows[:, 0] >= since_s][:, 1:3])


@BOTH
def test_a_fence_is_flown_round(dialect):
    harness = deck_of(dialect)
    fence(harness, (CIRCLE_OUT, 150.0, 900.0, 0.0))
    harness.fly(80.0)
    assert harness.app.mode.value == "arrived"
    assert harness.texts("fence") == ["1 to stay out of, 0 to stay in"]
    assert flown(harness).distance(Point(900.0, 0.0)) > 150.0


@BOTH
def test_a_fence_uploaded_in_flight_is_flown_round_from_the_next_cycle_on(dialect):
    places = []

    def shut(harness):
        """Stand in the flown path, 900 m on its way."""
        rows = harness.app.state.flown.path.positions_enu_m
        places.append(rows[np.searchsorted(rows[:, 0], 900.0), :2])
        fence(harness, (CIRCLE_OUT, 150.0, *places[0]))

    harness = deck_of(dialect).fly(90.0, at(8.0, shut))
    assert harness.app.mode.value == "arrived"
    told = [entry.stamp_s for entry in harness.recorder.decisions if entry.kind == "fence"]
    assert 8.0 < told[0] < 8.0 + 16.0  # a time horizon and the plan that follows
    assert "fence 1" in " ".join(harness.texts("swap"))
    assert flown(harness).distance(Point(places[0])) > 150.0


def test_a_fence_that_is_not_understood_is_said_once_and_changes_nothing():
    harness = deck_of(Dialect.ARDUPILOT)
    fence(harness, (POLYGON_OUT, 4.0, 900.0, 0.0), (POLYGON_OUT, 4.0, 950.0, 0.0))
    harness.fly(30.0)
    assert len(harness.texts("fence")) == 1
    assert "not complete" in harness.texts("fence")[0]
    assert harness.app.num_swaps >= 1


HOME = (800.0, 1000.0)
SHORTER = BLOCK.format("wall", 1500, -400, 1550, 2150)


# Without the parameter another way is flown, on one autopilot as on the other.
KEPT_AND_NOT = [(Dialect.ARDUPILOT, False), (Dialect.ARDUPILOT, True), (Dialect.PX4, True)]


@pytest.mark.parametrize(("dialect", "is_set"), KEPT_AND_NOT)
@pytest.mark.thorough
def test_a_circle_about_home_that_is_a_parameter_is_kept_within(dialect, is_set):
    """The shorter way round a wall leads out of it; it is told after the first plan."""
    text = PLAIN.replace("{east_m: 1750, north_m: 750", "{east_m: 2000, north_m: 900")
    mission = mission_from_text(
        text.replace("total_planning_time_s: 80", "total_planning_time_s: 200") + "obstacles:\n" + SHORTER,
        "fence.yaml",
    )
    harness = SitlHarness(mission, dialect=dialect)
    home_at(harness, *HOME)
    fenced_by(harness, 1500.0 * is_set, 0.0)

    def look(harness):
        harness.is_over = harness.app.mode is Mode.ARRIVED

    harness.fly(220.0, look)
    assert harness.app.mode.value == "arrived"
    rows = np.array(harness.simulator.truth.path)[:, 1:3]
    reach = np.linalg.norm(rows - HOME, axis=1).max()
    assert bool(reach < 1500.0) is is_set
    assert harness.texts("fence") == (
        ["0 to stay out of, 1 to stay in, within 1500 m of home"] if is_set else []
    )


def fenced_by(harness, radius_m, height_m):
    parameters = harness.simulator.autopilot.parameters
    if harness.flight.dialect is Dialect.PX4:
        parameters["GF_MAX_HOR_DIST"], parameters["GF_MAX_VER_DIST"] = radius_m, height_m
        return
    parameters["FENCE_ENABLE"] = 1.0 if radius_m or height_m else 0.0
    parameters["FENCE_TYPE"] = 3.0
    parameters["FENCE_RADIUS"], parameters["FENCE_ALT_MAX"] = radius_m, height_m


@pytest.mark.parametrize(("dialect", "is_set"), KEPT_AND_NOT)
@pytest.mark.thorough
def test_a_ceiling_that_is_a_parameter_is_kept_below(dialect, is_set):
    """A wall in the way is lower than the bounds, and higher than the ceiling."""
    text = PLAIN.replace("dimension: 2", "dimension: 3").replace("up_m: [60, 160]", "up_m: [60, 260]")
    text = text.replace("{east_m: 1750, north_m: 750", "{east_m: 2600, north_m: 0")
    wall = BLOCK.format("wall", 1400, -1800, 1450, 1800).replace("top_m: 300", "top_m: 130")
    mission = mission_from_text(text + "obstacles:\n" + wall, "fence.yaml")
    harness = SitlHarness(mission, dialect=dialect)
    fenced_by(harness, 0.0, 140.0 * is_set)
    harness.fly(60.0 if is_set else 100.0)
    flown_up = np.array(harness.simulator.truth.path)[:, 3]
    assert bool(flown_up.max() < 140.0) is is_set
