"""Flights of an aircraft that slips in turns: at a bank it turns less than a coordinated aircraft does."""

import math

import numpy as np
import pytest
import shapely

from companion.config import load_mission
from companion.flight.state import flight_state
from companion.tracking.ownship import CoordinationEstimate
from companion.types.events import Dialect
from sim.vehicle.attitude import AttitudeController
from tests.sim.client import CONFIGS
from tests.support.sitl_harness import SitlHarness

WRONG_RUDDER = 0.16  # Times the sine of the bank, at 25 m/s [rad]: it turns at 0.7 of a coordinated rate.


def flown(coordination=1.0):
    """A flight over paper-2d; its distance from its path in 95 %, and the least from a wall [m]."""
    mission = load_mission(CONFIGS / "paper-2d.yaml")
    vehicle = mission.vehicle.model_copy(update={"coordination": coordination})
    mission = mission.model_copy(update={"vehicle": vehicle})
    harness = SitlHarness(mission, dialect=Dialect.ARDUPILOT, seed=2)
    walls = shapely.union_all([shapely.Polygon(wall.polygon_enu_m) for wall in mission.obstacle_list])
    off, near = [], []

    def note(harness):
        flown, harness.is_over = harness.app.state.flown, harness.app.state.num_reached == 1
        true = harness.simulator.autopilot.flight.dynamics.state
        place = shapely.points(true.east_m, true.north_m)
        near.append(shapely.distance(walls, place))
        if flown is not None:
            path = shapely.linestrings(flown.path.positions_enu_m[:, :2])
            off.append(shapely.distance(path, place))

    harness.fly(200.0, note)
    assert harness.app.state.num_reached == 1
    return harness, np.percentile(off, 95.0), min(near)


@pytest.fixture
def slips(monkeypatch):
    rudder = AttitudeController._rudder

    def wrong(controller, estimate, scale):
        held = rudder(controller, estimate, scale) + WRONG_RUDDER * scale * math.sin(estimate.bank_rad)
        return max(-0.3, min(0.3, held))

    monkeypatch.setattr(AttitudeController, "_rudder", wrong)


@pytest.mark.usefixtures("slips")
def test_turns_are_foreseen_and_planned_as_the_aircraft_flies_them(monkeypatch):
    """With turns taken for coordinated, it leaves its path for a while, and touches a wall."""
    ours, ours_m, near_m = flown()
    assert ours.app.state.coordination < 0.75
    assert not ours.texts("off path")
    assert near_m > 15.0
    monkeypatch.setattr(CoordinationEstimate, "share", 1.0)
    without, without_m, touched_m = flown()
    assert without.texts("off path")
    assert ours_m < 50.0 < without_m
    assert touched_m == 0.0


@pytest.mark.usefixtures("slips")
def test_foreseen_turns_alone_are_not_enough(monkeypatch):
    """Planned as coordinated turns, it touches the same wall."""
    monkeypatch.setattr(flight_state, "COORDINATION_CHANGE", 1.0)
    planned, _, near_m = flown()
    assert planned.app.state.rules.vehicle.coordination == 1.0
    assert near_m == 0.0


@pytest.mark.usefixtures("slips")
def test_the_mission_file_tells_the_first_turn():
    """An aircraft that is known to slip is near its paths from the start."""
    _, off_m, near_m = flown(0.73)
    assert off_m < 25.0
    assert near_m > 30.0
