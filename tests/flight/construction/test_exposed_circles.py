"""The circle at the end of a mission is put where no threat is; compared with missions of one end only."""

import numpy as np
import pytest

from companion.config import mission_from_text
from companion.flight.construction import mission_construction
from companion.flight.construction.mission_construction import construct
from companion.flight.construction.mission_simulation import is_circle_exposed
from companion.types.events import Dialect
from tests.flight.replanning.test_surprise import LONG
from tests.support.sitl_harness import SitlHarness

FAR = LONG.replace("sensing_horizon_m: 825", "sensing_horizon_m: 1500").replace(
    "threat_level_max: 0.3", "threat_level_max: 0.2"
)
RADAR = "radars: [{{name: r, east_m: 1230, north_m: {}, up_m: 100, max_threat_radius_m: 500}}]\n"


def circled(dialect, north):
    """How far the circle at the end of what is flown lies from the radar, and whether it is under threat."""
    harness = SitlHarness(mission_from_text(FAR + RADAR.format(north), "radar.yaml"), dialect=dialect)
    state = harness.fly(12.0).app.state
    found = construct(state, state.flown.path, state.mission_list.max_waypoints)
    assert found.violations == ()
    away = np.hypot(*(found.waypoints.loiter_centre_enu_m[:2] - (1230.0, north)))
    return away, is_circle_exposed(state, found.waypoints, found.covered_until_s)


# The radar stands where it would reach the circle.
@pytest.mark.parametrize(
    ("dialect", "north"),
    [(Dialect.ARDUPILOT, -520.0), (Dialect.ARDUPILOT, -560.0), (Dialect.PX4, -520.0), (Dialect.PX4, -560.0)],
)
def test_should_the_service_fall_silent_it_circles_out_of_the_radar(dialect, north, monkeypatch):
    away, is_exposed = circled(dialect, north)
    assert not is_exposed
    monkeypatch.setattr(mission_construction, "ENDS_MAX", 1)
    nearer, was_exposed = circled(dialect, north)
    assert was_exposed
    assert nearer < away
