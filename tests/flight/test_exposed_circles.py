"""The circle at the end of a mission is put where no threat is; beside the same missions that do not look."""

import numpy as np
import pytest

from companion.config import mission_from_text
from companion.flight.state import shaping
from companion.flight.state.flown_track import is_circle_exposed
from companion.flight.state.shaping import waypoints_of
from companion.types.events import Dialect
from tests.flight.tasks.test_surprise import LONG
from tests.support.sitl_harness import SitlHarness

FAR = LONG.replace("sensing_horizon_m: 825", "sensing_horizon_m: 1500").replace(
    "threat_level_max: 0.3", "threat_level_max: 0.2"
)
RADAR = "radars: [{{name: r, east_m: 1230, north_m: {}, up_m: 100, max_threat_radius_m: 500}}]\n"


def circled(dialect, north):
    """How far the circle at the end of what is flown lies from the radar, and whether it is under threat."""
    harness = SitlHarness(mission_from_text(FAR + RADAR.format(north), "radar.yaml"), dialect=dialect)
    state = harness.fly(12.0).app.state
    waypoints, carried_s, wrong = waypoints_of(state, state.flown.path, state.mission_list.max_waypoints)
    assert wrong == ()
    away = np.hypot(waypoints.loiter_centre_enu_m[0] - 1230.0, waypoints.loiter_centre_enu_m[1] - north)
    return away, is_circle_exposed(state, waypoints, carried_s)


# Each autopilot's circle lies on another side of the path. The radar stands where it would reach that circle.
@pytest.mark.parametrize(
    ("dialect", "north"),
    [(Dialect.ARDUPILOT, -520.0), (Dialect.ARDUPILOT, -560.0), (Dialect.PX4, 580.0), (Dialect.PX4, 600.0)],
)
def test_should_the_service_fall_silent_it_circles_out_of_the_radar(dialect, north, monkeypatch):
    away, is_exposed = circled(dialect, north)
    assert not is_exposed
    monkeypatch.setattr(shaping, "SAFER_ROWS", 0)
    nearer, was_exposed = circled(dialect, north)
    assert was_exposed
    assert nearer < away
