"""Deletes the oldest recordings once all of them together exceed a limit."""

from __future__ import annotations

import asyncio
import itertools
import logging
import re
import shutil
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from companion.clock import Clock
from companion.recording.recorder import TLOG

FLIGHTS_MAX_BYTES = 2_000_000_000  # About 100 hours of flight.
LOOK_S = 60.0  # Interval between checks.
NEWS_S = 120.0  # A recording written within this time may belong to another running service.
_NAME = re.compile(r"\d{8}T\d{6}Z-.+")

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class _Kept:
    folder: Path
    size: int
    written_s: float


def _flights_in(flights: Path) -> list[_Kept]:
    """Return the folders of flights, oldest first; other folders are ignored."""
    found = []
    for folder in sorted(flights.iterdir()):
        if not _NAME.fullmatch(folder.name) or folder.is_symlink() or not (folder / TLOG).is_file():
            continue
        files = [entry.stat() for entry in folder.rglob("*") if entry.is_file() and not entry.is_symlink()]
        found.append(_Kept(folder, sum(file.st_size for file in files), max(file.st_mtime for file in files)))
    return found


def prune(flights: Path, limit_bytes: int, running: Path, utc_s: float) -> list[Path]:
    """Delete the oldest flights until the rest does not exceed the limit.

    Parameters
    ----------
    flights : Path
        Folder of all flights. Only subfolders that are named like flights and contain a recording are counted
        or deleted.
    limit_bytes : int
        Limit of the total size.
    running : Path
        Folder of the flight that is being recorded; it is never deleted.
    utc_s : float
        Present time [s since 1970 UTC]; recently written recordings are not deleted.

    Returns
    -------
    list of Path
        Deleted folders.
    """
    deleted: list[Path] = []
    try:
        kept = _flights_in(flights)
        total = sum(entry.size for entry in kept)
        for entry in kept:
            if total <= limit_bytes:
                break
            if entry.folder == running or abs(utc_s - entry.written_s) < NEWS_S:
                continue
            shutil.rmtree(entry.folder)
            deleted.append(entry.folder)
            total -= entry.size
    except OSError as error:
        _log.warning("old flights cannot be deleted: %s", error)
    for folder in deleted:
        _log.info("deleted %s: the recordings take more than %d MB", folder, limit_bytes // 1_000_000)
    return deleted


def folder_for(flights: Path, mission: str, begun: datetime) -> Path:
    """Return a new folder's path; a number is appended if it exists, since a clock may be set back."""
    folder = flights / f"{begun.astimezone(UTC):%Y%m%dT%H%M%SZ}-{mission}"
    names = (folder.with_name(f"{folder.name}-{number}") for number in itertools.count(2))
    return next(path for path in itertools.chain([folder], names) if not path.exists())


def discard(folder: Path) -> None:
    """Delete a recording that is not needed."""
    try:
        shutil.rmtree(folder)
    except OSError as error:
        _log.warning("%s cannot be deleted: %s", folder, error)


async def keep_pruned(flights: Path, limit_bytes: int, running: Path, clock: Clock, epoch_s: float) -> None:
    """Prune every minute; ``epoch_s`` is the UTC at clock reading 0 [s]."""
    while True:
        await asyncio.to_thread(prune, flights, limit_bytes, running, epoch_s + clock.now_s())
        await clock.sleep_until(clock.now_s() + LOOK_S)
