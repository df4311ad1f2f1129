"""Recordings for the page: every message of a flight, one on each line, for the browser to step through."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from companion.errors import RecordError
from companion.recording import mcap_schema as channels
from companion.recording.mcap_reader import messages_of, text
from companion.recording.mcap_writer import encoded
from companion.recording.reader import stamp_of
from companion.recording.recorder import MCAP
from companion.ui.page.feed import UNPUBLISHED, line_of
from companion.ui.page.world_document import WORLD, WorldDocument

MISSION_MAX = 2_000_000  # Most characters of a mission file.


class Playback:
    """A recording, or the result of a replay, in the page's form.

    Parameters
    ----------
    name : str
        Name of the recording on the page.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.world: WorldDocument | None = None
        self._lines: list[bytes] = []

    def tell(self, topic: str, now_s: float, message: Mapping[str, object], data: bytes) -> None:
        """Add a message of a recorder."""
        if topic in UNPUBLISHED:
            return
        if topic == channels.MISSION:
            self.begin(now_s, text(message.get("mission_file"), MISSION_MAX))
        else:
            self._lines.append(line_of(topic, data))

    def begin(self, now_s: float, mission_text: str) -> None:
        """Show a mission file's world from an instant on."""
        self.world = WorldDocument(mission_text, self.name)
        self._lines.append(line_of(WORLD, encoded(now_s, json.loads(self.world.document))))

    @property
    def body(self) -> bytes:
        """All lines."""
        return b"".join(line + b"\n" for line in self._lines)

    @property
    def is_empty(self) -> bool:
        """Whether the playback has no line."""
        return not self._lines


def mcap_of(path: Path) -> Path:
    """Return the mcap of a flight: in its folder, or next to a tlog.

    Raises
    ------
    RecordError
        When there is none.
    """
    file = path / MCAP if path.is_dir() else path.with_suffix(".mcap")
    if not file.exists():
        raise RecordError(f"{path}: no {file.name} there; what was known and decided is in that file")
    return file


def recorded_playback(path: Path) -> Playback:
    """Read the recording in a flight's folder, or next to a tlog.

    Parameters
    ----------
    path : Path
        The folder, its ``flight.mcap``, or its tlog.

    Raises
    ------
    RecordError
        If there is no mcap, or no message in it.
    """
    file = mcap_of(path)
    playback = Playback(file.parent.name)
    for topic, document in messages_of(file, Counter()):
        data = json.dumps(document, separators=(",", ":")).encode("ascii")
        playback.tell(topic, stamp_of(document), document, data)
    if playback.is_empty:
        raise RecordError(f"{file}: no message in it")
    return playback
