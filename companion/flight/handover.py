"""Missions on their way to the autopilot: whose list it is, what is flown of it, and the swap itself.

Knows the difference between the autopilots; the cycle decides what is worth flying, the service whether
it may act at all.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

from companion.clock import Clock
from companion.config import MissionConfig
from companion.errors import CompanionError
from companion.flight.checkpoint import Memory, key_of
from companion.flight.cycle import Cycle, Flown
from companion.link.missions.autopilot_link import AutopilotLink
from companion.mission.list_layout import BANK_EXTRAS, BANK_ITEMS_MAX, Banks, Layout, Whole, layout_of
from companion.mission.mission_id import mission_id
from companion.mission.operator import (
    Operator,
    banks_in,
    goals_of_operator,
    operator_of,
    position_of,
    span_in,
    without_ours,
)
from companion.mission.path_progress import progress_on
from companion.mission.swap import SwapOutcome, difference, enter, replace_whole, store
from companion.mission.waypoints import Waypoints, sequence_of_waypoint
from companion.types.events import Dialect, Event, MissionCurrent, StatusText
from companion.types.mission import Mission, MissionItem
from companion.types.path import Path
from companion.types.state import Ownship

NUM_ITEMS_UNKNOWN = 40
OUTSIDE_S = 1.5  # at another item for so long, it is no report from before a swap that came late
UNDER_WAY_S = 4.0  # a command may still take effect, and a report from before still arrive, for so long
FRESH_S = 2.0  # a list read so lately is not read again before it is written to
RECEIVED = "Flight plan received"  # what ArduPlane tells everybody when an upload has ended
ITEM_S = 0.02  # for each of a list's: half are written, one in 20 ms, all are read twice, several at once
EXCHANGE_EXTRA_S = 0.5
EXCHANGE_MAX_S = 12.0  # believed at most: what is further ahead is flown by then
EXCHANGES_KEPT = 3
MARGIN_OF_EXCHANGES = 1.3


class Reading(Enum):
    """What the autopilot was found to hold."""

    OURS = "ours, or nothing new"
    FOREIGN = "another mission"
    UNREADABLE = "not to be read"


@dataclass(frozen=True, slots=True)
class _Doubt:
    """A mission that was asked to be flown last then, and for all we know only asked."""

    asked_s: float
    layout: Layout
    flown: Flown
    waypoints: Waypoints
    identity: int


class Place(Enum):
    """Where in its list the autopilot is."""

    OURS = "in ours, or not known to be elsewhere"
    PAST_GOAL = "in the operator's items that follow the goal"
    ELSEWHERE = "at an item that we did not choose"


class Handover:
    """The autopilot's mission list, as far as it is known.

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    cycle : Cycle
        Takes the operator's goals, and learns what is flown.
    link : AutopilotLink
        To the autopilot.
    clock : Clock
        The service's.
    state : callable
        Where the aircraft is now, None while that is not known.
    may_act : callable
        Whether the pilot leaves it to us.
    say : callable
        Takes the kind and text of a decision.
    home_amsl_m : callable
        Height that relative altitudes count from, None while it is not known.
    memory : Memory
        For the path that a mission found in the autopilot carries.

    Attributes
    ----------
    layout : Layout or None
        How the list is laid out, None before it was read.
    offered : Mission or None
        The mission that was handed over last, whatever came of it.
    found_flown : bool
        Whether the autopilot was flying a mission of ours when its list was first read: the service was
        restarted in flight.
    """

    def __init__(
        self,
        mission: MissionConfig,
        cycle: Cycle,
        link: AutopilotLink,
        clock: Clock,
        *,
        state: Callable[[], Ownship | None],
        may_act: Callable[[], bool],
        say: Callable[[str, str], None],
        home_amsl_m: Callable[[], float | None],
        memory: Memory,
    ) -> None:
        self.layout: Layout | None = None
        self.found_flown = False
        self.offered: Mission | None = None
        self.operator: Operator | None = None
        self._mission = mission
        self._cycle = cycle
        self._link = link
        self._clock = clock
        self._state = state
        self._may_act = may_act
        self._say = say
        self._home_amsl_m = home_amsl_m
        self._memory = memory
        self._doubt: _Doubt | None = None
        self._is_exchanging = False
        self._suspected = ""
        self._stored: tuple[MissionItem, ...] = ()
        self._is_mixed = False
        self._identities: set[int] = set()
        self._read_s = -math.inf
        self._num_read = 0
        self._lasted_s: deque[float] = deque(maxlen=EXCHANGES_KEPT)
        self._said_landing = False
        self._outside_s: float | None = None

    # --- what is known of the list

    @property
    def num_items(self) -> int:
        """Length of the list, as far as it is known."""
        return NUM_ITEMS_UNKNOWN if self.layout is None else self.layout.num_items

    @property
    def exchange_s(self) -> float:
        """How long a swap lasts from a plan to its entry, by the list's length and the last few swaps [s]."""
        expected = ITEM_S * self.num_items + EXCHANGE_EXTRA_S
        return min(EXCHANGE_MAX_S, max(expected, MARGIN_OF_EXCHANGES * max(self._lasted_s, default=0.0)))

    def _sending_s(self, mission: Mission) -> float:
        """How long a PX4 takes for a whole list [s]."""
        return min(EXCHANGE_MAX_S, max(ITEM_S * len(mission.items), max(self._lasted_s, default=0.0)))

    @property
    def room(self) -> int:
        """Most waypoints that a mission carries."""
        return BANK_ITEMS_MAX - BANK_EXTRAS if self.layout is None else self.layout.room

    @property
    def is_suspicious(self) -> bool:
        """Whether something was heard that another uploader would explain."""
        return bool(self._suspected)

    @property
    def suspected(self) -> str:
        """What was heard that another uploader would explain, '' if nothing."""
        return self._suspected

    @property
    def place(self) -> Place:
        """Where in its list the autopilot is, once it has told so for a while."""
        layout, current = self.layout, self._link.current
        if layout is None or current is None or self._outside_s is None or self._suspected:
            return Place.OURS
        if current.stamp_s - self._outside_s < OUTSIDE_S:
            return Place.OURS
        tail = layout.tail_span
        return Place.PAST_GOAL if tail[0] <= current.sequence < tail[1] else Place.ELSEWHERE

    def _watch_index(self, event: MissionCurrent) -> None:
        """Note since when the autopilot is at an item that is none of the part flown."""
        layout = self.layout
        if layout is None or self._cycle.flown is None or self._doubt is not None:
            self._outside_s = None
            return
        first, end = layout.flown_span
        if first <= event.sequence < end:
            self._outside_s = None
        elif self._outside_s is None:
            self._outside_s = event.stamp_s

    def note(self, event: Event) -> None:
        """Watch for missions that we did not send."""
        if self._is_exchanging or self.layout is None:
            self._outside_s = None
            return
        if isinstance(event, MissionCurrent):
            self._watch_index(event)
        if isinstance(event, StatusText) and event.text.startswith(RECEIVED):
            self._suspected = event.text
        elif isinstance(event, MissionCurrent):
            if event.mission_id:
                if self._identities and event.mission_id not in self._identities:
                    self._suspected = f"mission {event.mission_id:08x}"
            elif self._doubt is None and not self._is_mixed and event.total is not None:
                expected = len(self._stored) - (1 if self._link.dialect is Dialect.ARDUPILOT else 0)
                if event.total != expected:
                    self._suspected = f"{event.total} items"

    async def prepare(self) -> Reading:
        """Read the autopilot's list if it is not known, or may have been changed by somebody else."""
        if self.layout is not None and not self._suspected:
            return Reading.OURS
        try:
            read = await self._read()
        except CompanionError as error:
            self._say("rejected", f"the autopilot's mission cannot be read: {error}")
            return Reading.UNREADABLE
        is_first = self.layout is None
        if not is_first and self._is_as_left(read):
            self._suspected = ""
            self._note_identity()
            return Reading.OURS
        self._adopt(read)
        span = self._flown_span_in(read)
        if is_first and span is not None:
            self.found_flown = True
            if isinstance(self.layout, Whole):
                self.layout = replace(self.layout, flown=read[slice(*span)])
            self._recover(read, span)
        return Reading.OURS if is_first else Reading.FOREIGN

    async def _read(self) -> tuple[MissionItem, ...]:
        """The autopilot's list; quickly where it is known to be an ArduPlane's."""
        is_bank = isinstance(self.layout, Banks)
        read = await (self._link.read_back() if is_bank else self._link.download())
        self._read_s, self._num_read = self._clock.now_s(), len(read)
        return read

    def _flown_span_in(self, read: tuple[MissionItem, ...]) -> tuple[int, int] | None:
        """Where ours lie in a list as read, if the item being flown is one of them."""
        current, span = self._link.current, None
        if self._link.dialect is Dialect.PX4:
            span = span_in(read)
        elif banks_in(read) is not None and self.layout is not None:
            span = self.layout.flown_span
        if current is None or span is None or not span[0] <= current.sequence < span[1]:
            return None
        return span

    def _recover(self, read: tuple[MissionItem, ...], span: tuple[int, int]) -> None:
        """Take up the path of a mission that the autopilot flies since before a restart."""
        kept, state = self._memory.flown(key_of(read[slice(*span)])), self._state()
        if kept is None or state is None:
            return
        path, until_s = kept
        row = progress_on(path, state.position_enu_m).row
        self._cycle.flown = Flown(path, Mission(read, span[0], 0), until_s, row)

    def adopt(self, mission: MissionConfig) -> None:
        """Go by another mission file from now on; with other goals the list is laid out anew."""
        if mission.goals != self._mission.goals:
            self.layout = None
        self._mission = mission

    def forget(self) -> None:
        """Read the list anew before it is written to again: others may have used the pause."""
        if self._doubt is None:
            self._suspected = self._suspected or "a pause"

    def _note_identity(self) -> None:
        if self._link.current is not None and self._link.current.mission_id:
            self._identities.add(self._link.current.mission_id)

    def _adopt(self, read: tuple[MissionItem, ...]) -> None:
        """Take a list as the operator's, but for what in it is ours."""
        dialect = self._link.dialect or Dialect.ARDUPILOT
        frame, home = self._mission.frame, self._home_amsl_m()
        goals = self._mission.goals
        place = None
        if goals:
            last = goals[-1]
            place = float(last.east_m), float(last.north_m), float(last.acceptance_radius_m)
        self.operator = operator_of(without_ours(read, dialect), frame, home, place)
        current = self._link.current
        sequence = current.sequence if current is not None else 0
        self.layout = layout_of(read, dialect, self.operator, sequence, 0)
        self._stored, self._is_mixed, self._suspected, self._doubt = read, False, "", None
        self._identities = {mission_id(read)}
        self._note_identity()
        self._cycle.flown = None
        if self._mission.goals_from_autopilot:
            has_home = dialect is Dialect.ARDUPILOT
            self._cycle.set_goals(goals_of_operator(self.operator, frame, home, has_home_slot=has_home))
        self._cycle.tail_enu_m = self._tail_position(home)
        if dialect is Dialect.PX4 and not self.operator.has_landing and not self._said_landing:
            self._said_landing = True
            self._say("landing", "no landing in the autopilot's mission")

    def _tail_position(self, home_amsl_m: float | None) -> tuple[float, float, float] | None:
        """Where the operator goes on after the goal; None where that is not known."""
        if self.operator is None:
            return None
        for item in self.operator.items[self.operator.tail :]:
            place = position_of(item, self._mission.frame, home_amsl_m)
            if place is not None:
                return place
        return None

    def _is_as_left(self, read: tuple[MissionItem, ...]) -> bool:
        """Whether a list is what we left: exactly, or after a broken upload in the parts that count."""
        layout = self.layout
        if layout is None:
            return False
        if not self._is_mixed:
            return not difference(self._stored, read)
        first, end = layout.flown_span
        kept = len(self.operator.items) if self.operator is not None else 0
        is_whole = not difference(self._stored[:kept], read[:kept])
        if layout.flown is None:
            return is_whole
        return is_whole and not difference(self._stored[first - 1 : end], read[first - 1 : end])

    # --- swapping

    def is_settled(self) -> bool:
        """Whether it is known what is flown; takes it from the autopilot where an answer was lost.

        An entry that was asked for and not acknowledged may well be flown: to write there would change
        the mission under the aircraft.
        """
        doubt, current = self._doubt, self._link.current
        if doubt is None:
            return True
        if current is None or current.stamp_s <= doubt.asked_s + UNDER_WAY_S:
            return False
        self._doubt = None
        if current.mission_id:
            is_flown = current.mission_id == doubt.identity
        else:
            first, end = doubt.layout.flown_span
            is_flown = first <= current.sequence < end
        if is_flown:
            self._take(doubt.layout, doubt.flown)
            self._say("swap", f"entered at item {current.sequence}, though unanswered")
        return True

    def _take(self, layout: Layout, flown: Flown) -> None:
        """Count a mission as flown."""
        self.layout, self._cycle.flown = layout, flown
        self._stored, self._is_mixed = flown.mission.items, False
        self._identities = {mission_id(flown.mission.items)}
        self._note_identity()
        ours = flown.mission.items[slice(*layout.flown_span)]
        self._memory.note_flown(key_of(ours), flown.path, flown.carried_until_s)

    async def swap(
        self, path: Path, waypoints: Waypoints, carried_s: float, enter_s: float
    ) -> tuple[SwapOutcome, str]:
        """Store a mission and enter it at an instant; broken off, what was flown stays whole."""
        layout = self.layout
        if layout is None:
            return SwapOutcome.REFUSED, "the autopilot's mission is not known"
        mission, after = self._cycle.mission_for(waypoints, layout)
        self.offered = mission
        flown = Flown(path, mission, carried_s)
        identity = mission_id(mission.items)
        self._is_exchanging = True
        try:
            if self._link.dialect is Dialect.PX4:
                outcome, reason = await self._swap_whole(enter_s, waypoints, after, flown, identity)
            else:
                outcome, reason = await self._swap_bank(enter_s, waypoints, after, flown)
        finally:
            self._is_exchanging = False
            if self._doubt is not None:  # broken off or not, nothing was asked after this
                self._doubt = replace(self._doubt, asked_s=self._clock.now_s())
        if outcome is SwapOutcome.FLOWN:
            self._doubt = None
            self._take(after, flown)
        elif outcome in (SwapOutcome.STALE, SwapOutcome.FOREIGN):
            self._doubt = None
        return outcome, reason

    async def _swap_bank(
        self, enter_s: float, waypoints: Waypoints, after: Layout, flown: Flown
    ) -> tuple[SwapOutcome, str]:
        """ArduPlane: write to the idle bank, read it back, and go there."""
        mission, current, begun_s = flown.mission, self._link.current, self._clock.now_s()
        first, end = after.flown_span
        if current is not None and first <= current.sequence < end:
            return SwapOutcome.REFUSED, f"item {current.sequence} is flown, in the bank to be written"
        if begun_s - self._read_s > FRESH_S:
            try:
                read = await self._read()
            except CompanionError as error:
                return SwapOutcome.REFUSED, str(error)
            if not self._is_as_left(read):
                self._suspected = self._suspected or "another list"
                return SwapOutcome.FOREIGN, "somebody else has uploaded a mission"
        self._is_mixed = True
        # Of a list as long as this one, as it was found, only the idle bank is to be changed.
        part = slice(first, end) if self._num_read == len(mission.items) else None
        outcome, reason = await store(self._link, mission, part)
        if outcome is not None:
            return outcome, reason
        self._lasted_s.append(self._clock.now_s() - begun_s)
        self._stored, self._is_mixed, self._suspected = mission.items, False, ""
        self._num_read = len(mission.items)
        await self._clock.sleep_until(enter_s)
        self._doubt = _Doubt(self._clock.now_s(), after, flown, waypoints, 0)
        return await enter(
            self._link, mission, lambda: self._entry(mission, flown.path, waypoints, 0.0), self._may_act
        )

    async def _swap_whole(
        self, enter_s: float, waypoints: Waypoints, after: Layout, flown: Flown, identity: int
    ) -> tuple[SwapOutcome, str]:
        """PX4: the upload is the entry, so it begins when the aircraft is nearly there."""
        mission = flown.mission
        lasts_s = self._sending_s(mission)
        await self._clock.sleep_until(enter_s - lasts_s)
        if self._suspected:
            return SwapOutcome.FOREIGN, "somebody else has uploaded a mission"
        self._doubt = _Doubt(self._clock.now_s(), after, flown, waypoints, identity)
        begun_s = asked_s = self._clock.now_s()

        def entry() -> int | None:
            nonlocal asked_s
            asked_s = self._clock.now_s()  # for the last time before the last item leaves
            left_s = max(0.0, begun_s + lasts_s - asked_s)
            return self._entry(mission, flown.path, waypoints, left_s)

        self._identities.add(identity)
        outcome, reason = await replace_whole(self._link, mission, entry, self._may_act)
        if outcome is SwapOutcome.FLOWN or asked_s - begun_s > lasts_s:
            self._lasted_s.append(asked_s - begun_s)
        if outcome in (SwapOutcome.REFUSED, SwapOutcome.DIFFERS, SwapOutcome.WITHDRAWN):
            # Whether it is flown is told by the next MISSION_CURRENT.
            self._doubt = _Doubt(self._clock.now_s(), after, flown, waypoints, identity)
        return outcome, reason

    def _entry(self, mission: Mission, path: Path, waypoints: Waypoints, in_s: float) -> int | None:
        """Sequence at which a mission is entered from where the aircraft is, so many seconds from now."""
        state = self._state()
        first = None if state is None else self._cycle.entry(state, path, waypoints, in_s)
        return None if first is None else sequence_of_waypoint(mission, first)
