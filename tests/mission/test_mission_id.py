"""The name of a mission: against the names that a real PX4 gave."""

import math
import struct
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.wire.tlog import read_tlog
from companion.mission.mission_id import mission_id
from companion.types.mission import MissionItem
from tests.mission.made import item

RECORDED = Path(__file__).parents[1] / "data" / "px4-1.17dev-replace.tlog"


def recorded():
    """Uploads to a real PX4 as sent, each with the opaque id of its acknowledgement."""
    parser, items = mavlink.MAVLink(None), []
    for entry in read_tlog(RECORDED):
        try:
            message = parser.decode(bytearray(entry.raw))
        except mavlink.MAVError:
            continue  # of a message younger than the dialect
        if message.get_type() == "MISSION_COUNT":
            items = []
        elif message.get_type() == "MISSION_ITEM_INT":
            values = (message.param1, message.param2, message.param3, message.param4)
            items.append(
                MissionItem(
                    message.seq, message.command, message.frame,
                    tuple(None if math.isnan(value) else value for value in values),
                    message.x, message.y, message.z, bool(message.current), bool(message.autocontinue),
                )
            )  # fmt: skip
        elif message.get_type() == "MISSION_ACK":
            yield tuple(items), int.from_bytes(entry.raw[14:18], "little")


def test_the_ids_of_a_real_px4():
    uploads = list(recorded())
    assert [mission_id(items) for items, _ in uploads] == [told for _, told in uploads]
    assert [len(items) for items, _ in uploads] == [8, 8, 8]


def test_an_empty_mission_has_none():
    assert mission_id(()) == 0


def test_which_item_is_current_does_not_count():
    items = (item(0), item(1))
    assert mission_id(items) == mission_id((items[0], replace(items[1], is_current=True)))


@pytest.mark.parametrize(
    "change",
    [
        {"frame": 6}, {"command": 17}, {"autocontinue": False}, {"parameters": (1.0, 0.0, 0.0, None)},
        {"parameters": (0.0, 0.0, 0.0, 0.0)}, {"latitude_e7": 1}, {"longitude_e7": 1}, {"altitude_m": 684.01},
    ],
)  # fmt: skip
def test_everything_else_counts(change):
    items = (item(0), item(1))
    assert mission_id(items) != mission_id((items[0], replace(items[1], **change)))


def by_table(data):
    """PX4's own way, byte by byte."""
    table = []
    for number in range(256):
        entry = number
        for _ in range(8):
            entry = (entry >> 1) ^ (0xEDB88320 if entry & 1 else 0)
        table.append(entry)
    remainder = 0
    for byte in data:
        remainder = table[(remainder ^ byte) & 0xFF] ^ (remainder >> 8)
    return remainder


@given(
    st.lists(st.tuples(st.integers(0, 2**16 - 1), st.integers(-(2**31), 2**31 - 1), st.floats(width=32)),
             max_size=5)
)  # fmt: skip
def test_it_is_the_checksum_that_px4_computes(rows):
    items = [
        replace(item(number), command=command, latitude_e7=latitude, altitude_m=altitude)
        for number, (command, latitude, altitude) in enumerate(rows)
    ]
    packed = b"".join(
        struct.pack(
            "<BHBffffiif", each.frame, each.command, each.autocontinue,
            *(math.nan if value is None else value for value in each.parameters),
            each.latitude_e7, each.longitude_e7, each.altitude_m,
        )
        for each in items
    )  # fmt: skip
    assert mission_id(items) == by_table(packed)
