"""The service's own page: one address over all its flights, and gone with it."""

import asyncio
import socket
import urllib.request

import pytest

from companion.flight.state.flight_phase import LANDED_S
from companion.link.wire.memory_transport import MemoryTransport
from companion.service.process import service as services
from companion.service.process.service import Service
from companion.ui.page.access import Access
from companion.ui.page.live_page import LivePage
from tests.service.process.test_recorded_flights import AUTO, FBWA, MISSION, Bench, served
from tests.ui.page.test_page_server import Heard, request


class PageBench(Bench):
    """A service with a page; its clock and autopilot are in the test's hands."""

    def __init__(self, folder):
        super().__init__(folder / "without")
        self.service.close()
        self.flights = folder / "flights"
        ours, self.theirs = MemoryTransport.pair()
        self.page = LivePage(Access(0))
        self.service = Service(
            MISSION, "tcp://nowhere:1", self.flights, {}, clock=self.clock, line=ours, page=self.page
        )


@pytest.fixture
def bench(tmp_path, monkeypatch):
    monkeypatch.setattr(services, "make_ready", lambda report: None)
    return PageBench(tmp_path)


def told_until(heard, is_it):
    """Messages up to the first for which it is so, that one included."""
    told = []
    while True:
        for topic, message in heard.event()[1]:
            told.append((topic, message))
            if is_it(topic, message):
                return told


def test_one_page_over_two_flights(bench):
    port, found = bench.page._server.port, {}

    def look(kind):
        with socket.create_connection(("127.0.0.1", port), timeout=30.0) as line:
            line.sendall(request("/stream"))
            heard = Heard(line)
            found[kind] = told_until(
                heard, lambda topic, message: topic == "/standing" and message["is_armed"]
            )
            if kind == "first":
                found["next"] = told_until(heard, lambda topic, _: topic == "/reset")

    async def beaten(looking, beat):
        while not looking.done():
            await bench.pass_time(1.0, beat)
        looking.result()

    async def script():
        looking = asyncio.create_task(asyncio.to_thread(look, "first"))
        while "first" not in found:
            await bench.pass_time(1.0, (AUTO, True))
        await bench.pass_time(LANDED_S + 5.0, (FBWA, False))  # the flight is over
        await beaten(looking, (FBWA, False))
        again = asyncio.create_task(asyncio.to_thread(look, "second"))
        await beaten(again, (AUTO, True))

    served(bench, script)
    topics = [topic for topic, _ in found["first"]]
    assert topics[0] == "/reset"
    assert "/world" in topics
    assert found["first"][-1][1]["mode"] == "departing"
    assert [message["kind"] for topic, message in found["next"] if topic == "/decision"][-1] in (
        "landed",
        "mode",
    )
    began = next(message for topic, message in found["second"] if topic == "/standing")
    assert began["stamp_s"] > found["first"][-1][1]["stamp_s"] + LANDED_S
    assert "/world" in [topic for topic, _ in found["second"]], "of the flight that goes on"
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    with pytest.raises(OSError, match="refused"):
        opener.open(bench.page.address, timeout=10.0)
