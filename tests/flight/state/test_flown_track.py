"""How the end of a mission is flown: circles that the last leg touches, and those moved into the bounds."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from companion.config import mission_from_text
from companion.flight.state import shaping
from companion.flight.state.mission_simulation import (
    PASSED_BY_M,
    UNSURE_M,
    airspeed_at_end,
    astray,
    is_circle_met,
    track_over,
)
from companion.flight.state.mission_construction import carried
from companion.mission.waypoints import waypoints_from_path
from companion.types.events import Dialect
from companion.types.path import straight_path
from tests.mission.made import path_along
from tests.sim.client import PLAIN
from tests.support.sitl_harness import SitlHarness

RADIUS, EAST = 125.0, 6000.0  # of the circle; of the bounds
CORNERS = "[[{0}, {2}], [{0}, {3}], [{1}, {3}], [{1}, {2}]]"
TOWER = "obstacles:\n  - {{name: tower, polygon_enu_m: " + CORNERS + ", base_m: 0, top_m: 300}}\n"


def state_of(more=""):
    return (
        SitlHarness(mission_from_text(PLAIN + more, "plain.yaml"), dialect=Dialect.ARDUPILOT)
        .fly(5.0)
        .app.state
    )


@pytest.fixture(scope="module")
def state():
    return state_of()


def northwards(circle_east, direction):
    """600 m to the north, 100 m inside the bounds, into a circle abreast of their end."""
    path = straight_path(
        2.0 * np.arange(13.0), 0.0, np.array([EAST - 100.0, 0.0, 100.0]), 0.0, 25.0,
        covariance_m2=np.zeros((3, 3)), threat_level=0.0, wind_enu_m_s=(0.0, 0.0),
    )  # fmt: skip
    waypoints = waypoints_from_path(path, 25.0, flies_by=True)
    centre = np.array([circle_east, 600.0, 100.0])
    return path, replace(waypoints, loiter_centre_enu_m=centre, loiter_radius_m=direction * RADIUS)


def test_a_circle_beside_the_end_is_met(state):
    for side in (-1.0, 1.0):
        path, waypoints = northwards(EAST - 100.0 + side * RADIUS, side)
        assert is_circle_met(waypoints)
    path, waypoints = northwards(EAST - 100.0 - RADIUS, -1.0)
    assert astray(state, path, waypoints) == (0.0, 0.0)


def test_a_circle_moved_over_the_end_is_not_and_only_one_way_round_stays_in_the_bounds(state):
    """Left of the leg by 25 m: to the left the aircraft is on it soon, to the right it swings out of them."""
    path, to_the_left = northwards(EAST - RADIUS, -1.0)
    assert not is_circle_met(to_the_left)
    assert astray(state, path, to_the_left) == (0.0, 0.0)
    _, to_the_right = northwards(EAST - RADIUS, 1.0)
    near, out = astray(state, path, to_the_right)
    farthest = track_over(state, path, to_the_right, 35.0).positions_enu_m[:, 0].max() - EAST
    assert near == 0.0
    assert out == pytest.approx(farthest - PASSED_BY_M, abs=1.0)
    assert out > 20.0


def test_what_stands_beside_such_a_circle_is_too_near():
    """The circle is as wide as the thin air makes it; a tower stands 25 m behind its westernmost place."""
    west = EAST - RADIUS - 1.07 * RADIUS
    near_state = state_of(TOWER.format(west - 45.0, west - 25.0, 590, 610))
    path, waypoints = northwards(EAST - RADIUS, -1.0)
    near, out = astray(near_state, path, waypoints)
    nearest = (track_over(near_state, path, waypoints, 35.0).positions_enu_m[:, 0] - (west - 25.0)).min()
    kept = float(near_state.mission.planning.clearance_min_m) + UNSURE_M
    assert (near, out) == (pytest.approx(kept - nearest, abs=1.0), 0.0)
    assert near > 0.0


def test_faster_it_swings_wider(state):
    """Commanded to 37 m/s it is on its circle at that speed, wherever it began."""
    path, waypoints = northwards(EAST - RADIUS, 1.0)
    hurried = replace(waypoints, airspeed_m_s=37.0)
    assert astray(state, path, hurried)[1] > astray(state, path, waypoints)[1] + 10.0


def test_what_is_slowed_down_is_slower_at_the_end(state):
    """37 m/s and 0.5 m/s² over 600 m: 37² - 600 = 769, 27.7 m/s; over 1,200 m it is at cruise."""
    path, _ = northwards(EAST - RADIUS, 1.0)
    fast = replace(path, speeds_m_s=np.full(len(path), 37.0))
    assert airspeed_at_end(fast, state.rules.vehicle, 25.0) == pytest.approx(math.sqrt(769.0))
    assert airspeed_at_end(fast, state.rules.vehicle, 37.0) == 37.0
    assert airspeed_at_end(path, state.rules.vehicle, 25.0) == 25.0


def round_a_corner(state):
    """A path that comes to 37.5 m/s, left by 80 degrees: how fast it is carried, and how near it comes so."""
    path = path_along((700.0, 28), (170.0, math.radians(-80.0), 9), (600.0, 24), course=0.5 * math.pi)
    path = replace(path, speeds_m_s=np.linspace(25.0, 37.5, len(path)))
    waypoints, wrong = carried(state, path, len(path) - 1)
    assert wrong == ()
    track = track_over(state, path, waypoints, 0.0, waypoints.airspeed_m_s).positions_enu_m[:, :2]
    walls = [shapely.Polygon(wall.polygon_enu_m) for wall in state.rules.obstacles]
    return waypoints.airspeed_m_s, min(
        (wall.distance(shapely.LineString(track)) for wall in walls), default=math.inf
    )


def test_what_would_fly_wide_into_something_is_carried_otherwise_or_at_cruise(state, monkeypatch):
    """Commanded to 37.5 m/s it passes 28 m outside the turn, at 25 m/s nine; a tower stands there."""
    assert round_a_corner(state) == (37.5, math.inf)
    beside_it, nearer = (state_of(TOWER.format(east, 910.0, 105, 125)) for east in (890.0, 876.0))
    airspeed, nearest = round_a_corner(beside_it)  # with waypoints closer together
    assert airspeed == 37.5
    assert nearest > float(beside_it.mission.planning.clearance_min_m)
    airspeed, nearest = round_a_corner(nearer)
    assert airspeed == 25.0
    assert nearest > nearer.rules.checker.limits.margin_m
    # Looked at as fast as it begins only, and never at cruise, it flies into either.
    monkeypatch.setattr(shaping, "_is_fast", lambda *_: False)
    monkeypatch.setattr(shaping, "commanded_airspeed_m_s", lambda path, _: float(path.speeds_m_s[-1]))
    monkeypatch.setattr(shaping, "FASTER_M_S", 100.0)
    for somewhere in (beside_it, nearer):
        airspeed, nearest = round_a_corner(somewhere)
        assert airspeed == 37.5
        assert nearest < 1.0
