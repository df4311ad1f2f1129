"""The simulator's height sensor over ground, and landings on ground that is not at home's height."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import mission_from_text
from companion.types.events import Dialect
from sim.simulator import Simulator
from tests.sim.client import CONFIGS, plain_mission

RIDGE = (CONFIGS / "ridge.yaml").read_text(encoding="utf-8")
START = "start: {east_m: 250, north_m: 1700, up_m: 150, course_deg: 90}"
BOTH = pytest.mark.parametrize("dialect", list(Dialect), ids=lambda dialect: dialect.value)


def measured(mission, dialect, seconds=10.0):
    """Messages of the height sensor, each with the true height over ground at that time."""
    simulator, parser, found = Simulator(mission, seed=1, dialect=dialect), mavlink.MAVLink(None), []
    parser.robust_parsing = True
    while simulator.now_s < seconds:
        simulator.step(0.02)
        flight = simulator._scenario.flight
        over = flight.dynamics.state.up_m - flight.ground_up_m
        messages = parser.parse_buffer(simulator.take_outgoing()) or []
        found += [(message, over) for message in messages if message.get_type() == "DISTANCE_SENSOR"]
    return found


def over_ridges(up_m=None):
    """The mission ``ridge``, or one that starts at another height."""
    assert START in RIDGE
    text = RIDGE if up_m is None else RIDGE.replace(START, START.replace("150", str(up_m)))
    return mission_from_text(text, "ridge.yaml")


@BOTH
def test_the_height_sensor_measures_down_once_a_second(dialect):
    """Level flight at 100 m over the valley, which 120 m of range allow; banked by 15° it is 3 m more."""
    found = measured(over_ridges(100), dialect)
    assert 9 <= len(found) <= 11
    for message, over in found:
        assert message.orientation == mavlink.MAV_SENSOR_ROTATION_PITCH_270
        assert (message.min_distance, message.max_distance) == (20, 12_000)
        assert message.signal_quality == 100
        slant = 0.01 * message.current_distance
        assert over - 0.5 < slant < over / math.cos(math.radians(50.0)) + 0.5
    assert 0.01 * found[0][0].current_distance == pytest.approx(found[0][1], abs=2.0)


def test_out_of_its_range_there_is_no_signal():
    found = [entry for entry in measured(over_ridges(), Dialect.ARDUPILOT, 3.0) if entry[1] > 121.0]
    assert found
    assert {(message.current_distance, message.signal_quality) for message, _ in found} == {(12_000, 1)}


def test_without_a_map_there_is_no_height_sensor():
    assert not measured(plain_mission(), Dialect.ARDUPILOT, 3.0)
