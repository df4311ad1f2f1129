"""The page's HTTP server: files, streams and fields to a few viewers at once, in a thread of its own.

A slow viewer holds up nothing: news that it does not accept in time is dropped together with its connection,
and when it connects again it gets the present state. Only GET requests are answered, and no request changes
anything.

References
----------
WHATWG HTML, "Server-sent events": the stream's format, and that browsers connect again by themselves.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from companion.loopback_server import HEAD_MAX, Answer, Request, accepted, head_of, request_of
from companion.ui.page.access import Access
from companion.ui.page.feed import Feed
from companion.ui.page.ground import Ground
from companion.ui.page.pages import Pages
from companion.ui.page.playback import Playback

CONNECTIONS_MAX = 48  # Three viewers' browsers open six connections each; the rest is in reserve.
TIMEOUT_S = 10.0  # A viewer has this long to send a request, and to accept what is sent.
WAITING_MAX = 4 * 2**20  # Most bytes that wait for a viewer.
ALIVE_S = 10.0  # Without news, a viewer gets an empty message this often.
POLL_S = 0.25
STREAM = "/stream"
_PORTION = 262_144
_STREAM_HEAD = (
    b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\n"
    b"X-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\nretry: 500\n\n"
)


@dataclass(slots=True, eq=False)
class _Viewer:
    """A connection: its request, the data that waits to be sent, and by when it takes some of it."""

    line: socket.socket
    until_s: float
    asked: bytearray = field(default_factory=bytearray)
    waiting: list[memoryview] = field(default_factory=list)
    num_waiting: int = 0
    has_asked: bool = False
    is_stream: bool = False
    queued_s: float = 0.0

    def receive(self, data: bytes) -> bool:
        """Take received data; whether the request is complete or too long. What follows is ignored."""
        if self.has_asked:
            return False
        self.asked += data
        self.has_asked = b"\r\n\r\n" in self.asked or len(self.asked) > HEAD_MAX
        return self.has_asked

    def wait(self, now_s: float) -> None:
        """Give it time, from now on."""
        self.until_s = now_s + TIMEOUT_S

    def add_viewer(self) -> None:
        """From now on it receives new messages."""
        self.is_stream = True

    def tell(self, data: bytes, now_s: float) -> None:
        """Add to the data that waits to be sent."""
        self.waiting.append(memoryview(data))
        self.num_waiting += len(data)
        self.queued_s = now_s

    def send(self) -> bool:
        """Send as much as goes without waiting; whether any went."""
        went = False
        while self.waiting:
            first = self.waiting[0]
            number = self.line.send(first[:_PORTION])
            went = went or number > 0
            self.num_waiting -= number
            if number < len(first):
                self.waiting[0] = first[number:]
                break
            self.waiting.pop(0)
        return went


class PageServer:
    """Serves the page.

    Parameters
    ----------
    access : Access
        Where it listens, and who may look.
    feed : Feed or None
        A running flight; None where recordings are shown.
    playbacks : sequence of Playback
        Recordings, the one that is looked at first.
    now_s : callable
        Monotonic seconds.
    ground : Ground, optional
        What is drawn under the map.

    Raises
    ------
    OSError
        If the port is taken, or the address none of this computer's.
    """

    def __init__(
        self,
        access: Access,
        feed: Feed | None,
        playbacks: Sequence[Playback] = (),
        now_s: Callable[[], float] = time.monotonic,
        *,
        ground: Ground | None = None,
    ) -> None:
        self._access, self._feed, self._now_s = access, feed, now_s
        self._pages = Pages(feed, playbacks, ground)
        self._viewers: set[_Viewer] = set()
        self._listener = socket.create_server((access.host, access.port), backlog=CONNECTIONS_MAX)
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._woken, self._waker = socket.socketpair()
        self._woken.setblocking(False)
        self._waker.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ, self._accept)
        self._selector.register(self._woken, selectors.EVENT_READ, self._wake_up)
        self._is_over = False
        self.num_dropped = 0
        if feed is not None:
            feed.wake_by(self._wake)
        self._thread = threading.Thread(target=self._serve, name="page", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """URL to open in a browser on this computer."""
        return self._access.address(self.port)

    def close(self) -> None:
        """End it."""
        self._is_over = True
        self._wake()
        self._thread.join()
        self._waker.close()

    def _wake(self) -> None:
        """There is news; called in the flight's thread."""
        with contextlib.suppress(OSError):  # The server is awake already, or has ended.
            self._waker.send(b"\0")

    def _wake_up(self) -> None:
        with contextlib.suppress(OSError):
            self._woken.recv(4_096)

    def _serve(self) -> None:
        while not self._is_over:
            for key, _ in self._selector.select(POLL_S):
                key.data()
            self._tell_news()
            self._look_after_viewers()
        for viewer in list(self._viewers):
            self._drop(viewer)
        self._selector.close()
        self._listener.close()
        self._woken.close()

    def _accept(self) -> None:
        line = accepted(self._listener, is_full=len(self._viewers) >= CONNECTIONS_MAX)
        if line is None:
            return
        line.setsockopt(
            socket.SOL_SOCKET, socket.SO_SNDBUF, _PORTION
        )  # The operating system buffers little for the viewer, too.
        viewer = _Viewer(line, self._now_s() + TIMEOUT_S)
        self._viewers.add(viewer)
        self._selector.register(line, selectors.EVENT_READ, lambda: self._go_on(viewer))

    def _go_on(self, viewer: _Viewer) -> None:
        """Receive and send as much as is possible without waiting."""
        try:
            if viewer.waiting:
                self._send(viewer)
            else:
                self._hear(viewer)
        except BlockingIOError:
            return
        except OSError:
            self._drop(viewer)

    def _hear(self, viewer: _Viewer) -> None:
        data = viewer.line.recv(HEAD_MAX)
        if not data:
            self._drop(viewer)
        elif viewer.receive(data):
            self._answer(viewer, request_of(bytes(viewer.asked)))

    def _answer(self, viewer: _Viewer, request: Request | Answer) -> None:
        now = self._now_s()
        viewer.wait(now)
        if isinstance(request, Answer):
            viewer.tell(head_of(request), now)
        elif (refusal := self._access.refusal(request)) is not None:
            viewer.tell(refusal, now)
        elif (
            request.target.partition("?")[0] == STREAM and self._feed is not None and request.method == "GET"
        ):
            viewer.add_viewer()
            viewer.tell(_STREAM_HEAD + _events(self._feed.snapshot(), "snapshot"), now)
        else:
            viewer.tell(self._pages.answer(request), now)
        self._selector.modify(viewer.line, selectors.EVENT_WRITE, lambda: self._go_on(viewer))

    def _send(self, viewer: _Viewer) -> None:
        if viewer.send():
            viewer.wait(self._now_s())
        if viewer.waiting:
            return
        if not viewer.is_stream:
            # If it were closed at once, unread bytes of the viewer would cancel the answer.
            viewer.line.shutdown(socket.SHUT_WR)
        self._selector.modify(viewer.line, selectors.EVENT_READ, lambda: self._go_on(viewer))

    def _tell_news(self) -> None:
        """Send news to the viewers; a viewer that has not accepted earlier news is dropped."""
        if self._feed is None:
            return
        lines, is_lost = self._feed.news()
        streams = [viewer for viewer in self._viewers if viewer.is_stream]
        if is_lost:
            for viewer in streams:
                self._stalled(viewer)
            return
        if not lines:
            return
        now, data = self._now_s(), _events(lines)
        for viewer in streams:
            self._tell(viewer, data, now)

    def _tell(self, viewer: _Viewer, data: bytes, now: float) -> None:
        if viewer.num_waiting > WAITING_MAX:
            self._stalled(viewer)
            return
        if not viewer.waiting:
            viewer.wait(now)
            self._selector.modify(viewer.line, selectors.EVENT_WRITE, lambda: self._go_on(viewer))
        viewer.tell(data, now)
        self._go_on(viewer)

    def _look_after_viewers(self) -> None:
        """Drop viewers that have been silent for long; send an empty message to those without news."""
        now = self._now_s()
        for viewer in list(self._viewers):
            is_done = viewer.is_stream and not viewer.waiting
            if now > viewer.until_s and not is_done:
                self._stalled(viewer)
            elif is_done and now - viewer.queued_s > ALIVE_S:
                self._tell(viewer, b":\n\n", now)

    def _stalled(self, viewer: _Viewer) -> None:
        self.num_dropped += viewer.is_stream
        self._drop(viewer)

    def _drop(self, viewer: _Viewer) -> None:
        if viewer in self._viewers:
            self._viewers.discard(viewer)
            self._selector.unregister(viewer.line)
            viewer.line.close()


def _events(lines: Sequence[bytes], kind: str = "news") -> bytes:
    """Return lines as one event, which browsers get at once; its id is the time of sending [ms of UTC]."""
    kind = f"{kind}\nid: {time.time() * 1e3:.0f}"
    return (
        b"event: "
        + kind.encode("ascii")
        + b"\n"
        + b"".join(b"data: " + line + b"\n" for line in lines)
        + b"\n"
    )
