"""MAVLink frames cut out of a byte stream, without I/O and without a dialect.

A frame is believed when its checksum fits. After damage the search goes on one byte further, not
one frame further, so that a corrupted length does not swallow the good frames behind it.

References
----------
MAVLink guide, *Packet Serialization*: header layout, CRC-16/MCRF4XX with the message's extra byte.
"""

from __future__ import annotations

import re
from collections import Counter, OrderedDict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from fastcrc.crc16 import mcrf4xx

MAGIC_V1, MAGIC_V2 = 0xFE, 0xFD
_HEADER_V1, _HEADER_V2 = 6, 10
_HEADERS = {MAGIC_V1: _HEADER_V1, MAGIC_V2: _HEADER_V2}
_CHECKSUM = 2
SIGNATURE = 13
_SIGNED = 0x01
_LENGTH_KNOWN = 3  # bytes of a header that tell the frame's length
_MAGICS = re.compile(rb"[\xfd\xfe]").finditer


def checksum(data: bytes | bytearray, extra: int) -> int:
    """CRC-16/MCRF4XX of the data followed by the message's extra byte."""
    return mcrf4xx(bytes((extra,)), mcrf4xx(bytes(data)))


@dataclass(frozen=True, slots=True)
class RawFrame:
    """One frame as it came.

    ``is_verified`` is false for a message that the dialect does not know: its checksum cannot be
    told, only that another frame or nothing follows it.
    """

    raw: bytes
    system_id: int
    component_id: int
    message_id: int
    is_verified: bool

    @property
    def payload(self) -> bytes:
        """Payload as sent; MAVLink 2 leaves trailing zeros out."""
        start = _HEADERS[self.raw[0]]
        return self.raw[start : start + self.raw[1]]


def raw_frame(raw: bytes, *, is_verified: bool = True) -> RawFrame:
    """Read the header of a whole frame."""
    if raw[0] == MAGIC_V2:
        return RawFrame(raw, raw[5], raw[6], int.from_bytes(raw[7:10], "little"), is_verified)
    return RawFrame(raw, raw[3], raw[4], raw[5], is_verified)


def renumbered(raw: bytes, sequence: int, extra: int) -> bytes:
    """Return an unsigned frame with another sequence number and the checksum that goes with it."""
    changed = bytearray(raw)
    changed[4 if raw[0] == MAGIC_V2 else 2] = sequence
    body = _HEADERS[raw[0]] + raw[1]
    changed[body : body + _CHECKSUM] = checksum(changed[1:body], extra).to_bytes(_CHECKSUM, "little")
    return bytes(changed)


def _length_at(data: bytes | bytearray, start: int) -> int:
    """Length of the frame whose header begins at an index, signature and all."""
    length = _HEADERS[data[start]] + data[start + 1] + _CHECKSUM
    if data[start] == MAGIC_V2 and data[start + 2] & _SIGNED:
        length += SIGNATURE
    return length


def frames_in(data: bytes) -> Iterator[bytes]:
    """Cut whole frames that stand one behind the other, as we packed them."""
    start = 0
    while start < len(data):
        length = _length_at(data, start)
        yield data[start : start + length]
        start += length


class Framer:
    """Bytes in, frames out; each place in the stream is judged once, whatever the bytes are.

    Parameters
    ----------
    extras : mapping of int to int
        CRC extra byte of each message id the dialect knows.
    counters : Counter
        Counts ``garbage_bytes``, ``bad_checksum``, ``bad_length`` and ``incompatible`` frames.
    lengths_max : mapping of int to int, optional
        Bytes of each message with all its extensions: a MAVLink 1 frame cannot carry more. (A MAVLink 2
        frame can, of extensions that are younger than the dialect.)

    Notes
    -----
    Places are counted from the stream's first byte. A place where a frame may begin, but cannot be told
    yet, is *open*: it waits for its last byte, or holds a whole frame of an unknown message, which is
    given up for a verified one that begins inside. A verified frame ends all that is open before it.
    """

    def __init__(
        self,
        extras: Mapping[int, int],
        counters: Counter[str],
        lengths_max: Mapping[int, int] | None = None,
    ) -> None:
        self._lengths_max = lengths_max or {}
        self._extras = {number: bytes((extra,)) for number, extra in extras.items()}
        self._counters = counters
        self._buffer = b""
        self._begin = 0  # place of the buffer's first byte
        self._start = 0  # before it nothing is left to tell
        self._seen = 0  # before it every place was looked at
        self._open: OrderedDict[int, RawFrame | None] = OrderedDict()
        self._awaited: dict[int, list[int]] = {}  # open places by where what begins there ends

    def feed(self, data: bytes) -> list[RawFrame]:
        """Take bytes; return the frames that became complete, in order."""
        buffer = self._buffer = self._buffer[self._start - self._begin :] + data
        begin = self._begin = self._start
        end = begin + len(buffer)
        found: list[RawFrame] = []
        for place in self._completed(end - len(data), end):
            self._judge(place, found)
        seen = end
        for magic in _MAGICS(buffer, max(self._seen, self._start) - begin):
            place = begin + magic.start()
            if place + _LENGTH_KNOWN > end:
                seen = place
                break
            if place >= self._start:
                self._judge(place, found)
        self._seen = seen
        self._give_unknown(end, found)
        self._skip_to(next(iter(self._open), seen))
        return found

    def _completed(self, before: int, end: int) -> list[int]:
        """Open places, in order, whose last byte came behind one place and before another."""
        if not self._awaited:
            return []
        ends = [last for last in range(before + 1, end + 1) if last in self._awaited]
        return sorted(place for last in ends for place in self._awaited.pop(last) if place >= self._start)

    def _judge(self, place: int, found: list[RawFrame]) -> None:
        """Tell what begins at a place where a magic byte and a length stand."""
        self._give_unknown(place, found)
        if place < self._start:
            return
        buffer, start = self._buffer, place - self._begin
        size, length = len(buffer), buffer[start + 1]
        is_v1 = buffer[start] == MAGIC_V1
        if is_v1:
            if start + 5 < size and length > self._lengths_max.get(buffer[start + 5], 255):
                self._deny(place, "bad_length")
                return
            body = start + _HEADER_V1 + length
            end = body + _CHECKSUM
        elif (flags := buffer[start + 2]) & ~_SIGNED:
            self._deny(place, "incompatible")
            return
        else:
            body = start + _HEADER_V2 + length
            end = body + _CHECKSUM + (SIGNATURE if flags else 0)
        if end > size:
            self._open[place] = None
            self._awaited.setdefault(self._begin + end, []).append(place)
            return
        number = buffer[start + 5] if is_v1 else int.from_bytes(buffer[start + 7 : start + 10], "little")
        extra = self._extras.get(number)
        if extra is None:
            self._hold(place, start, end)
        elif mcrf4xx(extra, mcrf4xx(buffer[start + 1 : body])) == buffer[body] | buffer[body + 1] << 8:
            self._give(place, raw_frame(buffer[start:end]), found)
        else:
            self._deny(place, "bad_checksum")

    def _hold(self, place: int, start: int, end: int) -> None:
        """Keep a whole frame of an unknown message, if something like a frame follows it, or nothing."""
        if end < len(self._buffer) and self._buffer[end] not in _HEADERS:
            self._deny(place, "")
        else:
            self._open[place] = raw_frame(self._buffer[start:end], is_verified=False)

    def _deny(self, place: int, reason: str) -> None:
        """No frame begins here; why not is counted where none could begin before it either."""
        if reason and next(iter(self._open), place) >= place:
            self._counters[reason] += 1
        self._open.pop(place, None)

    def _give(self, place: int, frame: RawFrame, found: list[RawFrame]) -> None:
        found.append(frame)
        self._skip_to(place)
        self._start = place + len(frame.raw)
        while self._open and next(iter(self._open)) < self._start:
            self._open.popitem(last=False)

    def _give_unknown(self, until: int, found: list[RawFrame]) -> None:
        """Give frames of unknown messages that end by a place, with nothing open before them."""
        while self._open:
            place = next(iter(self._open))
            frame = self._open[place]
            if frame is None or place + len(frame.raw) > until:
                return
            self._give(place, frame, found)

    def _skip_to(self, place: int) -> None:
        """Count what lies before a place, and belongs to no frame."""
        if place > self._start:
            self._counters["garbage_bytes"] += place - self._start
            self._start = place
