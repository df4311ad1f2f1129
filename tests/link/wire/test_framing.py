"""The checksum of frames against its definition; cutting frames is tested with the codec."""

from hypothesis import example, given
from hypothesis import strategies as st

from companion.link.wire.framing import checksum, frames_in, raw_frame, renumbered
from tests.link.pymavlink_frames import heartbeat


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
