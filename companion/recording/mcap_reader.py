"""``flight.mcap`` read back, whatever is in it: nothing that it claims of its sizes is believed.

A chunk is unpacked as a stream that ends at a limit, so that a small file cannot fill the memory; what a
file may hold in all is limited, too, far beyond the longest flight. What is damaged or too large is left
out and counted.
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

CHUNK_MAX = 16 * 2**20  # bytes, unpacked; ours take one or two MB
MESSAGE_MAX = 8 * 2**20  # bytes; the longest of ours has a mission file in it
VALUES_MAX = 1_000_000  # in one message; a plan has some thousand
TOTAL_MAX = 512 * 2**20  # bytes, unpacked, of a file: some ten hours of flight
MESSAGES_MAX = 1_000_000  # of a file
_MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # of a record: what it is, and its length
_FOOTER, _CHANNEL, _MESSAGE, _CHUNK = 0x02, 0x04, 0x05, 0x06
_MESSAGE_HEAD = 22
_DAMAGE = (struct.error, ValueError, zstandard.ZstdError, RuntimeError, EOFError, MemoryError, OverflowError)

Document = dict[str, object]


class _TooMuch(Exception):
    """A file that holds more than any flight leaves."""


def messages_of(path: Path, counters: Counter[str]) -> Iterator[tuple[str, Document]]:
    """Messages of an mcap with their topics, in order, as far as it can be read.

    One whose end is missing, since the process was killed, is read to there (``mcap_ends_early``);
    chunks and messages that are damaged or too large are left out (``damaged_chunks``,
    ``damaged_messages``), and so is what lies beyond the limits (``mcap_too_large``).

    Raises
    ------
    RecordError
        When the file cannot be opened.
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
    """Channels and messages, until there are more than any flight leaves."""
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
    """Channels, messages and chunks of a file, which ends with a footer or too early."""
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
        elif length > CHUNK_MAX:  # nothing packed is longer than unpacked, but by a few bytes
            file.seek(length, os.SEEK_CUR)
            counters["damaged_chunks"] += 1
        else:
            yield kind, file.read(length)
    counters["mcap_ends_early"] += 1


def _records_in(data: bytes, counters: Counter[str]) -> Iterator[tuple[int, bytes]]:
    """Channels and messages of an unpacked chunk."""
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
    """What a chunk holds; nothing, and counted, where it is damaged or too large."""
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
    """At most one byte more than a chunk may have; what the frame claims of its size is not asked for."""
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
    """Take note of a channel; one that is damaged has none."""
    try:
        number, _, length = struct.unpack_from("<HHI", content)
        topics[number] = content[8 : 8 + length].decode()
    except _DAMAGE:
        return


def _document_of(data: bytes) -> Document | None:
    """A message's JSON object; None where it is none, or one that no program would have written."""
    num_values = data.count(b",") + data.count(b"[") + data.count(b"{")
    if len(data) > MESSAGE_MAX or num_values > VALUES_MAX:
        return None
    try:
        document = json.loads(data, parse_constant=_refused)
    except (ValueError, RecursionError):
        return None
    return document if isinstance(document, dict) else None


def _refused(constant: str) -> float:
    """Infinity and NaN, which are not JSON."""
    raise ValueError(constant)


def number(value: object, limit: float = 1e15) -> float | None:
    """A number of a document within a limit; None for anything else.

    Parameters
    ----------
    value : object
        What stands in the document.
    limit : float
        The largest that can be meant, either sign.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if abs(value) <= limit else None  # no NaN is, and integers may be too long


def utc_of(told: Document) -> float | None:
    """UTC that a document tells as a time of Foxglove's [s]; None where it tells none.

    Parameters
    ----------
    told : dict
        A message.
    """
    at = told.get("timestamp")
    if not isinstance(at, dict):
        return None
    return (number(at.get("sec")) or 0.0) + 1e-9 * (number(at.get("nsec")) or 0.0)


def text(value: object, length_max: int = 4_000) -> str:
    """A text of a document, cut to a length; '' for anything else.

    Parameters
    ----------
    value : object
        What stands in the document.
    length_max : int
        Characters that are kept.
    """
    return value[:length_max] if isinstance(value, str) else ""
