"""Attacks of others on the link beside a flight: what the service does, and what it says."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.clock import ManualClock
from companion.config import mission_from_text
from companion.config.parameters.pilot_parameters import ENABLE
from companion.flight.messages.vehicle_link import VehicleLink
from companion.flight.state.modes import Mode
from companion.link.wire.memory_transport import MemoryTransport
from companion.recording.recorder import Recorder
from companion.types.events import Dialect
from companion.types.mavlink_enums import MessageId
from tests.hostile.intercepted import causes, intercepted
from tests.link.pymavlink_frames import heartbeat, position
from tests.support.sitl_harness import FIRST_FLIGHT, SitlHarness

PX4_MISSION = 4 << 24 | 4 << 16


def flown(until_s, attack, text=FIRST_FLIGHT, dialect=Dialect.ARDUPILOT):
    harness = SitlHarness(mission_from_text(text, "first-flight.yaml"), dialect=dialect)
    return harness.fly(until_s, attack)


def every(period_s, data_of):
    """Send to the service each so many seconds, from the third on."""
    sent = []

    def attack(harness):
        if harness.now_s > 3.0 and harness.now_s - (sent[-1] if sent else 0.0) > period_s:
            sent.append(harness.now_s)
            harness.app.link.receive(data_of(len(sent)))

    return attack


def parameter_set(value, system):
    message = mavlink.MAVLink_param_set_message(1, 195, ENABLE.encode(), value, 9)
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=190)))


def test_a_heartbeat_of_a_px4_neither_makes_an_arduplane_one_nor_forgets_what_is_flown():
    """Sixteen in eight seconds; once 416 questions, the flown plan forgotten, an emergency mission."""

    def forged(_):
        return heartbeat(autopilot=12, custom_mode=PX4_MISSION)

    harness = flown(20.0, every(0.5, forged))
    asked = [stamp for stamp, message in harness.said("COMMAND_LONG") if stamp > 4.0]
    assert len(asked) < 10
    assert harness.app.link.autopilot.dialect is Dialect.ARDUPILOT
    assert harness.app.mode is Mode.SUSPENDED
    assert harness.texts("link") == ["heartbeats contradict each other"]
    assert "heartbeats contradict (AUTO)" in harness.texts("suspended")
    assert harness.texts("emergency") == []
    assert harness.changes(after_s=5.0) == []


def test_it_goes_on_when_the_contradictions_are_over():
    def attack(harness):
        if 6.0 < harness.now_s < 6.03:
            harness.app.link.receive(heartbeat(autopilot=12, custom_mode=PX4_MISSION))

    harness = flown(40.0, attack)
    assert harness.texts("link") == ["heartbeats contradict each other", "heartbeats agree again"]
    assert harness.app.mode is Mode.ACTIVE
    assert harness.changes(after_s=12.0) != []


def test_parameters_are_set_by_those_alone_who_may():
    harness = flown(12.0, every(0.1, lambda number: parameter_set(0.0, system=66)))
    assert harness.app.link.codec.counters["refused_parameter_source"] > 5
    assert harness.app._parameters.is_replanning
    assert harness.texts("parameters") == []
    assert harness.texts("link") == ["who may not wants to set parameters"]


def test_who_switches_replanning_is_told_and_so_often_it_is_not():
    """Off and on a hundred times a second: two changes a second are taken."""
    harness = flown(12.0, every(0.01, lambda number: parameter_set(float(number % 2), system=255)))
    told = harness.texts("parameters")
    assert told[0] in (f"{ENABLE} is 0, by 255/190", f"{ENABLE} is 1, by 255/190")
    assert len(told) <= 2 * 9 + 8 + 2
    assert harness.app.link.codec.counters["unanswered"] > 100


def test_a_value_that_is_in_force_is_no_change():
    harness = flown(8.0, every(0.5, lambda number: parameter_set(1.0, system=255)))
    assert harness.texts("parameters") == []


def test_another_autopilot_is_told_once_and_not_flown():
    far = -352_632_610  # ten kilometres: near by it would be a threat
    harness = flown(
        12.0, every(0.5, lambda number: heartbeat(system=7) + position(number * 1_000, system=7, lat=far))
    )
    assert harness.texts("link") == ["autopilot 7 is heard, too; flying 1"]
    assert harness.app.num_swaps == 1


def test_a_flood_is_told_once_and_its_end_too():
    def pings(harness):
        if 4.0 < harness.now_s < 8.0:
            writer = mavlink.MAVLink(None, srcSystem=66, srcComponent=1)
            data = b"".join(bytes(mavlink.MAVLink_ping_message(0, n, 0, 0).pack(writer)) for n in range(100))
            harness.app.link.receive(data)

    harness = flown(24.0, pings)
    assert harness.texts("link") == ["flood: not all is heard", "the flood is over"]
    assert len(harness.said("PING")) < 400  # of 20,000: a kilobyte a second to one asker
    assert harness.app.mode is Mode.ACTIVE
    assert harness.app.num_swaps >= 1


def test_another_aircrafts_streams_do_not_hide_that_ours_are_lost():
    clock, mission = ManualClock(), mission_from_text(FIRST_FLIGHT + "\nlink: {vehicle_system_id: 1}\n", "m")
    link = VehicleLink(mission, MemoryTransport.pair()[0], clock, Recorder())
    for second in range(8):
        clock.advance_to(float(second))
        link.receive(heartbeat() + heartbeat(system=7) + position(second * 1_000, system=7))
        link.streams.due(link.codec, float(second))
    assert link.codec.vehicle_system_id == 1
    assert MessageId.GLOBAL_POSITION_INT in link.streams.missing


@pytest.mark.parametrize("seed", [4, 5])
def test_a_man_in_the_middle_without_the_key_causes_nothing_unchecked(seed):
    found = intercepted(seed, is_signed=True)
    assert causes(found, is_signed=True) == []
    assert sum(found["forged"].values()) > 3
    assert found["swaps"] >= 1


def test_what_he_must_not_cause_is_found():
    found = intercepted(5, is_signed=True)
    spoiled = found | {"violations": [["5.0", "mode RTL"]], "parameters": {ENABLE: 0.0}, "said": ["SET_MODE"]}
    assert len(causes(spoiled, is_signed=True)) == 3
    assert causes(spoiled | {"autopilot_parameters_changed": True}, is_signed=False) == [
        "the service said ['SET_MODE']", "autopilot's parameter",
    ]  # fmt: skip
