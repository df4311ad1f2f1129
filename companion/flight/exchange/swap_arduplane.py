"""The swap on ArduPlane: write the idle bank, read it back, and enter it by a command.

ArduPlane acknowledges an upload that it then stores differently, and continues with the item that it has
cached (measured). Only reading back proves what is stored, and only DO_SET_MISSION_CURRENT makes ArduPlane
fly it.
"""

from __future__ import annotations

from dataclasses import replace

from companion.errors import CompanionError, LinkError
from companion.flight.exchange.swap_protocol import Entry, SwapOrder, SwapProtocol
from companion.flight.state.list_state import (
    ListState,
    after_asked,
    after_stored,
    after_suspicion,
    after_writing_begun,
)
from companion.mission.item_difference import difference
from companion.mission.list_layout import (
    BANK_ITEMS,
    TEAM_BANK_ITEMS,
    Layout,
    TwoBankLayout,
    two_bank_layout_of,
    without_returns,
)
from companion.mission.operator import Operator, banks_in, without_banks
from companion.mission.swap import NO_SAFE_ENTRY, MissionLink, SwapOutcome, enter
from companion.types.mission import Mission, MissionItem

LATE_S = 2.0  # A repeated jump command may take effect this late: a silent link may be a slow one.
FRESH_S = 2.0  # A list that was read this recently is not read again before writing.


class ArduPlaneSwap(SwapProtocol):
    """See :class:`companion.flight.exchange.swap_protocol.SwapProtocol`."""

    wants_landing = False

    def without_ours(self, read: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
        """Return the operator's items in a list as read."""
        return without_banks(without_returns(read))

    def layout_of(self, read: tuple[MissionItem, ...], operator: Operator, current: int) -> Layout:
        """Return the layout: two banks behind the operator's items."""
        is_team = self._parts.flight.state.mission.team is not None
        return two_bank_layout_of(read, operator, current, TEAM_BANK_ITEMS if is_team else BANK_ITEMS)

    def span_of_ours(self, read: tuple[MissionItem, ...], layout: Layout) -> tuple[int, int] | None:
        """Return the bank that is not written next."""
        return None if banks_in(without_returns(read)) is None else layout.flown_span

    def layout_as_flown(self, layout: Layout, _ours: tuple[MissionItem, ...], /) -> Layout:
        """Return the same layout, because it was read with the flown bank in it."""
        return layout

    async def carry_out(self, order: SwapOrder) -> tuple[SwapOutcome, str]:
        """Store and enter a mission: write the idle bank, read it back, and jump to it."""
        flight, link, clock = self._parts.flight, self._parts.link, self._parts.clock
        mission, current, begun_s = order.flown.mission, link.current, clock.now_s()
        first, end = order.layout.flown_span
        if current is not None and first <= current.sequence < end:
            return SwapOutcome.REFUSED, f"item {current.sequence} is flown, in the bank to be written"
        if not self._parts.may_be_entered(order):
            return NO_SAFE_ENTRY
        if begun_s - flight.listed.read_s > FRESH_S:
            left_out = flight.listed.num_returns
            try:
                read = await self._parts.read(left_out)
            except CompanionError as error:
                return SwapOutcome.REFUSED, str(error)
            if not flight.listed.is_as_left(read, left_out):
                flight.apply_to_list(after_suspicion, "another list")
                return SwapOutcome.FOREIGN, "somebody else has uploaded a mission"
        part = _part_to_write(flight.listed, mission, slice(first, end))
        flight.apply_to_list(after_writing_begun)
        num_returns = len(order.layout.returns) if isinstance(order.layout, TwoBankLayout) else 0
        outcome, reason = await store(link, mission, part, num_returns=num_returns)
        if outcome is not None:
            return outcome, reason
        flight.apply_to_list(after_stored, mission.items, clock.now_s() - begun_s)
        await self._parts.until_due(order)
        flight.apply_to_list(after_asked, order.pending(clock.now_s(), 0))
        entry = Entry(self._parts, order, late_s=LATE_S)
        return await enter(link, mission, entry.sequence, self._parts.may_act)


def _part_to_write(listed: ListState, mission: Mission, bank: slice) -> slice | None:
    """Return the part of an unchanged list that is written; None for the whole list.

    In the idle bank only items that differ are written, because an ArduPlane takes 20 ms per item. The whole
    list is written if its length changes, or before the first mission, when neither bank is known.
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
    link: MissionLink, mission: Mission, part: slice | None = None, *, num_returns: int = 0
) -> tuple[SwapOutcome | None, str]:
    """Send a list to an ArduPlane and read it back; return None and '' if it is stored correctly.

    Parameters
    ----------
    link : MissionLink
        The link to the autopilot.
    mission : Mission
        The whole list.
    part : slice, optional
        The items that are sent, the others being stored already; all if omitted.
    num_returns : int
        Number of items of return banks, at the end: they are not compared, since no mission leads there.
    """
    reason = ""
    try:
        if part is None:
            await link.upload(mission.items)
        else:
            await link.write(mission.items[part])
    except LinkError as error:
        reason = str(error)  # The last acknowledgement may be lost: reading back decides what is stored.
    try:
        read = await link.read_back(num_left_out=num_returns)
        differs = difference(mission.items[: len(mission.items) - num_returns], read)
    except LinkError as error:
        return SwapOutcome.REFUSED, "; ".join(filter(None, (reason, str(error))))
    if not differs:
        return None, ""
    return (SwapOutcome.REFUSED, reason) if reason else (SwapOutcome.DIFFERS, differs)
