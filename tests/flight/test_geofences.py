"""Fences uploaded before and in flight, through the whole service."""

from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import LineString, Point

from companion.config import mission_from_text
from companion.types.events import Dialect
from companion.types.mission import MavFrame, MissionItem
from sim.autopilot.px4.px4_store import stored
from sim.mission_types import MissionKind
from tests.flight.test_app import at
from tests.sim.client import PLAIN
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
    autopilot = harness.simulator.autopilot
    if harness.flight.dialect is Dialect.PX4:
        autopilot.switch(MissionKind.FENCE, stored(items), None)
        return
    autopilot.store.truncate(MissionKind.FENCE, 0)
    for entry in items:
        autopilot.store.put(MissionKind.FENCE, entry)


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
