"""An aircraft that crosses is passed well clear; beside the same flight that takes it for a vehicle."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import mission_from_text
from companion.tracking import threat_assigner
from companion.types.events import Dialect
from tests.flight.replanning.test_surprise import LONG
from tests.flight.test_geofences import BOTH
from tests.support.sitl_harness import SitlHarness

SPEED_M_S, MEET_S, PERIOD_S = 50.0, 60.0, 0.5
UNTIL_S = MEET_S + 20.0  # a kilometre past where they would have met, faster than it can be followed


def crossed(dialect, up_m=100.0, *, is_reported=True):
    """A flight whose way an aircraft crosses from the north; how near they came, and what was decided."""
    harness = SitlHarness(mission_from_text(LONG, "crossing.yaml"), dialect=dialect)
    near, due = [], [0.0]

    def place(now_s):
        return 25.0 * MEET_S, SPEED_M_S * (MEET_S - now_s)

    def on_step(harness):
        east, north = place(harness.now_s)
        own = harness.simulator.truth.path[-1]
        near.append(float(np.hypot(own[1] - east, own[2] - north)))
        if not is_reported or harness.now_s < due[0]:
            return
        due[0] += PERIOD_S
        latitude, longitude = harness.simulator.autopilot.projection.degrees(east, north)
        report = mavlink.MAVLink_adsb_vehicle_message(
            0x3C65AC, round(latitude * 1e7), round(longitude * 1e7), mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC,
            round(1e3 * (584.0 + up_m)), 18_000, round(100.0 * SPEED_M_S), 0, b"DLH1",
            mavlink.ADSB_EMITTER_TYPE_LIGHT, 0, 63, 0,
        )  # fmt: skip
        harness.simulator.autopilot.relay_traffic(report, (200, mavlink.MAV_COMP_ID_ADSB))

    harness.fly(UNTIL_S, on_step)
    return min(near), [(entry.kind, entry.text) for entry in harness.recorder.decisions]


@BOTH
def test_it_is_passed_well_clear_without_an_emergency(dialect):
    unaware, _ = crossed(dialect, is_reported=False)
    assert unaware < 150.0
    near, told = crossed(dialect)
    assert near > 609.6  # the well clear distance, 2000 ft
    assert "emergency" not in {kind for kind, _ in told}
    assert "traffic" in {kind for kind, _ in told}


@pytest.mark.slow
@BOTH
def test_taken_for_a_hunter_it_leaves_no_way(dialect, monkeypatch):
    monkeypatch.setattr(threat_assigner, "COOPERATIVE", frozenset())
    _, told = crossed(dialect)
    assert "emergency" in {kind for kind, _ in told}


@pytest.mark.parametrize("up_m", [200.0, 600.0])
def test_far_above_it_is_nothing(up_m):
    near, told = crossed(Dialect.PX4, up_m)
    assert near < 150.0
    assert {kind for kind, _ in told} <= {"mode", "mission", "takeover", "swap", "keep", "fault", "return"}


def turned_into(*, says_next):
    """A flight whose way an aircraft turns into: how near they came, and when the pilot was told.

    It flies west, abeam of the way, turns left at 3°/s, and flies south over where they would meet.
    """
    harness = SitlHarness(mission_from_text(LONG, "turning.yaml"), dialect=Dialect.PX4)
    speed, rate, straight_s = 40.0, math.radians(3.0), 20.0
    radius, turn_s = speed / rate, 0.5 * math.pi / rate
    begins_s = MEET_S - straight_s - turn_s
    corner = np.array([25.0 * MEET_S, speed * straight_s + radius])
    near, due = [], [0.0]

    def state(now_s):
        turned = rate * min(max(now_s - begins_s, 0.0), turn_s)
        flown = min(now_s - begins_s, 0.0), max(now_s - begins_s - turn_s, 0.0)
        place = corner + radius * np.array([1.0 - math.sin(turned), math.cos(turned) - 1.0])
        return (
            place + speed * np.array([-flown[0], -flown[1]]),
            speed * np.array([-math.cos(turned), -math.sin(turned)]),
        )

    def on_step(harness):
        place, velocity = state(harness.now_s)
        near.append(math.dist(harness.simulator.truth.path[-1][1:3], place))
        if harness.now_s < due[0]:
            return
        due[0] += 1.0
        there = corner if harness.now_s < begins_s else (corner[0], -4000.0)
        degrees = harness.simulator.autopilot.projection.degrees
        at, next_at = ([round(1e7 * value) for value in degrees(*where)] for where in (place, there))
        report = mavlink.MAVLink_utm_global_position_message(
            0, bytes(range(1, 19)), *at, 684_000, 0, *(round(100.0 * v) for v in velocity[::-1]), 0,
            2_500, 3_000, 500, *next_at, 684_000, 100, 3, 0xFF if says_next else 0x7F,
        )  # fmt: skip
        for channel in harness.simulator.autopilot.channels:
            channel.send_as(report, 200, 1)

    harness.fly(MEET_S + 20.0, on_step)
    return min(near), min(entry.stamp_s for entry in harness.recorder.decisions if entry.kind == "traffic")


def test_the_pilot_is_told_sooner_of_an_aircraft_that_says_where_it_flies_next():
    near, told_s = turned_into(says_next=True)
    _, without_s = turned_into(says_next=False)
    assert near > 609.6
    assert told_s < without_s - 2.0
