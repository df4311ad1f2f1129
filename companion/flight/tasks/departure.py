"""Before the takeover: the operator's list is read whenever it changes, and answered; nothing is uploaded."""

from __future__ import annotations

import math

from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import after_takeover
from companion.flight.state.list_state import after_suspicion
from companion.flight.takeover.capability import shortfalls
from companion.flight.takeover.operator_summary import operator_summary_of
from companion.flight.takeover.takeover import is_due
from companion.flight.tasks.handback import Handback
from companion.flight.tasks.replanning_parts import ReplanningParts
from companion.types.mission import MissionItem

READ_AGAIN_S = 2.0  # soonest after a reading, that failed perhaps
LOOK_S = 10.0  # between readings of a list whose changes the autopilot does not tell everybody
FRESH_S = 2.0  # of such a list, when the service takes over


class Departure:
    """Keeps what is known of the operator's list up to date up to the takeover, and says what it comes to.

    Parameters
    ----------
    parts : ReplanningParts
        What it works with.

    Attributes
    ----------
    handback : Handback
        Says while the pilot flies what handing back comes to.
    """

    def __init__(self, parts: ReplanningParts) -> None:
        self._flight, self._situation, self._clock = parts.flight, parts.situation, parts.clock
        self._announcer, self._rally_points = parts.announcer, parts.rally_points
        self._reader, self._protocols = parts.handover.reader, parts.handover.protocols
        self.handback = Handback(parts)
        self._read_s = -math.inf
        self._briefed: tuple[tuple[MissionItem, ...], tuple[str, ...]] | None = None

    async def keep_up(self) -> None:
        """Read the list if it is not known or may have changed, and brief the pilot on what is new in it."""
        now = self._clock.now_s()
        if self._may_have_changed(LOOK_S, now):
            self._flight.apply_to_list(after_suspicion, "a look")
        listed = self._flight.listed
        is_known = listed.layout is not None and not listed.suspected
        # Whether a list's items are flown is told by where the aircraft is.
        is_reported = not self._flight.state.phase.is_armed or self._situation.ownship.state(now) is not None
        if not is_known and is_reported and now - self._read_s >= READ_AGAIN_S:
            await self._reader.prepare()
            self._read_s = self._clock.now_s()
        elif is_known:
            await self._rally_points.renew(is_again=True)
        listed = self._flight.listed
        # Said again, too, when a parameter changes what is wrong.
        news = listed.stored, shortfalls(self._flight.state.mission, self._flight.state.settings)
        if listed.layout is not None and news != self._briefed:
            self._briefed = news
            if not listed.found_flown:
                self._brief()

    def _may_have_changed(self, after_s: float, now: float) -> bool:
        """Whether a list that its autopilot gives no name was read longer ago than ``after_s``.

        An ArduPlane tells the end of an upload on the link that it came over, and others the number of items.
        """
        listed, current = self._flight.listed, self._protocols.parts.link.current
        is_named = current is not None and current.mission_id != 0
        return listed.layout is not None and not is_named and now - listed.read_s > after_s

    def _brief(self) -> None:
        """Tell the pilot what will be flown, from when on by the service, and what is wrong."""
        ownship = self._situation.ownship.state(self._clock.now_s())
        told = operator_summary_of(self._flight.state, ownship, self._protocols.dialect.num_home_items)
        decide = self._announcer.decide
        if told.plan:
            decide(DecisionKind.MISSION, told.plan, tell="mission", mission=told.plan)
            decide(DecisionKind.TAKEOVER, told.takeover, tell="takeover", when=told.takeover)
            tell = "landing" if told.has_end else "no landing"
            decide(DecisionKind.MISSION, told.landing, tell=tell, landing=told.landing)
        for fault in told.faults:
            decide(DecisionKind.FAULT, fault, tell="check", about=fault, fault=fault)

    def take_over_if_due(self) -> bool:
        """Whether the service takes over now."""
        link, now = self._protocols.parts.link, self._clock.now_s()
        current = link.current
        if current is None or not is_due(self._flight.state, current, self._situation.ownship.state(now)):
            return False
        if self._may_have_changed(FRESH_S, now):
            self._flight.apply_to_list(after_suspicion, "the takeover")
            self._read_s = -math.inf
            return False
        self._flight.apply(after_takeover, current.sequence)
        return True
