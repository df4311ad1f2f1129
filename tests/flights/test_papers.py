"""One flight of each of the paper's maps."""

import numpy as np
import pytest

from tests.flights.flown import (
    reaches,
    shipped,
    stays_inside,
    touches_anything,
    true_places,
    uploads_in_flight,
)

pytestmark = pytest.mark.xdist_group("shipped flights")  # they share flights that are made once a process

MAPS = ("paper-2d", "paper-3d")


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
