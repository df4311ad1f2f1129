"""What a restarted service must know of the flight, and the autopilot cannot tell.

The autopilot holds the mission that is flown, but not the path it was made from, nor which goals are
reached. Both are kept in files, and believed only where they fit what the autopilot holds. They are of one
flight: an aircraft that is not armed has no use for them, and the next flight begins at its first goal.
"""

from __future__ import annotations

import contextlib
import io
import json
import logging
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path as FilePath

import numpy as np

from companion.safe_files import replace_file
from companion.types.mission import MissionItem
from companion.types.path import Path

_log = logging.getLogger(__name__)

Places = Sequence[tuple[float, float, float]]

GOALS, FLOWN = ".goals.json", ".flown.npz"


def key_of(items: Sequence[MissionItem]) -> int:
    """Number of a part of a mission by its commands and places, which no autopilot rounds."""
    text = ";".join(f"{item.command},{item.latitude_e7},{item.longitude_e7}" for item in items)
    return zlib.crc32(text.encode("ascii"))


class Checkpoint:
    """Goals reached, and the path being flown.

    Parameters
    ----------
    stem : Path, optional
        Beginning of the names of the files that outlast this process; left out, nothing does.
    kept : mapping of str to bytes, optional
        What is remembered at first, by the ends of the files' names, instead of the files' contents.
    """

    def __init__(self, stem: FilePath | None = None, kept: Mapping[str, bytes] | None = None) -> None:
        self._stem = stem
        self._kept = dict(kept) if kept is not None else self._read()

    @property
    def kept(self) -> Mapping[str, bytes]:
        """All that is remembered, by the ends of the files' names; another checkpoint can be made of it."""
        return self._kept

    def reached(self, goals: Places) -> int:
        """Goals reached of this very list; 0 where nothing of it is known."""
        try:
            kept = json.loads(self._kept[GOALS])
            number, places = int(kept["reached"]), [tuple(float(x) for x in place) for place in kept["goals"]]
        except (ValueError, KeyError, TypeError):
            return 0
        return number if places == _rounded(goals) and 0 <= number <= len(places) else 0

    def note_reached(self, goals: Places, number: int, boot_s: float = 0.0) -> None:
        """Remember how many goals of a list are reached, and how long the autopilot had run by then [s]."""
        kept = {"goals": _rounded(goals), "reached": number, "boot_s": boot_s}
        self._keep(GOALS, json.dumps(kept).encode("ascii"))

    @property
    def boot_s(self) -> float:
        """How long the autopilot had run when a goal was noted; one that runs for less was started since."""
        try:
            return float(json.loads(self._kept[GOALS])["boot_s"])
        except (ValueError, KeyError, TypeError):
            return 0.0

    def flown(self, key: int) -> tuple[Path, float] | None:
        """The path that a mission of this number carries, and the path's time at its end; None if unknown."""
        try:
            with np.load(io.BytesIO(self._kept[FLOWN]), allow_pickle=False) as kept:
                if int(kept["key"]) != key:
                    return None
                path = Path(**{field.name: kept[field.name] for field in fields(Path)})
                return path, float(kept["until_s"])
        except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
            return None

    def note_flown(self, key: int, path: Path, until_s: float) -> None:
        """Remember the path that a mission carries."""
        buffer = io.BytesIO()
        columns = {field.name: getattr(path, field.name) for field in fields(Path)}
        np.savez(buffer, key=key, until_s=until_s, **columns)
        self._keep(FLOWN, buffer.getvalue())

    def forget(self) -> None:
        """Remember nothing: a flight is over."""
        self._kept.clear()
        for file in self._files().values():
            try:
                file.unlink(missing_ok=True)
            except OSError as error:
                _log.error("the last flight's state is not forgotten: %s", error)

    def _files(self) -> dict[str, FilePath]:
        stem = self._stem
        return {} if stem is None else {end: stem.with_name(stem.name + end) for end in (GOALS, FLOWN)}

    def _read(self) -> dict[str, bytes]:
        kept = {}
        for end, file in self._files().items():
            with contextlib.suppress(OSError):  # mostly there is none
                kept[end] = file.read_bytes()
        return kept

    def _keep(self, end: str, data: bytes) -> None:
        """Remember; written whole or not at all, and a full disk costs the memory, not the flight."""
        self._kept[end] = data
        file = self._files().get(end)
        if file is None:
            return
        try:
            replace_file(file, data)
        except OSError as error:
            _log.error("the flight's state is not remembered: %s", error)


def _rounded(goals: Places) -> list[tuple[float, ...]]:
    return [tuple(round(float(value), 1) for value in goal) for goal in goals]
