"""Ages of what is heard, by hand and on a service that flies."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import mission_from_text
from companion.flight.monitors.freshness_watch import Input
from companion.types.events import Dialect
from sim.faults import FaultyLink, LinkFaults
from tests.sim.client import PLAIN
from tests.support.sitl_harness import SitlHarness

BEGIN_S, END_S = 20.0, 32.0


@pytest.mark.parametrize(
    ("received_s", "now_s", "since_s", "fault"),
    [
        (10.0, 11.5, -math.inf, ""),
        (10.0, 11.6, -math.inf, "no position for 1.5 s"),
        (-math.inf, 11.6, 10.0, "no position for 1.5 s"),
        (-math.inf, 11.0, 10.0, ""),
        (5.0, 11.0, 10.0, ""),
    ],
)
def test_an_age_counts_from_when_it_was_to_be_heard(received_s, now_s, since_s, fault):
    assert Input("position", received_s, 1.5).fault(now_s, since_s) == fault


def test_what_is_heard_may_be_doubted():
    entry = Input("position", 10.0, 1.5, "it jumped by 40 m")
    assert entry.fault(10.5) == "position: it jumped by 40 m"
    assert entry.fault(12.0) == "no position for 1.5 s"


def silenced(*message_ids, dialect=Dialect.ARDUPILOT, begin_s=BEGIN_S, end_s=END_S, until_s=50.0):
    """A flight in which some of the autopilot's messages are lost for a while."""
    harness = SitlHarness(mission_from_text(PLAIN, "plain.yaml"), dialect=dialect)
    harness.link = FaultyLink(harness.simulator, LinkFaults(), seed=1)
    harness.flight.wire = harness.link

    def watch(frame, is_from_client):
        is_lost = begin_s <= harness.now_s < end_s and int.from_bytes(frame[7:10], "little") in message_ids
        return is_from_client or not is_lost

    harness.link.watch = watch
    harness.fly(until_s)
    return harness


def told(harness, kind):
    return [
        (decision.stamp_s, decision.text) for decision in harness.recorder.decisions if decision.kind == kind
    ]


@pytest.mark.parametrize("dialect", Dialect)
def test_without_a_position_nothing_is_planned_and_nothing_changed(dialect):
    harness = silenced(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, dialect=dialect)
    [(stale_s, words)] = told(harness, "stale")
    [(fresh_s, back)] = told(harness, "fresh")
    assert BEGIN_S < stale_s < BEGIN_S + 2.0
    assert words == "no position for 1.5 s; the flown mission stands"
    assert fresh_s == pytest.approx(END_S, abs=0.5)
    assert back == "position again, after 12 s"
    assert not harness.changes(BEGIN_S + 2.0, END_S)
    assert not [at for at, _ in told(harness, "swap") + told(harness, "keep") if BEGIN_S + 3.0 < at < END_S]
    assert [at for at, _ in told(harness, "swap") + told(harness, "keep") if END_S < at < END_S + 5.0]
    states = {
        message.system_status for at, message in harness.said("HEARTBEAT") if BEGIN_S + 3.0 < at < END_S
    }
    assert states == {mavlink.MAV_STATE_CRITICAL}
    before = [message.system_status for at, message in harness.said("HEARTBEAT") if 15.0 < at < BEGIN_S]
    assert set(before) == {mavlink.MAV_STATE_ACTIVE}


@pytest.mark.parametrize(
    ("message_id", "name"),
    [(mavlink.MAVLINK_MSG_ID_ATTITUDE, "attitude"), (mavlink.MAVLINK_MSG_ID_VFR_HUD, "airspeed")],
)
def test_what_can_be_worked_out_is_told_and_flown_without(message_id, name):
    """For a whole flight: the pilot hears of it once, within two seconds, and plans go on."""
    harness = silenced(message_id, begin_s=0.0, end_s=math.inf)
    [(stale_s, words)] = told(harness, "stale")
    assert stale_s < 4.0, "known to be armed with the second heartbeat, at 2 s"
    assert words == f"no {name} for 1.5 s"
    assert not told(harness, "fresh")
    assert len(told(harness, "swap")) >= 2


def test_without_the_item_flown_nothing_is_changed():
    harness = silenced(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, begin_s=BEGIN_S, end_s=40.0)
    [(stale_s, words)] = told(harness, "stale")
    assert BEGIN_S + 4.8 < stale_s < BEGIN_S + 5.5
    assert words == "no mission item for 5 s; the flown mission stands"
    assert not harness.changes(stale_s, 40.0)
    assert told(harness, "fresh")


def test_an_aircraft_on_the_ground_misses_nothing():
    harness = SitlHarness(mission_from_text(PLAIN, "plain.yaml"), on_ground=True)
    harness.fly(10.0)
    assert not told(harness, "stale")
