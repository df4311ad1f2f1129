"""Writes ``flight.mcap``, which contains knowledge, plans and decisions of a flight with their schemas."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from companion.errors import RecordError
from companion.recording.mcap_schema import CHANNELS, Schema
from companion.safe_files import open_to_write

CHUNK_S = 0.5  # A killed process loses at most this time. Half of what docs/promises.md allows.
_DIGITS = 9


class FlightLog:
    """Writes messages to an MCAP file.

    A chunk is closed and passed to the operating system every half second. The file of a killed process lacks
    its end; :func:`companion.recording.mcap_reader.messages_of` can read it.

    Parameters
    ----------
    path : Path
        The file; an existing one is replaced.
    epoch_s : float
        UTC at clock reading 0 [s].

    Raises
    ------
    RecordError
        If the file cannot be written, now or later. The log is then closed.
    """

    def __init__(self, path: Path, epoch_s: float) -> None:
        self._path, self._epoch_s = path, epoch_s
        self._flushed_s = -math.inf
        try:
            self._file = open_to_write(path)
            self._writer: Writer | None = Writer(self._file, compression=CompressionType.ZSTD)
            self._writer.start("", "companion")
            self._channels = registered(
                self._writer, {channel.topic: (channel.name, channel.schema) for channel in CHANNELS}
            )
        except OSError as error:
            raise self._failure(error) from error

    def write(self, topic: str, now_s: float, data: bytes) -> None:
        """Add a message that :func:`encoded` made."""
        if self._writer is None:
            return
        stamp = max(0, round(1e9 * (self._epoch_s + now_s)))
        try:
            self._writer.add_message(self._channels[topic], stamp, data, stamp)
            if not 0.0 <= now_s - self._flushed_s < CHUNK_S:
                self._writer.flush()
                self._flushed_s = now_s
        except OSError as error:
            self._abandon()
            raise self._failure(error) from error

    def close(self) -> None:
        """Write index and end, and close the file."""
        writer, self._writer = self._writer, None
        if writer is None:
            return
        try:
            writer.finish()
            self._file.close()
        except OSError as error:
            self._abandon()
            raise self._failure(error) from error

    def _abandon(self) -> None:
        """Close the file without another error."""
        self._writer = None
        with contextlib.suppress(OSError):
            self._file.close()

    def _failure(self, error: OSError) -> RecordError:
        return RecordError(f"{self._path}: {error.strerror or error}")


def registered(writer: Writer, schemas: Mapping[str, tuple[str, Schema]]) -> dict[str, int]:
    """Register a channel for each topic, given the name and JSON schema; returns their ids by topic."""
    return {
        topic: writer.register_channel(
            topic, "json", writer.register_schema(name, "jsonschema", json.dumps(schema).encode("ascii"))
        )
        for topic, (name, schema) in schemas.items()
    }


def encoded(now_s: float, message: Mapping[str, object]) -> bytes:
    """Encode a message as JSON on one line; adds ``stamp_s`` unless it has a ``timestamp``."""
    document = message if "timestamp" in message else {"stamp_s": now_s, **message}
    return json.dumps(plain(document), allow_nan=False, separators=(",", ":")).encode("ascii")


def plain(value: object) -> object:
    """Convert a value to JSON types: arrays to lists, data classes to tables, infinite values to null."""
    if isinstance(value, float | np.floating):
        return round(float(value), _DIGITS) if math.isfinite(value) else None
    if isinstance(value, np.integer | np.bool_):
        return value.item()
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray):
        return _plain_array(value)
    return _plain_parts(value)


def _plain_array(values: np.ndarray[tuple[int, ...], np.dtype[Any]]) -> object:
    """Convert an array to lists, at once if its numbers allow it; ``values`` (…,), search trees are large."""
    if values.dtype.kind in "iub":
        return values.tolist()
    if values.dtype.kind == "f" and np.isfinite(values).all():
        return np.round(values.astype(np.float64), _DIGITS).tolist()
    return plain(values.tolist())


def _plain_parts(value: object) -> object:
    """Convert the elements of a container; return anything else unchanged."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(entry) for entry in value]
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    return value
