"""What there is to ask the page's server for besides the stream: files, recordings, the radars' field."""

from __future__ import annotations

import json
from collections.abc import Sequence
from http import HTTPStatus
from importlib.resources import files

from companion import __version__
from companion.loopback_server import Answer, Request, head_of
from companion.page.feed import Feed
from companion.page.playback import Playback
from companion.page.world_document import WorldDocument
from companion.ui.vocabulary import as_script

STATIC = "static"
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
    ".json": "application/json",
}
# Nothing of another host is loaded, nothing that stands in a message is run, no other page frames this one.
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
    """

    def __init__(self, feed: Feed | None, playbacks: Sequence[Playback]) -> None:
        self._feed, self._playbacks = feed, tuple(playbacks)
        self._files = {f"/{name}": data for name, data in static_files().items()}
        self._files["/"] = self._files["/index.html"]

    def answer(self, request: Request) -> bytes:
        """Answer to a request as it goes out."""
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
            case _:
                return Answer(HTTPStatus.NOT_FOUND, "text/plain", b"there is no such page\n")

    def _sources(self) -> dict[str, object]:
        """What can be looked at."""
        recordings = [
            {"name": playback.name, "recording": f"/recording/{number}", "field": f"/field/{number}"}
            for number, playback in enumerate(self._playbacks)
        ]
        live = [] if self._feed is None else [{"name": "live", "stream": "/stream", "field": "/field/live"}]
        return {"version": __version__, "sources": [*live, *recordings]}

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
    """The field at a height that is asked for [m]."""
    try:
        return Answer(HTTPStatus.OK, KINDS[".json"], world.field(float(height[:20])))
    except ValueError:
        return Answer(HTTPStatus.BAD_REQUEST, "text/plain", b"a height in metres, please\n")


def static_files() -> dict[str, bytes]:
    """The page's files by their path."""
    found: dict[str, bytes] = {}
    folder = files("companion.page").joinpath(STATIC)
    for entry in folder.iterdir():
        inside = entry.iterdir() if entry.is_dir() else (entry,)
        prefix = f"{entry.name}/" if entry.is_dir() else ""
        found |= {f"{prefix}{file.name}": file.read_bytes() for file in inside if file.is_file()}
    return found | {"kinds.js": as_script()}
