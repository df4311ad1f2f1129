"""How old everything is that decisions are made by: what is stale is told to the pilot, and what is back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from companion.config.models import UseBy
from companion.flight.messages.announcer import Announcer
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import StateOwner
from companion.flight.state.situation import Situation
from companion.link.missions.autopilot_link import AutopilotLink
from companion.tracking.ownship import OwnshipEstimator
from companion.types.events import MissionCurrent

POSITION, MISSION_ITEM = "position", "mission item"
VITAL = frozenset({POSITION, MISSION_ITEM})
STANDS = "; the flown mission stands"
SETTLED_S = 3.0  # what is not vital is told to be back once it stayed so long


@dataclass(frozen=True, slots=True)
class Input:
    """Something that is heard again and again.

    Parameters
    ----------
    name : str
        What it is, in words.
    received_s : float
        When it was heard last, by the clock [s]; minus infinity if it never was.
    use_by_s : float
        Age up to which it is gone by [s].
    doubt : str
        Why it is not to be believed although it is heard; '' if it is.
    """

    name: str
    received_s: float
    use_by_s: float
    doubt: str = ""

    def fault(self, now_s: float, since_s: float = -math.inf) -> str:
        """What is wrong with it, in words; '' if it may be gone by.

        Parameters
        ----------
        now_s : float
            The clock's reading [s].
        since_s : float
            When it was to be heard from [s]: what never came is missing since then.
        """
        age_s = now_s - max(self.received_s, since_s)
        if age_s > self.use_by_s:
            return f"no {self.name} for {self.use_by_s:g} s"
        return f"{self.name}: {self.doubt}" if self.doubt else ""


def inputs(
    use_by: UseBy,
    ownship: OwnshipEstimator,
    current: MissionCurrent | None,
    tracks: Mapping[str, float],
    now_s: float,
) -> tuple[Input, ...]:
    """All that decisions are made by, what is vital first.

    Parameters
    ----------
    use_by : UseBy
        The mission file's ages.
    ownship : OwnshipEstimator
        Where the aircraft is.
    current : MissionCurrent or None
        What the autopilot told last of the mission it flies.
    tracks : mapping of str to float
        When each moving threat was seen last, by its identity [s].
    now_s : float
        The clock's reading [s].
    """
    ages = {
        POSITION: use_by.position_s, "attitude": use_by.attitude_s,
        "airspeed": use_by.airspeed_s, "wind": use_by.wind_s,
    }  # fmt: skip
    heard = ownship.received_s()
    own = [
        Input(name, heard[name], float(age), ownship.doubt(now_s) if name == POSITION else "")
        for name, age in ages.items()
    ]
    item = Input(
        MISSION_ITEM, -math.inf if current is None else current.stamp_s, float(use_by.mission_item_s)
    )
    moving = (Input(f"track {name}", seen_s, float(use_by.track_s)) for name, seen_s in tracks.items())
    return (own[0], item, *own[1:], *moving)


class FreshnessWatch:
    """Looks at the ages of all inputs of an aircraft that is armed.

    Parameters
    ----------
    flight : StateOwner
        The flight's state, for the mission file's ages.
    situation : Situation
        Where the aircraft and the threats are.
    link : AutopilotLink
        What it told of the mission it flies.
    announcer : Announcer
        Told what is stale, and what is back.
    """

    def __init__(
        self, flight: StateOwner, situation: Situation, link: AutopilotLink, announcer: Announcer
    ) -> None:
        self._flight, self._situation = flight, situation
        self._link, self._announcer = link, announcer
        self._since_s = math.inf  # armed
        self._stale: dict[str, tuple[float, float]] = {}  # when it was heard last before, and missed last

    @property
    def is_blind(self) -> bool:
        """Whether something is missing without which nothing is planned."""
        return not VITAL.isdisjoint(self._stale)

    def look(self, now_s: float) -> bool:
        """Tell what has become stale, and what is fresh again.

        Parameters
        ----------
        now_s : float
            The clock's reading [s].

        Returns
        -------
        bool
            Whether all that is vital is there again, and was not: a plan is due.
        """
        if not self._flight.state.phase.is_armed:
            self._since_s, self._stale = math.inf, {}
            return False
        self._since_s = min(self._since_s, now_s)
        was_blind = self.is_blind
        tracks = self._situation.tracker.received_s(now_s)
        found = inputs(
            self._flight.state.mission.use_by, self._situation.ownship, self._link.current, tracks, now_s
        )
        for entry in found:
            self._follow(entry, now_s)
        names = {entry.name for entry in found}
        self._stale = {name: span for name, span in self._stale.items() if name in names}  # tracks end
        return was_blind and not self.is_blind

    def _follow(self, entry: Input, now_s: float) -> None:
        name, is_vital = entry.name, entry.name in VITAL
        fault = entry.fault(now_s, self._since_s)
        received_s, last_s = self._stale.get(name, (max(entry.received_s, self._since_s), now_s))
        if fault:
            if name not in self._stale:
                text, tell = (fault + STANDS, "missing") if is_vital else (fault, "old")
                age = f"{entry.use_by_s:g}"
                self._announcer.decide(DecisionKind.STALE, text, tell=tell, about=name, what=name, age=age)
            self._stale[name] = received_s, now_s
        elif name in self._stale and (is_vital or now_s - last_s >= SETTLED_S):
            del self._stale[name]
            text = f"{name} again, after {last_s - received_s:.0f} s"
            self._announcer.decide(DecisionKind.FRESH, text, tell="back", about=name, what=name.capitalize())
