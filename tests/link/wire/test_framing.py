"""The checksum of frames against its definition, and what cutting frames costs and finds."""

import itertools
from collections import Counter

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from companion.link.messages.codec import _EXTRAS, _LENGTHS_MAX
from companion.link.wire import framing
from companion.link.wire.framing import Framer, checksum, frames_in, raw_frame, renumbered
from tests.link.pymavlink_frames import adsb, heartbeat, position


def by_definition(data):
    """CRC-16/MCRF4XX bit by bit: polynomial 8408 reversed, start FFFF, no final XOR."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0x8408 if crc & 1 else 0)
    return crc


@example(b"12345678", ord("9"))  # whose checksum the catalogue of parametrised CRCs gives as 6F91
@given(st.binary(max_size=300), st.integers(0, 255))
def test_the_checksum_is_the_one_of_mavlink(data, extra):
    assert checksum(data, extra) == by_definition(data + bytes((extra,)))


def test_the_catalogue_s_check_value():
    assert checksum(b"12345678", ord("9")) == 0x6F91


def test_frames_are_cut_where_they_end_and_renumbering_keeps_all_but_number_and_checksum():
    one = heartbeat()
    assert list(frames_in(one * 3)) == [one] * 3
    other = renumbered(one, 200, 50)
    assert raw_frame(other).payload == raw_frame(one).payload
    assert other[4] == 200


# --- the stream

UNKNOWN = bytes([0xFD, 4, 0, 0, 9, 42, 1, 0x60, 0xEA, 0, 1, 2, 3, 4, 5, 6])
# Headers of MAVLink 1 and 2, known and unknown, standing in each other: each byte may begin a frame.
WORST = {
    "headers of MAVLink 1": bytes([0xFE, 0xFE, 0xD1, 0xFE]),
    "one byte": b"\xfe",
    "headers of MAVLink 2": bytes([0xFD, 0xFD, 0x00, 0x00]),
    "signed": bytes([0xFD, 0xFF, 0x01, 0xFD, 0x01, 0x00]),
    "long ones of file transfer": bytes([0x6E, 0x09, 0x00, 0x6E, 0xFE, 0xFE]),
    "unknown ones round a true one": bytes.fromhex("fefea891fefe") * 30 + heartbeat() * 3,
    "both": bytes([0xFE, 0xFD, 0xFD, 0x00, 0x1E, 0xFD]),
}


def framer():
    return Framer(_EXTRAS, Counter(), _LENGTHS_MAX)


def fed(data, portion):
    cutter = framer()
    return [frame for at in range(0, len(data), portion) for frame in cutter.feed(data[at : at + portion])]


@pytest.mark.parametrize("pattern", WORST.values(), ids=WORST)
@pytest.mark.parametrize("portion", [1, 7, 100, 280, 8_000])
def test_each_byte_costs_a_bounded_number_of_checksums_whatever_it_is(monkeypatch, pattern, portion):
    """Once 300 of them; a place is judged once, so that there is one for each byte at most, of 265 bytes."""
    summed = Counter()

    def counting(data, *start):
        summed["calls"] += 1
        summed["bytes"] += len(data)
        return real(data, *start)

    def judging(self, buffer, start, **options):
        summed["judged"] += 1
        return judged(self, buffer, start, **options)

    real, judged = framing.mcrf4xx, Framer._judged
    monkeypatch.setattr(Framer, "_judged", judging)
    monkeypatch.setattr(framing, "mcrf4xx", counting)
    data = (pattern * 8_000)[:8_000]
    fed(data, portion)
    assert summed["calls"] <= 2 * len(data)  # body, and extra byte
    assert summed["bytes"] <= 266 * len(data)
    # Again where the last byte is waited for, once a portion; a place inside an unknown message twice.
    assert summed["judged"] <= 2 * len(data) + 2 * len(data) / portion + 2


@given(
    parts=st.lists(
        st.sampled_from([heartbeat(), position(), adsb(), UNKNOWN])
        | st.binary(max_size=40).map(lambda noise: noise.replace(b"\xfd", b"").replace(b"\xfe", b"")),
        max_size=12,
    ),
    portion=st.integers(1, 400),
)
def test_whole_frames_are_found_among_noise_in_any_portions(parts, portion):
    found = [frame.raw for frame in fed(b"".join(parts), portion) if frame.is_verified]
    assert found == [part for part in parts if part[:1] == b"\xfd" and part != UNKNOWN]


@given(data=st.binary(max_size=600), cuts=st.lists(st.integers(0, 600), max_size=8))
def test_of_any_bytes_each_belongs_to_one_frame_or_is_counted(data, cuts):
    cutter, frames = framer(), []
    edges = sorted({0, len(data), *(cut for cut in cuts if cut < len(data))})
    for begin, end in itertools.pairwise(edges):
        frames += cutter.feed(data[begin:end])
    rest = len(cutter._buffer)
    assert sum(len(frame.raw) for frame in frames) + cutter._counters["garbage_bytes"] + rest == len(data)
    assert rest < 280
    place = 0
    for frame in frames:
        place = data.index(frame.raw, place) + len(frame.raw)


@given(noise=st.binary(max_size=300), portion=st.integers(1, 300))
def test_a_frame_behind_any_noise_is_found_at_the_latest_with_the_next(noise, portion):
    """A length in the noise may reach over the frame, but over no more than 280 bytes."""
    data = noise + heartbeat() * 20
    found = fed(data, portion)
    assert sum(frame.raw == heartbeat() for frame in found) >= 19 or found[0].raw != heartbeat()
    assert found[-1].raw == heartbeat()


def test_a_frame_of_mavlink_1_is_no_longer_than_its_message():
    """254 bytes of DEBUG, which has 9: no checksum is needed to tell."""
    cutter = framer()
    assert cutter.feed(bytes([0xFE, 254, 0, 1, 1, 254]) + bytes(256)) == []
    assert cutter._counters["bad_length"] == 1
