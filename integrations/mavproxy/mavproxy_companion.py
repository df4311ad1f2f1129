"""What the companion's planner knows, on MAVProxy's map: its plan, radars, moving threats, decisions.

It reads the companion's page (``companion run … --page PORT``) and needs nothing but MAVProxy and Python. It
only looks: nothing is sent to the aircraft, but that the mission is read again when the companion replaced it
(``companion set reload False`` leaves that out).
"""

import collections
import http.client
import json
import math
import queue
import threading
import time
import urllib.parse

from MAVProxy.modules.lib import mp_module, mp_settings
from MAVProxy.modules.mavproxy_map import mp_slipmap

DEFAULT_URL = "http://127.0.0.1:8080/"
USAGE = "usage: companion <open URL|close|status|set>"
LAYER, PREFIX = 3, "companion "
AGAIN_S, SILENT_S = 2.0, 60.0  # the page says something every few seconds
DRAWN_S = 0.5  # between two pictures
LINE_MAX = 16_000_000  # characters of a message, trees and all
WAITING_MAX = 5_000  # messages
DECISIONS = 6  # that stand on the map
PLANS_KEPT = 8  # one of which may be flown
REACH_S = (10.0, 30.0, 60.0)
DEVIATIONS = 2.0  # of a track's place, by which it is taken to be nearer
TOPICS = frozenset(
    ("/reset", "/world", "/snapshot", "/plan", "/swap", "/tracks", "/ownship", "/decision", "/standing")
)
UNREADABLE = (KeyError, TypeError, ValueError, IndexError, AttributeError, ArithmeticError)
CANDIDATE, FLOWN = (255, 176, 0), (190, 80, 255)
RADAR, UNSENSED = (255, 60, 60), (150, 80, 80)
HUNTER, REACH, SAID = (255, 0, 120), (255, 120, 180), (0, 150, 255)
_EQUATOR_M, _ECCENTRICITY2 = 6_378_137.0, 6.69437999014e-3  # WGS84


def latlon(origin, east_m, north_m):
    """Latitude and longitude [deg] of a place east and north of an origin, to a metre within 10 km."""
    latitude, longitude = origin
    middle = math.radians(latitude) + north_m / _EQUATOR_M / 2.0
    root = math.sqrt(1.0 - _ECCENTRICITY2 * math.sin(middle) ** 2)
    meridian = _EQUATOR_M * (1.0 - _ECCENTRICITY2) / root**3
    lat = math.radians(latitude) + north_m / meridian
    across = _EQUATOR_M / math.sqrt(1.0 - _ECCENTRICITY2 * math.sin(lat) ** 2)
    lat -= east_m**2 * math.tan(lat) / (2.0 * meridian * across)  # a great circle east bends to the equator
    return math.degrees(lat), longitude + math.degrees(east_m / (across * math.cos(lat)))


class Stream(threading.Thread):
    """Reads a page's stream, and connects again whenever it ends.

    Parameters
    ----------
    url : str
        The page's address, with its token if it has one.

    Attributes
    ----------
    news : queue.Queue
        Topic, message, and whether it is new: no part of what is told at first of the flight so far.
    state : str
        How the connection is, in words.
    """

    def __init__(self, url):
        super().__init__(name="companion page", daemon=True)
        self.news = queue.Queue(WAITING_MAX)
        self.state = "not connected"
        self._url = urllib.parse.urlsplit(url if "//" in url else f"http://{url}")
        if self._url.scheme != "http" or not self._url.hostname:
            raise ValueError(f"{url} is no address of a page; one is {DEFAULT_URL}")
        self._port = self._url.port or 80
        self._is_over = threading.Event()

    def close(self):
        """End it; a connection that is silent ends by itself."""
        self._is_over.set()

    def run(self):
        """Read until it is closed."""
        while not self._is_over.is_set():
            line = http.client.HTTPConnection(self._url.hostname, self._port, timeout=SILENT_S)
            try:
                self._read(line)
                self.state = "the page ended the stream"
            except (OSError, ValueError, http.client.HTTPException) as error:
                self.state = f"{type(error).__name__}: {error}"
            finally:
                line.close()
            self._is_over.wait(AGAIN_S)

    def _read(self, line):
        headers = {"Accept": "text/event-stream"}
        if self._url.query:  # the token, for which there is a cookie
            line.request("GET", f"/?{self._url.query}")
            answer = line.getresponse()
            answer.read()
            headers["Cookie"] = (answer.getheader("Set-Cookie") or "").partition(";")[0]
            line.close()
        line.request("GET", "/stream", headers=headers)
        answer = line.getresponse()
        if answer.status != http.client.OK:
            raise ValueError(f"{answer.status} {answer.read(200).decode(errors='replace').strip()}")
        self.state, is_news = "connected", False
        while not self._is_over.is_set():
            told = answer.readline(LINE_MAX)
            if not told:
                return
            if told.startswith(b"event: "):
                is_news = told.strip() == b"event: news"
            elif told.startswith(b"data: "):
                self._take(told[6:], is_news=is_news)

    def _take(self, told, *, is_news):
        """One message; what nobody draws is not even read."""
        topic, _, text = told.partition(b" ")
        if topic.decode("ascii", "replace") not in TOPICS:
            return
        message = json.loads(text)
        if not isinstance(message, dict):
            raise ValueError("a message is no table")
        try:
            self.news.put_nowait((topic.decode("ascii"), message, is_news))
        except queue.Full:
            raise ValueError("MAVProxy takes nothing") from None


class Picture:
    """What is to be drawn, made of the messages so far."""

    def __init__(self):
        self.begin()

    def begin(self):
        """Forget everything: another flight."""
        self.world, self.tracks, self.known = {}, [], set()
        self.plans, self.candidate, self.flown = {}, None, None
        self.place, self.mode = None, ""
        self.decisions = collections.deque(maxlen=DECISIONS)

    @property
    def origin(self):
        """Latitude and longitude of the mission's origin [deg], None until they are told."""
        told = self.world.get("origin")
        return None if told is None else (float(told["latitude_deg"]), float(told["longitude_deg"]))

    def take(self, topic, message):
        """Take a message; returns words for the console, '' for none, and whether a mission was replaced."""
        if topic == "/reset":
            self.begin()
        elif topic == "/world":
            self.world = message
        elif topic == "/tracks":
            self.tracks = message["tracks"]
        elif topic == "/snapshot":
            self.known = set(message["known_threats"])
        elif topic == "/ownship":
            self.place = message["position_enu_m"]
        elif topic == "/standing":
            self.mode = str(message["mode"])
        elif topic == "/plan":
            self._take_plan(message)
        elif topic == "/swap":
            return "", self._take_swap(message)
        elif topic == "/decision":
            self.decisions.append((self.place, str(message["kind"])))
            return f"{message['kind']}: {message['text']}", False
        return "", False

    def _take_plan(self, message):
        path = message.get("path")  # briefs of what is past have none
        if path:
            number = message["number"]
            self.plans[number] = [row[1:3] for row in path]
            self.candidate = number
            while len(self.plans) > PLANS_KEPT:
                del self.plans[next(iter(self.plans))]

    def _take_swap(self, message):
        places = message.get("waypoints_enu_m")
        if message.get("outcome") != "flown" or not places:
            return False
        number = message["plan_number"]
        self.flown = self.plans.get(number) or [place[:2] for place in places]
        if self.candidate == number:
            self.candidate = None
        return True

    def objects(self):
        """What stands on the map, by key."""
        if self.origin is None:
            return {}
        made = [*self._radars(), *self._threats(), *self._ways(), *self._said()]
        return {entry.key: entry for entry in made}

    def _at(self, place):
        return latlon(self.origin, float(place[0]), float(place[1]))

    def _label(self, key, place, text, colour):
        return mp_slipmap.SlipLabel(PREFIX + key, self._at(place), text, LAYER, colour)

    def _circle(self, key, place, radius_m, colour, width=1):
        return mp_slipmap.SlipCircle(PREFIX + key, LAYER, self._at(place), radius_m, colour, width)

    def _radars(self):
        for radar in self.world.get("radars", ()):
            name, place = radar["name"], radar["position_enu_m"]
            is_known = name in self.known
            colour = RADAR if is_known else UNSENSED
            yield self._circle(
                f"radar {name}", place, radar["max_threat_radius_m"], colour, 2 if is_known else 1
            )
            yield self._label(
                f"radar {name} name", place, name if is_known else f"{name} (not sensed)", colour
            )

    def _threats(self):
        """Moving threats: their radius, and straight ways as far as they can be; walls make it less."""
        for track in self.tracks:
            name, place = track["identity"], track["position_enu_m"]
            yield self._circle(f"threat {name}", place, track["max_threat_radius_m"], HUNTER, 2)
            yield self._label(f"threat {name} name", place, name, HUNTER)
            spread = DEVIATIONS * math.sqrt(max(track["covariance"][0][0], track["covariance"][2][2], 0.0))
            for seconds in REACH_S:
                reach = spread + track["speed_max_m_s"] * seconds
                yield self._circle(f"reach {name} {seconds:g}", place, reach, REACH)
                rim = (place[0], place[1] + reach)
                yield self._label(f"reach {name} {seconds:g} s", rim, f"{seconds:g} s", REACH)

    def _ways(self):
        for key, way, colour in (
            ("flown", self.flown, FLOWN),
            ("candidate", self.plans.get(self.candidate), CANDIDATE),
        ):
            if way and len(way) > 1:
                places = [self._at(place) for place in way]
                yield mp_slipmap.SlipPolygon(PREFIX + key, places, LAYER, colour, 3, showcircles=False)

    def _said(self):
        for number, (place, kind) in enumerate(self.decisions):
            if place is not None:
                yield self._label(f"decision {number}", place, kind, SAID)


class CompanionModule(mp_module.MPModule):
    """The module, as MAVProxy drives it."""

    def __init__(self, mpstate):
        super().__init__(mpstate, "companion", "what the path planner knows, on the map", public=True)
        self.companion_settings = mp_settings.MPSettings([("reload", bool, True), ("verbose", bool, True)])
        self.picture, self.stream = Picture(), None
        self._drawn, self._drawn_s = {}, -math.inf
        self.add_command(
            "companion", self.cmd_companion, "the path planner's picture", ["open", "close", "status", "set"]
        )

    def cmd_companion(self, args):
        """Do what is typed behind ``companion``."""
        verb, *rest = args or ["status"]
        if verb == "open":
            self._open(rest[0] if rest else DEFAULT_URL)
        elif verb == "close":
            self._close()
        elif verb == "status":
            self._say(self.status_text())
        elif verb == "set":
            self.companion_settings.command(rest)
        else:
            self._say(USAGE)

    def status_text(self):
        """How the connection is, and what is known."""
        picture = self.picture
        how = "closed" if self.stream is None else self.stream.state
        return (
            f"page: {how}; mode {picture.mode or 'unknown'}, {len(picture.tracks)} moving threats, "
            f"{len(picture.known)} threats known, plan {picture.candidate or 'handed over or none'}"
        )

    def _open(self, url):
        self._close()
        try:
            self.stream = Stream(url)
        except ValueError as error:
            self._say(str(error))
            return
        self.stream.start()

    def _close(self):
        if self.stream is not None:
            self.stream.close()
            self.stream = None
        self.picture.begin()
        self._draw({})

    def _say(self, text):
        self.console.writeln(f"companion: {text}")

    def idle_task(self):
        """Take what was told, and draw twice a second; MAVProxy calls this often."""
        if self.stream is not None:
            self._take_news(self.stream)
        now_s = time.monotonic()
        if now_s - self._drawn_s >= DRAWN_S:
            self._drawn_s = now_s
            self._draw(self._objects())

    def _take_news(self, stream):
        is_replaced = False
        for _ in range(WAITING_MAX):
            try:
                topic, message, is_news = stream.news.get_nowait()
            except queue.Empty:
                break
            try:
                words, is_flown = self.picture.take(topic, message)
            except UNREADABLE as error:
                words, is_flown = f"{topic} of another version: {type(error).__name__} {error}", False
            if words and is_news and self.companion_settings.verbose:
                self._say(words)
            is_replaced = is_replaced or is_flown
        if is_replaced and self.companion_settings.reload:
            self._read_mission()

    def _objects(self):
        """What is to be drawn; what cannot be is told, and another flight begun with."""
        try:
            return self.picture.objects()
        except UNREADABLE as error:
            self._say(f"the page is of another version: {type(error).__name__} {error}")
            self.picture.begin()
            return {}

    def _read_mission(self):
        """Have MAVProxy read the autopilot's mission, which no message tells it of on ArduPilot."""
        missions = self.module("wp")
        if missions is not None:
            missions.cmd_wp(["list"])

    def _draw(self, objects):
        """Put what is new on every map, and take away what is gone."""
        for module in self.module_matching("map*"):
            for key in self._drawn.keys() - objects.keys():
                module.map.remove_object(key)
            for key, entry in objects.items():
                if self._drawn.get(key) != vars(entry):
                    module.map.add_object(entry)
        self._drawn = {key: dict(vars(entry)) for key, entry in objects.items()}

    def unload(self):
        """Leave nothing behind."""
        self._close()
        self.remove_command("companion")
        super().unload()


def init(mpstate):
    """Begin, as MAVProxy asks for it."""
    return CompanionModule(mpstate)
