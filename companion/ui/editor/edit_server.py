"""The editor's HTTP server: the page's files, and requests in JSON, a thread for each.

A plan is answered when it is made, so that requests wait; the page's own server never does. Only who has the
token gets an answer. A request that may change something has to be JSON, and comes from a page of this server
only: a browser tells the page's origin, and asks before it sends JSON elsewhere.
"""

from __future__ import annotations

import json
import logging
import sys
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from companion.errors import CompanionError, ConfigError
from companion.loopback_server import Answer, Request, head_of
from companion.ui.editor.edit_session import EditSession
from companion.ui.editor.plan_answers import SupersededError
from companion.ui.page.access import Access
from companion.ui.page.ground import Ground
from companion.ui.page.pages import HEADERS, Pages

BODY_MAX = 2_000_000  # Bytes of a request.
TIMEOUT_S = 10.0  # Time in which a browser has to send a request, and to accept the answer.
CONNECTIONS_MAX = 32
POLL_S = 0.1  # The server notices within this time that it has to end.
PAGE = "/edit/edit.html"
_JSON = "application/json"
_DIGITS_MAX = 9

_log = logging.getLogger(__name__)


class EditServer:
    """Serves the editor of one mission file.

    Parameters
    ----------
    access : Access
        Where it listens, and who may look.
    session : EditSession
        The mission file.
    ground : Ground, optional
        What is drawn under the map.

    Raises
    ------
    OSError
        If the port is taken, or the address none of this computer's.
    """

    def __init__(self, access: Access, session: EditSession, ground: Ground | None = None) -> None:
        self.access, self.session = access, session
        self.pages = Pages(None, (), ground)
        self._room = threading.BoundedSemaphore(CONNECTIONS_MAX)
        owner = self

        class Handler(_Handler):
            server_of_editor = owner

        class Server(ThreadingHTTPServer):
            daemon_threads = True
            request_queue_size = CONNECTIONS_MAX

            def process_request(self, request: Any, client_address: Any) -> None:  # noqa: ANN401
                if owner._room.acquire(blocking=False):
                    super().process_request(request, client_address)
                else:
                    self.shutdown_request(request)

            def process_request_thread(self, request: Any, client_address: Any) -> None:  # noqa: ANN401
                try:
                    super().process_request_thread(request, client_address)
                finally:
                    owner._room.release()

            def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ANN401, ARG002
                """Log an unexpected error; a browser that closed its connection is none."""
                if not isinstance(sys.exception(), OSError):
                    _log.exception("internal error")

        self._server = Server((access.host, access.port), Handler)
        self.port: int = self._server.server_address[1]
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(POLL_S,), name="editor", daemon=True
        )
        self._thread.start()

    @property
    def address(self) -> str:
        """URL to open in a browser on this computer; with the token, which the browser keeps."""
        return f"{self.access.address(self.port)}?token={self.access.token}"

    def close(self) -> None:
        """End it, and the flight that is being flown."""
        self.session.close()
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


class _Handler(BaseHTTPRequestHandler):
    """One request; the connection is closed after it."""

    server_of_editor: EditServer
    timeout = TIMEOUT_S

    def log_message(self, *_: object) -> None:
        """Say nothing of requests."""

    def do_GET(self) -> None:
        """Answer with a file, or what is known."""
        request = self._request()
        if (refusal := self.server_of_editor.access.refusal(request)) is not None:
            self._send(refusal)
        elif (answer := self._got(request.target.partition("?")[0])) is not None:
            self._tell(answer)
        else:
            self._send(self.server_of_editor.pages.answer(request))

    def do_POST(self) -> None:
        """Carry a request out."""
        request = self._request()
        if (refusal := self.server_of_editor.access.refusal(request)) is not None:
            self._send(refusal)
        elif (refused := self._refused(request)) is not None:
            self._tell(refused)
        else:
            self._tell(self._posted(request.target))

    def _request(self) -> Request:
        headers = {name.lower(): value for name, value in self.headers.items()}
        return Request(self.command, self.path, headers)

    def _got(self, path: str) -> Answer | None:
        """Return the answer to a request that changes nothing; None if it asks for a file."""
        session = self.server_of_editor.session
        match path.split("/")[1:]:
            case [""]:
                return Answer(HTTPStatus.SEE_OTHER, "text/plain", b"")
            case ["edit", "state"]:
                return _json(session.state())
            case ["edit", "tables"]:
                return _json(session.tables())
            case ["edit", "ground"]:
                return Answer(HTTPStatus.OK, _JSON, session.ground())
            case ["edit", "field", height] if _is_number(height):
                return Answer(HTTPStatus.OK, _JSON, session.field(float(height)))
            case ["edit", "flight", since] if _is_number(since):
                return _json(session.flight(int(since)))
            case _:
                return None

    def _refused(self, request: Request) -> Answer | None:
        """Return why a request that may change something is not carried out."""
        origin, host = request.headers.get("origin"), request.headers.get("host", "")
        if origin is not None and origin != f"http://{host}":
            return _said(HTTPStatus.FORBIDDEN, "another page's request")
        if request.headers.get("content-type", "").partition(";")[0].strip() != _JSON:
            return _said(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"a request of another kind than {_JSON}")
        length = request.headers.get("content-length", "")
        if (
            not length.isascii()
            or not length.isdecimal()
            or len(length) > _DIGITS_MAX
            or int(length) > BODY_MAX
        ):
            return _said(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"a request longer than {BODY_MAX} bytes")
        return None

    def _posted(self, target: str) -> Answer:
        """Carry a request out, and return its answer.

        The answer to a wrong one names the key, the value and what was expected. It is no failure of HTTP:
        browsers would log one for each.
        """
        data = self.rfile.read(int(self.headers["content-length"]))
        try:
            found = self.server_of_editor.session.post(target.removeprefix("/edit/"), _body(data))
        except SupersededError as error:
            return _json({"error": str(error), "is_superseded": True})
        except ConfigError as error:
            path = [int(part) if part.isdecimal() else part for part in error.key.split(".")]
            answer = {"error": str(error), "path": path, "key": error.key, "got": error.value}
            return _json(answer | {"expected": error.expected, "line": error.line})
        except CompanionError as error:
            return _said(HTTPStatus.OK, str(error))
        return _said(HTTPStatus.NOT_FOUND, "there is no such request") if found is None else _json(found)

    def _tell(self, answer: Answer) -> None:
        where = [f"Location: {PAGE}"] if answer.status is HTTPStatus.SEE_OTHER else []
        self._send(head_of(answer, *HEADERS, *where) + answer.body)

    def _send(self, data: bytes) -> None:
        self.close_connection = True
        self.wfile.write(data)


def _body(data: bytes) -> dict[str, object]:
    """Return a request's JSON.

    Raises
    ------
    ConfigError
        If it is none, or no mapping.
    """
    try:
        document = json.loads(data or b"{}")
    except (ValueError, RecursionError):
        document = None
    if not isinstance(document, dict):
        raise ConfigError("request", None, "body", f"{len(data)} bytes", "a mapping in JSON")
    return document


def _is_number(text: str) -> bool:
    """Return whether a part of an address is a number of a few digits."""
    return text.isascii() and text.removeprefix("-").isdecimal() and len(text) <= _DIGITS_MAX


def _json(document: dict[str, object], status: HTTPStatus = HTTPStatus.OK) -> Answer:
    return Answer(status, _JSON, json.dumps(document, separators=(",", ":")).encode("ascii"))


def _said(status: HTTPStatus, text: str) -> Answer:
    return _json({"error": text}, status)
