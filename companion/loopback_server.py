"""A small HTTP server for this computer only. It answers GET requests and cannot be blocked by a client.

One thread serves a few connections. Each has a few seconds and a few kilobytes for its request, and further
connections are refused at once, so that neither threads nor memory grow.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus

LOOPBACK = "127.0.0.1"
CONNECTIONS_MAX = 8
TIMEOUT_S = 3.0  # Time for sending a request and receiving the answer.
HEAD_MAX = 8_192  # Bytes of a request.
POLL_S = 0.1  # The thread ends within this time.
_PORTION = 65_536


@dataclass(frozen=True, slots=True)
class Answer:
    """An HTTP response: status, content type (``text/plain``), and content."""

    status: HTTPStatus
    kind: str
    body: bytes


@dataclass(frozen=True, slots=True)
class Request:
    """An HTTP request: ``GET`` or ``HEAD``, the target as sent, and headers by lower-case name."""

    method: str
    target: str
    headers: Mapping[str, str]


@dataclass(slots=True, eq=False)
class _Connection:
    """A connection: its deadline, the bytes received, and the bytes still to be sent."""

    line: socket.socket
    until_s: float
    asked: bytearray = field(default_factory=bytearray)
    unsent: memoryview | None = None

    def receive(self, data: bytes) -> bool:
        """Take received bytes; returns whether the request is complete or too long."""
        self.asked += data
        return b"\r\n\r\n" in self.asked or len(self.asked) > HEAD_MAX

    def answer(self, answer: bytes) -> None:
        """Set the response."""
        self.unsent = memoryview(answer)

    def send(self) -> bool:
        """Send as much as possible without waiting; returns whether all is sent."""
        unsent = self.unsent or memoryview(b"")
        self.unsent = unsent[self.line.send(unsent[:_PORTION]) :]
        return not self.unsent


class LoopbackServer:
    """Serves pages on the loopback interface, in its own thread.

    Parameters
    ----------
    port : int
        TCP port to listen on; 0 for any free port.
    page : callable
        Returns the response for a path; called in the server's thread.
    now_s : callable
        Returns monotonic seconds.

    Raises
    ------
    OSError
        If the port is in use.
    """

    def __init__(
        self, port: int, page: Callable[[str], Answer], now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._page, self._now_s = page, now_s
        self._connections: set[_Connection] = set()
        self._listener = socket.create_server((LOOPBACK, port), backlog=CONNECTIONS_MAX)
        self._listener.setblocking(False)
        self.address: tuple[str, int] = self._listener.getsockname()
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._is_over = False
        self._thread = threading.Thread(target=self._serve, name="metrics", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the server."""
        self._is_over = True
        self._thread.join()

    def _serve(self) -> None:
        while not self._is_over:
            for key, _ in self._selector.select(POLL_S):
                if key.data is None:
                    self._accept()
                else:
                    self._go_on(key.data)
            now = self._now_s()
            for connection in [entry for entry in self._connections if now > entry.until_s]:
                self._drop(connection)
        for connection in list(self._connections):
            self._drop(connection)
        self._selector.close()
        self._listener.close()

    def _accept(self) -> None:
        line = accepted(self._listener, is_full=len(self._connections) >= CONNECTIONS_MAX)
        if line is None:
            return
        connection = _Connection(line, self._now_s() + TIMEOUT_S)
        self._connections.add(connection)
        self._selector.register(line, selectors.EVENT_READ, connection)

    def _go_on(self, connection: _Connection) -> None:
        """Receive or send as much as possible without waiting."""
        try:
            if connection.unsent:
                self._send(connection)
            else:
                self._receive(connection)
        except BlockingIOError:
            return
        except OSError:
            self._drop(connection)

    def _receive(self, connection: _Connection) -> None:
        data = connection.line.recv(HEAD_MAX)
        if not data:
            self._drop(connection)
        elif connection.unsent is None and connection.receive(data):  # Data after the request is ignored.
            connection.answer(self._answer(bytes(connection.asked)))
            self._selector.modify(connection.line, selectors.EVENT_WRITE, connection)

    def _send(self, connection: _Connection) -> None:
        if connection.send():
            # Closing at once would discard the response if received data was still unread.
            connection.line.shutdown(socket.SHUT_WR)
            self._selector.modify(connection.line, selectors.EVENT_READ, connection)

    def _drop(self, connection: _Connection) -> None:
        self._connections.discard(connection)
        self._selector.unregister(connection.line)
        connection.line.close()

    def _answer(self, asked: bytes) -> bytes:
        """Return the bytes of the response to a request."""
        request = request_of(asked)
        if isinstance(request, Answer):
            return head_of(request)
        answer = self._page(request.target.partition("?")[0])
        return head_of(answer) + (b"" if request.method == "HEAD" else answer.body)


def accepted(listener: socket.socket, *, is_full: bool) -> socket.socket | None:
    """Accept a non-blocking connection; None if it was refused as one too many, or is closed already."""
    try:
        line, _ = listener.accept()
    except OSError:  # The client has closed it, or no descriptors are left.
        return None
    line.setblocking(False)
    if not is_full:
        return line
    with line, contextlib.suppress(OSError):
        line.send(head_of(Answer(HTTPStatus.SERVICE_UNAVAILABLE, "text/plain", b"")))
    return None


def request_of(asked: bytes) -> Request | Answer:
    """Parse a request; returns a response for an invalid one."""
    head, end, _ = asked.partition(b"\r\n\r\n")
    first, *lines = head.decode("latin-1").split("\r\n")
    words = first.split(" ")
    if not end:
        return Answer(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, "text/plain", b"")
    if len(words) != 3 or not words[2].startswith("HTTP/1."):
        return Answer(HTTPStatus.BAD_REQUEST, "text/plain", b"")
    if words[0] not in ("GET", "HEAD"):
        return Answer(HTTPStatus.METHOD_NOT_ALLOWED, "text/plain", b"")
    parts = (line.partition(":") for line in lines)
    return Request(words[0], words[1], {name.strip().lower(): value.strip() for name, _, value in parts})


def head_of(answer: Answer, *more: str) -> bytes:
    """Return status line and headers of a response."""
    lines = [
        f"HTTP/1.1 {answer.status.value} {answer.status.phrase}",
        f"Content-Type: {answer.kind}",
        f"Content-Length: {len(answer.body)}",
        "Connection: close",
        *(["Allow: GET, HEAD"] if answer.status is HTTPStatus.METHOD_NOT_ALLOWED else []),
        *more,
    ]
    return "\r\n".join([*lines, "", ""]).encode("latin-1")
