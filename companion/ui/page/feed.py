"""The feed of a running flight: a viewer first receives all that is needed, then each message.

The recorder calls the feed in the service's event loop, where the feed only puts bytes into lists. The
page's server takes them in a thread of its own. Even if that thread hangs, the waiting bytes are bounded.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from companion.recording import mcap_schema as channels
from companion.recording.mcap_writer import encoded
from companion.ui.page.world_document import WORLD, WorldDocument

HISTORY, RESET = "/history", "/reset"
HISTORY_S = 1.0  # Time between rows of the flown path; of longer flights every second row is left out.
HISTORY_MAX = 2_000
DECISIONS_KEPT = 300
BRIEFS_KEPT = 1_000  # Plans and exchanges that are kept without their paths, for the strips.
PLANS_KEPT = 8  # Number of whole plans that are kept; one of them is flown.
NEWS_MAX = 2_000  # Most messages that wait for the server: those of a minute and a half.
LAST = (
    channels.PLAN, channels.TREES, channels.TRACKS, channels.THREAT, channels.OWNSHIP, channels.LINK,
    channels.STANDING, channels.ENERGY,
)  # fmt: skip
FLOWN = "flown"  # The outcome of an exchange whose mission is flown.
_SOON_S, _DIGITS = 0.05, 2
Row = tuple[Any, ...]  # time, east, north, up, airspeed, threat level

# Channels that viewers do not get: the ownship's message has the same position.
UNPUBLISHED = frozenset({channels.LOCATION})


def line_of(topic: str, data: bytes) -> bytes:
    """Return a message as the page reads it: its topic, a space, and JSON."""
    return topic.encode("ascii") + b" " + data


class Feed:
    """Collects what a viewer needs, and what is new for those that look on."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._wake: Callable[[], None] | None = None
        self.world: WorldDocument | None = None
        self._begin()

    def _begin(self) -> None:
        """Forget the flight before."""
        self._mission: tuple[str, str] | None = None
        self._last: dict[str, bytes] = {}
        self._history: list[Row] = []
        self._level: object = None
        self._decisions: deque[bytes] = deque(maxlen=DECISIONS_KEPT)
        self._briefs: deque[bytes] = deque(maxlen=BRIEFS_KEPT)
        self._plans: dict[object, bytes] = {}
        self._obstacles = self._flown = self._flown_plan = b""
        self._news: deque[bytes] = deque()
        self._is_lost = False

    def wake_by(self, wake: Callable[[], None]) -> None:
        """Call this whenever there is news; it neither waits nor raises."""
        self._wake = wake

    def begin_flight(self) -> None:
        """Begin another flight: viewers forget the one before."""
        with self._lock:
            self._begin()
            self.world = None
            self._news.append(line_of(RESET, b"{}"))
        self._tell_server()

    def tell(self, topic: str, now_s: float, message: Mapping[str, object], data: bytes) -> None:
        """Take a message as the recorder writes it down."""
        if topic in UNPUBLISHED:
            return
        with self._lock:
            self._keep(topic, now_s, message, data)
            if topic != channels.MISSION:  # The server makes the world from the mission.
                self._add_news(line_of(topic, data))
        self._tell_server()

    def notice(self, topic: str, data: bytes) -> None:
        """Pass on a message for present viewers only; the recorder's next message has the same content."""
        with self._lock:
            self._add_news(line_of(topic, data))
        self._tell_server()

    def _add_news(self, line: bytes) -> None:
        """Add a line for the viewers, unless too much waits for the server already."""
        if len(self._news) >= NEWS_MAX:
            self._news.clear()
            self._is_lost = True
        if not self._is_lost:
            self._news.append(line)

    def _tell_server(self) -> None:
        if self._wake is not None:
            self._wake()

    def _keep(self, topic: str, now_s: float, message: Mapping[str, object], data: bytes) -> None:
        """Keep what a viewer that comes later needs of a message."""
        if topic in LAST:
            self._last[topic] = line_of(topic, data)
        match topic:
            case channels.MISSION:
                self._mission = str(message.get("mission_file")), str(message.get("name"))
            case channels.DECISION:
                self._decisions.append(line_of(topic, data))
            case channels.THREAT:
                self._level = message.get("level")
            case channels.OWNSHIP:
                self._note_place(now_s, message)
            case channels.SNAPSHOT:
                self._last[topic] = line_of(topic, data)
                if "obstacles" in message:
                    self._obstacles = line_of(topic, data)
            case channels.PLAN:
                self._note_plan(now_s, message, data)
            case channels.SWAP:
                self._note_swap(now_s, message, data)

    def _note_place(self, now_s: float, message: Mapping[str, object]) -> None:
        """Add a row of the flown path: time, east, north, up, airspeed, threat level; about one a second."""
        place = message.get("position_enu_m")
        is_due = not self._history or now_s - self._history[-1][0] >= HISTORY_S - _SOON_S
        if not is_due or not isinstance(place, tuple):
            return
        self._history.append((now_s, *place, message.get("airspeed_m_s"), self._level))
        if len(self._history) > HISTORY_MAX:
            self._history = self._history[::2]

    def _note_plan(self, now_s: float, message: Mapping[str, object], data: bytes) -> None:
        """Keep a plan, which may be flown, and what the strips show of it."""
        self._plans[message.get("number")] = line_of(channels.PLAN, data)
        while len(self._plans) > PLANS_KEPT:
            self._plans.pop(next(iter(self._plans)))
        self._brief(channels.PLAN, now_s, message, ("number", "pursuit", "flown_pursuit", "plan_ms", "gap"))

    def _note_swap(self, now_s: float, message: Mapping[str, object], data: bytes) -> None:
        """Keep a mission that is flown, and what the strips show of an exchange."""
        self._brief(channels.SWAP, now_s, message, ("outcome", "plan_number"))
        if message.get("outcome") == FLOWN:
            self._flown = line_of(channels.SWAP, data)
            self._flown_plan = self._plans.get(message.get("plan_number"), b"")

    def _brief(self, topic: str, now_s: float, message: Mapping[str, object], keys: tuple[str, ...]) -> None:
        """Keep some keys of a message for those that come later."""
        self._briefs.append(line_of(topic, encoded(now_s, {key: message.get(key) for key in keys})))

    # --- in the server's thread

    def news(self) -> tuple[list[bytes], bool]:
        """Lines since it was last asked; whether some were lost, so that viewers have to begin anew."""
        world_due = None
        with self._lock:
            if self._mission is not None:
                world_due, self._mission = self._mission, None
        lines = []
        if world_due is not None:
            self.world = WorldDocument(*world_due)
            lines.append(line_of(WORLD, self.world.document))
        with self._lock:
            lines += self._news
            is_lost, self._is_lost = self._is_lost, False
            self._news.clear()
        return lines, is_lost

    def snapshot(self) -> list[bytes]:
        """Lines from which a viewer knows the flight so far; news comes after them."""
        with self._lock:
            rows = list(self._history)
            lines = [
                *self._briefs, *self._decisions, self._obstacles, self._last.get(channels.SNAPSHOT, b""),
                self._flown_plan, self._flown, *(self._last[topic] for topic in LAST if topic in self._last),
            ]  # fmt: skip
        world = [] if self.world is None else [line_of(WORLD, self.world.document)]
        history = line_of(
            HISTORY, encoded(0.0, {"rows": [[_rounded(value) for value in row] for row in rows]})
        )
        return [line_of(RESET, b"{}"), *world, history, *(line for line in lines if line)]


def _rounded(value: object) -> object:
    """Return a figure for the strips and the flown path."""
    return round(value, _DIGITS) if isinstance(value, float) else value
