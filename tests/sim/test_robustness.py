"""Whatever a client sends, the autopilot goes on flying."""

from __future__ import annotations

import math
import re
import struct

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim.simulator import Simulator
from tests.sim.client import plain_mission

HANDLED = [
    *("COMMAND_LONG", "COMMAND_INT", "MISSION_COUNT", "MISSION_ITEM", "MISSION_ITEM_INT", "MISSION_REQUEST"),
    *("MISSION_REQUEST_INT", "MISSION_REQUEST_LIST", "MISSION_CLEAR_ALL", "MISSION_SET_CURRENT", "SET_MODE"),
    *("MISSION_WRITE_PARTIAL_LIST", "PARAM_SET", "PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "TIMESYNC"),
    *("PING", "REQUEST_DATA_STREAM", "ADSB_VEHICLE", "HEARTBEAT"),
]
TYPES = {kind.msgname: kind for kind in mavlink.mavlink_map.values()}
COMMANDS = [16, 17, 18, 20, 22, 176, 177, 178, 192, 224, 300, 400, 410, 510, 511, 512, 520, 5002, 65535]


@pytest.fixture(scope="module")
def simulator():
    return Simulator(plain_mission(), seed=1)


def frame(name: str, payload: bytes, command: int) -> bytes:
    """A frame of a type with any payload, but for the target and, unless negative, the command."""
    kind = TYPES[name]
    body = bytearray(payload[: kind.unpacker.size].ljust(kind.unpacker.size, b"\0"))
    fields = re.findall(r"\d*[a-zA-Z]", kind.unpacker.format.lstrip("<"))
    for key, value in (("target_system", 1), ("target_component", 1), ("command", command)):
        if key in kind.ordered_fieldnames and value >= 0:
            index = kind.ordered_fieldnames.index(key)
            struct.pack_into("<" + fields[index], body, struct.calcsize("<" + "".join(fields[:index])), value)
    header = bytes([0xFD, len(body), 0, 0, 0, 1, 195]) + kind.id.to_bytes(3, "little")
    checksum = mavlink.x25crc(header[1:] + bytes(body))
    checksum.accumulate([kind.crc_extra])
    return header + bytes(body) + struct.pack("<H", checksum.crc)


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    name=st.sampled_from(HANDLED), payload=st.binary(max_size=255), command=st.sampled_from([-1, *COMMANDS])
)
def test_any_message_with_any_content_is_survived(simulator, name, payload, command):
    dropped = simulator.autopilot.channels[0].num_dropped
    simulator.receive(frame(name, payload, command))
    assert simulator.autopilot.channels[0].num_dropped == dropped
    simulator.step(0.02)
    simulator.take_outgoing()
    assert math.isfinite(simulator.autopilot.flight.estimate.up_m)


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.binary(max_size=400))
def test_any_bytes_are_survived(simulator, data):
    simulator.receive(data)
    simulator.step(0.02)
    assert simulator.autopilot.channels[0].num_dropped >= 0


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 3.4e38])
@pytest.mark.parametrize("command", [16, 17, 18, 19, 22, 31, 177, 178, 206, 31_999])
def test_items_of_no_number_are_survived(simulator, command, value):
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=195)
    values = (value,) * 4
    for message in (
        mavlink.MAVLink_mission_count_message(1, 1, 1),
        mavlink.MAVLink_mission_item_message(1, 1, 0, 3, command, 0, 1, *values, value, value, value),
        mavlink.MAVLink_mission_write_partial_list_message(1, 1, 1, 1),
        mavlink.MAVLink_mission_item_int_message(1, 1, 1, 3, command, 0, 1, *values, 0, 0, value),
        mavlink.MAVLink_command_long_message(1, 1, 224, 0, 1, *(0.0,) * 6),
        mavlink.MAVLink_command_long_message(1, 1, command, 0, *values, value, value, value),
    ):
        simulator.receive(message.pack(mav))
        simulator.step(0.1)
    simulator.set_mode("LOITER")
    assert math.isfinite(simulator.autopilot.flight.estimate.up_m)
