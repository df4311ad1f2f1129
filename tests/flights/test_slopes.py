"""Heights along legs: autopilots climb and descend as their parameters say."""

import numpy as np
import pytest

from companion.config import mission_from_text
from companion.types.events import Dialect
from tests.sim.client import PLAIN
from tests.support.sitl_harness import SitlHarness

# A wall 600 m thick that can only be flown over, by 150 m more than start and goal are high.
OVER_A_WALL = (
    (
        PLAIN.replace("dimension: 2", "dimension: 3")
        .replace("north_m: [-6000, 6000], up_m: [60, 160]", "north_m: [-1500, 1500], up_m: [60, 400]")
        .replace("east_m: 1750, north_m: 750", "east_m: 4500, north_m: 0")
    )
    + """obstacles:
  - name: wall
    polygon_enu_m: [[2000, -1600], [2600, -1600], [2600, 1600], [2000, 1600]]
    base_m: 0
    top_m: 250
"""
)
EACH_CLIMB_AT_ONCE = 1 << 14


def flown_over_the_wall(parameters, dialect):
    """The flight, and least height over the wall and 30 m beside it [m]."""
    harness = SitlHarness(mission_from_text(OVER_A_WALL, "wall.yaml"), dialect=dialect)
    for name, value in parameters.items():
        harness.simulator.autopilot.parameters[name] = value
    flown = []

    def note(harness):
        true = harness.simulator.autopilot.flight.dynamics.state
        flown.append((true.east_m, true.up_m))

    harness.fly(210.0, note)
    east, up = np.array(flown).T
    return harness, up[(east > 1970.0) & (east < 2630.0)].min()


@pytest.mark.parametrize(("slope_min_m", "options"), [(15, 0), (0, 0), (40, 0), (15, EACH_CLIMB_AT_ONCE)])
def test_an_arduplane_flies_over_a_wall_at_the_heights_of_the_path(slope_min_m, options):
    """With slopes taken for granted the second flight was 39 m below its path behind the wall.

    The wall is passed 50 m above its top; 30 m is the least that a path may have. That flight had 29.9 m.
    """
    parameters = {"ALT_SLOPE_MIN": slope_min_m, "FLIGHT_OPTIONS": options}
    harness, least_m = flown_over_the_wall(parameters, Dialect.ARDUPILOT)
    assert least_m > 290.0
    assert not harness.texts("off path")
    assert harness.app.state.num_reached == 1


def test_a_px4_flies_over_a_wall_with_the_rates_that_are_its_defaults():
    """It climbs at 3 and descends at 2 m/s; the mission file's 10 degrees are 4.3 m/s.

    With paths of 10 degrees it was told three times to be 28 to 30 m above them, and once 101 m beside.
    """
    parameters = {"FW_T_CLMB_R_SP": 3.0, "FW_T_SINK_R_SP": 2.0}
    harness, least_m = flown_over_the_wall(parameters, Dialect.PX4)
    assert least_m > 290.0
    assert not harness.texts("off path")
    assert harness.app.state.num_reached == 1
