"""Extraction of MAVLink frames from a byte stream, without I/O and without a dialect.

A frame is accepted if its checksum is correct. After a damaged frame the search continues one byte further,
not one frame further: a corrupted length then delays the good frames that follow, but loses none of them.

References
----------
MAVLink guide, *Packet Serialization*: header layout, CRC-16/MCRF4XX with the message's extra byte.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from fastcrc.crc16 import mcrf4xx

MAGIC_V1, MAGIC_V2 = 0xFE, 0xFD
_HEADERS = {MAGIC_V1: 6, MAGIC_V2: 10}
_CHECKSUM = 2
SIGNATURE = 13
_SIGNED = 0x01
_LENGTH_KNOWN = 3  # The first three bytes of a header determine the length of the frame.
_MAGIC = re.compile(rb"[\xfd\xfe]").search
# Verdicts of `Framer._judged`: no frame begins here; more bytes are needed; the message is unknown.
_NONE, _WAITING, _UNKNOWN = -1, -2, -3


def checksum(data: bytes | bytearray, extra: int) -> int:
    """CRC-16/MCRF4XX of the data followed by the message's extra byte."""
    return mcrf4xx(bytes((extra,)), mcrf4xx(bytes(data)))


@dataclass(frozen=True, slots=True)
class RawFrame:
    """One frame as received.

    ``is_verified`` is false for a message that the dialect does not know. Its checksum cannot be verified;
    it is only known that no verified frame begins inside it.
    """

    raw: bytes
    system_id: int
    component_id: int
    message_id: int
    is_verified: bool

    @property
    def payload(self) -> bytes:
        """The payload as sent; MAVLink 2 omits trailing zeros."""
        start = _HEADERS[self.raw[0]]
        return self.raw[start : start + self.raw[1]]


def raw_frame(raw: bytes, *, is_verified: bool = True) -> RawFrame:
    """Return a complete frame with the ids of its header."""
    if raw[0] == MAGIC_V2:
        return RawFrame(raw, raw[5], raw[6], int.from_bytes(raw[7:10], "little"), is_verified)
    return RawFrame(raw, raw[3], raw[4], raw[5], is_verified)


def packed_frame(
    message_id: int, payload: bytes, sequence: int, sender: tuple[int, int], extra: int
) -> bytes:
    """Pack an unsigned MAVLink 2 frame of any message, without the trailing zeros of its payload.

    Parameters
    ----------
    message_id : int
        Message id.
    payload : bytes
        Payload, at most 255 bytes.
    sequence : int
        Sequence number of the frame.
    sender : tuple of int
        System id and component id of the sender.
    extra : int
        CRC extra byte of the message.
    """
    payload = payload.rstrip(b"\0") or b"\0"
    body = bytes((len(payload), 0, 0, sequence, *sender)) + message_id.to_bytes(3, "little") + payload
    return bytes((MAGIC_V2,)) + body + checksum(body, extra).to_bytes(_CHECKSUM, "little")


def renumbered(raw: bytes, sequence: int, extra: int) -> bytes:
    """Return an unsigned frame with another sequence number and the matching checksum."""
    changed = bytearray(raw)
    changed[4 if raw[0] == MAGIC_V2 else 2] = sequence
    body = _HEADERS[raw[0]] + raw[1]
    changed[body : body + _CHECKSUM] = checksum(changed[1:body], extra).to_bytes(_CHECKSUM, "little")
    return bytes(changed)


def _length_at(data: bytes | bytearray, start: int) -> int:
    """Return the length, including the signature, of the frame whose header begins at ``start``."""
    length = _HEADERS[data[start]] + data[start + 1] + _CHECKSUM
    if data[start] == MAGIC_V2 and data[start + 2] & _SIGNED:
        length += SIGNATURE
    return length


def frames_in(data: bytes) -> Iterator[bytes]:
    """Split a sequence of complete frames that this program packed."""
    start = 0
    while start < len(data):
        length = _length_at(data, start)
        yield data[start : start + length]
        start += length


class Framer:
    """Extracts frames from bytes that arrive in arbitrary portions.

    The framer judges each position of the stream once, in order. If a frame may begin at a position and its
    end has not arrived, the framer waits, for at most 280 bytes. A frame of an unknown message is discarded
    if a verified frame begins inside it, since a truncated header and the bytes after it can look like any
    message.

    Parameters
    ----------
    extras : mapping of int to int
        CRC extra byte of each message id that the dialect knows.
    counters : Counter
        Counts ``garbage_bytes``, ``bad_checksum``, ``bad_length`` and ``incompatible`` frames.
    lengths_max : mapping of int to int, optional
        Payload length of each message with all its extensions. A longer MAVLink 1 frame is refused. A MAVLink
        2 frame may be longer, if it has extensions that are newer than the dialect.
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
        self._inside = 1  # Offset in the unknown frame at the buffer's start up to which it was searched.

    def feed(self, data: bytes) -> list[RawFrame]:
        """Take bytes and return the frames that they complete, in order."""
        buffer = self._buffer + data
        start, size = 0, len(buffer)
        found: list[RawFrame] = []
        while start < size:
            is_verified, is_frame = True, False
            if buffer[start] in _HEADERS:
                end = self._judged(buffer, start)
                is_verified = end != _UNKNOWN
                if not is_verified:
                    end = self._looked_through(buffer, start)
                if end == _WAITING:
                    break
                is_frame = end != _NONE and (is_verified or end - start == _length_at(buffer, start))
                end = start + 1 if end == _NONE else end
            else:
                magic = _MAGIC(buffer, start)
                end = size if magic is None else magic.start()
            if is_frame:
                found.append(raw_frame(buffer[start:end], is_verified=is_verified))
            else:
                self._counters["garbage_bytes"] += end - start
            start = end
        self._buffer = buffer[start:]
        return found

    def _judged(self, buffer: bytes, start: int, *, is_counted: bool = True) -> int:
        """Return the end of the frame that begins at a magic byte, or a verdict below 0."""
        size = len(buffer)
        if size - start < _LENGTH_KNOWN:
            return _WAITING
        length, is_v1 = buffer[start + 1], buffer[start] == MAGIC_V1
        if is_v1 and start + 5 < size and length > self._lengths_max.get(buffer[start + 5], 255):
            return self._denied("bad_length", is_counted)
        if not is_v1 and buffer[start + 2] & ~_SIGNED:
            return self._denied("incompatible", is_counted)
        end = start + _length_at(buffer, start)
        if end > size:
            return _WAITING
        body = start + _HEADERS[buffer[start]] + length
        number = buffer[start + 5] if is_v1 else int.from_bytes(buffer[start + 7 : start + 10], "little")
        extra = self._extras.get(number)
        if extra is None:
            return _UNKNOWN
        if mcrf4xx(extra, mcrf4xx(buffer[start + 1 : body])) == buffer[body] | buffer[body + 1] << 8:
            return end
        return self._denied("bad_checksum", is_counted)

    def _looked_through(self, buffer: bytes, start: int) -> int:
        """Return the end of a frame of an unknown message, or the start of a verified frame inside it."""
        end = start + _length_at(buffer, start)
        for place in range(start + self._inside, end):
            if buffer[place] not in _HEADERS:
                continue
            verdict = self._judged(buffer, place, is_counted=False)
            if verdict == _WAITING:
                self._inside = place - start
                return _WAITING
            if verdict > 0:
                end = place
                break
        self._inside = 1
        return end

    def _denied(self, reason: str, is_counted: bool) -> int:
        if is_counted:
            self._counters[reason] += 1
        return _NONE
