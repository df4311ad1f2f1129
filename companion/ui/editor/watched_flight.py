"""Flights in the simulator for the editor's page: one at a time, published message by message as it goes."""

from __future__ import annotations

import pkgutil
import threading
from collections.abc import Callable, Mapping
from typing import Protocol, cast

from companion.config import MissionConfig, require_goals
from companion.errors import CompanionError, ConfigError
from companion.recording import mcap_schema as channels
from companion.run_places import WATCHED, places

LINES_MAX = 50_000  # Number of a flight's messages that are kept.
# The page of the editor draws these; others are large, or said again by them.
TOPICS = frozenset(
    {
        channels.OWNSHIP, channels.TRACKS, channels.THREAT, channels.DECISION, channels.STANDING,
        channels.SNAPSHOT, channels.PLAN, channels.SWAP,
    }
)  # fmt: skip


class Flyer(Protocol):
    """Flies a mission in the simulator."""

    def __call__(
        self,
        mission: MissionConfig,
        seed: int,
        pace: float,
        listen: Callable[..., None],
        is_wanted: Callable[[], bool],
    ) -> Mapping[str, object]:
        """Fly, and return the measures by name; nothing if it is not wanted any more."""
        ...


def simulator() -> Flyer:
    """Return the simulator's function that flies.

    Raises
    ------
    ConfigError
        If no simulator is installed.
    """
    try:
        return cast("Flyer", pkgutil.resolve_name(places()[WATCHED]))
    except (KeyError, ImportError):
        expected = "pip install 'safe-rrt-companion[sim]'"
        raise ConfigError("companion", None, "fly", "no simulator installed", expected) from None


class WatchedFlight:
    """A flight in a thread of its own.

    Parameters
    ----------
    mission : MissionConfig
        The mission.
    seed : int
        Seed of everything random.
    pace : float
        Simulated seconds a second; infinite for as fast as it goes.

    Raises
    ------
    ConfigError
        If the mission has no goals.
    """

    def __init__(self, mission: MissionConfig, seed: int, pace: float) -> None:
        require_goals(mission, mission.name)
        self._mission, self._seed, self._pace = mission, seed, pace
        self._lines: list[str] = []
        self._is_wanted = True
        self._measures: Mapping[str, object] | None = None
        self._fault = ""
        self._thread = threading.Thread(target=self._fly, name="flight", daemon=True)
        self._thread.start()

    def _fly(self) -> None:
        try:
            flyer = simulator()  # Its import takes a second or two.
            self._measures = flyer(
                self._mission, self._seed, self._pace, self._listen, lambda: self._is_wanted
            )
        except CompanionError as error:
            self._fault = str(error)

    def _listen(self, topic: str, _now_s: float, _message: Mapping[str, object], data: bytes) -> None:
        if topic in TOPICS and len(self._lines) < LINES_MAX:
            self._lines.append(f"{topic} {data.decode()}")

    def stop(self) -> None:
        """End the flight, and wait for its end."""
        self._is_wanted = False
        self._thread.join()

    def messages_since(self, since: int) -> dict[str, object]:
        """Return the messages from a number on, and the measures once the flight is over.

        Parameters
        ----------
        since : int
            Number of messages that are known already.
        """
        is_over = not self._thread.is_alive()  # Asked first: all messages are there by then.
        lines = self._lines[since:]
        return {
            "lines": lines, "next": since + len(lines), "is_over": is_over, "measures": self._measures,
            "fault": self._fault,
        }  # fmt: skip
