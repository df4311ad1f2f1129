"""The mission to copy from, flown whole: goal, determinism, and that the threat is what it turns for."""

import numpy as np
import pytest

from companion.mission.item_difference import difference
from tests.flights.flown import (
    fly,
    miss_distance_m,
    mission_named,
    reaches,
    shipped,
    stays_inside,
    touches_anything,
    true_places,
    uploads_in_flight,
)

pytestmark = pytest.mark.xdist_group("shipped flights")  # they share flights that are made once a process

NAME, PARKED = "first-flight", (950.0, 750.0)


def test_reaches_the_goal_clear_of_everything_with_missions_uploaded_in_flight():
    flight = shipped(NAME, 1)
    places = true_places(flight)
    assert reaches(flight.mission, places)
    assert not touches_anything(flight.mission, places)
    assert stays_inside(flight.mission, places)
    assert uploads_in_flight(flight) >= 2
    assert flight.document()["success"] is True


def test_the_report_agrees_with_the_true_path():
    flight = shipped(NAME, 1)
    document, places = flight.document(), true_places(flight)
    slant = np.hypot(np.hypot(*(places[:, :2] - PARKED).T), places[:, 2])  # the vehicle stands at up 0
    assert document["min_dt_distance_m"] == pytest.approx(slant.min(), abs=0.5)
    wall = np.array(flight.mission.obstacles[0].polygon_enu_m)
    away = np.linalg.norm(places[:, None, :2] - wall, axis=2).min()  # it is passed at a corner or farther
    assert document["min_obstacle_clearance_m"] <= away + 0.5
    assert document["collision"] is False
    assert document["replans"] == len(flight.recorder.plan_ms)
    times = np.array(document["true_path"])[:, 0]
    np.testing.assert_allclose(np.diff(times), 0.1, atol=1e-6)


def test_the_same_seed_flies_the_same_flight():
    first, again = shipped(NAME, 1), fly(mission_named(NAME), 1)
    assert first.document()["true_path"] == again.document()["true_path"]
    assert first.document()["dt_path"] == again.document()["dt_path"]
    assert len(first.recorder.missions) == len(again.recorder.missions)
    for one, other in zip(first.recorder.missions, again.recorder.missions, strict=True):
        assert one.stamp_s == other.stamp_s
        np.testing.assert_array_equal(one.positions_enu_m, other.positions_enu_m)
    assert first.simulator.autopilot.mission_items == again.simulator.autopilot.mission_items
    told = [
        [(entry.stamp_s, entry.kind, entry.text) for entry in f.recorder.decisions] for f in (first, again)
    ]
    assert told[0] == told[1]


def test_another_seed_flies_another():
    assert shipped(NAME, 1).document()["true_path"] != shipped(NAME, 2).document()["true_path"]


@pytest.mark.parametrize(("seed", "miss_m"), [(1, 200.0), (2, 180.0)])  # its threat radius is 250 m
def test_it_turns_away_for_the_parked_vehicle_and_for_nothing_else(seed, miss_m):
    """The same flight with and without it: over its place, or at a distance."""
    without = fly(mission_named(NAME, dynamic_threats=()), seed)
    assert reaches(without.mission, true_places(without))
    assert miss_distance_m(true_places(without), *PARKED) < 60.0
    avoiding = shipped(NAME, seed)
    assert reaches(avoiding.mission, true_places(avoiding))
    assert miss_distance_m(true_places(avoiding), *PARKED) > miss_m


def test_when_it_ends_the_autopilot_holds_a_mission_that_ends_in_a_loiter():
    flight = shipped(NAME, 1)
    banks, items = flight.app.state.mission_list.layout, flight.simulator.autopilot.mission_items
    bank = items[banks.first_of(banks.flown_index) :][: banks.size]
    assert bank[-1].command == 17
    assert difference((None, *banks.flown), (None, *bank)) == ""
