"""Flights whose cruise is little above AIRSPEED_MIN: an ArduPlane's stall prevention limits the bank."""

import math

import numpy as np
import shapely

from companion.config import load_mission
from companion.types.events import Dialect
from companion.types.state import AutopilotSettings
from tests.sim.client import CONFIGS
from tests.support.sitl_harness import SitlHarness

SLOWEST_M_S = 23.0  # The mission file cruises at 25 m/s.


def off_path_m(seed):
    """Distance of a flight over paper-2d from the path that it flies, in 95 % [m]."""
    harness = SitlHarness(load_mission(CONFIGS / "paper-2d.yaml"), dialect=Dialect.ARDUPILOT, seed=seed)
    harness.simulator.autopilot.parameters["AIRSPEED_MIN"] = SLOWEST_M_S
    off = []

    def note(harness):
        flown, harness.is_over = harness.app.state.flown, harness.app.state.num_reached == 1
        true = harness.simulator.autopilot.flight.dynamics.state
        if flown is not None and flown.path is not None:
            path = shapely.linestrings(flown.path.positions_enu_m[:, :2])
            off.append(shapely.distance(path, shapely.points(true.east_m, true.north_m)))

    harness.fly(200.0, note)
    assert harness.app.state.num_reached == 1
    return np.percentile(off, 95.0)


def test_missions_are_built_for_the_bank_that_stall_prevention_leaves(monkeypatch):
    """Without that, corners are flown wide."""
    ours_m = off_path_m(1)
    monkeypatch.setattr(AutopilotSettings, "bank_limit_rad", lambda *_: math.radians(50.0))
    without_m = off_path_m(1)
    assert ours_m < 25.0
    assert without_m > 35.0
