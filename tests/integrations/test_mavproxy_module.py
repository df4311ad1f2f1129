"""The module for MAVProxy, with a stand-in of its interface and the page of a flight that is told.

What it looks like in MAVProxy itself is in docs/connecting.md.
"""

import importlib.util
import socket
import sys
import types
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.frames import LocalFrame
from companion.ui.page.access import Access
from companion.ui.page.feed import Feed
from companion.ui.page.page_server import PageServer
from tests.ui.page.flown import Told

FILE = Path(__file__).parents[2] / "integrations" / "mavproxy" / "mavproxy_companion.py"


class Settings:
    def __init__(self, entries):
        for name, _, value in entries:
            setattr(self, name, value)

    def command(self, args):
        setattr(self, args[0], args[1] != "False")


class Slip:
    """What is drawn, with whatever MAVProxy's own class of that name takes."""

    names = ()

    def __init__(self, *arguments, **keys):
        for name, value in (dict(zip(self.names, arguments, strict=False)) | keys).items():
            setattr(self, name, value)


class SlipLabel(Slip):
    names = ("key", "point", "label", "layer", "colour", "size")


class SlipCircle(Slip):
    names = ("key", "layer", "latlon", "radius", "color", "linewidth")


class SlipPolygon(Slip):
    names = ("key", "points", "layer", "colour", "linewidth")


class Base:
    def __init__(self, mpstate, name, description=None, public=False):
        self.mpstate, self.commands = mpstate, {}

    def add_command(self, name, callback, description, completions=None):
        self.commands[name] = callback

    def remove_command(self, name):
        del self.commands[name]

    def module(self, name):
        return self.mpstate.modules.get(name)

    def module_matching(self, pattern):
        assert pattern == "map*"
        return [self.mpstate.modules["map"]]

    @property
    def console(self):
        return self.mpstate

    def unload(self):
        """As of MAVProxy's base class."""


class Proxy:
    """MAVProxy's state: a map, a console, and the module of missions."""

    def __init__(self):
        self.drawn, self.said, self.asked, self.renewed = {}, [], [], 0
        self.map = self
        self.modules = {"map": self, "wp": self}

    def add_object(self, entry):
        self.renewed += 1
        self.drawn[entry.key] = entry

    def remove_object(self, key):
        del self.drawn[key]

    def writeln(self, text):
        self.said.append(text)

    def cmd_wp(self, args):
        self.asked.append(args)


@pytest.fixture(scope="module")
def program():
    """The module's file, imported among stand-ins."""
    parts = {
        "MAVProxy.modules.lib.mp_module": {"MPModule": Base},
        "MAVProxy.modules.lib.mp_settings": {"MPSettings": Settings},
        "MAVProxy.modules.mavproxy_map.mp_slipmap": {
            "SlipLabel": SlipLabel, "SlipCircle": SlipCircle, "SlipPolygon": SlipPolygon,
        },
    }  # fmt: skip
    made = {}
    for path, names in parts.items():
        words = path.split(".")
        for count in range(1, len(words) + 1):
            made.setdefault(".".join(words[:count]), types.ModuleType(".".join(words[:count])))
        vars(made[path]).update(names)
    for path, module in made.items():
        parent, _, name = path.rpartition(".")
        if parent:
            setattr(made[parent], name, module)
    with pytest.MonkeyPatch.context() as patch:
        for path, module in made.items():
            patch.setitem(sys.modules, path, module)
        spec = importlib.util.spec_from_file_location("mavproxy_companion", FILE)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return module


@pytest.fixture
def page():
    feed = Feed()
    server = PageServer(Access(0), feed)
    yield Told(feed.tell), server
    server.close()


def driven(module, is_it):
    """MAVProxy's loop, until it is so."""
    while not is_it():
        module._drawn_s = float("-inf")
        module.idle_task()
        assert module.stream is None or module.stream.is_alive()


def test_a_flight_is_drawn(program, page):
    told, server = page
    told.fly(2)
    proxy = Proxy()
    module = program.init(proxy)
    module.cmd_companion(["open", server.address])
    driven(module, lambda: "companion flown" in proxy.drawn and module.picture.mode)
    world = module.picture.world
    radars = {radar["name"] for radar in world["radars"]}
    circles = {key for key, entry in proxy.drawn.items() if isinstance(entry, SlipCircle)}
    assert radars
    assert {f"companion radar {name}" for name in radars} <= circles
    track = "icao:D70001"
    assert proxy.drawn[f"companion threat {track}"].radius == 250.0
    # twice the greater deviation (4 m, of the variance 16), and 20 m/s for 10, 30 and 60 s
    assert [proxy.drawn[f"companion reach {track} {seconds}"].radius for seconds in (10, 30, 60)] == [
        208.0, 608.0, 1208.0,
    ]  # fmt: skip
    way = proxy.drawn["companion flown"].points
    assert len(way) == 60
    origin = module.picture.origin
    frame = LocalFrame(*origin, 0.0)
    assert way[0] == pytest.approx(frame.global_from_local(100.0, 750.0, 0.0)[:2], abs=1e-6)
    assert proxy.asked == [["list"]]
    assert proxy.said == [], "what was decided before is not news"
    told.plan(2, 3.0)
    driven(module, lambda: "companion candidate" in proxy.drawn)
    told.swap(2, 3.5)
    told.recorder.decide(3.5, "swap", "cheaper", 90.0, why={})
    driven(module, lambda: any(key.startswith("companion decision") for key in proxy.drawn))
    assert "companion candidate" not in proxy.drawn
    assert proxy.asked == [["list"]] * 2
    assert proxy.said == ["companion: swap: cheaper"]
    renewed = proxy.renewed
    module._drawn_s = float("-inf")
    module.idle_task()
    assert proxy.renewed == renewed, "what stays is not sent to the map again"
    module.unload()
    assert proxy.drawn == module.commands == {}


def test_the_mission_is_read_again_only_where_it_is_wanted(program):
    proxy = Proxy()
    module = program.init(proxy)
    module.cmd_companion(["set", "reload", "False"])
    stream = types.SimpleNamespace(news=program.queue.Queue())
    flown = {"outcome": "flown", "plan_number": 1, "waypoints_enu_m": [[0.0, 0.0, 1.0], [9.0, 0.0, 1.0]]}
    for outcome, reload, asked in (("flown", "False", 0), ("refused", "True", 0), ("flown", "True", 1)):
        module.cmd_companion(["set", "reload", reload])
        stream.news.put(("/swap", flown | {"outcome": outcome}, True))
        module._take_news(stream)
        assert len(proxy.asked) == asked


def test_a_token_is_exchanged_for_a_cookie(program):
    feed = Feed()
    server = PageServer(Access(0, token="much-too-secret"), feed)
    told = Told(feed.tell)
    told.fly(1)
    module = program.init(Proxy())
    module.cmd_companion(["open", f"{server.address}?token=much-too-secret"])
    driven(module, lambda: module.picture.origin is not None)
    module.unload()
    server.close()


def test_what_is_no_page_is_told(program):
    proxy = Proxy()
    module = program.init(proxy)
    for url in ("ftp://x/", "http://", "https://127.0.0.1/", "http://127.0.0.1:x/"):
        module.cmd_companion(["open", url])
        module.cmd_companion(["close"])
    assert len(proxy.said) == 4
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        stream = program.Stream(f"127.0.0.1:{nobody.getsockname()[1]}")
        line = program.http.client.HTTPConnection(*nobody.getsockname(), timeout=5.0)
        with pytest.raises(OSError, match="refused"):
            stream._read(line)
    module.cmd_companion(["status"])
    assert proxy.said[-1].startswith("companion: page: closed")
    module.cmd_companion(["what"])
    assert proxy.said[-1].endswith(program.USAGE)


@given(
    topic=st.sampled_from(["/world", "/tracks", "/snapshot", "/plan", "/swap", "/ownship", "/decision"]),
    message=st.dictionaries(
        st.sampled_from(["origin", "tracks", "known_threats", "path", "number", "kind", "position_enu_m"]),
        st.one_of(st.none(), st.integers(), st.lists(st.integers(), max_size=3), st.text(max_size=5)),
    ),
)
def test_messages_of_another_version_do_not_end_mavproxys_loop(program, topic, message):
    module = program.init(Proxy())
    module.stream = types.SimpleNamespace(news=program.queue.Queue(), state="", close=lambda: None)
    module.stream.news.put((topic, message, True))
    module.idle_task()
    module.idle_task()


@given(east=st.floats(-10_000.0, 10_000.0), north=st.floats(-10_000.0, 10_000.0), lat=st.floats(-60.0, 60.0))
def test_places_are_where_the_program_has_them(program, east, north, lat):
    expected = LocalFrame(lat, 149.0, 0.0).global_from_local(east, north, 0.0)[:2]
    told = program.latlon((lat, 149.0), east, north)
    assert abs(told[0] - expected[0]) * 111_000.0 < 5.0
    assert abs(told[1] - expected[1]) * 111_000.0 < 5.0
