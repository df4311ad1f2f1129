"""The page's server under real sockets: streams, stalls, tokens, other hosts' names, and bad requests."""

import base64
import json
import socket
import threading
import urllib.error
import urllib.request

import numpy as np
import pytest

from companion.config.load import text_of
from companion.errors import ConfigError, LinkError
from companion.recording.recorder import Recorder
from companion.ui.page import world_document
from companion.ui.page.access import COOKIE, Access
from companion.ui.page.feed import Feed
from companion.ui.page.live_page import LivePage, page_of
from companion.ui.page.page_server import ALIVE_S, CONNECTIONS_MAX, TIMEOUT_S, WAITING_MAX, PageServer
from companion.ui.page.pages import static_files
from tests.ui.page.flown import Told

TOKEN = "correct horse"
LONG_S = 20.0


class Served:
    """A server with a flight's feed, whose clock is in the test's hands."""

    def __init__(self, token=""):
        self.now_s = 0.0
        self.feed = Feed()
        self.told = Told(self.feed.tell)
        self.server = PageServer(Access(0, token=token), self.feed, (), lambda: self.now_s)
        self.told.fly(2)

    def connected(self, receive=None):
        line = socket.socket()
        if receive is not None:
            line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive)
        line.settimeout(LONG_S)
        line.connect(("127.0.0.1", self.server.port))
        return line

    def said_to(self, data):
        with self.connected() as line:
            line.sendall(data)
            said = b""
            while more := line.recv(65_536):
                said += more
            return said

    def get(self, path, *headers, method="GET", host="127.0.0.1:1"):
        return self.said_to(request(path, *headers, method=method, host=host))

    def stream(self, *headers, receive=None):
        line = self.connected(receive)
        line.sendall(request("/stream", *headers))
        return line


def request(path, *headers, method="GET", host="127.0.0.1:1"):
    lines = [f"{method} {path} HTTP/1.1", f"Host: {host}", *headers, "", ""]
    return "\r\n".join(lines).encode()


@pytest.fixture
def served():
    made = Served()
    yield made
    made.server.close()


class Heard:
    """Events of a stream, as they come."""

    def __init__(self, line):
        self.file = line.makefile("rb")
        self.head = self.until_empty()
        self.until_empty()  # how soon to come again

    def until_empty(self):
        lines = []
        while (line := self.file.readline().rstrip(b"\r\n")) or not lines:
            if not line and not lines:
                assert self.file.peek(1), "ended"
                continue
            lines.append(line)
        return lines

    def event(self):
        """Kind and messages of the next event; words that only keep the line open are passed over."""
        while True:
            lines = self.until_empty()
            if lines != [b":"]:
                break
        kind = lines[0].partition(b": ")[2].decode()
        messages = [line[6:].partition(b" ") for line in lines if line.startswith(b"data: ")]
        return kind, [(topic.decode(), json.loads(text)) for topic, _, text in messages]


def test_a_viewer_who_asks_again_on_the_same_line_is_not_answered_again(served):
    with served.stream() as line:
        heard = Heard(line)
        assert heard.event()[0] == "snapshot"
        line.sendall(request("/stream"))
        assert served.get("/healthz")  # By then what was said before it has been heard.
        served.told.recorder.decide(3.0, "keep", "cost 1.0, flown 2.0")
        assert heard.event()[0] == "news"


def test_a_viewer_gets_a_picture_and_then_what_is_new(served):
    with served.stream() as line:
        heard = Heard(line)
        assert heard.head[0] == b"HTTP/1.1 200 OK"
        assert b"Content-Type: text/event-stream" in heard.head
        kind, messages = heard.event()
        assert kind == "snapshot"
        topics = [topic for topic, _ in messages]
        assert {"/world", "/history", "/swap", "/decision", "/ownship", "/standing"} <= set(topics)
        served.told.recorder.decide(3.0, "keep", "cost 1.0, flown 2.0")
        while True:
            kind, messages = heard.event()
            assert kind == "news"
            if messages[-1][0] == "/decision":
                break
        assert messages[-1][1]["text"] == "cost 1.0, flown 2.0"


def test_three_viewers_hear_the_same(served):
    lines = [served.stream() for _ in range(3)]
    heard = [Heard(line) for line in lines]
    for one in heard:
        assert one.event()[0] == "snapshot"
    served.told.recorder.decide(4.0, "mode", "to all")
    for one in heard:
        while one.event()[1][-1][1].get("text") != "to all":
            pass
    for line, one in zip(lines, heard, strict=True):
        one.file.close()
        line.close()


def test_one_that_stalls_is_dropped_and_the_others_are_not(served):
    with served.stream(receive=4_096) as stalled, served.stream() as line:
        heard = Heard(line)
        assert heard.event()[0] == "snapshot"
        sent = 0
        number = 2
        while served.server.num_dropped == 0:
            served.told.plan(number, float(number), num_edges=5_000)
            while heard.event()[1][-1][0] != "/trees":
                pass
            sent += 150_000
            number += 1
            assert sent < 4 * WAITING_MAX, "it is waited for without end"
        assert len([viewer for viewer in served.server._viewers if viewer.is_stream]) == 1
        served.told.recorder.decide(99.0, "mode", "still told")
        while heard.event()[1][-1][1].get("text") != "still told":
            pass
        stalled.close()


def test_one_that_takes_nothing_for_long_is_dropped_by_the_clock(served):
    with served.stream(receive=4_096) as stalled, served.stream() as line:
        heard = Heard(line)
        heard.event()
        for number in range(2, 14):  # more than lies in the system's buffers
            served.told.plan(number, float(number), num_edges=5_000)
            while heard.event()[1][-1][0] != "/trees":
                pass
        assert served.server.num_dropped == 0
        served.now_s = TIMEOUT_S + 1.0
        served.told.recorder.decide(9.0, "mode", "later")
        while heard.event()[1][-1][1].get("text") != "later":
            pass
        served.told.recorder.decide(9.5, "mode", "after")
        while heard.event()[1][-1][1].get("text") != "after":
            pass
        assert served.server.num_dropped == 1
        stalled.close()


def test_a_quiet_line_is_kept_open(served):
    with served.stream() as line:
        heard = Heard(line)
        heard.event()
        served.now_s = ALIVE_S + 1.0
        assert heard.until_empty() == [b":"]


def test_the_flight_goes_on_when_the_page_is_dead(served):
    served.server.close()
    for tick in range(5_000):
        served.told.state(10.0 + 0.2 * tick)
    assert len(served.told.recorder.flown) > 5_000
    served.server = PageServer(Access(0), Feed())


@pytest.mark.parametrize("name", sorted(static_files()))
def test_every_file_is_served_with_headers_that_keep_others_out(served, name):
    said = served.get(f"/{name}")
    head, _, body = said.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 200 OK\r\n")
    assert body == static_files()[name]
    assert b"default-src 'none'" in head
    assert b"nosniff" in head


def test_the_first_page_and_what_can_be_looked_at(served):
    assert b"<!DOCTYPE html>" in served.get("/?t=1")
    told = json.loads(served.get("/sources.json").partition(b"\r\n\r\n")[2])
    assert told["sources"] == [{"name": "live", "stream": "/stream", "field": "/field/live"}]


def test_the_radars_field_at_a_height(served):
    with served.stream() as line:
        Heard(line).event()  # by when the world is known
    served.feed.world.finish()
    field = json.loads(served.get("/field/live/123.4").partition(b"\r\n\r\n")[2])
    assert field["height_m"] == 120.0
    assert (field["columns"], field["rows"]) == (160, 120)
    assert json.loads(served.get("/field/live/1e9").partition(b"\r\n\r\n")[2])["height_m"] == 350.0
    assert json.loads(served.get("/field/live/nan").partition(b"\r\n\r\n")[2]) == {"is_later": False}


def test_the_radars_floors(served):
    """The wall is 400 m from the radar and 300 m high: 600 m away it hides what is lower than 450 m."""
    with served.stream() as line:
        Heard(line).event()
    served.feed.world.finish()
    (floor,) = json.loads(served.get("/floors/live").partition(b"\r\n\r\n")[2])["radars"]
    steps = np.frombuffer(base64.b64decode(floor["steps"]), "<u2").reshape(floor["rows"], floor["columns"])
    row, column = (
        int((at - floor[edge]) // floor["spacing_m"]) for at, edge in ((750.0, "south_m"), (800.0, "west_m"))
    )
    assert floor["low_m"] + floor["step_m"] * steps[row, column] == pytest.approx(350.0, abs=0.1), (
        "the ceiling"
    )
    assert steps[row, int((1500.0 - floor["west_m"]) // floor["spacing_m"])] == 0, "nothing hides"
    assert steps[row, 0] == 65535, "out of range"


def test_shadows_that_are_still_worked_out_are_told_later(served, monkeypatch):
    with served.stream() as line:
        Heard(line).event()
    served.feed.world.finish()
    may_end = threading.Event()
    monkeypatch.setattr(world_document, "world_of", lambda *_, **__: may_end.wait(LONG_S) and None)
    world = world_document.WorldDocument(text_of(served.told.mission), "slow")
    assert json.loads(world.field(100.0)) == {"is_later": True}
    assert json.loads(world.floors()) == {"is_later": True}
    assert json.loads(world.document)["name"] == "made-up", "the rest is known at once"
    may_end.set()
    world.finish()


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/field/live/high", 400), ("/field/9/100", 404), ("/field/live", 404), ("/recording/0", 404),
        ("/recording/-1", 404), ("/../pyproject.toml", 404), ("/vendor/../main.js", 404),
        ("/vendor", 404), ("//evil", 404), ("/%2e%2e/x", 404), ("/stream/x", 404),
    ],
)  # fmt: skip
def test_what_there_is_not(served, path, status):
    assert served.get(path).startswith(f"HTTP/1.1 {status} ".encode())


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH"])
def test_it_only_looks(served, method):
    assert served.get("/stream", method=method).startswith(b"HTTP/1.1 405 ")


@pytest.mark.parametrize("data", [b"\r\n\r\n", b"GET /\r\n\r\n", b"x" * 9_000, b"GET / HTTP/9\r\n\r\n"])
def test_what_is_no_request(served, data):
    assert served.said_to(data)[:12] in (b"HTTP/1.1 400", b"HTTP/1.1 431")
    assert served.get("/icon.svg").startswith(b"HTTP/1.1 200 ")


def test_who_asks_nothing_is_not_waited_for(served):
    with served.connected() as line:
        line.sendall(b"GET / HT")
        served.get("/icon.svg")  # after which it is known of, too
        served.now_s = TIMEOUT_S + 1.0
        assert line.recv(10) == b""


def test_one_connection_too_many_is_refused(served):
    lines = [served.connected() for _ in range(CONNECTIONS_MAX)]
    with served.connected() as line:
        assert line.recv(1_000).startswith(b"HTTP/1.1 503 ")
    for line in lines:
        line.close()


# --- who may look


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8080", "", "127.0.0.1.evil.example:80"])
def test_another_hosts_name_is_refused(served, host):
    assert served.get("/sources.json", host=host).startswith(b"HTTP/1.1 403 ")


@pytest.mark.parametrize("host", ["localhost:8080", "127.0.0.1", "localhost"])
def test_this_computers_names_are_not(served, host):
    assert served.get("/sources.json", host=host).startswith(b"HTTP/1.1 200 ")


@pytest.fixture
def guarded():
    made = Served(TOKEN)
    yield made
    made.server.close()


def test_without_the_token_nothing_is_told(guarded):
    for path in ("/", "/stream", "/sources.json", "/field/live/100", "/main.js", "/?token=wrong", "/?token="):
        said = guarded.get(path, host="other:80")
        assert said.startswith(b"HTTP/1.1 401 "), path
        assert b"made-up" not in said


def test_the_token_is_taken_once_and_a_cookie_then(guarded):
    said = guarded.get("/?token=correct%20horse", host="other:80").decode()
    assert said.startswith("HTTP/1.1 303 ")
    assert "Location: /\r\n" in said
    assert TOKEN not in said
    [cookie] = [line for line in said.split("\r\n") if line.startswith("Set-Cookie: ")]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    value = cookie.removeprefix("Set-Cookie: ").partition(";")[0]
    assert guarded.get("/sources.json", f"Cookie: other=1; {value}").startswith(b"HTTP/1.1 200 ")
    with guarded.stream(f"Cookie: {value}") as line:
        assert Heard(line).event()[0] == "snapshot"


@pytest.mark.parametrize("cookie", [f"{COOKIE}=", f"{COOKIE}=x", f"{COOKIE}=correct horse", "é=1", COOKIE])
def test_a_cookie_that_is_not_the_pages_is_no_token(guarded, cookie):
    assert guarded.said_to(request("/", f"Cookie: {cookie}")).startswith(b"HTTP/1.1 401 ")


def test_the_page_is_for_this_computer_unless_it_has_a_token():
    with pytest.raises(ConfigError, match=r"--page-listen: got 0\.0\.0\.0; expected a token beside it"):
        page_of(8080, "0.0.0.0", "")
    with pytest.raises(ConfigError, match=r"--page-token: got 3 characters; expected at least 8"):
        page_of(8080, "0.0.0.0", "abc")
    with pytest.raises(ConfigError, match=r"--page-listen: got everybody; expected an IPv4 address"):
        page_of(8080, "everybody", TOKEN)
    assert page_of(None, "", "") is None
    assert Access(8080).address(8080) == "http://127.0.0.1:8080/"
    assert Access(8080, "0.0.0.0", TOKEN).address(8080) == "http://127.0.0.1:8080/"


def test_a_port_that_is_taken_is_said():
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        pytest.raises(LinkError, match=r"page on 127\.0\.0\.1"),
    ):
        LivePage(Access(taken.getsockname()[1]))


def test_a_page_follows_one_flight_after_the_other():
    page = LivePage(Access(0))
    for number in (1, 2):
        recorder = Recorder()
        page.follow(recorder)
        recorder.decide(1.0, "mode", f"flight {number}")
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    with opener.open(f"{page.address}stream", timeout=LONG_S) as stream:
        told = b""
        while b"flight 2" not in told:
            told += stream.readline()
        assert b"flight 1" not in told
    page.close()
