"""The part of a flight's state that a restarted service cannot learn from the autopilot.

The autopilot has the flown mission, but neither the path from which it was made nor the goals that are
reached. Both are stored in files, and used only if they match the autopilot's mission. They belong to one
flight: after disarming they are deleted, and the next flight begins at its first goal.
"""

from __future__ import annotations

import io
import json
import logging
import math
import re
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path as FilePath

import numpy as np

from companion.flight.state.flight_state import FlightState
from companion.frames import FloatArray
from companion.safe_files import StateFile, read_file, rename_damaged
from companion.types.mission import MissionItem
from companion.types.path import Path
from companion.types.state import ReturnEnd

_log = logging.getLogger(__name__)

Places = Sequence[tuple[float, float, float]]

GOALS_END, FLOWN_END = ".goals.json", ".flown.npz"  # The ends of the files' names.
WIND_COLUMN = "wind_enu_m_s"  # This column of a path is missing in files of versions before 0.3.
_HEADER = re.compile(  # The header of an array of numbers as numpy writes it.
    rb"\x93NUMPY\x01\x00..\{'descr': '<([fi]8)', 'fortran_order': (True|False), "
    rb"'shape': \(([0-9, ]{0,40})\), \} *\n",
    re.DOTALL,
)
# Largest file and its largest unpacked size in bytes; a path of an hour takes a tenth.
SIZE_MAX, UNPACKED_MAX = 4_000_000, 16_000_000


def key_of(items: Sequence[MissionItem]) -> int:
    """Return a key of a mission part: a checksum of commands and positions, which no autopilot rounds."""
    text = ";".join(f"{item.command},{item.latitude_e7},{item.longitude_e7}" for item in items)
    return zlib.crc32(text.encode("ascii"))


class Checkpoint:
    """The goals that are reached, and the flown path.

    Parameters
    ----------
    stem : Path, optional
        Common beginning of the files' names; without it nothing outlasts the process.
    contents : mapping of str to bytes, optional
        Initial contents by the ends of the files' names, instead of the files.
    is_threaded : bool
        Whether files are written in threads, as in a service.
    """

    def __init__(
        self,
        stem: FilePath | None = None,
        contents: Mapping[str, bytes] | None = None,
        *,
        is_threaded: bool = False,
    ) -> None:
        self._files: dict[str, StateFile] = {}
        for end in () if stem is None else (GOALS_END, FLOWN_END):
            path = FilePath(f"{stem}{end}")
            self._files[end] = StateFile(path, partial(_note_failure, path), is_threaded=is_threaded)
        self._contents = dict(contents) if contents is not None else self._read()

    @property
    def contents(self) -> Mapping[str, bytes]:
        """The contents by the ends of the files' names, from which another checkpoint can be made."""
        return self._contents

    def reached(self, goals: Places) -> int:
        """Return the number of goals reached of this list of goals; 0 for another list."""
        kept = _goals_in(self._contents.get(GOALS_END))
        if kept is None or kept.places != _rounded(goals):
            return 0
        return kept.reached

    @property
    def return_end(self) -> ReturnEnd | None:
        """Where the return ends that the service plans, and whether a landing follows; None without one."""
        kept = _goals_in(self._contents.get(GOALS_END))
        return None if kept is None else kept.return_end

    def note_progress(self, state: FlightState, boot_s: float) -> None:
        """Store which goals are reached, and where a return ends that the service plans."""
        ends = (state.goals[-1].position_enu_m, state.tail_enu_m is not None) if state.is_returning else None
        places = [goal.position_enu_m for goal in state.own_goals]
        self.note_reached(places, state.num_done, boot_s, ends)

    def note_reached(
        self, goals: Places, number: int, boot_s: float = 0.0, return_end: ReturnEnd | None = None
    ) -> None:
        """Store how many goals of a list are reached, and how long the autopilot has run since boot [s].

        In a return that the service plans, all of them are given up, and ``return_end`` is stored.
        """
        kept = {"goals": _rounded(goals), "reached": min(number, len(goals)), "boot_s": boot_s}
        if return_end is not None:
            kept["return_end"] = [*return_end[0], float(return_end[1])]
        self._keep(GOALS_END, json.dumps(kept).encode("ascii"))

    @property
    def boot_s(self) -> float:
        """The autopilot's time since boot at the last note [s]; a shorter one now means a restart."""
        kept = _goals_in(self._contents.get(GOALS_END))
        return 0.0 if kept is None else kept.boot_s

    def flown(self, key: int) -> tuple[Path, float] | None:
        """Return the path of the mission with this key, and the path's time at its end; None if unknown."""
        kept = _flown_in(self._contents.get(FLOWN_END))
        return None if kept is None or kept[0] != key else kept[1:]

    def note_flown(self, key: int, path: Path, until_s: float) -> None:
        """Store the path of a mission."""
        buffer = io.BytesIO()
        columns = {field.name: getattr(path, field.name) for field in fields(Path)}
        np.savez(buffer, key=key, until_s=until_s, **columns)
        self._keep(FLOWN_END, buffer.getvalue())

    def forget(self) -> None:
        """Delete everything: a flight is over."""
        self._contents.clear()
        for file in self._files.values():
            file.replace(b"")

    def wait(self) -> None:
        """Wait until everything is written."""
        for file in self._files.values():
            file.wait()

    def _read(self) -> dict[str, bytes]:
        kept = {}
        for end, file in self._files.items():
            try:
                data = read_file(file.path, SIZE_MAX)
                is_sound = (_goals_in(data) if end == GOALS_END else _flown_in(data)) is not None
            except FileNotFoundError:
                continue
            except OSError:
                is_sound = False
            if is_sound:
                kept[end] = data
            else:
                renamed = rename_damaged(file.path)
                found = "cannot be read" if renamed is None else f"was damaged and is now {renamed}"
                _log.error("%s %s: the flight begins without it", file.path, found)
        return kept

    def _keep(self, end: str, data: bytes) -> None:
        """Store, completely or not at all; a full disk loses the checkpoint, not the flight."""
        self._contents[end] = data
        if (file := self._files.get(end)) is not None:
            file.replace(data)


def _note_failure(path: FilePath, error: OSError) -> None:
    """Log that a file cannot be written or deleted."""
    _log.error("the checkpoint %s cannot be written: %s", path, error)


@dataclass(frozen=True, slots=True)
class _Goals:
    """A list of goals, how many are reached, the autopilot's time since boot then [s], and a return's end."""

    places: list[tuple[float, ...]]
    reached: int
    boot_s: float
    return_end: ReturnEnd | None = None


def _goals_in(data: bytes | None) -> _Goals | None:
    """Return the content of a file of goals; None if it is not valid."""
    try:
        kept = json.loads((data or b"")[: SIZE_MAX + 1])
        places = [tuple(float(x) for x in place) for place in kept["goals"]]
        goals = _Goals(places, int(kept["reached"]), float(kept["boot_s"]), _return_end_in(kept))
    except (ValueError, LookupError, TypeError, OverflowError, RecursionError):
        return None
    return goals if 0 <= goals.reached <= len(places) and math.isfinite(goals.boot_s) else None


def _return_end_in(kept: dict[str, object]) -> ReturnEnd | None:
    """Return where a return ends; None without one. What is not valid raises ValueError or TypeError."""
    stored = kept.get("return_end")
    if not isinstance(stored, list):
        return None
    east, north, up, is_landing = (float(value) for value in stored)
    if not (math.isfinite(east) and math.isfinite(north) and math.isfinite(up)):
        raise ValueError("a return's end is not finite")
    return (east, north, up), bool(is_landing)


def _flown_in(data: bytes | None) -> tuple[int, Path, float] | None:
    """Return key, path and end time [s] of a file; None if it is not valid."""
    try:
        arrays = _arrays_in(data or b"")
        key, until_s = int(arrays.pop("key").item()), float(arrays.pop("until_s").item())
        east, north = arrays.pop(WIND_COLUMN, np.zeros(2)).tolist()
    except (OSError, EOFError, ValueError, LookupError, OverflowError, RuntimeError, zlib.error):
        return None  # zipfile raises RuntimeError for an unknown compression.
    except (zipfile.BadZipFile, MemoryError):
        return None
    rows = arrays["times_s"].shape
    shapes = {"positions_enu_m": (*rows, 3), "position_covariances_m2": (*rows, 3, 3)}
    if len(rows) != 1 or any(array.shape != shapes.get(name, rows) for name, array in arrays.items()):
        return None
    numbers = (*arrays["times_s"], *arrays["positions_enu_m"].flat, until_s)
    if not np.isfinite((*numbers, east, north)).all():
        return None
    return key, Path(**arrays, wind_enu_m_s=(east, north)), until_s


def _arrays_in(data: bytes) -> dict[str, FloatArray]:
    """Return the arrays (N, …) of an archive, by name.

    The stated sizes are added up before anything is unpacked, and nothing is unpacked beyond them.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > UNPACKED_MAX:
            raise ValueError("too large")
        names = ("key", "until_s", *(field.name for field in fields(Path)))
        held = archive.namelist()
        return {
            name: _array_in(archive, f"{name}.npy")
            for name in names
            if name != WIND_COLUMN or f"{name}.npy" in held
        }


def _array_in(archive: zipfile.ZipFile, name: str) -> FloatArray:
    """Return an array (N, …) of numbers as numpy writes it; other contents are refused."""
    with archive.open(name) as entry:
        data = entry.read(UNPACKED_MAX)
    header = _HEADER.match(data)
    if header is None:
        raise ValueError("no array of numbers")
    kind, is_by_columns, sizes = (group.decode("ascii") for group in header.groups())
    shape = tuple(int(size) for size in sizes.split(",") if size.strip())
    numbers = np.frombuffer(data, dtype=f"<{kind}", offset=header.end()).astype(np.float64)
    return numbers.reshape(shape, order="F" if is_by_columns == "True" else "C")


def _rounded(goals: Places) -> list[tuple[float, ...]]:
    return [tuple(round(float(value), 1) for value in goal) for goal in goals]
