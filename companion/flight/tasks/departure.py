"""Before the takeover: read the operator's list whenever it changes, and brief the pilot; upload nothing."""

from __future__ import annotations

import math

from companion.flight.messages.operator_summary import operator_summary_of
from companion.flight.monitors.glide_down import GlideDown
from companion.flight.monitors.return_setting import ReturnSetting
from companion.flight.prediction.return_words import return_in_words
from companion.flight.replanning.replanning_parts import ReplanningParts
from companion.flight.state.decision import DecisionKind
from companion.flight.state.goals_state import after_takeover
from companion.flight.state.list_state import after_suspicion
from companion.flight.takeover.capability import shortfalls
from companion.flight.takeover.takeover import is_due
from companion.flight.tasks.other_modes import OtherModes
from companion.types.mission import MissionItem

READ_AGAIN_S = 2.0  # Shortest time between two readings, of which the first may have failed.
# Time between readings of a list whose changes the autopilot does not report to all links.
LOOK_INTERVAL_S = 10.0
PARAMETERS_S = 5.0  # The takeover waits this long for the autopilot's parameters: missions depend on them.
FRESH_S = 2.0  # Such a list is read again at the takeover if the last reading is older.


class Departure:
    """Keeps the knowledge of the operator's list up to date until the takeover, and summarises it.

    Parameters
    ----------
    parts : ReplanningParts
        The parts of replanning.

    Attributes
    ----------
    other_modes : OtherModes
        Informs the pilot, while somebody else flies, of what lies ahead.
    glide : GlideDown
        Leads the aircraft to a field when thrust is missing.
    """

    def __init__(self, parts: ReplanningParts) -> None:
        self._flight, self._world_model, self._clock = parts.flight, parts.world_model, parts.clock
        self._announcer, self._rally_points = parts.announcer, parts.rally_points
        self._reader, self._protocols = parts.handover.reader, parts.handover.protocols
        self.other_modes = OtherModes(parts)
        self.glide = GlideDown(
            parts.flight, parts.world_model, parts.handover, parts.announcer, parts.performance, parts.clock
        )
        self._return_setting = ReturnSetting(
            parts.flight, self._protocols.parts.link, parts.announcer, parts.clock
        )
        self._read_s = -math.inf
        self._began_s: float | None = None
        self._last_summary: tuple[tuple[MissionItem, ...], tuple[str, ...]] | None = None

    async def keep_up(self) -> None:
        """Read the list if it is not known or may have changed, and brief the pilot if it has."""
        now = self._clock.now_s()
        self._began_s = now if self._began_s is None else self._began_s
        if self._may_have_changed(LOOK_INTERVAL_S, now):
            self._flight.apply_to_list(after_suspicion, "a look")
        listed = self._flight.listed
        is_known = listed.layout is not None and not listed.suspected
        # The aircraft's position shows whether it flies the list's items.
        is_reported = (
            not self._flight.state.phase.is_armed or self._world_model.ownship.state(now) is not None
        )
        if not is_known and is_reported and now - self._read_s >= READ_AGAIN_S:
            await self._reader.prepare()
            self._read_s = self._clock.now_s()
        elif is_known:
            await self._rally_points.renew(includes_unnamed=True)
            await self._return_setting.keep_up()
        listed = self._flight.listed
        # The summary is repeated if a parameter changes the shortfalls, or what a return does.
        state = self._flight.state
        limited = shortfalls(state.mission, state.settings, state.home_enu_m, flies_by=state.flies_by)
        news = listed.stored, (*limited, return_in_words(state))
        if listed.layout is not None and news != self._last_summary:
            self._last_summary = news
            if not listed.was_found_flown:
                self._send_summary()

    def _may_have_changed(self, after_s: float, now: float) -> bool:
        """Return whether a list without an identifier was read longer ago than ``after_s`` [s].

        An ArduPlane reports the end of an upload only on the link of the upload, and the number of items to
        all.
        """
        listed, current = self._flight.listed, self._protocols.parts.link.current
        is_named = current is not None and current.mission_id != 0
        return listed.layout is not None and not is_named and now - listed.read_s > after_s

    def _send_summary(self) -> None:
        """Inform the pilot what will be flown, when the service takes over, and what is wrong."""
        ownship = self._world_model.ownship.state(self._clock.now_s())
        summary = operator_summary_of(self._flight.state, ownship, self._protocols.dialect.num_home_items)
        decide = self._announcer.decide
        if summary.plan:
            decide(DecisionKind.MISSION, summary.plan, tell="mission", mission=summary.plan)
            decide(DecisionKind.TAKEOVER, summary.takeover, tell="takeover", when=summary.takeover)
            tell = "landing" if summary.has_end else "no landing"
            decide(DecisionKind.MISSION, summary.landing, tell=tell, landing=summary.landing)
        if summary.returns:
            decide(DecisionKind.RETURN, summary.returns, tell="return", returns=summary.returns)
        for fault in summary.faults:
            decide(DecisionKind.FAULT, fault, tell="check", about=fault, fault=fault)

    def take_over_if_due(self) -> bool:
        """Take over if it is time; return whether the service has taken over."""
        link, now = self._protocols.parts.link, self._clock.now_s()
        current = link.current
        if current is None or not is_due(self._flight.state, current, self._world_model.ownship.state(now)):
            return False
        is_known = self._flight.state.settings.return_kind is not None
        if not is_known and now - (now if self._began_s is None else self._began_s) < PARAMETERS_S:
            return False
        if self._may_have_changed(FRESH_S, now):
            self._flight.apply_to_list(after_suspicion, "the takeover")
            self._read_s = -math.inf
            return False
        self._flight.apply(after_takeover, current.sequence)
        return True
