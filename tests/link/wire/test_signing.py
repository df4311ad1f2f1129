"""Signatures both ways, against pymavlink's own; times, files and limits."""

import itertools
import json
import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.errors import ConfigError
from companion.link.messages.codec import Codec, signer_of
from companion.link.wire.framing import frames_in, raw_frame
from companion.link.wire.key_file import read_key
from companion.link.wire.signing import STREAMS_MAX, Timestamps
from companion.link.wire.source_limits import SourceLimits
from tests.link.pymavlink_frames import packed

KEY = bytes(range(32))
NOW_S = 1_790_000_000.0
UNITS = 100_000
NOW = int((NOW_S - 1_420_070_400) * UNITS)


LAST = 2**48 - 1


def times(path=None, now_s=NOW_S, *, is_synchronised=True):
    return Timestamps(path, lambda: now_s, lambda: is_synchronised)


def made(key=KEY, link_id=3, allow=(), timestamps=None, *, mavlink1=False):
    return signer_of(key, link_id, timestamps or times(), allow, allow_mavlink1=mavlink1)


def theirs(message, *, key=KEY, time=NOW, link_id=1, system=1, component=1):
    """A frame signed by pymavlink."""
    writer = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    writer.signing.secret_key = key
    writer.signing.link_id = link_id
    writer.signing.timestamp = time
    writer.signing.sign_outgoing = True
    return bytes(message.pack(writer))


HEARTBEAT = mavlink.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3)
REPORT = mavlink.MAVLink_adsb_vehicle_message(1, 2, 3, 1, 4, 5, 6, 7, b"X", 18, 0, 63, 0)


# --- the signature itself


@pytest.mark.parametrize("message", [HEARTBEAT, REPORT, mavlink.MAVLink_ping_message(0, 0, 0, 0)])
def test_what_another_implementation_signs_is_believed(message):
    assert made().accepts(raw_frame(theirs(message)))


@pytest.mark.parametrize("message", [HEARTBEAT, REPORT, mavlink.MAVLink_ping_message(0, 0, 0, 0)])
def test_what_we_sign_another_implementation_believes(message):
    reader = mavlink.MAVLink(None)
    reader.signing.secret_key = KEY
    signed = made().signed(packed(message, component=195))
    (found,) = reader.parse_buffer(signed)
    assert found.get_type() == message.get_type()
    assert reader.signing.goodsig_count == 1
    assert found.get_signed()


def test_several_frames_in_one_piece_are_signed_each_with_a_later_time():
    data = made().signed(packed(HEARTBEAT) + packed(REPORT) + packed(HEARTBEAT))
    frames = list(frames_in(data))
    stamps = [int.from_bytes(raw[-12:-6], "little") for raw in frames]
    assert len(frames) == 3
    assert stamps == sorted(set(stamps))
    assert {raw[-13] for raw in frames} == {3}


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_any_bit_that_is_turned_is_noticed(data):
    good = theirs(REPORT)
    bit = data.draw(st.integers(0, 8 * len(good) - 1))
    bad = bytearray(good)
    bad[bit // 8] ^= 1 << (bit % 8)
    if bad[0] == 0xFD and bad[1] == good[1] and bad[2] == good[2]:
        assert not made().accepts(raw_frame(bytes(bad)))


def test_another_key():
    signer = made()
    assert not signer.accepts(raw_frame(theirs(HEARTBEAT, key=bytes(32))))
    assert signer.counters["bad_signature"] == 1


def test_what_is_unsigned_is_dropped_and_counted_but_for_those_allowed():
    signer = made(allow=(200,))
    assert not signer.accepts(raw_frame(packed(HEARTBEAT, system=1)))
    assert signer.accepts(raw_frame(packed(HEARTBEAT, system=200)))
    assert (signer.counters["unsigned"], signer.counters["allowed_unsigned"]) == (1, 1)


def test_mavlink_1_has_no_room_for_a_signature():
    old = bytes(HEARTBEAT.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True))
    assert not made().accepts(raw_frame(old))
    assert made().signed(old) == old


# --- times


def test_mavlink_1_is_refused_even_from_those_that_need_not_sign(tmp_path):
    old = raw_frame(bytes(HEARTBEAT.pack(mavlink.MAVLink(None, 200, 1), force_mavlink1=True)))
    signer = made(allow=(200,))
    assert not signer.accepts(old)
    assert signer.counters["mavlink1"] == 1
    signer = made(allow=(200,), mavlink1=True)
    assert signer.accepts(old)
    assert not signer.accepts(
        raw_frame(bytes(HEARTBEAT.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=True)))
    )


def test_a_frame_sent_again_is_rejected():
    signer, frame = made(), raw_frame(theirs(HEARTBEAT))
    assert signer.accepts(frame)
    assert not signer.accepts(frame)
    assert signer.counters["replayed"] == 1


def test_streams_have_times_of_their_own():
    signer = made()
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + 50)))
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + 10, component=2)))
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + 10, link_id=2)))
    assert not signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + 49)))


@pytest.mark.parametrize(("lag_s", "accepted"), [(59, True), (61, False)])
def test_a_new_stream_may_lag_a_minute_behind_the_newest(lag_s, accepted):
    signer = made()
    signer.accepts(raw_frame(theirs(HEARTBEAT)))
    late = theirs(HEARTBEAT, time=NOW - lag_s * UNITS, component=2)
    assert signer.accepts(raw_frame(late)) is accepted
    assert signer.counters["too_old"] == (0 if accepted else 1)


def test_a_recorded_flight_cannot_be_replayed_after_a_restart(tmp_path):
    path, frame = tmp_path / "times", raw_frame(theirs(HEARTBEAT))
    first = times(path)
    assert made(timestamps=first).accepts(frame)
    first.close()
    signer = made(timestamps=times(path, NOW_S - 1e6, is_synchronised=False))  # and the clock was set back
    assert not signer.accepts(frame)
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + 1)))


@pytest.mark.parametrize("set_back_s", [0.0, 3600.0, 1e8])
@pytest.mark.parametrize("is_closed", [True, False])
def test_our_own_times_never_come_twice_not_even_after_a_crash(tmp_path, set_back_s, is_closed):
    path = tmp_path / "times"
    before = times(path)
    used = [before.next() for _ in range(1000)]
    if is_closed:
        before.close()
    after = times(path, NOW_S - set_back_s)
    assert after.next() > max(used)
    assert used == sorted(set(used))


def test_times_follow_the_clock_where_it_goes_on():
    now = [NOW_S]
    timestamps = Timestamps(None, lambda: now[0])
    first = timestamps.next()
    now[0] += 10.0
    assert timestamps.next() - first == pytest.approx(10 * UNITS, abs=2)


def test_the_file_of_times_is_the_owners_alone(tmp_path):
    path = tmp_path / "times"
    times(path).next()
    assert path.stat().st_mode & 0o777 == 0o600
    assert json.loads(path.read_text())["own"] > NOW


DAMAGED = {
    "empty": b"",
    "an object": b"{}",
    "a list": b"[]",
    "deep": b"[" * 100_000,
    "large": b" " * 1_000_000 + b"{}",
    "a number that is none": b'{"own": Infinity, "streams": {}}',
    "five thousand digits": b'{"own": ' + b"9" * 5_000 + b', "streams": {}}',
    "streams of another kind": b'{"own": 1, "streams": {"1/2": 3}}',
    "no text": bytes(range(256)),
}


@pytest.mark.parametrize("content", DAMAGED.values(), ids=DAMAGED)
def test_a_damaged_file_of_times_is_set_aside_and_the_clock_counts(tmp_path, content, caplog):
    path = tmp_path / "times"
    path.write_bytes(content)
    timestamps = times(path)
    assert (timestamps.reference, timestamps.next(), timestamps.streams) == (NOW, NOW, {})
    assert (tmp_path / "times.damaged").read_bytes() == content
    assert caplog.text.count("times.damaged") == 1
    assert times(path).next() > NOW  # the new file is in its place


def test_times_that_cannot_be_kept_do_not_silence_the_link(tmp_path):
    (tmp_path / "no folder").write_text("")
    timestamps = times(tmp_path / "no folder" / "times")
    assert timestamps.next() < timestamps.next()


@pytest.mark.parametrize("age_s", [61.0, 3600.0, 365 * 86_400.0])
@pytest.mark.parametrize("is_synchronised", [True, False])
def test_old_frames_are_refused_at_the_very_first_start(tmp_path, age_s, is_synchronised):
    """A year-old recording of 51 streams: not one of its frames was refused once."""
    signer = made(timestamps=times(tmp_path / "times", is_synchronised=is_synchronised))
    frames = [
        raw_frame(theirs(HEARTBEAT, component=number, time=NOW - int(age_s * UNITS) + number))
        for number in range(1, 52)
    ]
    assert [signer.accepts(frame) for frame in frames] == [False] * 51
    assert signer.counters["too_old"] == 51
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW - 59 * UNITS)))


@pytest.mark.parametrize("ahead_s", [61.0, 3600.0, 10 * 365 * 86_400.0])
def test_no_frame_is_more_than_a_minute_ahead_of_the_clock(ahead_s, caplog):
    signer = made()
    frame = raw_frame(theirs(HEARTBEAT, time=NOW + int(ahead_s * UNITS)))
    assert [signer.accepts(frame) for _ in range(3)] == [False] * 3
    assert signer.counters["too_new"] == 3
    assert caplog.text.count("its clock or this one is wrong") == 1
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + 59 * UNITS)))


@pytest.mark.parametrize("now_s", [NOW_S, 10.0, 0.0, -1e9, 1e300])
@pytest.mark.parametrize("is_synchronised", [True, False])
def test_one_frame_with_a_strange_time_neither_ends_the_service_nor_the_next_start(
    tmp_path, now_s, is_synchronised
):
    """2^48 - 3 ended the service with an overflow in what it sent, and again at each start."""
    path = tmp_path / "times"
    for _ in range(3):
        timestamps = times(path, now_s, is_synchronised=is_synchronised)
        signer = made(timestamps=timestamps)
        for component, time in enumerate([LAST - 2, LAST, LAST - 10 * UNITS], 1):
            assert not signer.accepts(raw_frame(theirs(HEARTBEAT, time=time, component=component)))
        assert signer.counters["too_new"] == 3
        (sent,) = frames_in(signer.signed(packed(HEARTBEAT)))
        assert int.from_bytes(sent[-12:-6], "little") < LAST // 2 + UNITS
        timestamps.close()


@pytest.mark.parametrize("ahead_s", [59.0, 61.0, 1e8])
def test_one_peer_moves_our_own_time_by_a_minute_at_most_however_many_frames_it_sends(ahead_s):
    timestamps = times()
    signer = made(timestamps=timestamps)
    for number in range(1, 200):
        signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + int(number * ahead_s * UNITS))))
        assert timestamps.next() <= NOW + 60 * UNITS + number


def test_times_on_the_disk_that_cannot_be_true_are_forgotten(tmp_path, caplog):
    path = tmp_path / "times"
    streams = {"1/1/1": LAST - 2, "1/2/1": -5, "1/3/1": NOW + 61 * UNITS, "1/4/1": NOW - 5, "1/5/1": LAST * 9}
    path.write_text(json.dumps({"own": LAST - 2, "streams": streams}))
    timestamps = times(path)
    assert timestamps.streams == {(1, 4, 1): NOW - 5}
    assert timestamps.next() == NOW
    assert "5 times of signatures" in caplog.text


# --- without a clock that is right


@pytest.mark.parametrize("now_s", [NOW_S, 60.0])
def test_a_vehicle_gets_in_however_long_the_computer_was_off(tmp_path, now_s):
    """A computer without a battery for its clock goes on from when it was switched off."""
    path = tmp_path / "times"
    before = times(path)
    assert made(timestamps=before).accepts(raw_frame(theirs(HEARTBEAT)))
    before.close()
    timestamps = times(path, now_s, is_synchronised=False)
    signer = made(timestamps=timestamps)
    assert not signer.accepts(raw_frame(theirs(HEARTBEAT)))
    week = NOW + 7 * 86_400 * UNITS
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=week)))
    assert timestamps.next() > week - 60 * UNITS


def test_without_a_clock_the_first_that_is_believed_tells_the_time_and_the_others_follow():
    now = [100.0]
    timestamps = Timestamps(None, lambda: now[0])
    signer = made(timestamps=timestamps)
    year = 365 * 86_400 * UNITS
    assert signer.accepts(raw_frame(theirs(HEARTBEAT)))
    assert not signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + year, component=2)))
    assert not signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW - year, component=2)))
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + 59 * UNITS, component=2)))
    assert timestamps.next() <= NOW + 60 * UNITS
    for second in range(4):  # as with its first GPS fix
        is_confirmed = second == 3
        assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + year + second * UNITS))) is is_confirmed
        now[0] += 1.0
    year += 4 * UNITS
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + year, component=3)))
    now[0] += 600.0  # the first fell silent, and its time goes on
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + year + 600 * UNITS, component=3)))
    assert not signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + year + 661 * UNITS, component=3)))


def test_without_a_clock_frames_of_another_time_in_the_vehicles_name_do_not_shut_it_out():
    """By a holder of the key, ten years ahead, while the vehicle goes on."""
    now = [100.0]
    signer = made(timestamps=Timestamps(None, lambda: now[0]))
    ahead = NOW + 3_650 * 86_400 * UNITS
    for second in range(60):
        now[0] += 1.0
        assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW + second * UNITS)))
        assert not signer.accepts(raw_frame(theirs(HEARTBEAT, time=ahead + second * UNITS)))


def test_a_clock_that_is_put_right_under_way_counts_from_then_on():
    now, synchronised = [100.0], [False]
    timestamps = Timestamps(None, lambda: now[0], lambda: synchronised[0])
    signer = made(timestamps=timestamps)
    wild = NOW + 365 * 86_400 * UNITS
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=wild)))
    now[0], synchronised[0] = NOW_S, True
    assert not signer.accepts(raw_frame(theirs(HEARTBEAT, time=wild + 1)))
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW, component=2)))
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW)))
    assert not signer.accepts(raw_frame(theirs(HEARTBEAT, time=NOW)))


def test_what_was_believed_by_a_wrong_clock_is_not_believed_again_by_a_right_one():
    """Fuzzed: heard by a clock of 2010, forgotten by one of 2025, and believed anew by one of today."""
    clock = [NOW_S - 16 * 365 * 86_400]
    signer = made(timestamps=Timestamps(None, lambda: clock[0]))
    frames = [raw_frame(theirs(HEARTBEAT, time=NOW + step)) for step in range(4)]
    assert all(signer.accepts(frame) for frame in frames[:3])
    clock[0] = NOW_S - 365 * 86_400
    assert not any(signer.accepts(frame) for frame in frames)
    clock[0] = NOW_S
    assert [signer.accepts(frame) for frame in frames] == [False, False, False, True]


# --- many streams


@pytest.mark.parametrize("begin_s", [NOW_S, 1_437_000_000.0])
@pytest.mark.parametrize("back_s", [30.0, 600.0, 8e6])
def test_a_clock_set_back_makes_nothing_believable_that_is_earlier(begin_s, back_s):
    """Fuzzed: a frame from before one that was believed was, where the clock had gone back meanwhile."""
    clock = [begin_s]
    signer = made(timestamps=Timestamps(None, lambda: clock[0]))
    sent = int((begin_s - 1_420_070_400) * UNITS)
    frames = [raw_frame(theirs(HEARTBEAT, time=sent + step)) for step in range(3)]
    assert signer.accepts(frames[1])
    clock[0] -= back_s
    assert not any(signer.accepts(frame) for frame in frames[:2])
    assert signer.accepts(frames[2]) is (back_s < 60.0), "a jump, from where the clock is now"


def test_streams_are_a_hundred_at_most_in_memory_and_on_disk(tmp_path):
    path, now = tmp_path / "times", [NOW_S]
    timestamps = Timestamps(path, lambda: now[0])
    signer = made(timestamps=timestamps)
    names = list(itertools.product(range(1, 5), range(1, 256)))
    taken = [
        signer.accepts(raw_frame(theirs(HEARTBEAT, system=system, component=component, time=NOW + number)))
        for number, (system, component) in enumerate(names)
    ]
    assert taken == [number < STREAMS_MAX for number in range(len(names))]
    assert signer.counters["too_many_streams"] == len(names) - STREAMS_MAX
    timestamps.close()
    assert path.stat().st_size < 10_000
    now[0] += 120.0  # those that fell silent make room, and cannot be replayed for that
    late = NOW + 120 * UNITS
    assert signer.accepts(raw_frame(theirs(HEARTBEAT, system=9, time=late)))
    assert not signer.accepts(raw_frame(theirs(HEARTBEAT, system=1, component=1, time=NOW + 1)))
    assert len(timestamps.streams) == STREAMS_MAX


def test_a_peer_does_not_keep_the_disk_busy(tmp_path, monkeypatch):
    now, written = [NOW_S], []
    timestamps = Timestamps(tmp_path / "times", lambda: now[0])
    monkeypatch.setattr("companion.link.wire.signing.replace_file", lambda *_, **__: written.append(1))
    signer = made(timestamps=timestamps)
    for number in range(500):
        now[0] += 0.01
        time = NOW + number * UNITS // 10
        assert signer.accepts(raw_frame(theirs(HEARTBEAT, component=1 + number % 2, time=time)))
    assert 4 <= len(written) <= 6


# --- the key


@pytest.mark.parametrize("text", [KEY, KEY.hex().encode(), KEY.hex().encode() + b"\n"])
def test_a_key_of_bytes_or_of_digits(tmp_path, text):
    path = tmp_path / "key"
    path.write_bytes(text)
    path.chmod(0o600)
    assert read_key(path) == KEY


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o620, 0o604, 0o666])
def test_a_key_that_others_may_read_is_refused(tmp_path, mode):
    path = tmp_path / "key"
    path.write_bytes(KEY)
    path.chmod(mode)
    with pytest.raises(ConfigError, match="0600") as caught:
        read_key(path)
    assert f"{mode:04o}" in str(caught.value)


@pytest.mark.parametrize("text", [b"", b"short", KEY + b"x", b"zz" * 32])
def test_what_is_no_key(tmp_path, text):
    path = tmp_path / "key"
    path.write_bytes(text)
    path.chmod(0o600)
    with pytest.raises(ConfigError, match="32 bytes, or 64 hexadecimal digits"):
        read_key(path)


def test_a_key_that_is_not_there(tmp_path):
    with pytest.raises(ConfigError, match="no such file"):
        read_key(tmp_path / "key")


def key_at(path):
    path.write_bytes(KEY)
    path.chmod(0o600)
    return path


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777, 0o722])
def test_a_key_that_others_may_replace_is_refused(tmp_path, mode):
    folder = tmp_path / "open"
    (folder / "within").mkdir(parents=True, mode=0o700)
    for path in (folder / "key", folder / "within" / "key"):
        key_at(path)
        folder.chmod(mode)
        with pytest.raises(ConfigError, match="nobody else may write to") as caught:
            read_key(path)
        assert f"{folder}, mode {mode:04o}" in str(caught.value)
        folder.chmod(0o1777)  # as /tmp
        assert read_key(path) == KEY
        folder.chmod(0o755)
        assert read_key(path) == KEY


def test_a_symlink_to_a_key_is_followed_where_nobody_else_can_turn_it(tmp_path):
    for name in ("safe", "open"):
        (tmp_path / name).mkdir(mode=0o700)
    key_at(tmp_path / "safe" / "key")
    (tmp_path / "safe" / "link").symlink_to("../safe/key")
    (tmp_path / "link to folder").symlink_to("safe")
    assert read_key(tmp_path / "link to folder" / "link") == KEY
    (tmp_path / "open" / "link").symlink_to(tmp_path / "safe" / "key")
    (tmp_path / "open").chmod(0o777)
    with pytest.raises(ConfigError, match="nobody else may write to"):
        read_key(tmp_path / "open" / "link")
    (tmp_path / "round").symlink_to("round")
    with pytest.raises(ConfigError, match="too many symlinks"):
        read_key(tmp_path / "round")


def test_a_key_of_another_user_is_refused(tmp_path, monkeypatch):
    path = key_at(tmp_path / "key")
    monkeypatch.setattr(os, "geteuid", lambda: 12_345)
    if path.stat().st_uid == 0:
        assert read_key(path) == KEY  # root's own is as good
        try:
            os.chown(path, 54_321, -1)
        except PermissionError:
            pytest.skip("nobody here may give a file away")
    with pytest.raises(ConfigError, match="of user"):
        read_key(path)


def test_what_is_no_plain_file_is_no_key(tmp_path):
    os.mkfifo(tmp_path / "pipe", 0o600)
    with pytest.raises(ConfigError, match="not a plain file"):
        read_key(tmp_path / "pipe")


# --- in the codec


def test_the_codec_believes_signed_frames_only_and_signs_its_own():
    codec = Codec(1, signer=made())
    assert codec.feed(packed(HEARTBEAT), 0.0) == []
    (frame,) = codec.feed(theirs(HEARTBEAT), 0.0)
    assert frame.events[0].mode == "AUTO"
    assert codec.counters["unsigned"] == 1
    reader = mavlink.MAVLink(None)
    reader.signing.secret_key = KEY
    (heard,) = reader.parse_buffer(codec.signed(codec.heartbeat()))
    assert heard.get_signed()


def test_a_signed_frame_is_handed_on_without_its_signature():
    plain = packed(HEARTBEAT)
    assert Codec.unsigned(theirs(HEARTBEAT)) == plain
    assert Codec.unsigned(plain) == plain


def test_keys_that_are_sent_are_neither_taken_nor_recorded():
    setup = mavlink.MAVLink_setup_signing_message(1, 195, list(KEY), 0)
    for codec, data in ((Codec(1), packed(setup)), (Codec(1, signer=made()), theirs(setup))):
        assert codec.feed(data, 0.0) == []
        assert codec.counters["setup_signing"] == 1


# --- sources


def beat(system, component=1):
    return packed(mavlink.MAVLink_heartbeat_message(1, 8, 0, 0, 4, 3), system=system, component=component)


def test_systems_that_are_not_listed_are_not_listened_to():
    codec = Codec(1, limits=SourceLimits(200.0, [1, 42]))
    assert len(codec.feed(beat(1) + beat(42) + beat(43), 0.0)) == 2
    assert codec.counters["unlisted_system"] == 1


def test_a_source_is_limited_and_the_others_are_not():
    """10 Hz: 20 in a burst, then 10 a second."""
    codec = Codec(1, limits=SourceLimits(10.0))
    taken = sum(len(codec.feed(beat(42), 0.0)) for _ in range(100))
    assert taken == 20
    assert len(codec.feed(beat(43), 0.0)) == 1
    assert sum(len(codec.feed(beat(42), 2.0)) for _ in range(100)) == 20
    assert sum(len(codec.feed(beat(42), 2.55)) for _ in range(100)) == 5


def test_the_own_autopilot_is_not_limited():
    codec = Codec(1, limits=SourceLimits(10.0))
    own = packed(HEARTBEAT)
    assert sum(len(codec.feed(own, 0.0)) for _ in range(100)) == 100


def test_a_flood_of_sources_does_not_fill_the_memory():
    limits = SourceLimits(10.0)
    for number in range(5_000):
        limits.refusal(number % 256, number // 256, 0.0)
    assert len(limits._buckets) <= 1_000


def test_a_clock_that_goes_back_gives_nothing_away():
    limits = SourceLimits(10.0)
    assert [limits.refusal(1, 2, 100.0) for _ in range(21)].count("") == 20
    assert limits.refusal(1, 2, 0.0) == "rate_limited"


def test_the_time_is_in_units_of_10_us_since_2015():
    """2015-01-01T00:01:00Z: 60 s are 6 000 000 units."""
    assert Timestamps(None, lambda: 1_420_070_460.0).next() == 6_000_000
