"""A mission file that is being edited: its text, what can be undone, and whether others changed the file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from companion.config.load import BYTES_MAX, mission_text
from companion.config.sections.geographic_places import frame_of
from companion.config.source import KeyPath, parse
from companion.errors import ConfigError
from companion.safe_files import read_file, replace_file
from companion.ui.editor.place_changes import bounded, drawn, fenced, moved, removed, set_value
from companion.ui.editor.text_edits import exchanged, parsed

STEPS_MAX = 500  # Number of changes that can be undone.
CHANGES_MAX = 2_000  # One step has at most this many changes.
KINDS = ("set", "move", "bound", "add", "remove", "fence", "exchange")
CORNERS_MAX = 1_000
DEPTH_MAX = 6  # The path of a change has at most this many parts.
MARK = "\ufeff"  # Some editors begin a file with it.


@dataclass(frozen=True, slots=True)
class Change:
    """One change, as the page asks for it.

    Parameters
    ----------
    kind : str
        ``set`` a key, ``move`` a place, ``add``, ``remove`` or ``exchange`` an entry of a list, ``bound`` the
        mission, or ``fence`` it.
    path : tuple
        Path of the key, place or entry; places are named as in metres.
    value : object
        New value; the way east and north of ``move``; west, east, south and north of ``bound``; corners of
        ``fence``, east and north [m]; of ``exchange``, how many places on the other entry is.
    """

    kind: str
    path: KeyPath
    value: object = None


def change_of(document: object) -> Change:
    """Return a change that a request describes by ``do``, ``path`` and ``value``.

    Raises
    ------
    ConfigError
        If it describes none.
    """
    if not isinstance(document, Mapping):
        raise _wrong("changes", document, "a list of mappings with do, path and value")
    kind, path, value = (document.get(key) for key in ("do", "path", "value"))
    if kind not in KINDS:
        raise _wrong("do", kind, f"one of {', '.join(KINDS)}")
    is_path = isinstance(path, list) and 0 < len(path) <= DEPTH_MAX
    if not is_path or not all(type(part) in (str, int) for part in path):  # type: ignore[union-attr]
        raise _wrong("path", path, f"a list of 1 to {DEPTH_MAX} keys and numbers")
    expected = _expected_value(str(kind), value)
    if expected is not None:
        raise _wrong("value", value, expected)
    return Change(str(kind), tuple(path), value)  # type: ignore[arg-type]


def changes_of(document: object) -> list[Change]:
    """Return the changes in a list.

    Raises
    ------
    ConfigError
        If one of them is none.
    """
    if not isinstance(document, Sequence) or isinstance(document, str) or len(document) > CHANGES_MAX:
        raise _wrong("changes", document, f"a list of at most {CHANGES_MAX} changes")
    return [change_of(entry) for entry in document]


def changed_text(text: str, changes: Sequence[Change]) -> str:
    """Return a mission file's text after changes.

    Raises
    ------
    ConfigError
        If one of them is not possible.
    """
    for change in changes:
        text = _changed(text, change)
    return text


def _changed(text: str, change: Change) -> str:
    path, value = change.path, change.value
    if change.kind == "set":
        return set_value(text, path, value)
    if change.kind == "remove":
        return removed(text, path)
    if change.kind == "exchange":
        return exchanged(text, path, int(str(value)))
    frame = frame_of(parsed(text))
    if change.kind == "add":
        return drawn(text, frame, path, value)
    assert isinstance(value, list)
    if change.kind == "fence":
        return fenced(text, frame, value)
    return bounded(text, frame, value) if change.kind == "bound" else moved(text, frame, path, value)


class EditedMission:
    """A mission file's text, which is changed step by step and saved as a whole.

    Parameters
    ----------
    path : Path
        The mission file.

    Raises
    ------
    ConfigError
        If it cannot be read, or is no YAML.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._target = path.resolve()  # A link to the file stays one; where it leads later does not count.
        self.number = 0
        self._undone: list[str] = []
        self._done: list[str] = []
        self.text = self._saved = self._read()

    def _read(self) -> str:
        text = mission_text(self.path)
        parse(text, str(self.path))
        self._bytes = self._present()
        return text

    @property
    def is_changed(self) -> bool:
        """Whether there is something to save."""
        return self.text != self._saved

    @property
    def can_undo(self) -> bool:
        """Whether there is a step to undo."""
        return bool(self._done)

    @property
    def can_redo(self) -> bool:
        """Whether there is an undone step."""
        return bool(self._undone)

    def change(self, changes: Sequence[Change]) -> None:
        """Make changes, as one step to undo; all of them or none.

        Raises
        ------
        ConfigError
            If one of them is not possible.
        """
        text = changed_text(self.text, changes)
        if text == self.text:
            return
        self._done = [*self._done, self.text][-STEPS_MAX:]
        self._undone = []
        self._become(text)

    def undo(self) -> None:
        """Undo the last step, if there is one."""
        if self._done:
            self._undone.append(self.text)
            self._become(self._done.pop())

    def redo(self) -> None:
        """Make the step again that was undone last, if there is one."""
        if self._undone:
            self._done.append(self.text)
            self._become(self._undone.pop())

    def save(self) -> None:
        """Write the file, whole or not at all.

        Raises
        ------
        ConfigError
            If the file was changed by others since it was read, or cannot be written.
        """
        if self._present() != self._bytes:
            expected = "the file as it was read; load it anew, and change that"
            raise ConfigError(str(self.path), None, "file", "a file that was changed meanwhile", expected)
        data = ((MARK if self._bytes.startswith(MARK.encode()) else "") + self.text).encode()
        try:
            replace_file(self._target, data, os.stat(self._target).st_mode & 0o777)
        except OSError as error:
            found = error.strerror or str(error)
            raise ConfigError(str(self.path), None, "file", found, "a file that can be written") from None
        self._bytes, self._saved = data, self.text

    def reload(self) -> None:
        """Read the file again; this is a step that can be undone.

        Raises
        ------
        ConfigError
            If it cannot be read, or is no YAML.
        """
        text = self._read()
        self._saved = text
        if text != self.text:
            self._done, self._undone = [*self._done, self.text][-STEPS_MAX:], []
            self._become(text)

    def _become(self, text: str) -> None:
        self.text = text
        self.number += 1

    def _present(self) -> bytes:
        """Return what the file holds now; nothing if it is gone."""
        try:
            return read_file(self._target, BYTES_MAX)
        except OSError:
            return b""


def _expected_value(kind: str, value: object) -> str | None:
    """Return what was expected instead of a change's value; None if it can be one."""
    size = {"move": 2, "bound": 4}.get(kind)
    if size is not None and not _are_numbers(value, size):
        return f"a list of {size} numbers (metres)"
    if kind == "fence" and not _are_corners(value):
        return f"at most {CORNERS_MAX} pairs of numbers (metres)"
    if kind == "exchange" and type(value) is not int:
        return "a whole number of places"
    return None


def _are_numbers(value: object, size: int) -> bool:
    return (
        isinstance(value, list)
        and len(value) == size
        and all(type(entry) in (int, float) and abs(entry) < 1e7 for entry in value)  # NaN is not below.
    )


def _are_corners(value: object) -> bool:
    return (
        isinstance(value, list)
        and len(value) <= CORNERS_MAX
        and all(_are_numbers(entry, 2) for entry in value)
    )


def _wrong(key: str, value: object, expected: str) -> ConfigError:
    return ConfigError("request", None, key, repr(value)[:60], expected)
