"""What is flown, judged again whenever the world has changed: what has become worse is answered at once."""

from __future__ import annotations

import math

from companion.config.rules import Rules
from companion.departure.foresight import begin
from companion.flight.flight_state import StateOwner
from companion.flight.progress import as_of_now
from companion.flight.situation import Situation
from companion.swapping.list_reader import ListReader
from companion.types.path import Path

RISE = 0.15  # of the threat level: an estimate wanders by less
LOOK_S = 0.3  # between two judgements at least: each takes some milliseconds


class SurpriseWatch:
    """Compares what is flown, in the world of now, with what it was when it was judged last.

    Hysteresis: whatever a plan decides, what it saw is what the next surprise is measured by.

    Parameters
    ----------
    flight : StateOwner
        What is flown, and by which rules.
    situation : Situation
        The world of now.
    reader : ListReader
        Knows the item being flown.

    Attributes
    ----------
    is_failing : bool
        Whether the rest of what is flown failed the check when it was judged last.
    """

    def __init__(self, flight: StateOwner, situation: Situation, reader: ListReader) -> None:
        self.is_failing = False
        self._flight, self._situation, self._reader = flight, situation, reader
        self._level = math.inf
        self._was_failing = True
        self._surprise = ""
        self._seen: tuple[float, int] | None = None
        self._rules: Rules | None = None
        self._looked_s = -math.inf

    def judged(self, path: Path | None, *, is_failing: bool) -> None:
        """What is flown was judged just now, and is what a surprise is measured by.

        Parameters
        ----------
        path : Path or None
            What is left of it; None where nothing is flown that could surprise.
        is_failing : bool
            Whether it fails the check; a path of the emergency strategy may be above the threat limit.
        """
        self._level = math.inf if path is None else float(path.threat_levels.max())
        self.is_failing = self._was_failing = is_failing
        self._surprise = ""

    def look(self, now_s: float) -> str:
        """How what is flown has become worse since, in words; '' if it has not.

        Parameters
        ----------
        now_s : float
            The clock's reading [s].
        """
        state, situation = self._flight.state, self._situation
        ownship = situation.ownship.state(now_s)
        world = situation.newest_track_s, situation.num_known_threats
        if ownship is None or not state.may_act or not state.flies_to_goal:
            return ""
        is_same = world == self._seen and state.rules is self._rules
        if is_same or now_s - self._looked_s < LOOK_S:
            return self._surprise
        self._seen, self._rules, self._looked_s = world, state.rules, now_s
        start = begin(state, ownship, self._reader.current, is_urgent=True)
        snapshot = situation.snapshot(now_s)
        state = self._flight.see(ownship, snapshot.picture)
        rest = as_of_now(state, start, snapshot).rest
        if rest is None:
            return ""
        level, violations = float(rest.threat_levels.max()), state.violations_of(rest)
        self.is_failing, self._surprise = bool(violations), ""
        if violations and not self._was_failing:
            self._surprise = f"flown path: {violations[0]}"
        elif level > self._level + RISE:
            self._surprise = f"threat on the flown path {self._level:.2f} -> {level:.2f}"
        return self._surprise
