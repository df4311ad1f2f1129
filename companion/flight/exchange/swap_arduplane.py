"""The swap on ArduPlane: into the idle bank, read back, and entered by a command.

ArduPlane acknowledges an upload it then stores differently, and goes on with the item it has cached
(measured): only reading back proves what is stored, and only DO_SET_MISSION_CURRENT makes it fly.
"""

from __future__ import annotations

from dataclasses import replace

from companion.errors import CompanionError, LinkError
from companion.flight.exchange.swap_protocol import Entry, SwapOrder, SwapParts
from companion.flight.state.list_state import (
    ListState,
    after_asked,
    after_stored,
    after_suspicion,
    after_writing_begun,
)
from companion.mission.item_difference import difference
from companion.mission.list_layout import Layout, two_bank_layout_of
from companion.mission.operator import Operator, banks_in, without_banks
from companion.mission.swap import NO_SAFE_ENTRY, MissionLink, SwapOutcome, enter
from companion.types.mission import Mission, MissionItem

LATE_S = 2.0  # that a jump asked for again may be late: a link that does not answer may be a slow one
FRESH_S = 2.0  # a list read so lately is not read again before it is written to


class ArduPlaneSwap:
    """See :class:`companion.flight.exchange.swap_protocol.SwapProtocol`.

    Parameters
    ----------
    parts : SwapParts
        What it works with.
    """

    wants_landing = False

    def __init__(self, parts: SwapParts) -> None:
        self._parts = parts

    def without_ours(self, read: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
        """The operator's items in a list as read."""
        return without_banks(read)

    def layout_of(self, read: tuple[MissionItem, ...], operator: Operator, current: int) -> Layout:
        """Two banks behind the operator's items."""
        return two_bank_layout_of(read, operator, current)

    def span_of_ours(self, read: tuple[MissionItem, ...], layout: Layout) -> tuple[int, int] | None:
        """The bank that is not written to next."""
        return None if banks_in(read) is None else layout.flown_span

    def layout_as_flown(self, layout: Layout, _ours: tuple[MissionItem, ...], /) -> Layout:
        """As it is: the layout was read with the flown bank in it."""
        return layout

    async def carry_out(self, order: SwapOrder) -> tuple[SwapOutcome, str]:
        """Write to the idle bank, read it back, and go there."""
        flight, link, clock = self._parts.flight, self._parts.link, self._parts.clock
        mission, current, begun_s = order.flown.mission, link.current, clock.now_s()
        first, end = order.layout.flown_span
        if current is not None and first <= current.sequence < end:
            return SwapOutcome.REFUSED, f"item {current.sequence} is flown, in the bank to be written"
        if not self._parts.may_be_entered(order):
            return NO_SAFE_ENTRY
        if begun_s - flight.listed.read_s > FRESH_S:
            try:
                read = await self._parts.read()
            except CompanionError as error:
                return SwapOutcome.REFUSED, str(error)
            if not flight.listed.is_as_left(read):
                flight.apply_to_list(after_suspicion, "another list")
                return SwapOutcome.FOREIGN, "somebody else has uploaded a mission"
        part = _part_to_write(flight.listed, mission, slice(first, end))
        flight.apply_to_list(after_writing_begun)
        outcome, reason = await store(link, mission, part)
        if outcome is not None:
            return outcome, reason
        flight.apply_to_list(after_stored, mission.items, clock.now_s() - begun_s)
        await self._parts.until_due(order)
        flight.apply_to_list(after_asked, order.pending(clock.now_s(), 0))
        entry = Entry(self._parts, order, late_s=LATE_S)
        return await enter(link, mission, entry.sequence, self._parts.may_act)


def _part_to_write(listed: ListState, mission: Mission, bank: slice) -> slice | None:
    """What is written of a list that was found as it was left; None for all of one of another length.

    Of the idle bank only what differs is written: an ArduPlane takes 20 ms an item. Before a first mission
    neither bank is known.
    """
    is_first = listed.layout is None or listed.layout.flown is None
    if is_first or listed.num_read != len(mission.items):
        return None
    if listed.is_mixed:
        return bank
    stored, items = listed.stored[bank], mission.items[bank]
    is_new = [replace(old, is_current=new.is_current) != new for old, new in zip(stored, items, strict=True)]
    differing = [bank.start + number for number, differs in enumerate(is_new) if differs] or [bank.start]
    return slice(differing[0], differing[-1] + 1)


async def store(
    link: MissionLink, mission: Mission, part: slice | None = None
) -> tuple[SwapOutcome | None, str]:
    """Send a list to an ArduPlane and read it back; None and '' when it is stored as it should be.

    Parameters
    ----------
    link : MissionLink
        To the autopilot.
    mission : Mission
        The whole list.
    part : slice, optional
        Which of its items are sent, the rest being stored already; left out, all.
    """
    reason = ""
    try:
        if part is None:
            await link.upload(mission.items)
        else:
            await link.write(mission.items[part])
    except LinkError as error:
        reason = str(error)  # of a lost last acknowledgement, too: reading back decides what is stored
    try:
        differs = difference(mission.items, await link.read_back())
    except LinkError as error:
        return SwapOutcome.REFUSED, "; ".join(filter(None, (reason, str(error))))
    if not differs:
        return None, ""
    return (SwapOutcome.REFUSED, reason) if reason else (SwapOutcome.DIFFERS, differs)
