"""What we answer, and what we ask for."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages.codec import Codec
from companion.link.messages.component import answer
from companion.link.messages.streams import Streams
from companion.types.mavlink_enums import MessageId
from tests.link.pymavlink_frames import heartbeat, packed, position


def started(**changes):
    codec = Codec(1)
    codec.feed(heartbeat(**changes), 0.0)
    return codec


def answers(message, *, system=255, component=190):
    codec = started()
    data = b"".join(answer(frame, codec) for frame in codec.feed(packed(message, system, component), 0.0))
    return mavlink.MAVLink(None).parse_buffer(data) or []


def command(number, *, target=(1, 195), first=0.0):
    return mavlink.MAVLink_command_long_message(*target, number, 0, first, 0, 0, 0, 0, 0, 0)


@pytest.mark.parametrize("number", [400, 511, 22, 176])
def test_commands_are_refused_politely(number):
    (ack,) = answers(command(number))
    assert (ack.get_type(), ack.command, ack.result) == ("COMMAND_ACK", number, 3)
    assert (ack.target_system, ack.target_component) == (255, 190)


def test_commands_as_integers_are_refused_too():
    message = mavlink.MAVLink_command_int_message(1, 195, 0, 192, 0, 0, 0, 0, 0, 0, 0, 0, 0)
    assert answers(message)[0].result == 3


@pytest.mark.parametrize("target", [(1, 1), (0, 0), (1, 0), (2, 195), (1, 191)])
def test_commands_to_others_are_left_alone(target):
    assert answers(command(400, target=target)) == []


@pytest.mark.parametrize(("wanted", "kind"), [(148, "AUTOPILOT_VERSION"), (0, "HEARTBEAT")])
def test_requests_for_a_message(wanted, kind):
    ack, message = answers(command(512, first=wanted))
    assert (ack.result, message.get_type()) == (0, kind)


@pytest.mark.parametrize("wanted", [77, -1, 1e30, float("nan"), float("inf")])
def test_requests_for_a_message_we_do_not_have(wanted):
    assert [ack.result for ack in answers(command(512, first=wanted))] == [3]


def test_pings():
    (pong,) = answers(mavlink.MAVLink_ping_message(123_456, 9, 0, 0))
    assert (pong.time_usec, pong.seq, pong.target_system, pong.target_component) == (123_456, 9, 255, 190)
    assert answers(mavlink.MAVLink_ping_message(123_456, 9, 1, 195)) == []
    # A double holds neither: the last would round to 2**64, which no PING can say.
    for time_us in (2**53 + 1, 2**64 - 1):
        (pong,) = answers(mavlink.MAVLink_ping_message(time_us, 9, 0, 0))
        assert pong.time_usec == time_us


def test_missions_are_not_kept_here():
    for message in (
        mavlink.MAVLink_mission_request_list_message(1, 195),
        mavlink.MAVLink_mission_count_message(1, 195, 3),
    ):
        (ack,) = answers(message)
        assert (ack.get_type(), ack.type) == ("MISSION_ACK", 3)
    assert answers(mavlink.MAVLink_mission_count_message(1, 195, 3), system=1, component=1) == []


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_param_request_list_message(1, 195),
        mavlink.MAVLink_param_request_read_message(1, 195, b"X", -1),
        mavlink.MAVLink_param_set_message(1, 195, b"X", 1.0, 9),
        mavlink.MAVLink_statustext_message(6, b"hello"),
    ],
)
def test_what_needs_no_answer(message):
    assert answers(message) == []


def asked(streams, codec, now_s):
    messages = mavlink.MAVLink(None).parse_buffer(streams.due(codec, now_s)) or []
    return {int(message.param1): message for message in messages if getattr(message, "command", 0) == 511}


def note(streams, codec, data, stamp_s):
    for frame in codec.feed(data, stamp_s):
        streams.note(frame, stamp_s)


def test_nothing_is_asked_before_an_autopilot_is_heard():
    assert Streams(10.0).due(Codec(1), 0.0) == b""


@pytest.mark.parametrize(
    ("autopilot", "there", "absent"),
    [(3, MessageId.WIND, MessageId.ESTIMATOR_STATUS), (12, MessageId.WIND_COV, MessageId.WIND)],
)
def test_each_stream_is_asked_for_once(autopilot, there, absent):
    codec, streams = Codec(1), Streams(10.0)
    note(streams, codec, heartbeat(autopilot=autopilot), 0.0)
    first = asked(streams, codec, 0.0)
    assert there in first
    assert absent not in first
    assert first[MessageId.GLOBAL_POSITION_INT].param2 == pytest.approx(100_000.0)
    assert asked(streams, codec, 1.0) == {}


@pytest.mark.parametrize(("autopilot", "stored"), [(3, MessageId.TERRAIN_REPORT), (12, MessageId.ALTITUDE)])
@pytest.mark.parametrize("wanted", [True, False])
def test_the_ground_is_asked_for_where_there_is_a_map(autopilot, stored, wanted):
    codec, streams = Codec(1), Streams(10.0, with_ground=wanted)
    note(streams, codec, heartbeat(autopilot=autopilot), 0.0)
    first = asked(streams, codec, 0.0)
    assert (stored in first, MessageId.DISTANCE_SENSOR in first) == (wanted, wanted)


def test_home_and_the_version_are_asked_for_by_name_as_well():
    codec, streams = Codec(1), Streams(10.0)
    note(streams, codec, heartbeat(), 0.0)
    messages = mavlink.MAVLink(None).parse_buffer(streams.due(codec, 0.0))
    assert {int(message.param1) for message in messages if getattr(message, "command", 0) == 512} == {
        MessageId.HOME_POSITION, MessageId.AUTOPILOT_VERSION,
    }  # fmt: skip


def test_what_does_not_arrive_is_asked_for_again():
    codec, streams = Codec(1), Streams(10.0)
    note(streams, codec, heartbeat(), 0.0)
    asked(streams, codec, 0.0)
    for tick in range(1, 70):
        note(streams, codec, position(tick * 100), tick * 0.1)
    again = asked(streams, codec, 7.0)
    assert MessageId.VFR_HUD in again
    assert MessageId.GLOBAL_POSITION_INT not in again
    assert MessageId.VFR_HUD in streams.missing
    assert MessageId.GLOBAL_POSITION_INT not in streams.missing


def test_everything_is_asked_for_again_after_a_reboot():
    codec, streams = Codec(1), Streams(10.0)
    note(streams, codec, heartbeat() + position(60_000), 0.0)
    before = asked(streams, codec, 0.0)
    note(streams, codec, position(900) + position(1_000), 2.0)
    assert asked(streams, codec, 2.0).keys() == before.keys()


def test_another_autopilot_is_asked_for_its_own():
    codec, streams = Codec(1), Streams(10.0)
    note(streams, codec, heartbeat(), 0.0)
    asked(streams, codec, 0.0)
    note(streams, codec, heartbeat(base_mode=89), 1.0)  # not armed, and then silent
    note(streams, codec, heartbeat(autopilot=12), 6.5)
    assert MessageId.WIND_COV in asked(streams, codec, 6.5)
