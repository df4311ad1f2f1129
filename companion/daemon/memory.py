"""What a restarted service must know of the flight, and the autopilot cannot tell.

The autopilot holds the mission that is flown, but not the path it was made from, nor which goals are
reached. Both are kept in files, and believed only where they fit what the autopilot holds.
"""

from __future__ import annotations

import io
import json
import logging
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path as FilePath

import numpy as np

from companion.types.mission import MissionItem
from companion.types.path import Path

_log = logging.getLogger(__name__)

Places = Sequence[tuple[float, float, float]]


def key_of(items: Sequence[MissionItem]) -> int:
    """Number of a part of a mission by its commands and places, which no autopilot rounds."""
    text = ";".join(f"{item.command},{item.latitude_e7},{item.longitude_e7}" for item in items)
    return zlib.crc32(text.encode("ascii"))


class Memory:
    """Goals reached, and the path being flown, in two files.

    Parameters
    ----------
    stem : Path or None
        Beginning of the files' names; None remembers nothing.
    """

    def __init__(self, stem: FilePath | None) -> None:
        self._goals = None if stem is None else stem.with_name(stem.name + ".goals.json")
        self._flown = None if stem is None else stem.with_name(stem.name + ".flown.npz")

    def reached(self, goals: Places) -> int:
        """Goals reached of this very list; 0 where nothing of it is known."""
        if self._goals is None:
            return 0
        try:
            kept = json.loads(self._goals.read_text(encoding="utf-8"))
            number, places = int(kept["reached"]), [tuple(float(x) for x in place) for place in kept["goals"]]
        except (OSError, ValueError, KeyError, TypeError):
            return 0
        return number if places == _rounded(goals) and 0 <= number <= len(places) else 0

    def note_reached(self, goals: Places, number: int) -> None:
        """Remember how many goals of a list are reached."""
        _write(self._goals, json.dumps({"goals": _rounded(goals), "reached": number}).encode("ascii"))

    def flown(self, key: int) -> tuple[Path, float] | None:
        """The path that a mission of this number carries, and the path's time at its end; None if unknown."""
        if self._flown is None:
            return None
        try:
            with np.load(io.BytesIO(self._flown.read_bytes()), allow_pickle=False) as kept:
                if int(kept["key"]) != key:
                    return None
                path = Path(**{field.name: kept[field.name] for field in fields(Path)})
                return path, float(kept["until_s"])
        except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
            return None

    def note_flown(self, key: int, path: Path, until_s: float) -> None:
        """Remember the path that a mission carries."""
        if self._flown is None:
            return
        buffer = io.BytesIO()
        columns = {field.name: getattr(path, field.name) for field in fields(Path)}
        np.savez(buffer, key=key, until_s=until_s, **columns)
        _write(self._flown, buffer.getvalue())


def _write(path: FilePath | None, data: bytes) -> None:
    """Write whole or not at all; a full disk costs the memory, not the flight."""
    if path is None:
        return
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(data)
        part.replace(path)
    except OSError as error:
        _log.error("the flight's state is not remembered: %s", error)


def _rounded(goals: Places) -> list[tuple[float, ...]]:
    return [tuple(round(float(value), 1) for value in goal) for goal in goals]
