"""What is known of the autopilot's mission list: whose it is, what in it is flown, and what was asked last.

A frozen value and the functions that make the next one. Nothing here waits or speaks to the autopilot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

from companion.mission.item_difference import difference
from companion.mission.list_layout import BANK_EXTRAS, BANK_ITEMS_MAX, Layout
from companion.mission.mission_id import mission_id
from companion.mission.operator import Operator
from companion.mission.waypoints import Waypoints
from companion.types.events import MissionCurrent
from companion.types.mission import Mission, MissionItem
from companion.types.path import Path

NUM_ITEMS_UNKNOWN = 40
RECEIVED = "Flight plan received"
OUTSIDE_S = 1.5  # at another item for so long, it is no report from before a swap that came late
UNDER_WAY_S = 4.0  # a command may still take effect, and a report from before still arrive, for so long
ITEM_S = 0.02  # for each of a list's: half are written, one in 20 ms, all are read twice, several at once
EXCHANGE_EXTRA_S = 0.5
EXCHANGE_MIN_S = 0.3
EXCHANGE_MAX_S = 12.0  # believed at most: what is further ahead is flown by then
EXCHANGES_KEPT = 3
MARGIN_OF_EXCHANGES = 1.3


class MissionPosition(Enum):
    """Where in its list the autopilot is."""

    OURS = "in ours, or not known to be elsewhere"
    PAST_GOAL = "in the operator's items that follow the goal"
    ELSEWHERE = "at an item that we did not choose"


@dataclass(frozen=True, slots=True)
class FlownPath:
    """The path being flown, and the mission that carries it.

    Parameters
    ----------
    path : Path
        The whole path, also behind the aircraft.
    mission : Mission
        The list that was uploaded for it.
    covered_until_s : float
        The path's time at the end of what the mission carries [s].
    row : int
        The path's row that the aircraft has passed last.
    cost : float
        What it was to cost when it was chosen; infinite where that is not known.
    """

    path: Path
    mission: Mission
    covered_until_s: float
    row: int = 0
    cost: float = math.inf

    def carried_s(self, row: int) -> float:
        """How long the mission carries on from a row of the path [s]; endless where it does to its end."""
        if self.covered_until_s >= self.path.times_s[-1]:
            return math.inf
        return self.covered_until_s - float(self.path.times_s[row])


@dataclass(frozen=True, slots=True)
class PendingSwap:
    """A mission that was asked to be flown, and for all we know only asked.

    Parameters
    ----------
    asked_s : float
        When it was asked last, by the clock [s].
    layout : Layout
        The list's once it is flown.
    flown : FlownPath
        What is flown then.
    waypoints : Waypoints
        What the mission carries out.
    identity : int
        The name that a PX4 gives it; 0 on ArduPlane.
    """

    asked_s: float
    layout: Layout
    flown: FlownPath
    waypoints: Waypoints
    identity: int


@dataclass(frozen=True, slots=True)
class ListState:
    """The autopilot's mission list as far as it is known.

    Parameters
    ----------
    layout : Layout or None
        How the list is laid out, None before it was read.
    operator : Operator or None
        What in it is the operator's.
    stored : tuple of MissionItem
        The whole list as it was read or sent last.
    is_mixed : bool
        Whether an upload was begun and not seen to end: the idle part may hold anything.
    suspected : str
        What was heard that another uploader would explain, '' if nothing.
    identities : frozenset of int
        Names under which a PX4 tells missions that are known to us.
    pending : PendingSwap or None
        What was asked and not answered.
    outside_s : float or None
        Since when the autopilot has been at an item that is none of the part flown [s].
    is_exchanging : bool
        Whether a swap is under way.
    waits_until_s : float
        When the swap that is under way goes on, where it waits for the aircraft; else not finite [s].
    unwanted : str
        Why nobody wants the mission that waits any more, '' if it is wanted.
    found_flown : bool
        Whether the autopilot was flying a mission of ours when its list was first read: the service was
        restarted in flight.
    said_landing : bool
        Whether the pilot was told that there is no landing in the mission.
    home_amsl_m : float or None
        Height that relative altitudes count from, when it was taken [m].
    read_s : float
        When the list was read last [s].
    num_read : int
        How many items it had.
    lasted_s : tuple of float
        How long the last few exchanges took [s].
    """

    layout: Layout | None = None
    operator: Operator | None = None
    stored: tuple[MissionItem, ...] = ()
    is_mixed: bool = False
    suspected: str = ""
    identities: frozenset[int] = frozenset()
    pending: PendingSwap | None = None
    outside_s: float | None = None
    is_exchanging: bool = False
    waits_until_s: float = -math.inf
    unwanted: str = ""
    found_flown: bool = False
    said_landing: bool = False
    home_amsl_m: float | None = None
    read_s: float = -math.inf
    num_read: int = 0
    lasted_s: tuple[float, ...] = ()

    @property
    def num_items(self) -> int:
        """Length of the list, as far as it is known."""
        return NUM_ITEMS_UNKNOWN if self.layout is None else self.layout.num_items

    @property
    def max_waypoints(self) -> int:
        """Most waypoints that a mission carries."""
        return BANK_ITEMS_MAX - BANK_EXTRAS if self.layout is None else self.layout.max_waypoints

    @property
    def exchange_s(self) -> float:
        """How long a swap lasts from a plan to its entry, by the last few swaps, or the list's length [s]."""
        if not self.lasted_s:
            return min(EXCHANGE_MAX_S, ITEM_S * self.num_items + EXCHANGE_EXTRA_S)
        return min(EXCHANGE_MAX_S, max(EXCHANGE_MIN_S, MARGIN_OF_EXCHANGES * max(self.lasted_s)))

    def sending_s(self, mission: Mission) -> float:
        """How long a PX4 takes for a whole list [s]."""
        return min(EXCHANGE_MAX_S, max(ITEM_S * len(mission.items), max(self.lasted_s, default=0.0)))

    def position(self, current: MissionCurrent | None) -> MissionPosition:
        """Where in its list the autopilot is, once it has told so for a while."""
        if self.layout is None or current is None or self.outside_s is None or self.suspected:
            return MissionPosition.OURS
        if current.stamp_s - self.outside_s < OUTSIDE_S:
            return MissionPosition.OURS
        tail = self.layout.tail_span
        is_past = tail[0] <= current.sequence < tail[1]
        return MissionPosition.PAST_GOAL if is_past else MissionPosition.ELSEWHERE

    def is_as_left(self, read: tuple[MissionItem, ...]) -> bool:
        """Whether a list is what we left: exactly, or after a broken upload in the parts that count."""
        layout = self.layout
        if layout is None:
            return False
        if not self.is_mixed:
            return not difference(self.stored, read)
        first, end = layout.flown_span
        kept = len(self.operator.items) if self.operator is not None else 0
        is_whole = not difference(self.stored[:kept], read[:kept])
        if layout.flown is None:
            return is_whole
        return is_whole and not difference(self.stored[first - 1 : end], read[first - 1 : end])

    def has_settled(self, current: MissionCurrent | None) -> bool:
        """Whether what was asked and not answered has taken effect by now, or never will."""
        if self.pending is None:
            return True
        return current is not None and current.stamp_s > self.pending.asked_s + UNDER_WAY_S

    def is_pending_flown(self, current: MissionCurrent) -> bool:
        """Whether what was asked and not answered is what the autopilot tells that it flies."""
        if self.pending is None:
            return False
        if current.mission_id:
            return current.mission_id == self.pending.identity
        first, end = self.pending.layout.flown_span
        return first <= current.sequence < end


def _known(identities: frozenset[int], current: MissionCurrent | None) -> frozenset[int]:
    """Names with the one that the autopilot tells now."""
    return identities | {current.mission_id} if current is not None and current.mission_id else identities


def after_current_reported(
    listed: ListState, event: MissionCurrent, *, is_flying_ours: bool, num_home_items: int
) -> ListState:
    """The list after the autopilot told its mission and the item that it flies to.

    Parameters
    ----------
    listed : ListState
        The list before.
    event : MissionCurrent
        What was told.
    is_flying_ours : bool
        Whether a path of ours is being flown.
    num_home_items : int
        How many items of the list it does not count: ArduPlane's home slot.
    """
    if listed.is_exchanging or listed.layout is None:
        return replace(listed, outside_s=None)
    first, end = listed.layout.flown_span
    is_inside = not is_flying_ours or listed.pending is not None or first <= event.sequence < end
    since_s = event.stamp_s if listed.outside_s is None else listed.outside_s
    return replace(
        listed,
        outside_s=None if is_inside else since_s,
        suspected=_foreign(listed, event, num_home_items) or listed.suspected,
    )


def _foreign(listed: ListState, event: MissionCurrent, num_home_items: int) -> str:
    """What in a told mission is not ours: its name, or the number of its items; '' if nothing."""
    if event.mission_id:
        is_known = not listed.identities or event.mission_id in listed.identities
        return "" if is_known else f"mission {event.mission_id:08x}"
    if listed.pending is not None or listed.is_mixed or event.total is None:
        return ""
    return "" if event.total == len(listed.stored) - num_home_items else f"{event.total} items"


def after_text_reported(listed: ListState, text: str) -> ListState:
    """The list after a text of the autopilot's: ArduPlane tells everybody when an upload has ended."""
    if listed.is_exchanging or listed.layout is None:
        return replace(listed, outside_s=None)
    return replace(listed, suspected=text) if text.startswith(RECEIVED) else listed


def after_pause(listed: ListState) -> ListState:
    """The list after a pause that others may have used: read anew before it is written to again."""
    if listed.pending is not None:
        return listed
    return replace(listed, suspected=listed.suspected or "a pause")


def after_reading(listed: ListState, now_s: float, num_items: int) -> ListState:
    """The list after it was read, whatever was found."""
    return replace(listed, read_s=now_s, num_read=num_items)


def after_found_as_left(listed: ListState, current: MissionCurrent | None) -> ListState:
    """The list after it was found as it was left."""
    return replace(listed, suspected="", identities=_known(listed.identities, current))


def after_adopted(
    listed: ListState,
    read: tuple[MissionItem, ...],
    layout: Layout,
    operator: Operator,
    current: MissionCurrent | None,
    home_amsl_m: float | None = None,
) -> ListState:
    """The list after it was taken as the operator's, but for what in it is ours."""
    return replace(
        listed, layout=layout, operator=operator, stored=read, is_mixed=False, suspected="", pending=None,
        home_amsl_m=home_amsl_m,
        identities=_known(frozenset({mission_id(read)}), current),
    )  # fmt: skip


def after_found_flown(listed: ListState, layout: Layout) -> ListState:
    """The list after ours in it turned out to be flown since before a restart."""
    return replace(listed, found_flown=True, layout=layout)


def after_suspicion(listed: ListState, what: str) -> ListState:
    """The list after something was found that another uploader would explain."""
    return replace(listed, suspected=listed.suspected or what)


def after_landing_missed(listed: ListState) -> ListState:
    """The list after the pilot was told that it has no landing."""
    return replace(listed, said_landing=True)


def after_swap_begun(listed: ListState) -> ListState:
    """The list while a swap is under way."""
    return replace(listed, is_exchanging=True, unwanted="")


def after_waiting(listed: ListState, until_s: float) -> ListState:
    """The list while a swap waits until then; not finite: it waits no more."""
    return replace(listed, waits_until_s=until_s)


def after_unwanted(listed: ListState, why: str) -> ListState:
    """The list when nobody wants the mission that waits any more."""
    return replace(listed, unwanted=why)


def after_swap_ended(listed: ListState, now_s: float) -> ListState:
    """The list after a swap, broken off or not: nothing was asked after this."""
    pending = None if listed.pending is None else replace(listed.pending, asked_s=now_s)
    return replace(listed, is_exchanging=False, waits_until_s=-math.inf, pending=pending)


def after_writing_begun(listed: ListState) -> ListState:
    """The list while the idle bank may hold anything."""
    return replace(listed, is_mixed=True)


def after_stored(listed: ListState, items: tuple[MissionItem, ...], lasted_s: float) -> ListState:
    """The list after it was read back as it was sent."""
    return replace(
        after_exchange(listed, lasted_s), stored=items, is_mixed=False, suspected="", num_read=len(items)
    )


def after_exchange(listed: ListState, lasted_s: float) -> ListState:
    """The list after an exchange of so many seconds."""
    return replace(listed, lasted_s=(*listed.lasted_s, lasted_s)[-EXCHANGES_KEPT:])


def after_asked(listed: ListState, pending: PendingSwap) -> ListState:
    """The list after a mission was asked to be flown."""
    identities = listed.identities | {pending.identity} if pending.identity else listed.identities
    return replace(listed, pending=pending, identities=identities)


def after_settled(listed: ListState) -> ListState:
    """The list once it is known what came of a swap."""
    return replace(listed, pending=None)


def after_taken(
    listed: ListState, layout: Layout, items: tuple[MissionItem, ...], current: MissionCurrent | None
) -> ListState:
    """The list once a mission in it is flown."""
    return replace(
        listed, layout=layout, stored=items, is_mixed=False,
        identities=_known(frozenset({mission_id(items)}), current),
    )  # fmt: skip


def after_other_goals(listed: ListState) -> ListState:
    """The list where other goals are flown to: it is read and laid out anew."""
    return replace(listed, layout=None)


def after_landing(listed: ListState) -> ListState:
    """The list once the flight is over: nothing is known of it but how long exchanges take."""
    return ListState(lasted_s=listed.lasted_s)
