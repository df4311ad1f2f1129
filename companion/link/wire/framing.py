"""MAVLink frames cut out of a byte stream, without I/O and without a dialect.

A frame is believed when its checksum fits. After damage the search goes on one byte further, not
one frame further, so that a corrupted length does not swallow the good frames behind it.

References
----------
MAVLink guide, *Packet Serialization*: header layout, CRC-16/MCRF4XX with the message's extra byte.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from fastcrc.crc16 import mcrf4xx

MAGIC_V1, MAGIC_V2 = 0xFE, 0xFD
_HEADERS = {MAGIC_V1: 6, MAGIC_V2: 10}
_CHECKSUM = 2
SIGNATURE = 13
_SIGNED = 0x01


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


def _fits(raw: bytes, body: int, extra: int) -> bool:
    """Whether the checksum behind a frame's body, which ends at an index, is that of the body."""
    return checksum(raw[1:body], extra) == int.from_bytes(raw[body : body + _CHECKSUM], "little")


def frames_in(data: bytes) -> Iterator[bytes]:
    """Cut whole frames that stand one behind the other, as we packed them."""
    start = 0
    while start < len(data):
        length = _length_at(data, start)
        yield data[start : start + length]
        start += length


class Framer:
    """Bytes in, frames out.

    Parameters
    ----------
    extras : mapping of int to int
        CRC extra byte of each message id the dialect knows.
    counters : Counter
        Counts ``garbage_bytes``, ``bad_checksum`` and ``incompatible`` frames.
    """

    def __init__(self, extras: Mapping[int, int], counters: Counter[str]) -> None:
        self._extras = extras
        self._counters = counters
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[RawFrame]:
        """Take bytes; yield the frames that are complete."""
        self._buffer += data
        start = 0
        while start < len(self._buffer):
            frame, is_waiting = self._frame_at(start)
            if frame is None and is_waiting:
                skipped = self._next_verified(start + 1, len(self._buffer))
                if skipped is None:
                    break
                self._counters["garbage_bytes"] += skipped - start
                start = skipped
                continue
            if frame is None:
                self._counters["garbage_bytes"] += 1
                start += 1
                continue
            start += len(frame.raw)
            yield frame
        del self._buffer[:start]

    def _next_verified(self, start: int, end: int) -> int | None:
        """Where a whole verified frame begins behind one that is incomplete or cannot be verified."""
        for index in range(start, end):
            if self._buffer[index] in _HEADERS:
                frame, _ = self._frame_at(index, is_counted=False)
                if frame is not None and frame.is_verified:
                    return index
        return None

    def _frame_at(self, start: int, *, is_counted: bool = True) -> tuple[RawFrame | None, bool]:
        """Return the frame that begins at an index, and whether more bytes are needed to tell."""
        buffer = self._buffer
        header = _HEADERS.get(buffer[start])
        if header is None:
            return None, False
        if len(buffer) - start < 3:
            return None, True
        if buffer[start] == MAGIC_V2 and buffer[start + 2] & ~_SIGNED:
            self._count("incompatible", is_counted)
            return None, False
        end = start + _length_at(buffer, start)
        if end > len(buffer):
            return None, True
        frame = raw_frame(bytes(buffer[start:end]))
        extra = self._extras.get(frame.message_id)
        if extra is None:
            # A header cut short joins with what follows to any id: a true frame inside gives it away.
            is_torn = is_counted and self._next_verified(start + 1, end) is not None
            if is_torn or (end < len(buffer) and buffer[end] not in _HEADERS):
                return None, False
            return raw_frame(frame.raw, is_verified=False), False
        if not _fits(frame.raw, header + frame.raw[1], extra):
            self._count("bad_checksum", is_counted)
            return None, False
        return frame, False

    def _count(self, reason: str, is_counted: bool) -> None:
        if is_counted:
            self._counters[reason] += 1
