"""Recordings for the page: every message of them, as they were told live."""

import json
import socket

import pytest

from companion.errors import RecordError
from companion.ui.page.access import Access
from companion.ui.page.page_server import PageServer
from companion.ui.page.playback import Playback, recorded_playback
from tests.ui.page.flown import Told
from tests.ui.page.test_page_server import request


def lines_of(playback):
    found = [line.partition(b" ") for line in playback.body.splitlines()]
    return [(topic.decode(), json.loads(data)) for topic, _, data in found]


@pytest.fixture
def flown(tmp_path):
    told = Told(lambda *_: None, tmp_path / "flight")
    told.fly(4)
    told.recorder.close()
    return tmp_path / "flight"


@pytest.mark.parametrize("name", ["", "flight.mcap", "flight.tlog"])
def test_a_recording_is_every_message_of_it_and_the_world(flown, name):
    playback = recorded_playback(flown / name)
    lines = lines_of(playback)
    assert playback.name == "flight"
    assert lines[0][0] == "/world"
    assert lines[0][1]["name"] == "made-up"
    assert lines[0][1]["stamp_s"] == 0.0
    topics = [topic for topic, _ in lines]
    assert topics.count("/ownship") == topics.count("/tracks") == topics.count("/threat") == 20
    assert topics.count("/plan") == topics.count("/trees") == topics.count("/swap") == 1
    assert "/location" not in topics
    assert "/mission" not in topics
    assert all("stamp_s" in message for _, message in lines)


def test_it_is_what_is_told_live(flown):
    live = Playback("live")
    Told(live.tell).fly(4)
    assert lines_of(live) == lines_of(recorded_playback(flown))


def test_without_an_mcap_there_is_nothing_to_show(tmp_path):
    (tmp_path / "flight.tlog").write_bytes(b"")
    with pytest.raises(RecordError, match=r"no flight\.mcap there"):
        recorded_playback(tmp_path / "flight.tlog")
    (tmp_path / "flight.mcap").write_bytes(b"rubbish")
    with pytest.raises(RecordError, match="no message in it"):
        recorded_playback(tmp_path)


def asked(server, path):
    with socket.create_connection(("127.0.0.1", server.port), timeout=20.0) as line:
        line.sendall(request(path))
        said = b""
        while more := line.recv(65_536):
            said += more
    return said.partition(b"\r\n\r\n")


def test_two_recordings_are_served_side_by_side(flown):
    other = Playback("what would be decided now")
    Told(other.tell).fly(1)
    server = PageServer(Access(0), None, [recorded_playback(flown), other])
    sources = json.loads(asked(server, "/sources.json")[2])["sources"]
    assert [source["name"] for source in sources] == ["flight", "what would be decided now"]
    for source, playback in zip(sources, server._pages._playbacks, strict=True):
        playback.world.finish()
        assert asked(server, source["recording"])[2] == playback.body
        assert json.loads(asked(server, f"{source['field']}/100")[2])["height_m"] == 100.0
    assert asked(server, "/stream")[0].startswith(b"HTTP/1.1 404 "), "nothing is flown"
    server.close()
