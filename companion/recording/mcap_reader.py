"""Reads ``flight.mcap`` without trusting any size that the file states.

A chunk is decompressed as a stream up to a limit, so that a small file cannot fill the memory. The total size
of a file is limited as well, far above the longest flight. Damaged and oversized parts are skipped and
counted.
"""

from __future__ import annotations

import io
import json
import os
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import zstandard

from companion.errors import RecordError
from companion.safe_files import open_to_read

CHUNK_MAX = 16 * 2**20  # Bytes of a decompressed chunk; our own have one or two MB.
MESSAGE_MAX = 8 * 2**20  # Bytes of a message; our longest contains a mission file.
VALUES_MAX = 1_000_000  # Values in a message; a plan has a few thousand.
TOTAL_MAX = 512 * 2**20  # Decompressed bytes of a file; about ten hours of flight.
MESSAGES_MAX = 1_000_000  # Messages of a file.
_MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # Kind and length of a record.
_FOOTER, _CHANNEL, _MESSAGE, _CHUNK = 0x02, 0x04, 0x05, 0x06
_MESSAGE_HEAD = 22
_DAMAGE = (struct.error, ValueError, zstandard.ZstdError, RuntimeError, EOFError, MemoryError, OverflowError)

Document = dict[str, object]


class _TooMuch(Exception):
    """The file holds more than any flight produces."""


def messages_of(path: Path, counters: Counter[str]) -> Iterator[tuple[str, Document]]:
    """Yield the topics and messages of an MCAP file, in order, as far as it can be read.

    If the end of the file is missing, since the process was killed, the file is read up to there
    (``mcap_ends_early``). Damaged and oversized chunks and messages are skipped (``damaged_chunks``,
    ``damaged_messages``), and so is everything beyond the limits (``mcap_too_large``).

    Raises
    ------
    RecordError
        If the file cannot be opened.
    """
    topics: dict[int, str] = {}
    try:
        with open_to_read(path) as file:
            for kind, content in _within_limits(file, counters):
                if kind == _CHANNEL:
                    _note_topic(topics, content)
                elif int.from_bytes(content[:2], "little") in topics:
                    document = _document_of(content[_MESSAGE_HEAD:])
                    if document is None:
                        counters["damaged_messages"] += 1
                    else:
                        yield topics[int.from_bytes(content[:2], "little")], document
    except _TooMuch:
        counters["mcap_too_large"] += 1
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror or error}") from error


def _within_limits(file: BinaryIO, counters: Counter[str]) -> Iterator[tuple[int, bytes]]:
    """Yield channels and messages; raise once there are more than any flight produces."""
    total = number = 0
    for kind, content in _records(file, os.fstat(file.fileno()).st_size, counters):
        inside: Iterator[tuple[int, bytes]] = iter([(kind, content)])
        if kind == _CHUNK:
            unpacked = _unpacked(content, counters)
            total += len(unpacked)
            inside = _records_in(unpacked, counters)
        for entry in inside:
            total += len(entry[1]) if kind != _CHUNK else 0
            number += 1
            if total > TOTAL_MAX or number > MESSAGES_MAX:
                raise _TooMuch
            yield entry


def _records(file: BinaryIO, size: int, counters: Counter[str]) -> Iterator[tuple[int, bytes]]:
    """Yield the channels, messages and chunks of a file; count a missing end."""
    is_whole = file.read(len(_MAGIC)) == _MAGIC
    while is_whole:
        head = file.read(_HEAD.size)
        kind, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, size)
        if file.tell() + length > size:
            break
        if kind not in (_CHANNEL, _MESSAGE, _CHUNK):
            file.seek(length, os.SEEK_CUR)
            if kind == _FOOTER:
                if file.read(len(_MAGIC)) == _MAGIC:
                    return
                break
        elif length > CHUNK_MAX:  # Compression lengthens data by a few bytes at most.
            file.seek(length, os.SEEK_CUR)
            counters["damaged_chunks"] += 1
        else:
            yield kind, file.read(length)
    counters["mcap_ends_early"] += 1


def _records_in(data: bytes, counters: Counter[str]) -> Iterator[tuple[int, bytes]]:
    """Yield the channels and messages of a decompressed chunk."""
    place = 0
    while place < len(data):
        if len(data) - place < _HEAD.size:
            counters["damaged_chunks"] += 1
            return
        kind, length = _HEAD.unpack_from(data, place)
        place += _HEAD.size
        if length > len(data) - place:
            counters["damaged_chunks"] += 1
            return
        if kind in (_CHANNEL, _MESSAGE):
            yield kind, data[place : place + length]
        place += length


def _unpacked(content: bytes, counters: Counter[str]) -> bytes:
    """Decompress a chunk; a damaged or oversized one is counted and empty."""
    try:
        _, _, _, checksum, name_length = struct.unpack_from("<QQQII", content)
        compression = content[32 : 32 + name_length].decode("ascii")
        (length,) = struct.unpack_from("<Q", content, 32 + name_length)
        packed = content[40 + name_length : 40 + name_length + length]
        data = _unpacked_by(compression, packed)
        if len(data) > CHUNK_MAX or (checksum and zlib.crc32(data) != checksum):
            raise ValueError("too large, or not what was written")
    except _DAMAGE:
        counters["damaged_chunks"] += 1
        return b""
    return data


def _unpacked_by(compression: str, packed: bytes) -> bytes:
    """Decompress one byte more than a chunk may have at most, whatever size the data states."""
    if compression == "zstd":
        unpacker = zstandard.ZstdDecompressor(max_window_size=CHUNK_MAX)
        with unpacker.stream_reader(io.BytesIO(packed), read_across_frames=True) as stream:
            return stream.read(CHUNK_MAX + 1)
    if compression == "lz4":
        data: bytes = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=CHUNK_MAX + 1)
        return data
    if compression:
        raise ValueError(compression)
    return packed


def _note_topic(topics: dict[int, str], content: bytes) -> None:
    """Record the topic of a channel; a damaged channel is ignored."""
    try:
        number, _, length = struct.unpack_from("<HHI", content)
        topics[number] = content[8 : 8 + length].decode()
    except _DAMAGE:
        return


def _document_of(data: bytes) -> Document | None:
    """Parse the JSON object of a message; None if it is none or is too large."""
    num_values = data.count(b",") + data.count(b"[") + data.count(b"{")
    if len(data) > MESSAGE_MAX or num_values > VALUES_MAX:
        return None
    try:
        document = json.loads(data, parse_constant=_refused)
    except (ValueError, RecursionError):
        return None
    return document if isinstance(document, dict) else None


def _refused(constant: str) -> float:
    """Refuse Infinity and NaN, which are not JSON."""
    raise ValueError(constant)


def number(value: object, limit: float = 1e15) -> float | None:
    """Return a number of a document if it is within a limit, else None.

    Parameters
    ----------
    value : object
        Value in the document.
    limit : float
        Largest plausible magnitude.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if abs(value) <= limit else None  # NaN compares false.


def utc_of(document: Document) -> float | None:
    """Return the UTC of a document with a Foxglove timestamp [s]; None if it has none.

    Parameters
    ----------
    document : dict
        Message of a recording.
    """
    at = document.get("timestamp")
    if not isinstance(at, dict):
        return None
    return (number(at.get("sec")) or 0.0) + 1e-9 * (number(at.get("nsec")) or 0.0)


def text(value: object, length_max: int = 4_000) -> str:
    """Return a text of a document, truncated to a length; '' for anything else.

    Parameters
    ----------
    value : object
        Value in the document.
    length_max : int
        Maximum number of characters.
    """
    return value[:length_max] if isinstance(value, str) else ""
