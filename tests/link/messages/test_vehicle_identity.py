"""Who is taken for the vehicle, and what is accept_heartbeat of heartbeats under its ids."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages.codec import Codec
from companion.link.messages.vehicle_identity import CANDIDATES_MAX, OTHERS_MAX, VehicleIdentity
from companion.types.events import Dialect, GlobalPosition, Heartbeat
from tests.link.pymavlink_frames import heartbeat, packed, position

VEHICLE, STRANGER = ("127.0.0.1", 14_550), ("127.0.0.1", 40_000)
AUTO, FBWA = 10, 5
ARMED, DISARMED = 217, 89
PX4_MISSION = 4 << 24 | 4 << 16


def heartbeats(codec, data, stamp_s, address=None):
    return [
        event
        for frame in codec.feed(data, stamp_s, address)
        for event in frame.events
        if isinstance(event, Heartbeat)
    ]


# --- which system


def test_the_first_autopilot_heard_is_not_the_vehicle_yet():
    codec = Codec()
    assert not codec.identity.has_candidate
    codec.feed(heartbeat(system=7) + position(system=7), 0.0)
    codec.feed(heartbeat(system=7), 0.5)
    assert codec.vehicle_system_id is None
    assert codec.identity.has_candidate
    codec.feed(heartbeat(system=7), 1.0)
    assert codec.vehicle_system_id == 7
    assert not codec.identity.has_candidate


def test_who_sends_heartbeats_alone_gives_way_to_an_autopilot():
    """A stranger who is there first, and has only heartbeats."""
    codec = Codec()
    for second in range(4):
        codec.feed(heartbeat(system=66), float(second))
    codec.feed(heartbeat(system=1) + position(), 3.5)
    codec.feed(heartbeat(system=1), 4.5)
    assert codec.vehicle_system_id == 1
    assert codec.identity.others == [66]


def test_an_autopilot_that_is_silent_until_it_is_asked_is_the_vehicle_in_the_end():
    codec = Codec()
    for second in range(5):
        assert codec.vehicle_system_id is None
        codec.feed(heartbeat(), float(second))
    assert codec.vehicle_system_id == 1


def test_the_mission_file_names_the_vehicle():
    codec = Codec(42)
    codec.feed(heartbeat(system=1) + position(), 0.0)
    codec.feed(heartbeat(system=1) + position(2_000), 1.0)
    assert codec.vehicle_system_id == 42
    assert codec.identity.others == [1]
    assert len(heartbeats(codec, heartbeat(system=42), 2.0)) == 1


def test_a_flood_of_candidates_and_of_autopilots_does_not_fill_the_memory():
    codec = Codec()
    for system in range(1, 250):
        codec.feed(heartbeat(system=system), 0.0, ("127.0.0.1", system))
    assert len(codec.identity._candidates) <= CANDIDATES_MAX
    named = Codec(255)
    for system in range(1, 250):
        named.feed(heartbeat(system=system), 0.0)
    assert len(named.identity.others) == OTHERS_MAX


# --- which address


def test_the_vehicle_speaks_from_one_address_until_it_falls_silent():
    codec = Codec(1)
    assert len(codec.feed(heartbeat(), 0.0, VEHICLE)) == 1
    assert codec.identity.peer == VEHICLE
    assert codec.feed(b"\xfd", 1.0, STRANGER) == codec.feed(heartbeat(), 1.0, STRANGER) == []
    assert codec.counters["other_address"] == 1
    assert codec.identity.peer == VEHICLE
    assert len(codec.feed(position(), 4.0, VEHICLE)) == 1
    assert codec.feed(heartbeat(), 9.0, STRANGER) == []  # five seconds since the vehicle spoke
    assert len(codec.feed(heartbeat(), 9.1, STRANGER)) == 1
    assert codec.identity.peer == STRANGER


def test_no_unverified_frame_moves_the_vehicle():
    """Of a message that no dialect knows the checksum cannot be told."""
    codec, unknown = Codec(1), bytes([0xFD, 1, 0, 0, 0, 1, 1, 0x60, 0xEA, 0, 5, 0, 0])
    codec.feed(heartbeat(), 0.0, VEHICLE)
    assert codec.feed(unknown, 100.0, STRANGER) == []
    assert codec.identity.peer == VEHICLE


def test_strangers_bytes_do_not_tear_the_vehicles_frames():
    codec, whole = Codec(1), heartbeat()
    assert codec.feed(whole[:8], 0.0, VEHICLE) == []
    assert codec.feed(b"\xfd\xff\x00" * 20, 0.0, STRANGER) == []
    assert len(codec.feed(whole[8:], 0.0, VEHICLE)) == 1


def test_others_may_speak_from_anywhere():
    codec = Codec(1)
    codec.feed(heartbeat(), 0.0, VEHICLE)
    assert len(codec.feed(heartbeat(system=255, component=190, kind=6, autopilot=8), 0.1, STRANGER)) == 1


# --- what its heartbeats say


def test_the_dialect_is_fixed_while_armed():
    """Heartbeats of a PX4 under an ArduPlane's ids: told, suspended, and nothing begins anew."""
    codec = Codec(1)
    (first,) = heartbeats(codec, heartbeat(custom_mode=AUTO, base_mode=ARMED), 0.0)
    assert (first.dialect, first.is_mission_mode, first.is_contradicted) == (Dialect.ARDUPILOT, True, False)
    (forged,) = heartbeats(codec, heartbeat(autopilot=12, custom_mode=PX4_MISSION), 0.5)
    assert (forged.dialect, forged.is_mission_mode, forged.is_contradicted) == (
        Dialect.ARDUPILOT,
        False,
        True,
    )
    (own,) = heartbeats(codec, heartbeat(), 1.0)
    assert (own.dialect, own.is_mission_mode, own.is_contradicted) == (Dialect.ARDUPILOT, False, True)
    (later,) = heartbeats(codec, heartbeat(), 5.6)
    assert (later.is_mission_mode, later.is_contradicted) == (True, False)


def test_on_the_ground_another_autopilot_may_follow_one_that_fell_silent():
    codec = Codec(1)
    heartbeats(codec, heartbeat(base_mode=DISARMED), 0.0)
    (early,) = heartbeats(codec, heartbeat(autopilot=12), 4.0)
    assert (early.dialect, early.is_contradicted) == (Dialect.ARDUPILOT, True)
    (late,) = heartbeats(codec, heartbeat(autopilot=12), 10.0)
    assert (late.dialect, late.is_contradicted) == (Dialect.PX4, False)


def test_two_who_speak_as_the_vehicle_are_not_acted_on():
    """Disarmed by one, armed by the other; by the third heartbeat that is no aircraft's."""
    codec, found = Codec(1), []
    for index, base_mode in enumerate((ARMED, DISARMED, ARMED, DISARMED)):
        found += heartbeats(codec, heartbeat(base_mode=base_mode), 0.5 * index)
    assert [event.is_contradicted for event in found] == [False, False, True, True]


def test_a_pilot_may_change_his_mind():
    codec, found = Codec(1), []
    for second, mode in enumerate((AUTO, FBWA, AUTO, AUTO, AUTO)):
        found += heartbeats(codec, heartbeat(custom_mode=mode), float(second))
    assert not any(event.is_contradicted for event in found)
    assert [event.is_mission_mode for event in found] == [True, False, True, True, True]


@given(
    said=st.lists(
        st.tuples(st.sampled_from(Dialect), st.booleans(), st.sampled_from("ABC"), st.floats(0.0, 2.0)),
        min_size=1,
        max_size=60,
    )
)
def test_whatever_heartbeats_say_the_dialect_never_changes_in_the_air(said):
    identity, now, before, was_armed = VehicleIdentity(1), 0.0, None, False
    for dialect, is_armed, mode, pause in said:
        now += pause
        accept_heartbeat, armed, is_contradicted = identity.accept_heartbeat(
            dialect, mode, now, is_armed=is_armed
        )
        assert before in (None, accept_heartbeat) or not was_armed
        assert is_contradicted or (accept_heartbeat is dialect and armed is is_armed)
        before, was_armed = accept_heartbeat, armed
        told = identity._reported
        assert len(told.mode_changes_s) <= 4
        assert len(told.armed_changes_s) <= 4


@pytest.mark.parametrize("address", [None, VEHICLE])
def test_the_vehicles_own_messages_are_believed_from_its_place(address):
    codec = Codec(1)
    codec.feed(heartbeat(), 0.0, address)
    events = [event for frame in codec.feed(position(), 0.1, address) for event in frame.events]
    assert [type(event) for event in events] == [GlobalPosition]
    attitude = packed(mavlink.MAVLink_attitude_message(2_000, 0.0, 0.0, 1.5, 0.0, 0.0, 0.0))
    assert len(codec.feed(attitude, 0.2, address)) == 1
