"""Watch the age of the inputs of decisions; inform the pilot when one is stale and when it is back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from companion.config.models import UseBy
from companion.flight.messages.announcer import Announcer
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import StateOwner
from companion.flight.state.world_model import WorldModel
from companion.link.missions.autopilot_link import AutopilotLink
from companion.tracking.ownship import OwnshipEstimator
from companion.types.events import MissionCurrent

POSITION, MISSION_ITEM = "position", "mission item"  # Names of inputs, as recorded.
VITAL = frozenset({POSITION, MISSION_ITEM})  # Without these inputs nothing is planned.
MISSION_STAYS = "; the flown mission stands"  # Recorded if a vital input is stale.
FRESH_MIN_S = 3.0  # An input that is not vital is announced as back after this time.


@dataclass(frozen=True, slots=True)
class Input:
    """An input that is received repeatedly.

    Parameters
    ----------
    name : str
        Name of the input in words.
    received_s : float
        Time of the last reception, by the clock [s]; minus infinity if there was none.
    use_by_s : float
        Age up to which the input is used [s].
    doubt : str
        Why the input is not trusted although it is received; '' if it is.
    """

    name: str
    received_s: float
    use_by_s: float
    doubt: str = ""

    def fault(self, now_s: float, since_s: float = -math.inf) -> str:
        """Return what is wrong with the input, in words; '' if it may be used.

        Parameters
        ----------
        now_s : float
            The clock's reading [s].
        since_s : float
            Time from which the input is expected [s]: one that was never received is missing since then.
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
    """Return all inputs of decisions, the vital ones first.

    Parameters
    ----------
    use_by : UseBy
        The ages in the mission file.
    ownship : OwnshipEstimator
        The estimate of the aircraft.
    current : MissionCurrent or None
        The last message about the mission that the autopilot flies.
    tracks : mapping of str to float
        Time of the last report of each moving threat, by identity [s].
    now_s : float
        The clock's reading [s].
    """
    ages = {
        POSITION: use_by.position_s, "attitude": use_by.attitude_s,
        "airspeed": use_by.airspeed_s, "wind": use_by.wind_s,
    }  # fmt: skip
    received = ownship.received_s()
    own = [
        Input(name, received[name], float(age), ownship.doubt(now_s) if name == POSITION else "")
        for name, age in ages.items()
    ]
    item = Input(
        MISSION_ITEM, -math.inf if current is None else current.stamp_s, float(use_by.mission_item_s)
    )
    moving = (Input(f"track {name}", seen_s, float(use_by.track_s)) for name, seen_s in tracks.items())
    return (own[0], item, *own[1:], *moving)


class FreshnessWatch:
    """Checks the ages of all inputs while the aircraft is armed.

    Parameters
    ----------
    flight : StateOwner
        The flight's state, for the ages in the mission file.
    world_model : Situation
        The known world: aircraft and threats.
    link : AutopilotLink
        The link, for the last message about the mission.
    announcer : Announcer
        Announces stale inputs, and those that are back.
    """

    def __init__(
        self, flight: StateOwner, world_model: WorldModel, link: AutopilotLink, announcer: Announcer
    ) -> None:
        self._flight, self._world_model = flight, world_model
        self._link, self._announcer = link, announcer
        self._since_s = math.inf  # when the aircraft was armed
        self._stale: dict[str, tuple[float, float]] = {}  # last reception before, and last time found stale

    @property
    def is_blind(self) -> bool:
        """Whether a vital input is stale, so that nothing is planned."""
        return not VITAL.isdisjoint(self._stale)

    def look(self, now_s: float) -> bool:
        """Announce inputs that have become stale, and those that are fresh again.

        Parameters
        ----------
        now_s : float
            The clock's reading [s].

        Returns
        -------
        bool
            Whether the last stale vital input is fresh again, so that a plan is due.
        """
        if not self._flight.state.phase.is_armed:
            self._since_s, self._stale = math.inf, {}
            return False
        self._since_s = min(self._since_s, now_s)
        was_blind = self.is_blind
        tracks = self._world_model.tracker.received_s(now_s)
        found = inputs(
            self._flight.state.mission.use_by, self._world_model.ownship, self._link.current, tracks, now_s
        )
        for entry in found:
            self._follow(entry, now_s)
        names = {entry.name for entry in found}
        self._stale = {name: span for name, span in self._stale.items() if name in names}  # Tracks may end.
        return was_blind and not self.is_blind

    def _follow(self, entry: Input, now_s: float) -> None:
        name, is_vital = entry.name, entry.name in VITAL
        fault = entry.fault(now_s, self._since_s)
        received_s, last_s = self._stale.get(name, (max(entry.received_s, self._since_s), now_s))
        if fault:
            if name not in self._stale:
                text, tell = (fault + MISSION_STAYS, "missing") if is_vital else (fault, "old")
                age = f"{entry.use_by_s:g}"
                self._announcer.decide(DecisionKind.STALE, text, tell=tell, about=name, what=name, age=age)
            self._stale[name] = received_s, now_s
        elif name in self._stale and (is_vital or now_s - last_s >= FRESH_MIN_S):
            del self._stale[name]
            text = f"{name} again, after {last_s - received_s:.0f} s"
            self._announcer.decide(DecisionKind.FRESH, text, tell="back", about=name, what=name.capitalize())
