"""Messages of a team: TUNNEL to everybody, and the autopilot's UTC time."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages.codec import Codec
from companion.types.events import ClockReported, TeamMessage
from tests.link.pymavlink_frames import heartbeat, packed


def events(codec, data, kind):
    return [event for frame in codec.feed(data, 5.0) for event in frame.events if isinstance(event, kind)]


@pytest.mark.parametrize(
    "payload", [b"\x11", bytes(range(128)), b"\x11\x00\x00"], ids=["one", "full", "zeros"]
)
def test_a_payload_arrives_as_it_was_sent_with_its_sender(payload):
    sender = Codec(7)
    sent = sender.team_message(payload)
    assert events(Codec(1), sent, TeamMessage) == [TeamMessage(5.0, 7, payload)]


def test_other_tunnels_and_the_own_echo_are_no_messages_of_the_team():
    other = mavlink.MAVLink_tunnel_message(0, 0, 0, 3, b"abc".ljust(128, b"\0"))
    assert events(Codec(1), packed(other, 7), TeamMessage) == []
    codec = Codec(7)
    assert events(codec, codec.team_message(b"abc"), TeamMessage) == []


def test_a_length_beyond_the_payload_is_cut():
    sent = mavlink.MAVLink_tunnel_message(0, 0, 0xA7E1, 255, b"abc".ljust(128, b"\0"))
    (event,) = events(Codec(1), packed(sent, 7), TeamMessage)
    assert len(event.payload) == 128


def test_utc_is_that_of_the_own_autopilot_once_it_has_a_fix():
    def reported(unix_us, system=1):
        message = mavlink.MAVLink_system_time_message(unix_us, 1_000)
        return events(Codec(1), heartbeat() + packed(message, system), ClockReported)

    assert reported(1_767_225_600_500_000) == [ClockReported(5.0, 1_767_225_600.5)]
    assert reported(0) == []
    assert reported(1_767_225_600_500_000, system=2) == []
