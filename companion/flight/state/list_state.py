"""Knowledge of the autopilot's mission list: whose it is, what is flown, and the last request.

A frozen value, and functions that return the next one. Nothing here waits or talks to the autopilot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

from companion.mission.item_difference import difference
from companion.mission.list_layout import BANK_EXTRAS, BANK_ITEMS, Layout, TwoBankLayout
from companion.mission.mission_id import mission_id
from companion.mission.operator import Operator
from companion.mission.waypoints import Waypoints
from companion.types.events import MissionCurrent
from companion.types.mission import Mission, MissionItem
from companion.types.path import Path

NUM_ITEMS_UNKNOWN = 40  # The assumed length of a list that was not read yet.
UPLOAD_ENDED_TEXT = "Flight plan received"  # ArduPlane's text when an upload has ended.
OUTSIDE_MIN_S = 1.5  # After this time at another item, the report is not a late one from before a swap.
# For this time a command may still take effect, and an older report may still arrive.
COMMAND_DELAY_MAX_S = 4.0
# Time per item of a list: half of the items are written, one in 20 ms; all are read twice, several at once.
ITEM_S = 0.02
EXCHANGE_EXTRA_S = 0.5  # Time of an exchange apart from its items.
EXCHANGE_MIN_S = 0.3  # An exchange is not expected to be shorter.
EXCHANGE_MAX_S = 12.0  # An exchange is not expected to be longer: what is farther ahead is flown by then.
EXCHANGES_KEPT = 3  # The last few exchanges determine the expected duration.
EXCHANGE_MARGIN = 1.3  # The expected duration is the longest of these by this factor.


class MissionPosition(Enum):
    """The autopilot's position in its list."""

    OURS = "in ours, or not known to be elsewhere"
    PAST_GOAL = "in the operator's items that follow the goal"
    ELSEWHERE = "at an item that we did not choose"
    RETURNING = "on the return path"


@dataclass(frozen=True, slots=True)
class FlownPath:
    """The flown path, and the mission that was made of it.

    Parameters
    ----------
    path : Path
        The whole path, including the part behind the aircraft.
    mission : Mission
        The uploaded list.
    covered_until_s : float
        The path's time at the end of the part that the mission covers [s].
    row : int
        The last row of the path that the aircraft has passed.
    cost : float
        The path's cost when it was chosen; infinite if not known.
    """

    path: Path
    mission: Mission
    covered_until_s: float
    row: int = 0
    cost: float = math.inf

    def covered_s(self, row: int) -> float:
        """Return how long the mission continues from a row of the path [s]; infinite to its end."""
        if self.covered_until_s >= self.path.times_s[-1]:
            return math.inf
        return self.covered_until_s - float(self.path.times_s[row])


@dataclass(frozen=True, slots=True)
class PendingSwap:
    """A mission whose entry was requested and not confirmed.

    Parameters
    ----------
    asked_s : float
        Time of the last request, by the clock [s].
    layout : Layout
        The list's layout once the mission is flown.
    flown : FlownPath
        Path and mission once the mission is flown.
    waypoints : Waypoints
        The mission's waypoints.
    identity : int
        PX4's identifier of the mission; 0 on ArduPlane.
    """

    asked_s: float
    layout: Layout
    flown: FlownPath
    waypoints: Waypoints
    identity: int


@dataclass(frozen=True, slots=True)
class ListState:
    """The knowledge of the autopilot's mission list.

    Parameters
    ----------
    layout : Layout or None
        The list's layout; None before the list was read.
    operator : Operator or None
        The operator's part of the list.
    stored : tuple of MissionItem
        The whole list as it was last read or sent.
    is_mixed : bool
        Whether an upload was begun and not completed: the idle part may contain anything.
    suspected : str
        An observation that another uploader would explain, '' if there is none.
    identities : frozenset of int
        PX4's identifiers of known missions.
    pending : PendingSwap or None
        The request that is not confirmed.
    outside_s : float or None
        Since when the autopilot has been at an item outside the flown part [s].
    is_exchanging : bool
        Whether a swap is under way.
    waits_until_s : float
        Until when the swap under way waits for the aircraft [s]; not finite if it does not wait.
    unwanted : str
        Why the waiting mission is no longer wanted, '' if it is wanted.
    was_found_flown : bool
        Whether the autopilot was flying a mission of the service when its list was first read: the service
        was restarted in flight.
    landing_reported : bool
        Whether the pilot was informed that the mission has no landing.
    home_amsl_m : float or None
        Height of home, from which relative altitudes count, when the list was adopted [m].
    read_s : float
        When the list was last read [s].
    num_read : int
        Number of items read then.
    durations_s : tuple of float
        Durations of the last few exchanges [s].
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
    was_found_flown: bool = False
    landing_reported: bool = False
    home_amsl_m: float | None = None
    read_s: float = -math.inf
    num_read: int = 0
    durations_s: tuple[float, ...] = ()

    @property
    def num_items(self) -> int:
        """Length of the list, or an assumed one."""
        return NUM_ITEMS_UNKNOWN if self.layout is None else self.layout.num_items

    @property
    def max_waypoints(self) -> int:
        """Largest number of waypoints of a mission."""
        return BANK_ITEMS - BANK_EXTRAS if self.layout is None else self.layout.max_waypoints

    @property
    def exchange_s(self) -> float:
        """Expected time from a plan to its entry, by the last exchanges or the list's length [s]."""
        if not self.durations_s:
            return min(EXCHANGE_MAX_S, ITEM_S * self.num_items + EXCHANGE_EXTRA_S)
        return min(EXCHANGE_MAX_S, max(EXCHANGE_MIN_S, EXCHANGE_MARGIN * max(self.durations_s)))

    def sending_s(self, mission: Mission) -> float:
        """Return the time that a PX4 takes for a whole list [s]."""
        return min(EXCHANGE_MAX_S, max(ITEM_S * len(mission.items), max(self.durations_s, default=0.0)))

    def position(self, current: MissionCurrent | None) -> MissionPosition:
        """Return where in its list the autopilot is, once it has reported so for a while."""
        if self.layout is None or current is None:
            return MissionPosition.OURS
        first, end = self.layout.return_span
        if first <= current.sequence < end:  # No late report of a swap leads there.
            return MissionPosition.RETURNING
        if self.outside_s is None or self.suspected:
            return MissionPosition.OURS
        if current.stamp_s - self.outside_s < OUTSIDE_MIN_S:
            return MissionPosition.OURS
        tail = self.layout.tail_span
        is_past = tail[0] <= current.sequence < tail[1]
        return MissionPosition.PAST_GOAL if is_past else MissionPosition.ELSEWHERE

    @property
    def num_returns(self) -> int:
        """Number of items of return banks at the end of the list as stored; no mission leads there."""
        layout = self.layout
        has_returns = layout is not None and not self.is_mixed and len(self.stored) == layout.num_items
        return len(self.stored) - layout.return_span[0] if layout is not None and has_returns else 0

    def is_as_left(self, read: tuple[MissionItem, ...], num_left_out: int = 0) -> bool:
        """Return whether a list is as the service left it; after a broken upload, in the parts that count.

        Parameters
        ----------
        read : tuple of MissionItem
            The list as read.
        num_left_out : int
            Number of items at its end that were not read.
        """
        layout = self.layout
        if layout is None:
            return False
        if not self.is_mixed:
            kept = len(self.stored) - self.num_returns
            is_as_long = len(read) + num_left_out == len(self.stored)
            return is_as_long and not difference(self.stored[:kept], read[:kept])
        first, end = layout.flown_span
        kept = len(self.operator.items) if self.operator is not None else 0
        is_whole = not difference(self.stored[:kept], read[:kept])
        if layout.flown is None:
            return is_whole
        return is_whole and not difference(self.stored[first - 1 : end], read[first - 1 : end])

    def has_settled(self, current: MissionCurrent | None) -> bool:
        """Return whether a request without an answer has either taken effect by now, or never will."""
        if self.pending is None:
            return True
        if current is None:
            return False
        is_named = bool(current.mission_id) and self.is_pending_flown(current)
        return is_named or current.stamp_s > self.pending.asked_s + COMMAND_DELAY_MAX_S

    def is_pending_flown(self, current: MissionCurrent) -> bool:
        """Return whether the autopilot reports that it flies the mission of a request without an answer."""
        if self.pending is None:
            return False
        if current.mission_id:
            return current.mission_id == self.pending.identity
        first, end = self.pending.layout.flown_span
        return first <= current.sequence < end


def _with_reported(identities: frozenset[int], current: MissionCurrent | None) -> frozenset[int]:
    """Return identifiers including the one that the autopilot reports now."""
    return identities | {current.mission_id} if current is not None and current.mission_id else identities


def after_current_reported(
    listed: ListState, event: MissionCurrent, *, is_flying_ours: bool, num_home_items: int
) -> ListState:
    """Return the list after the autopilot reported its mission and the item that it flies to.

    Parameters
    ----------
    listed : ListState
        The list before.
    event : MissionCurrent
        The report.
    is_flying_ours : bool
        Whether a path of the service is flown.
    num_home_items : int
        Number of items that the autopilot does not count: ArduPlane's home slot.
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
    """Return what in a report is not the service's: identifier or number of items; '' if nothing."""
    if event.mission_id:
        is_known = not listed.identities or event.mission_id in listed.identities
        return "" if is_known else f"mission {event.mission_id:08x}"
    if listed.pending is not None or listed.is_mixed or event.total is None:
        return ""
    return "" if event.total == len(listed.stored) - num_home_items else f"{event.total} items"


def after_text_reported(listed: ListState, text: str) -> ListState:
    """Return the list after a text of the autopilot: ArduPlane announces the end of every upload."""
    if listed.is_exchanging or listed.layout is None:
        return replace(listed, outside_s=None)
    return replace(listed, suspected=text) if text.startswith(UPLOAD_ENDED_TEXT) else listed


def after_pause(listed: ListState) -> ListState:
    """Return the list after a pause that others may have used: it is read again before the next swap."""
    if listed.pending is not None:
        return listed
    return replace(listed, suspected=listed.suspected or "a pause")


def after_reading(listed: ListState, now_s: float, num_items: int) -> ListState:
    """Return the list after it was read, whatever the result."""
    return replace(listed, read_s=now_s, num_read=num_items)


def after_found_as_left(listed: ListState, current: MissionCurrent | None) -> ListState:
    """Return the list after it was found unchanged."""
    return replace(listed, suspected="", identities=_with_reported(listed.identities, current))


def after_adopted(
    listed: ListState,
    read: tuple[MissionItem, ...],
    layout: Layout,
    operator: Operator,
    current: MissionCurrent | None,
    home_amsl_m: float | None = None,
) -> ListState:
    """Return the list after it was adopted as the operator's, apart from the service's items."""
    return replace(
        listed, layout=layout, operator=operator, stored=read, is_mixed=False, suspected="", pending=None,
        home_amsl_m=home_amsl_m,
        identities=_with_reported(frozenset({mission_id(read)}), current),
    )  # fmt: skip


def after_found_flown(listed: ListState, layout: Layout) -> ListState:
    """Return the list after the service's items were found to be flown since before a restart."""
    return replace(listed, was_found_flown=True, layout=layout)


def after_suspicion(listed: ListState, what: str) -> ListState:
    """Return the list after an observation that another uploader would explain."""
    return replace(listed, suspected=listed.suspected or what)


def after_landing_missed(listed: ListState) -> ListState:
    """Return the list after the pilot was informed that it has no landing."""
    return replace(listed, landing_reported=True)


def after_swap_begun(listed: ListState) -> ListState:
    """Return the list while a swap is under way."""
    return replace(listed, is_exchanging=True, unwanted="")


def after_waiting(listed: ListState, until_s: float) -> ListState:
    """Return the list while a swap waits until a time; if that is not finite, it no longer waits."""
    return replace(listed, waits_until_s=until_s)


def after_unwanted(listed: ListState, why: str) -> ListState:
    """Return the list when the waiting mission is no longer wanted."""
    return replace(listed, unwanted=why)


def after_swap_ended(listed: ListState, now_s: float) -> ListState:
    """Return the list after a swap, completed or not: nothing is requested after this time."""
    pending = None if listed.pending is None else replace(listed.pending, asked_s=now_s)
    return replace(listed, is_exchanging=False, waits_until_s=-math.inf, pending=pending)


def after_writing_begun(listed: ListState) -> ListState:
    """Return the list while the idle bank may contain anything."""
    return replace(listed, is_mixed=True)


def after_stored(listed: ListState, items: tuple[MissionItem, ...], durations_s: float) -> ListState:
    """Return the list after it was read back as sent."""
    return replace(
        after_exchange(listed, durations_s), stored=items, is_mixed=False, suspected="", num_read=len(items)
    )


def after_written(listed: ListState, items: tuple[MissionItem, ...]) -> ListState:
    """Return the list after items of the return banks were written, or added at its end."""
    first = items[0].sequence
    stored = (*listed.stored[:first], *items, *listed.stored[first + len(items) :])
    layout = listed.layout
    if isinstance(layout, TwoBankLayout):
        layout = replace(layout, returns=stored[layout.return_span[0] :])
    return replace(listed, stored=stored, layout=layout, num_read=len(stored), is_mixed=False)


def after_exchange(listed: ListState, durations_s: float) -> ListState:
    """Return the list after an exchange of some duration [s]."""
    return replace(listed, durations_s=(*listed.durations_s, durations_s)[-EXCHANGES_KEPT:])


def after_asked(listed: ListState, pending: PendingSwap) -> ListState:
    """Return the list after the entry of a mission was requested."""
    identities = listed.identities | {pending.identity} if pending.identity else listed.identities
    return replace(listed, pending=pending, identities=identities)


def after_settled(listed: ListState) -> ListState:
    """Return the list once the result of a swap is known."""
    return replace(listed, pending=None)


def after_taken(
    listed: ListState, layout: Layout, items: tuple[MissionItem, ...], current: MissionCurrent | None
) -> ListState:
    """Return the list once a mission in it is flown."""
    return replace(
        listed, layout=layout, stored=items, is_mixed=False,
        identities=_with_reported(frozenset({mission_id(items)}), current),
    )  # fmt: skip


def after_other_goals(listed: ListState) -> ListState:
    """Return the list when the goals change: it is read and laid out again."""
    return replace(listed, layout=None)


def after_landing(listed: ListState) -> ListState:
    """Return the list after a landing: only the durations of exchanges stay known."""
    return ListState(durations_s=listed.durations_s)
