"""Requests to the page's server other than the stream: files, recordings, the radars' field, the ground."""

from __future__ import annotations

import json
from collections.abc import Sequence
from http import HTTPStatus
from importlib.resources import files

from companion import __version__
from companion.loopback_server import Answer, Request, head_of
from companion.ui.page.feed import Feed
from companion.ui.page.ground import Ground
from companion.ui.page.playback import Playback
from companion.ui.page.world_document import WorldDocument
from companion.ui.reports.vocabulary import as_script

STATIC = "static"
DIGITS = 9  # Most digits of a tile's column.
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
    ".json": "application/json",
}
# The page loads nothing from other hosts, runs no script of a message, and no other page may frame it.
HEADERS = (
    "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; frame-src 'self'; frame-ancestors 'self'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options: nosniff",
    "Referrer-Policy: no-referrer",
    "Cache-Control: no-store",
)


class Pages:
    """Answers to requests.

    Parameters
    ----------
    feed : Feed or None
        A running flight; None where recordings are shown.
    playbacks : sequence of Playback
        Recordings.
    ground : Ground or None
        The ground under the map.
    """

    def __init__(self, feed: Feed | None, playbacks: Sequence[Playback], ground: Ground | None) -> None:
        self._feed, self._playbacks, self._ground = feed, tuple(playbacks), ground
        self._files = {f"/{name}": data for name, data in static_files().items()}
        self._files["/"] = self._files["/index.html"]

    def answer(self, request: Request) -> bytes:
        """Return the answer to a request, as bytes."""
        path = request.target.partition("?")[0]
        answer = self._found(path)
        return head_of(answer, *HEADERS) + (b"" if request.method == "HEAD" else answer.body)

    def _found(self, path: str) -> Answer:
        if path in self._files:
            kind = KINDS["." + path.rpartition(".")[2] if "." in path else ".html"]
            return Answer(HTTPStatus.OK, kind, self._files[path])
        match path.split("/")[1:]:
            case ["sources.json"]:
                return _json(self._sources())
            case ["recording", number] if (playback := self._playback(number)) is not None:
                return Answer(HTTPStatus.OK, "text/plain; charset=utf-8", playback.body)
            case ["field", number, height] if (world := self._world(number)) is not None:
                return _field(world, height)
            case ["floors", number] if (world := self._world(number)) is not None:
                return Answer(HTTPStatus.OK, KINDS[".json"], world.floors())
            case ["ground", number] if (world := self._world(number)) is not None and self._shows(world):
                return Answer(HTTPStatus.OK, KINDS[".json"], world.ground(self._ground))
            case ["tiles", *place] if (tile := self._tile(place)) is not None:
                return tile
            case _:
                return Answer(HTTPStatus.NOT_FOUND, "text/plain", b"there is no such page\n")

    def _sources(self) -> dict[str, object]:
        """Return the flights and recordings that can be shown."""
        live = [] if self._feed is None else [{"name": "live", "stream": "/stream"} | self._data_of("live")]
        recordings = [
            {"name": playback.name, "recording": f"/recording/{number}"} | self._data_of(str(number))
            for number, playback in enumerate(self._playbacks)
        ]
        return {"version": __version__, "sources": [*live, *recordings]}

    def _data_of(self, number: str) -> dict[str, str]:
        """Addresses of data that is fetched in addition to a flight's messages."""
        ground = {} if self._ground is None else {"ground": f"/ground/{number}"}
        return {"field": f"/field/{number}"} | ground

    def _shows(self, world: WorldDocument) -> bool:
        """Return whether there is any ground to draw."""
        return self._ground is not None or world.knows_ground

    def _tile(self, place: Sequence[str]) -> Answer | None:
        """Picture of a tile, by zoom, column and row of its address; None if there is no such address.

        A missing tile is no error: browsers would log one for each.
        """
        is_one = len(place) == 3 and all(
            part.isascii() and part.isdecimal() and len(part) < DIGITS for part in place
        )
        if not is_one or self._ground is None:
            return None
        found = self._ground.tile(*map(int, place))
        return (
            Answer(HTTPStatus.NO_CONTENT, "text/plain", b"")
            if found is None
            else Answer(HTTPStatus.OK, *found)
        )

    def _playback(self, number: str) -> Playback | None:
        is_one = number.isascii() and number.isdecimal() and len(number) < 4
        return self._playbacks[int(number)] if is_one and int(number) < len(self._playbacks) else None

    def _world(self, number: str) -> WorldDocument | None:
        if number == "live":
            return None if self._feed is None else self._feed.world
        playback = self._playback(number)
        return None if playback is None else playback.world


def _json(document: dict[str, object]) -> Answer:
    return Answer(HTTPStatus.OK, KINDS[".json"], json.dumps(document).encode("ascii"))


def _field(world: WorldDocument, height: str) -> Answer:
    """Return the radars' field at a requested height [m]."""
    try:
        return Answer(HTTPStatus.OK, KINDS[".json"], world.field(float(height[:20])))
    except ValueError:
        return Answer(HTTPStatus.BAD_REQUEST, "text/plain", b"a height in metres, please\n")


def static_files() -> dict[str, bytes]:
    """Return the page's files by their path."""
    found: dict[str, bytes] = {}
    folder = files("companion.ui.page").joinpath(STATIC)
    for entry in folder.iterdir():
        inside = entry.iterdir() if entry.is_dir() else (entry,)
        prefix = f"{entry.name}/" if entry.is_dir() else ""
        found |= {f"{prefix}{file.name}": file.read_bytes() for file in inside if file.is_file()}
    return found | {"kinds.js": as_script()}
