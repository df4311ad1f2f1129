"""Flights of an aircraft that slips in turns: at a bank it turns less than a coordinated aircraft does."""

import math

import numpy as np
import pytest
import shapely

from companion.config import load_mission
from companion.tracking.ownship import CoordinationEstimate
from companion.types.events import Dialect
from sim.vehicle.attitude import AttitudeController
from tests.sim.client import CONFIGS
from tests.support.sitl_harness import SitlHarness

WRONG_RUDDER = 0.07  # Times the sine of the bank [rad]: it turns at 0.7 of a coordinated rate.


def off_path_m(seed):
    """A flight over paper-2d, and its distance from the path that it flies, in 95 % [m]."""
    harness = SitlHarness(load_mission(CONFIGS / "paper-2d.yaml"), dialect=Dialect.ARDUPILOT, seed=seed)
    off = []

    def note(harness):
        flown, harness.is_over = harness.app.state.flown, harness.app.state.num_reached == 1
        true = harness.simulator.autopilot.flight.dynamics.state
        if flown is not None:
            path = shapely.linestrings(flown.path.positions_enu_m[:, :2])
            off.append(shapely.distance(path, shapely.points(true.east_m, true.north_m)))

    harness.fly(200.0, note)
    assert harness.app.state.num_reached == 1
    return harness, np.percentile(off, 95.0)


@pytest.fixture
def slips(monkeypatch):
    rudder = AttitudeController._rudder

    def wrong(controller, estimate, scale):
        held = rudder(controller, estimate, scale) + WRONG_RUDDER * math.sin(estimate.bank_rad)
        return max(-0.3, min(0.3, held))

    monkeypatch.setattr(AttitudeController, "_rudder", wrong)


@pytest.mark.usefixtures("slips")
def test_turns_are_foreseen_as_the_aircraft_flies_them(monkeypatch):
    """With turns taken for coordinated, it is far off its path for a while, and nearer to a wall."""
    ours, ours_m = off_path_m(1)
    assert 0.65 < ours.app.state.coordination < 0.9
    monkeypatch.setattr(CoordinationEstimate, "share", 1.0)
    without, without_m = off_path_m(1)
    assert not ours.texts("off path")
    assert without.texts("off path")
    assert ours_m < 40.0 < 0.5 * without_m
