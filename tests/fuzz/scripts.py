"""Bytes read as a script: what a fuzzer changes becomes frames whose checksums fit, or nearly.

A record of a wire's script is a byte that says what is made, then its fields. A script that ends early goes
on with zeros, so every input means something.
"""

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

EXTRAS = {number: kind.crc_extra for number, kind in mavlink.mavlink_map.items()}
IDS = sorted(EXTRAS)
SCRIPT_FRAMES_MAX = 400  # of one script
V2, V1, SIGNED, DAMAGED, NOISE, NESTED, TORN, UNKNOWN = range(8)
_POLYNOMIAL = 0x8408


class Reader:
    """Bytes, read from the front; behind the end they are zeros."""

    def __init__(self, data):
        self._data, self._at = data, 0

    @property
    def is_at_end(self):
        return self._at >= len(self._data)

    def take(self, count):
        """As many bytes, or as many as are left."""
        taken = self._data[self._at : self._at + count]
        self._at += count
        return taken

    def number(self, size=1, *, signed=False):
        """A whole number of so many bytes."""
        return int.from_bytes(self.take(size).ljust(size, b"\0"), "little", signed=signed)


def _row(byte):
    for _ in range(8):
        byte = (byte >> 1) ^ (_POLYNOMIAL if byte & 1 else 0)
    return byte


_TABLE = [_row(byte) for byte in range(256)]


def crc(data):
    """CRC-16/MCRF4XX, apart from the library that the code under test uses."""
    value = 0xFFFF
    for byte in data:
        value = (value >> 8) ^ _TABLE[(value ^ byte) & 0xFF]
    return value


def packed(number, payload, system, component, *, sequence=0, version=2, extra=None, flags=0):
    """A frame; of a message that the dialect does not know, with a made-up extra byte."""
    extra = EXTRAS.get(number, 0) if extra is None else extra
    if version == 1:
        body = bytes((len(payload), sequence, system, component, number & 0xFF)) + payload
        return b"\xfe" + body + crc(body + bytes((extra,))).to_bytes(2, "little")
    header = bytes((len(payload), flags, 0, sequence, system, component)) + number.to_bytes(3, "little")
    body = header + payload
    return b"\xfd" + body + crc(body + bytes((extra,))).to_bytes(2, "little")


@dataclass(frozen=True)
class Piece:
    """Some bytes of a wire, and whether they are one sound frame of a known message."""

    raw: bytes
    is_sound: bool


def _fields(reader, ids):
    """Message, system, component, sequence and payload, as the script says."""
    number = ids[reader.number(2) % len(ids)]
    system, component, sequence = reader.number(), reader.number(), reader.number()
    return number, system, component, sequence, reader.take(reader.number())


def _sent(reader, ids, kind):
    number, system, component, sequence, payload = _fields(reader, ids)
    version = 1 if kind == V1 and number < 256 else 2
    # MAVLink 2 leaves trailing zeros out, but for the first byte; who does not is understood, too.
    raw = packed(
        number, payload, system, component, sequence=sequence, version=version, flags=int(kind == SIGNED)
    )
    return raw + reader.take(13).ljust(13, b"\0") if kind == SIGNED else raw


def _piece(reader, ids, kind):
    if kind == NOISE:
        return Piece(reader.take(reader.number()), is_sound=False)
    if kind == UNKNOWN:
        number = reader.number(3)
        payload = reader.take(reader.number())
        return Piece(packed(number, payload, 1, 1, extra=reader.number()), is_sound=False)
    if kind == NESTED:  # a frame in the payload of another
        outer, inner = ids[reader.number(2) % len(ids)], _sent(reader, ids, V2)
        payload = reader.take(reader.number() % 16) + inner
        return Piece(packed(outer, payload[:255], 1, 1), is_sound=True)
    raw = _sent(reader, ids, kind)
    if kind == TORN:
        return Piece(raw[: reader.number() % len(raw)], is_sound=False)
    if kind == DAMAGED:
        place, flipped = reader.number(2) % len(raw), reader.number()
        damaged = bytearray(raw)
        damaged[place] ^= flipped
        return Piece(bytes(damaged), is_sound=not flipped)
    return Piece(raw, is_sound=True)


def pieces_of(reader, ids=IDS):
    """What a script puts on the wire, piece by piece."""
    made = []
    while not reader.is_at_end and len(made) < SCRIPT_FRAMES_MAX:
        made.append(_piece(reader, ids, reader.number() % 8))
    return made


def record_of(raw, ids=IDS, kind=V2):
    """The script that makes a frame of a known message again, under MAVLink 2 or 1."""
    at = 10 if raw[0] == 0xFD else 6
    number = int.from_bytes(raw[7:10], "little") if raw[0] == 0xFD else raw[5]
    system, component, sequence = (raw[5], raw[6], raw[4]) if raw[0] == 0xFD else (raw[3], raw[4], raw[2])
    payload = raw[at : at + raw[1]]
    place = ids.index(number).to_bytes(2, "little")
    return bytes((kind,)) + place + bytes((system, component, sequence, len(payload))) + payload


def repeated(raw, least=4096):
    """A wire again and again, until it is as long as a stream's share of a moment."""
    return raw * -(-least // len(raw)) if raw else b""


def portions(data, sizes):
    """Cut bytes into portions whose sizes come round and round."""
    start, turn = 0, 0
    while start < len(data):
        size = sizes[turn % len(sizes)]
        yield data[start : start + size]
        start, turn = start + size, turn + 1
