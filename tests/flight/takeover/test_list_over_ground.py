"""Items over terrain in the autopilot's list: where they lie, and how it flies over them."""

from dataclasses import replace

import numpy as np
import pytest

from companion.flight.construction import loiter_circles
from companion.flight.construction.loiter_circles import place_of
from companion.flight.messages.operator_summary import operator_summary_of
from companion.flight.takeover import start_prediction
from companion.flight.takeover.start_prediction import list_track
from companion.mission.operator import goals_of_operator, operator_of
from companion.types.events import MissionCurrent
from companion.types.mission import Command, MavFrame
from companion.world.ground.autopilot_ground import AutopilotGround
from tests.flight.construction.test_cycle import OPEN, begun, state
from tests.mission.made import FRAME, item

HILL_M = 60.0


def hill_at(latitude_deg):
    """A hill across the way to the north, 60 m high at 600 m."""
    north = (latitude_deg - FRAME.latitude_deg) * 111_195.0
    return FRAME.altitude_amsl_m + np.interp(north, [300.0, 600.0, 900.0], [0.0, HILL_M, 0.0])


GROUND = AutopilotGround(
    lambda latitude, longitude: hill_at(latitude) + 0.0 * longitude,
    FRAME, (-500.0, 500.0, -500.0, 2000.0), 100.0,
)  # fmt: skip


def over(sequence, north_m, altitude_m, frame=MavFrame.GLOBAL_TERRAIN_ALT):
    latitude, longitude, _ = FRAME.global_from_local(0.0, north_m, 0.0)
    return item(
        sequence, frame=frame, altitude_m=altitude_m,
        latitude_e7=round(1e7 * latitude), longitude_e7=round(1e7 * longitude),
    )  # fmt: skip


ITEMS = (item(0), over(1, 0.0, 100.0), over(2, 1200.0, 100.0), over(3, 450.0, 50.0))


@pytest.fixture
def made(monkeypatch):
    """A state whose autopilot has these items, and heights of the hill."""
    for module in (loiter_circles, start_prediction):
        monkeypatch.setattr(module, "stored_ground", lambda state: GROUND)
    before = begun(text=OPEN.replace("dimension: 2", "dimension: 3"))
    operator = operator_of(ITEMS, FRAME, 584.0, num_home_items=1)
    return replace(before, mission_list=replace(before.mission_list, stored=ITEMS, operator=operator))


def test_an_item_over_terrain_lies_as_high_over_the_stored_ground(made):
    assert place_of(made, ITEMS[2]) == pytest.approx((0.0, 1200.0, 100.0), abs=0.6)
    assert place_of(made, ITEMS[3])[1:] == pytest.approx((450.0, 50.0 + 0.5 * HILL_M), abs=1.0)
    goals = goals_of_operator(made.mission_list.operator, FRAME, 584.0, GROUND)
    assert [goal.sequence for goal in goals] == [1, 2, 3]
    assert goals_of_operator(made.mission_list.operator, FRAME, 584.0) == ()
    assert not any("terrain" in fault for fault in operator_summary_of(made, None, 1).faults)


def test_without_a_map_the_first_item_over_terrain_is_a_fault(made, monkeypatch):
    monkeypatch.setattr(loiter_circles, "stored_ground", lambda state: None)
    assert "item 1: height over terrain" in operator_summary_of(made, None, 1).faults


def test_between_items_over_terrain_the_track_follows_the_ground(made):
    """From 100 m over the foot of the hill; at 4.3 m/s of climb the hill is followed at 22 m/s and more."""
    here = state(north=0.0, up=100.0, course=0.0)
    track = list_track(made, MissionCurrent(1.0, 2, 3, 0), here)
    leg = track.positions_enu_m[(track.reached == 0) & (track.positions_enu_m[:, 1] < 1100.0)]
    hill = hill_at(FRAME.latitude_deg + leg[:, 1] / 111_195.0) - FRAME.altitude_amsl_m
    assert leg[:, 2] - hill == pytest.approx(100.0, abs=12.0)
    assert leg[:, 2].max() > 100.0 + 0.8 * HILL_M


def test_between_items_above_the_sea_it_does_not(made):
    level = tuple(
        replace(entry, frame=MavFrame.GLOBAL, altitude_m=684.0) if entry.command == Command.NAV_WAYPOINT
        else entry for entry in ITEMS
    )  # fmt: skip
    listed = replace(made.mission_list, stored=level)
    track = list_track(
        replace(made, mission_list=listed), MissionCurrent(1.0, 2, 3, 0), state(up=100.0, course=0.0)
    )
    assert track.positions_enu_m[:40, 2] == pytest.approx(100.0, abs=0.5)
