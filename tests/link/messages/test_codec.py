"""Decoding what arrives, whatever arrives."""

import math
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages.codec import Codec
from companion.link.messages.component import answer
from companion.link.messages.flight_modes import custom_mode_of
from companion.link.wire.decoded_frame import CommandAck, MissionAck
from companion.link.wire.tlog import read_tlog
from companion.types.events import (
    AirData,
    Attitude,
    Dialect,
    Emitter,
    EngineSpeed,
    EstimatorAccuracy,
    EstimatorHealth,
    GlobalPosition,
    GroundReported,
    Heartbeat,
    HomePosition,
    MissionCurrent,
    MissionItemReached,
    Motion,
    Rebooted,
    StatusText,
    SteeringTarget,
    TrackReport,
    WindEstimate,
)
from tests.link.pymavlink_frames import adsb, heartbeat, packed, position

DATA = Path(__file__).parents[2] / "data"
FRAMES = [heartbeat(), position(), adsb(), heartbeat(component=191, kind=18, autopilot=8)]


def started(**settings_):
    codec = Codec(1, **settings_)
    codec.feed(heartbeat(), 0.0)
    codec.counters.clear()
    return codec


def events(codec, data, stamp_s=10.0):
    return [event for frame in codec.feed(data, stamp_s) for event in frame.events]


def test_heartbeat_tells_the_mode():
    codec = Codec()
    assert events(codec, heartbeat(system=7) + position(system=7), 9.0) == []
    assert codec.vehicle_system_id is None
    assert events(codec, heartbeat(system=7)) == [
        Heartbeat(
            10.0,
            7,
            1,
            Dialect.ARDUPILOT,
            mode="AUTO",
            is_mission_mode=True,
            is_armed=True,
            motion=Motion.MISSION,
        )
    ]
    assert codec.vehicle_system_id == 7
    assert codec.own_ids == (7, 195)


@pytest.mark.parametrize(
    ("changes", "mode", "is_mission"),
    [
        ({"custom_mode": 11}, "RTL", False),
        ({"custom_mode": 99}, "MODE_99", False),
        ({"custom_mode": 10, "kind": 2}, "MODE_10", False),  # a copter's numbers mean something else
        ({"custom_mode": 10, "base_mode": 0}, "MODE_10", False),
        ({"autopilot": 12, "custom_mode": 4 << 24 | 4 << 16}, "MISSION", True),
        ({"autopilot": 12, "custom_mode": 3 << 24 | 4 << 16}, "LOITER", False),
        ({"autopilot": 12, "custom_mode": 6 << 16}, "OFFBOARD", False),
        ({"autopilot": 12, "custom_mode": 77 << 24 | 4 << 16}, f"MODE_{77 << 24 | 4 << 16}", False),
    ],
)
def test_modes(changes, mode, is_mission):
    (event,) = events(Codec(1), heartbeat(**changes))
    assert (event.mode, event.is_mission_mode) == (mode, is_mission)


def test_modes_by_name():
    assert custom_mode_of(Dialect.ARDUPILOT, "AUTO") == 10
    assert custom_mode_of(Dialect.ARDUPILOT, "MISSION") is None
    assert custom_mode_of(Dialect.PX4, "MISSION") == 4 << 24 | 4 << 16
    assert custom_mode_of(Dialect.PX4, "OFFBOARD") == 6 << 16
    assert custom_mode_of(Dialect.PX4, "FBWA") is None


def test_what_pymavlink_cannot_decode_is_counted():
    codec = started()

    def broken(_data):
        raise mavlink.MAVError("cannot be")

    codec._reader.decode = broken
    (frame,) = codec.feed(FRAMES[0], 0.0)
    assert (frame.raw, frame.events) == (FRAMES[0], ())
    assert codec.counters["undecodable"] == 1


def test_heartbeats_of_others_are_not_the_autopilots():
    codec = started()
    assert events(codec, heartbeat(system=2)) == []
    assert events(codec, heartbeat(system=255, component=190, kind=6, autopilot=8)) == []
    assert codec.vehicle_system_id == 1


def test_position():
    (event,) = events(started(), position())
    assert event == GlobalPosition(
        stamp_s=10.0,
        boot_s=1.0,
        latitude_deg=pytest.approx(-35.363261),
        longitude_deg=pytest.approx(149.16523),
        altitude_amsl_m=pytest.approx(684.0),
        height_above_home_m=pytest.approx(100.0),
        velocity_enu_m_s=pytest.approx((20.0, 1.0, 0.5)),
    )


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (mavlink.MAVLink_vfr_hud_message(22.5, 24.0, 90, 50, 600.0, 0.0), AirData(10.0, 22.5, 24.0, 0.5)),
        (mavlink.MAVLink_attitude_message(5, 0.5, -0.25, 1.5, 0, 0, 0), Attitude(10.0, 0.5, -0.25, 1.5)),
        (mavlink.MAVLink_mission_item_reached_message(4), MissionItemReached(10.0, 4)),
        (mavlink.MAVLink_statustext_message(4, b"Reached\x07 1"), StatusText(10.0, 4, "Reached 1")),
        (
            mavlink.MAVLink_home_position_message(
                -353_632_610, 1_491_652_300, 584_000, *[0] * 3, [0] * 4, *[0] * 3
            ),
            HomePosition(10.0, pytest.approx(-35.363261), pytest.approx(149.16523), 584.0),
        ),
        (
            mavlink.MAVLink_position_target_global_int_message(
                5, 0, 0, -353_632_610, 1_491_652_300, 684.5, *[0.0] * 8
            ),
            SteeringTarget(10.0, pytest.approx(-35.363261), pytest.approx(149.16523), 684.5),
        ),
        (
            mavlink.MAVLink_esc_telemetry_1_to_4_message(
                bytes(4), (0,) * 4, (0,) * 4, (0,) * 4, (0, 6_999, 5_000, 0), (0,) * 4
            ),
            EngineSpeed(10.0, "ESC_TELEMETRY_1_TO_4", 6_999.0),
        ),
        (mavlink.MAVLink_rpm_message(4_500.0, 0.0), EngineSpeed(10.0, "RPM", 4_500.0)),
        (
            mavlink.MAVLink_terrain_report_message(-353_632_610, 1_491_652_300, 100, 612.5, 80.0, 3, 504),
            GroundReported(
                10.0,
                "autopilot",
                612.5,
                None,
                (pytest.approx(-35.363261), pytest.approx(149.16523)),
                100.0,
                3,
                504,
            ),
        ),
        (
            mavlink.MAVLink_distance_sensor_message(5, 20, 12_000, 8_050, 0, 0, 25, 255),
            GroundReported(10.0, "range finder", None, pytest.approx(80.5)),
        ),
        (
            mavlink.MAVLink_altitude_message(0, 9.0, 700.0, 100.0, 100.0, math.nan, 80.0),
            GroundReported(10.0, "estimator", 620.0),
        ),
        (
            mavlink.MAVLink_wind_message(270.0, 8.0, 0.0),
            WindEstimate(10.0, pytest.approx(8.0), pytest.approx(0.0, abs=1e-9)),
        ),
        (mavlink.MAVLink_wind_cov_message(0, 3.0, 4.0, *[0.0] * 6), WindEstimate(10.0, 4.0, 3.0)),
        (mavlink.MAVLink_mission_current_message(3, 7, 3, 1), MissionCurrent(10.0, 3, 7, 0, 3)),
        (mavlink.MAVLink_mission_current_message(0, 65535, 1, 0), MissionCurrent(10.0, 0, 0, 0, 1)),
        (mavlink.MAVLink_mission_current_message(3, 0, 0, 0), MissionCurrent(10.0, 3, None, 0)),
    ],
    ids=lambda value: value.get_type() if isinstance(value, mavlink.MAVLink_message) else "",
)
def test_telemetry(message, expected):
    codec = started()
    assert events(codec, packed(message)) == [expected]
    assert events(codec, packed(message, system=2)) == []
    assert events(codec, packed(message, component=191)) == []


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_distance_sensor_message(5, 20, 12_000, 8_050, 0, 0, 0, 255),  # It looks ahead.
        mavlink.MAVLink_distance_sensor_message(5, 20, 12_000, 12_000, 0, 0, 25, 255),  # Out of its range.
        mavlink.MAVLink_altitude_message(0, 9.0, 700.0, 100.0, 100.0, math.nan, math.nan),
        mavlink.MAVLink_altitude_message(0, 9.0, 700.0, 100.0, 100.0, math.nan, -1.0),
    ],
)
def test_what_measures_no_ground_is_no_report(message):
    codec = started()
    assert events(codec, packed(message)) == []
    assert codec.counters["refused_ground"] == 0


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_terrain_report_message(-353_632_610, 1_491_652_300, 100, math.nan, 80.0, 3, 504),
        mavlink.MAVLink_terrain_report_message(-353_632_610, 1_491_652_300, 100, -1e9, 80.0, 3, 504),
        mavlink.MAVLink_distance_sensor_message(5, 200, 100, 150, 0, 0, 25, 255),
        mavlink.MAVLink_altitude_message(0, 9.0, math.inf, 100.0, 100.0, math.nan, 80.0),
        mavlink.MAVLink_altitude_message(0, 9.0, 700.0, 100.0, 100.0, math.nan, 1e9),
    ],
)
def test_impossible_ground_is_dropped_and_counted(message):
    codec = started()
    assert events(codec, packed(message)) == []
    assert codec.counters["refused_ground"] == 1


# Flags of ESTIMATOR_STATUS and EKF_STATUS_REPORT: 831 is what both autopilots tell in good flight.
@pytest.mark.parametrize(
    ("message", "fault"),
    [
        (mavlink.MAVLink_ekf_status_report_message(831, *[0.0] * 5), ""),
        (mavlink.MAVLink_ekf_status_report_message(831 - 16, *[0.0] * 5), "the autopilot has no position"),
        (
            mavlink.MAVLink_ekf_status_report_message(831 + 128, *[0.0] * 5),
            "the autopilot takes it for constant",
        ),
        (mavlink.MAVLink_ekf_status_report_message(831 + 32768, *[0.0] * 5), "GPS glitch"),
        (mavlink.MAVLink_gps_raw_int_message(0, 3, *[0] * 8), ""),
        (mavlink.MAVLink_gps_raw_int_message(0, 2, *[0] * 8), "no GPS fix"),
    ],
)
def test_what_the_estimator_finds_wrong(message, fault):
    assert events(started(), packed(message)) == [EstimatorHealth(10.0, message.get_type(), fault)]


@pytest.mark.parametrize(("flags", "fault"), [(831, ""), (831 + 1024, "GPS glitch")])
def test_a_px4_tells_accuracy_and_health_in_one(flags, fault):
    message = mavlink.MAVLink_estimator_status_message(0, flags, *[0.0] * 6, 1.5, 2.5)
    health = EstimatorHealth(10.0, "ESTIMATOR_STATUS", fault)
    assert events(started(), packed(message)) == [health, EstimatorAccuracy(10.0, 1.5, 2.5)]


def test_an_accuracy_that_cannot_be_true_hides_no_fault():
    codec = started()
    message = mavlink.MAVLink_estimator_status_message(0, 0, *[0.0] * 6, math.nan, 2.5)
    told = EstimatorHealth(10.0, "ESTIMATOR_STATUS", "the autopilot has no position")
    assert events(codec, packed(message)) == [told]
    assert codec.counters["refused_accuracy"] == 1


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (position(lat=910_000_000), "position"),
        (position(lon=-1_810_000_000), "position"),
        (position(lat=0, lon=0), "position"),
        (position(lat=2405, lon=-1833), "position"),  # of a real ArduPlane before its GPS had a fix
        (position(alt=-2_000_000), "altitude"),
        (position(alt=40_000_000), "altitude"),
        (position(vx=32_767, vy=32_767, vz=32_767), "velocity"),
        (packed(mavlink.MAVLink_vfr_hud_message(math.nan, 24.0, 90, 50, 0.0, 0.0)), "airspeed"),
        (packed(mavlink.MAVLink_vfr_hud_message(20.0, math.inf, 90, 50, 0.0, 0.0)), "ground_speed"),
        (packed(mavlink.MAVLink_attitude_message(5, math.nan, 0, 0, 0, 0, 0)), "attitude"),
        (packed(mavlink.MAVLink_wind_message(10.0, 1e9, 0.0)), "wind"),
        (packed(mavlink.MAVLink_wind_cov_message(0, math.nan, 0.0, *[0.0] * 6)), "wind"),
        (adsb(lat=910_000_000), "track_position"),
        (adsb(flags=0x0E), "track_position"),
        (adsb(flags=0x0D), "track_altitude"),
        (adsb(hor_velocity=60_000), "track_velocity"),
        (adsb(ICAO_address=0, callsign=b""), "track_identity"),
        (adsb(tslc=200), "track_old"),
        (position(system=42, alt=90_000_000), "track_altitude"),
    ],
)
def test_values_that_cannot_be_true_are_counted_by_reason(data, reason):
    codec = started()
    assert events(codec, data) == []
    assert codec.counters[f"refused_{reason}"] == 1


def test_reboot_is_told_once_and_a_late_frame_is_none():
    codec = started()
    assert len(events(codec, position(60_000))) == 1
    assert events(codec, position(50_000)) == []  # one that came late
    assert len(events(codec, position(60_200))) == 1
    assert events(codec, position(60_100)) == []  # out of order
    assert events(codec, position(900)) == []  # the first after a reboot could be late, too
    rebooted, first = events(codec, position(1_000))
    assert (rebooted, first.boot_s) == (Rebooted(10.0), 1.0)
    assert [type(event) for event in events(codec, position(1_100))] == [GlobalPosition]
    assert codec.counters["refused_late"] == 3


def test_a_reboot_is_told_though_the_position_is_not_known_yet():
    codec = started()
    events(codec, position(60_000))
    events(codec, position(900, lat=0, lon=0))
    assert events(codec, position(1_000, lat=0, lon=0)) == [Rebooted(10.0)]


def test_ids_younger_than_the_dialect_are_read_from_the_payload():
    codec = started()
    payload = bytes([3, 0, 7, 0, 3, 1]) + (966021795).to_bytes(4, "little")
    frame = _frame(42, payload, mavlink.MAVLink_mission_current_message.crc_extra)
    assert events(codec, frame) == [MissionCurrent(10.0, 3, 7, 966021795, 3)]
    payload = bytes([1, 195, 0, 0]) + (190762406).to_bytes(4, "little")
    frame = _frame(47, payload, mavlink.MAVLink_mission_ack_message.crc_extra)
    (decoded,) = codec.feed(frame, 1.0)
    assert decoded.reply == MissionAck(1.0, 0, 0, 190762406)


def _frame(message_id, payload, extra, system=1):
    body = bytes([len(payload), 0, 0, 0, system, 1]) + message_id.to_bytes(3, "little") + payload
    crc = mavlink.x25crc(bytearray(body) + bytes([extra])).crc
    return b"\xfd" + body + crc.to_bytes(2, "little")


def test_replies():
    codec = started()
    data = packed(mavlink.MAVLink_command_ack_message(224, 2, 0, 0, 1, 195))
    assert codec.feed(data, 1.0)[0].reply == CommandAck(1.0, 224, 2)
    assert codec.feed(packed(mavlink.MAVLink_command_ack_message(224, 2), system=9), 1.0)[0].reply is None


def test_frames_carry_what_was_received():
    codec = Codec(1)
    data = b"".join(FRAMES)
    frames = codec.feed(data, 0.0)
    assert b"".join(frame.raw for frame in frames) == data
    assert [(frame.system_id, frame.component_id, frame.message_id) for frame in frames] == [
        (1, 1, 0),
        (1, 1, 33),
        (200, 156, 246),
        (1, 191, 0),
    ]


def test_mavlink_1_is_understood():
    data = packed(mavlink.MAVLink_mission_item_reached_message(4), version=1)
    assert data[0] == 0xFE
    assert events(started(), data) == [MissionItemReached(10.0, 4)]


def test_signed_frames_are_understood():
    writer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    writer.signing.secret_key = bytes(32)
    writer.signing.sign_outgoing = True
    data = bytes(mavlink.MAVLink_mission_item_reached_message(4).pack(writer))
    assert events(started(), data + heartbeat())[0] == MissionItemReached(10.0, 4)


def test_a_damaged_length_does_not_swallow_what_follows():
    damaged = bytearray(FRAMES[0])
    damaged[1] = 255
    codec, behind = Codec(1), [FRAMES[1]] * 10
    assert codec.feed(bytes(damaged) + b"".join(behind[:2]), 0.0) == []  # it may have been true
    assert [frame.raw for frame in codec.feed(b"".join(behind[2:]), 0.0)] == behind


def test_a_damaged_frame_is_counted():
    damaged = bytearray(FRAMES[1])
    damaged[12] ^= 0x10
    codec = Codec(1)
    assert [frame.raw for frame in codec.feed(bytes(damaged) + FRAMES[0], 0.0)] == [FRAMES[0]]
    assert codec.counters["bad_checksum"] == 1


def test_unknown_messages_are_passed_on_undecoded():
    data = _frame(410, b"\x01\x02\x03", 0)
    codec = Codec(1)
    frames = codec.feed(data + FRAMES[0], 0.0)
    assert [frame.raw for frame in frames] == [data, FRAMES[0]]
    assert frames[0].events == ()
    assert codec.counters["unknown_message"] == 1


def test_own_frames_that_come_back_are_left_out():
    codec = started()
    assert codec.feed(codec.heartbeat(), 0.0) == []
    assert codec.counters["own"] == 1


def test_encoders_are_understood_by_pymavlink():
    codec = started()
    data = b"".join(
        [
            codec.heartbeat(),
            codec.heartbeat(mavlink.MAV_STATE_CRITICAL),
            codec.status_text(4, "swap: plan 12, ΔQ"),
            codec.status_text(6, "x" * 120),
            codec.set_message_interval(33, 10.0),
            codec.request_message(242),
            codec.set_current_command(9, 1),
            codec.set_current_message(9),
            codec.set_mode(10),
            codec.set_mode(4 << 24 | 4 << 16),
            codec.command_ack(400, 3, 255, 190),
            codec.named_value(12.5, "quality_of_plan", 0.75),
            codec.mission_refusal(255, 190),
        ]
    )
    messages = mavlink.MAVLink(None).parse_buffer(data)
    assert [message.get_seq() for message in messages] == list(range(len(messages)))
    assert {(message.get_srcSystem(), message.get_srcComponent()) for message in messages} == {(1, 195)}
    beat, critical, text, *chunks = messages[:6]
    assert (beat.type, beat.autopilot, beat.system_status, critical.system_status) == (18, 8, 4, 5)
    assert text.text == "swap: plan 12, ?Q"
    assert [(chunk.text, chunk.id, chunk.chunk_seq) for chunk in chunks] == [
        ("x" * 50, 1, 0),
        ("x" * 50, 1, 1),
        ("x" * 20, 1, 2),
    ]
    interval, request, current, message, auto, mission, ack, value, refusal = messages[6:]
    assert (interval.command, interval.param1, interval.param2) == (511, 33.0, 100_000.0)
    assert (request.command, request.param1) == (512, 242.0)
    assert (current.command, current.param1, current.confirmation) == (224, 9.0, 1)
    assert message.seq == 9
    assert (auto.command, auto.param1, auto.param2, auto.param3) == (176, 1.0, 10.0, 0.0)
    assert (mission.param1, mission.param2, mission.param3) == (1.0, 4.0, 4.0)
    assert (ack.command, ack.result, ack.target_system) == (400, 3, 255)
    assert (value.time_boot_ms, value.name, value.value) == (12_500, "quality_of", 0.75)
    assert (refusal.type, refusal.target_component) == (3, 190)


@settings(deadline=None)
@given(st.lists(st.binary(max_size=400), max_size=6))
@example([b"\xfd"])
@example([b"\xfd\x00\x00" * 100])
def test_random_bytes_never_raise(chunks):
    codec = Codec(1)
    for chunk in chunks:
        codec.feed(chunk, 0.0)


@settings(deadline=None)
@given(st.lists(st.sampled_from(FRAMES), min_size=1, max_size=5), st.data())
def test_flipped_bits_never_raise_and_never_touch_other_frames(frames, data):
    stream = bytearray(b"".join(frames))
    index = data.draw(st.integers(0, len(frames[0]) - 1))
    stream[index] ^= 1 << data.draw(st.integers(0, 7))
    kept = [frame.raw for frame in Codec(1).feed(bytes(stream) + FRAMES[0], 0.0)]
    assert kept[-len(frames) :] == [*frames[1:], FRAMES[0]]


@settings(deadline=None)
@given(st.sampled_from(FRAMES), st.data())
def test_cut_frames_never_raise(frame, data):
    codec = Codec(1)
    codec.feed(frame[: data.draw(st.integers(0, len(frame) - 1))], 0.0)
    behind = [FRAMES[0], FRAMES[1]] * 6  # a header cut short reaches over 280 bytes at most
    assert [found.raw for found in codec.feed(b"".join(behind), 0.0) if found.raw in behind] == behind


_KNOWN = sorted(mavlink.mavlink_map)


@settings(deadline=None, max_examples=300)
@given(st.sampled_from(_KNOWN), st.binary(max_size=255), st.sampled_from([1, 42]))
def test_any_payload_of_any_message_never_raises(message_id, payload, system):
    _check_payload(message_id, payload, system)


@pytest.mark.parametrize("payload", [b"", b"\xff" * 255, b"\x7f" * 255, b"\x00\x00\xc0\x7f" * 63])
def test_extreme_payloads_of_every_message(payload):
    for message_id in _KNOWN:
        _check_payload(message_id, payload, 1)
        _check_payload(message_id, payload, 42)


def _check_payload(message_id, payload, system):
    codec = started()
    extra = mavlink.mavlink_map[message_id].crc_extra
    frames = codec.feed(_frame(message_id, payload, extra, system), 5.0)
    if message_id == mavlink.MAVLINK_MSG_ID_SETUP_SIGNING:
        assert frames == []  # a key is not passed on
        return
    (frame,) = frames
    answer(frame, codec)
    for event in frame.events:
        _assert_finite(event)


@settings(deadline=None, max_examples=200)
@given(st.data())
def test_hostile_floats_never_pass(data):
    number = st.floats(width=32)
    roll, pitch, yaw, speed, direction = (data.draw(number) for _ in range(5))
    codec = started()
    for message in (
        mavlink.MAVLink_attitude_message(5, roll, pitch, yaw, 0, 0, 0),
        mavlink.MAVLink_vfr_hud_message(speed, roll, 90, 50, 0.0, 0.0),
        mavlink.MAVLink_wind_message(direction, speed, 0.0),
        mavlink.MAVLink_wind_cov_message(0, speed, direction, *[0.0] * 6),
        mavlink.MAVLink_estimator_status_message(0, 0, *[0.0] * 6, speed, direction),
    ):
        for event in events(codec, packed(message)):
            _assert_finite(event)
    message = mavlink.MAVLink_follow_target_message(
        0, 3, 10_000_000, 10_000_000, roll, [speed] * 3, [0] * 3, [0] * 4, [0] * 3, [yaw] * 3, 0
    )
    for event in events(codec, packed(message, system=42)):
        _assert_finite(event)


def _assert_finite(event):
    for name in event.__slots__:
        value = getattr(event, name)
        for number in value if isinstance(value, tuple) else (value,):
            assert not isinstance(number, float) or math.isfinite(number)


def replayed(name):
    codec = Codec(1)
    return codec, [
        event for entry in read_tlog(DATA / name) for event in events(codec, entry.raw, entry.time_s)
    ]


def of(kind, seen):
    return [event for event in seen if isinstance(event, kind)]


def test_a_real_arduplane_flight():
    codec, seen = replayed("arduplane-4.7dev-replace.tlog")
    modes = list(dict.fromkeys(event.mode for event in of(Heartbeat, seen)))
    assert modes == ["INITIALISING", "MANUAL", "AUTO"]
    assert {event.dialect for event in of(Heartbeat, seen)} == {Dialect.ARDUPILOT}
    missions = list(dict.fromkeys((event.sequence, event.total) for event in of(MissionCurrent, seen)))
    assert missions == [(0, None), (1, 6), (2, 6), (3, 6), (3, 7), (4, 7), (5, 7), (6, 7), (7, 7)]
    tracks = of(TrackReport, seen)
    assert len(tracks) == 260
    assert {(track.identity, track.emitter, track.source) for track in tracks} == {
        ("icao:D70001", Emitter.GROUND, "ADSB_VEHICLE 200/156")
    }
    assert any("Flight plan received" in event.text for event in of(StatusText, seen))
    assert not of(Rebooted, seen)
    assert set(codec.counters) == {"accepted", "own", "refused_position"}  # no position before the first fix


def test_a_real_px4_flight():
    codec, seen = replayed("px4-1.17dev-replace.tlog")
    assert list(dict.fromkeys(event.mode for event in of(Heartbeat, seen))) == ["LOITER", "MISSION"]
    missions = list(dict.fromkeys((event.total, event.mission_id) for event in of(MissionCurrent, seen)))
    assert missions == [(0, 0), (8, 966021795), (8, 190762406)]
    assert {track.identity for track in of(TrackReport, seen)} == {"icao:D70001"}
    assert len(of(TrackReport, seen)) == 135  # PX4's repetition only: the companion's own are not received
    assert len(of(WindEstimate, seen)) > 1_000
    assert len(of(EstimatorAccuracy, seen)) == 180
    assert set(codec.counters) == {"accepted", "unknown_message", "own", "refused_airspeed"}
