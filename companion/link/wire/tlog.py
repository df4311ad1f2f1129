"""Telemetry logs (tlog): all frames of both directions, in the format of ground stations.

Each entry is the time in microseconds since 1970 UTC (eight bytes, big-endian) followed by the frame.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from companion.errors import RecordError
from companion.link.wire.framing import MAGIC_V1, MAGIC_V2
from companion.safe_files import open_to_read, open_to_write

_STAMP_BYTES = 8
_FLUSH_S = 0.5
_CHUNK = 1 << 16
# A later stamp is damage. A computer whose clock was never set writes stamps from 1970 on.
_STAMP_MAX_US = 4_102_444_800_000_000  # 2100-01-01
_LONGEST_FRAME = 280


@dataclass(frozen=True, slots=True)
class Entry:
    """One recorded frame and its time [s since 1970 UTC]."""

    time_s: float
    raw: bytes


class TlogWriter:
    """Appends frames to a file.

    Data older than half a second has been passed to the operating system, so that a killed process loses less
    than a second.

    Parameters
    ----------
    path : str or Path
        The file; entries are appended to an existing one.

    Raises
    ------
    RecordError
        If the file cannot be written, now or later. The writer is then closed.
    """

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path)
        self._flushed_s = float("-inf")
        try:
            self._file: BinaryIO | None = open_to_write(self._path, append=True)
        except OSError as error:
            raise self._failure(error) from error

    def write(self, time_s: float, raw: bytes) -> None:
        """Append one frame.

        Parameters
        ----------
        time_s : float
            Time since 1970 UTC [s].
        raw : bytes
            The frame as received or sent.
        """
        if self._file is None:
            return
        stamp = max(0, round(time_s * 1e6)).to_bytes(_STAMP_BYTES, "big")
        try:
            self._file.write(stamp + raw)
            # A clock that is set back must not stop the flushing.
            if not 0.0 <= time_s - self._flushed_s < _FLUSH_S:
                self._file.flush()
                self._flushed_s = time_s
        except OSError as error:
            file, self._file = self._file, None
            with contextlib.suppress(OSError):  # On a full disk closing fails, too.
                file.close()
            raise self._failure(error) from error

    def close(self) -> None:
        """Write buffered entries and close the file."""
        if self._file is None:
            return
        file, self._file = self._file, None
        try:
            file.close()
        except OSError as error:
            raise self._failure(error) from error

    def _failure(self, error: OSError) -> RecordError:
        return RecordError(f"{self._path}: {error.strerror or error}")


def read_tlog(path: str | Path, counters: Counter[str] | None = None) -> Iterator[Entry]:
    """Yield the entries of a log in file order.

    A truncated or damaged log is read as far as possible. Damaged bytes are skipped up to the next valid
    entry and counted as ``skipped_bytes``.

    Raises
    ------
    RecordError
        If the file cannot be read at all.
    """
    tally: Counter[str] = Counter() if counters is None else counters
    try:
        with open_to_read(Path(path)) as file:
            yield from _entries(file, tally)
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror or error}") from error


def _entries(file: BinaryIO, tally: Counter[str]) -> Iterator[Entry]:
    buffer, position, is_last = b"", 0, False
    while True:
        while not is_last and len(buffer) - position < 2 * (_STAMP_BYTES + _LONGEST_FRAME):
            chunk = file.read(_CHUNK)
            is_last = not chunk
            buffer, position = buffer[position:] + chunk, 0
        if position >= len(buffer):
            return
        length = _entry_length(buffer, position)
        end = position + length
        # The next entry must be valid, too: a magic byte alone is frequent in noise.
        if length and end <= len(buffer) and (end == len(buffer) or _entry_length(buffer, end) or is_last):
            raw = buffer[position + _STAMP_BYTES : end]
            stamp = int.from_bytes(buffer[position : position + _STAMP_BYTES], "big")
            position = end
            yield Entry(stamp * 1e-6, raw)
        else:
            position += 1
            tally["skipped_bytes"] += 1


def _entry_length(buffer: bytes, position: int) -> int:
    """Return the length of the entry at a position, 0 if there is none."""
    start = position + _STAMP_BYTES
    if len(buffer) < start + 3 or int.from_bytes(buffer[position:start], "big") > _STAMP_MAX_US:
        return 0
    if buffer[start] == MAGIC_V1:
        return _STAMP_BYTES + 8 + buffer[start + 1]
    if buffer[start] == MAGIC_V2 and not buffer[start + 2] & ~1:
        return _STAMP_BYTES + 12 + buffer[start + 1] + (13 if buffer[start + 2] else 0)
    return 0
