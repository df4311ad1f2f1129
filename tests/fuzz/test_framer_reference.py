"""The framer beside a slow one that is plainly right, and beside pymavlink's own parser."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.wire.framing import Framer
from tests.fuzz.link_targets import FLUSH, check_frames, framed
from tests.fuzz.scripts import EXTRAS, IDS, crc, packed, portions

KNOWN = st.builds(
    packed,
    st.sampled_from(IDS),
    st.binary(max_size=40),
    st.integers(0, 255),
    st.integers(0, 255),
    sequence=st.integers(0, 255),
)
SHORT = st.builds(
    packed,
    st.sampled_from([n for n in IDS if n < 256]),
    st.binary(max_size=40),
    st.just(1),
    st.just(1),
    version=st.just(1),
)
QUIET = st.binary(max_size=30).map(lambda data: bytes(byte for byte in data if byte not in (0xFD, 0xFE)))
NOISE = st.one_of(
    QUIET, st.binary(max_size=60), st.sampled_from([b"\xfe", b"\xfd", b"\xfe\xfe\xd1\xfe", b"\xfd\xff\x00"])
)
SIZES = st.lists(st.integers(1, 40), min_size=1, max_size=5)


def slowly(wire):
    """Frames of known messages only: at each place a whole one whose checksum fits, or one place further."""
    found, at = [], 0
    while at < len(wire):
        length = _length(wire[at:])
        found += [wire[at : at + length]] * (length > 0)
        at += max(1, length)
    return found


def _length(rest):
    header = {0xFD: 10, 0xFE: 6}.get(rest[0])
    if header is None or len(rest) < header or (rest[0] == 0xFD and rest[2] > 1):
        return 0
    number = int.from_bytes(rest[7:10], "little") if rest[0] == 0xFD else rest[5]
    body, signature = header + rest[1], 13 if rest[0] == 0xFD and rest[2] else 0
    if number not in EXTRAS or len(rest) < body + 2 + signature:
        return 0
    fits = crc(rest[1:body] + bytes((EXTRAS[number],))) == int.from_bytes(rest[body : body + 2], "little")
    return body + 2 + signature if fits else 0


@given(st.lists(st.one_of(KNOWN, SHORT, QUIET), max_size=8), SIZES)
def test_of_frames_and_bytes_that_begin_none_all_frames_are_found(pieces, sizes):
    wire = b"".join(pieces)
    for chunks in ([wire], portions(wire, sizes)):
        found, _ = framed(chunks)
        assert [frame.raw for frame in found] == slowly(wire)
        assert all(frame.is_verified for frame in found)


@given(st.lists(st.one_of(KNOWN, NOISE), max_size=8), SIZES)
def test_whatever_lies_between_them_believed_frames_are_those_of_the_slow_one(pieces, sizes):
    """But for a frame in the noise of a message that nobody knows, which may stand before one."""
    wire = b"".join(pieces) + FLUSH
    found, _ = framed([wire])
    if all(frame.is_verified for frame in found):
        assert [frame.raw for frame in found] == slowly(wire)
    check_frames(wire[: -len(FLUSH)], sizes)


@given(st.lists(st.one_of(KNOWN, SHORT), max_size=10), SIZES)
def test_pymavlink_finds_the_same_frames_in_an_intact_stream(frames, sizes):
    wire = b"".join(frames)
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    theirs = [bytes(message.get_msgbuf()) for message in parser.parse_buffer(bytearray(wire)) or ()]
    counters = Counter()
    framer = Framer(EXTRAS, counters)
    ours = [frame.raw for chunk in portions(wire, sizes) for frame in framer.feed(chunk)]
    assert ours == theirs == frames
    assert counters == Counter()
