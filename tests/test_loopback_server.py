"""The port for figures and health under those who ask slowly, too much, too often, or for something else."""

import socket
import threading
import urllib.request
from http import HTTPStatus

import pytest

from companion.loopback_server import CONNECTIONS_MAX, HEAD_MAX, TIMEOUT_S, Answer, LoopbackServer

PAGE = b"fine\n"


LARGE = 20_000_000  # Bytes that do not fit into the buffers of a connection.


class Served:
    """A server whose clock is in the test's hands."""

    def __init__(self):
        self.now_s, self.asked = 0.0, []
        self.server = LoopbackServer(0, self.page, lambda: self.now_s)

    def page(self, path):
        self.asked.append(path)
        body = PAGE if path == "/healthz" else bytes(LARGE)
        return Answer(HTTPStatus.OK, "text/plain", body)

    def connected(self):
        line = socket.create_connection(self.server.address, timeout=20.0)
        line.settimeout(20.0)
        return line

    def said_to(self, data):
        """All that is answered to bytes."""
        with self.connected() as line:
            line.sendall(data)
            return rest_of(line)


def rest_of(line):
    said = b""
    try:
        while data := line.recv(65_536):
            said += data
    except ConnectionResetError:
        pass
    return said


@pytest.fixture
def served():
    server = Served()
    yield server
    server.server.close()


def get(path="/healthz", method="GET", more=""):
    return f"{method} {path} HTTP/1.1\r\nHost: localhost\r\n{more}\r\n".encode()


def test_a_page_is_answered_and_the_line_closed(served):
    said = served.said_to(get("/healthz?x=1"))
    assert said.startswith(b"HTTP/1.1 200 OK\r\n")
    assert b"Content-Length: 5\r\n" in said
    assert said.endswith(b"\r\n\r\n" + PAGE)
    assert served.asked == ["/healthz"]
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    host, port = served.server.address
    with opener.open(f"http://{host}:{port}/large", timeout=20.0) as answer:
        assert len(answer.read()) == LARGE


def test_the_head_alone(served):
    assert served.said_to(get(method="HEAD")).endswith(b"Connection: close\r\n\r\n")


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "TRACE", "CONNECT", "get", "X"])
def test_nothing_but_get(served, method):
    said = served.said_to(get(method=method, more="Content-Length: 5\r\n") + b"hello")
    assert said.startswith(b"HTTP/1.1 405 ")
    assert b"Allow: GET, HEAD\r\n" in said
    assert served.asked == []


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        (b"GET\r\n\r\n", 400),
        (b"\r\n\r\n", 400),
        (b"GET / SPDY/9\r\n\r\n", 400),
        (b"GET / HTTP/1.1 x\r\n\r\n", 400),
        (bytes(range(256)) + b"\r\n\r\n", 400),
        (b"GET /" + b"x" * HEAD_MAX, 431),
        (b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * HEAD_MAX, 431),
    ],
)
def test_what_is_no_request_of_a_few_kilobytes(served, asked, code):
    said = served.said_to(asked)
    assert said.startswith(b"HTTP/1.1 %d " % code) or (code == 431 and said == b"")
    assert served.asked == []
    assert served.said_to(get()).endswith(PAGE)


def test_who_asks_slowly_is_cut_off_and_the_others_are_answered(served):
    slow = [served.connected() for _ in range(CONNECTIONS_MAX - 1)]
    for line in slow:
        line.sendall(b"GET /healthz")
    assert served.said_to(get()).endswith(PAGE)
    served.now_s = TIMEOUT_S + 0.1
    for line in slow:
        assert rest_of(line) == b""
        line.close()
    assert served.said_to(get()).endswith(PAGE)


def test_who_does_not_take_the_answer_is_cut_off(served):
    with served.connected() as line:
        line.sendall(get("/large"))
        assert line.recv(1) == b"H"
        served.now_s = TIMEOUT_S + 0.1
        assert served.said_to(get()).endswith(PAGE)
        assert len(rest_of(line)) < LARGE


def test_one_too_many_is_refused_at_once_and_no_thread_is_made(served):
    before = threading.active_count()
    waiting = []
    for _ in range(CONNECTIONS_MAX):
        waiting.append(served.connected())
        waiting[-1].sendall(b"G")
    for _ in range(50):
        said = served.said_to(b"")
        assert said == b"" or said.startswith(b"HTTP/1.1 503 ")
    assert threading.active_count() == before
    assert len(served.server._connections) == CONNECTIONS_MAX
    waiting.pop().close()
    for line in waiting:
        line.sendall(get()[1:])
        assert rest_of(line).endswith(PAGE)
        line.close()
    assert served.said_to(get()).endswith(PAGE)


def test_it_ends_with_lines_open():
    served = Served()
    with served.connected() as line:
        line.sendall(b"G")
        served.server.close()
        assert rest_of(line) == b""
    with pytest.raises(ConnectionRefusedError):
        served.connected()
