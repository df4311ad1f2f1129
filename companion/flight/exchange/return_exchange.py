"""Store a return path in an ArduPlane's list, so that there is one at every moment.

Steps: the idle return bank is disarmed, written, read back, and armed; then the other one is disarmed.
Whatever step is the last, an armed bank holds a complete return path that was checked.

The exchange gives way to a mission's: it is written in small parts, and ends between two of them on request.
A part is not abandoned halfway, because ArduPlane would deny partial uploads for 8 s (measured).
Only the first exchange sends the whole list, which makes room for the banks. It may be abandoned, since an
upload of the whole list restarts it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from companion.errors import CompanionError
from companion.flight.exchange.swap_protocol import SwapParts
from companion.flight.state.list_state import (
    after_reading,
    after_suspicion,
    after_swap_begun,
    after_swap_ended,
    after_writing_begun,
    after_written,
)
from companion.mission.item_difference import difference
from companion.mission.list_layout import TwoBankLayout
from companion.mission.return_bank import RETURN_ITEMS, armed, blank_bank, is_armed
from companion.types.mission import Command, MissionItem

PART_ITEMS = 4  # Items that are written at once: about 0.05 s.
STOPPED = "another exchange is due"


class ReturnExchange:
    """Writes return banks.

    Parameters
    ----------
    parts : SwapParts
        Flight state, link and clock.

    """

    def __init__(self, parts: SwapParts) -> None:
        self._is_stopped = self._is_reading = False
        self._flight, self._link, self._clock = parts.flight, parts.link, parts.clock

    async def store(self, bank: tuple[MissionItem, ...], start: Command) -> str:
        """Store a return bank and arm it; return why it could not be stored, '' if it was.

        Parameters
        ----------
        bank : tuple of MissionItem
            The bank, not armed.
        start : Command
            The command with which the autopilot's return paths begin.
        """
        self._is_stopped = False
        self._flight.apply_to_list(after_swap_begun)
        try:
            return await self._store(bank, start)
        except CompanionError as error:
            return str(error)
        finally:
            self._flight.apply_to_list(after_swap_ended, self._clock.now_s())

    def stop(self) -> bool:
        """End the exchange that is under way before its next part; return whether it may be cancelled."""
        self._is_stopped = True
        return self._is_reading

    async def _store(self, bank: tuple[MissionItem, ...], start: Command) -> str:
        if not self._layout().returns:
            await self._make_room(bank[0])
        armed_now = [is_armed(self._bank(index)) for index in (0, 1)]
        index = armed_now.index(False) if False in armed_now else 0
        parts = [(offset, bank[offset : offset + PART_ITEMS]) for offset in range(1, len(bank), PART_ITEMS)]
        for offset, items in [(0, bank[:1])] * armed_now[index] + parts:
            if self._is_stopped:
                return STOPPED
            await self._write(index, offset, items)
        self._is_reading = True
        try:
            read = await self._link.read_back(gives_way=True)
        finally:
            self._is_reading = False
        if len(read) != len(self._flight.listed.stored):
            self._flight.apply_to_list(after_suspicion, f"{len(read)} items")
            return f"{len(read)} items instead of {len(self._flight.listed.stored)}"
        first = self._first(index)
        differs = difference(self._bank(index), read[first : first + RETURN_ITEMS])  # but the start
        if differs or self._is_stopped:
            return differs or STOPPED
        await self._write(index, 0, armed(bank, start)[:1])
        if armed_now[1 - index]:
            await self._write(1 - index, 0, bank[:1])
        return ""

    async def _make_room(self, speed: MissionItem) -> None:
        """Send the list with both return banks, blank, and an idle bank that is a copy of the flown one."""
        layout, stored = self._layout(), self._flight.listed.stored
        idle = (layout.flown or ()) if len(stored) < layout.return_span[0] else ()
        added = _numbered((*idle, *blank_bank(speed), *blank_bank(speed)), len(stored))
        first = layout.flown_span[0]
        items = [replace(item, is_current=item.sequence == first) for item in (*stored, *added)]
        # Until then its length is open: the next mission would be sent with the whole list.
        self._flight.apply_to_list(after_reading, self._clock.now_s(), 0)
        self._flight.apply_to_list(after_writing_begun)
        await self._link.upload(items, gives_way=True)
        self._flight.apply_to_list(after_written, added)

    def _layout(self) -> TwoBankLayout:
        """Return the list's layout."""
        layout = self._flight.listed.layout
        if not isinstance(layout, TwoBankLayout):
            raise TypeError("only an ArduPlane's list has return banks")
        return layout

    def _first(self, index: int) -> int:
        """Return the sequence of the first item of a return bank."""
        return self._layout().return_span[0] + index * RETURN_ITEMS

    def _bank(self, index: int) -> tuple[MissionItem, ...]:
        """Return the items of a return bank as stored."""
        return self._layout().returns[index * RETURN_ITEMS : (index + 1) * RETURN_ITEMS]

    async def _write(self, index: int, offset: int, items: Sequence[MissionItem]) -> None:
        """Write items of a return bank."""
        numbered = _numbered(items, self._first(index) + offset)
        await self._link.write(numbered)
        self._flight.apply_to_list(after_written, numbered)


def _numbered(items: Sequence[MissionItem], first: int) -> tuple[MissionItem, ...]:
    """Return items numbered from a sequence on, none of them current."""
    return tuple(replace(item, sequence=first + n, is_current=False) for n, item in enumerate(items))
