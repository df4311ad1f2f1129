"""Store a return path in an ArduPlane's list, so that there is one at every moment.

Steps: the idle return bank is disarmed, written, read back, and armed; then the other one is disarmed.
Whatever step is the last, an armed bank holds a complete return path that was checked. Only items that differ
from those in the autopilot are written.

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
from companion.mission.return_bank import RETURN_ITEMS, blank_bank, disarmed, is_armed
from companion.types.mission import MissionItem

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
        self._unsure: set[int] = set()  # Return banks of which it is not certain what the autopilot holds.
        self._flight, self._link, self._clock = parts.flight, parts.link, parts.clock

    async def store(self, bank: tuple[MissionItem, ...], speed: MissionItem) -> str:
        """Store a return bank and arm it; return why it could not be stored, '' if it was.

        Parameters
        ----------
        bank : tuple of MissionItem
            The bank, armed.
        speed : MissionItem
            The item that commands the airspeed, in the places of the starts of a bank that is not armed.
        """
        self._is_stopped = False
        self._flight.apply_to_list(after_swap_begun)
        try:
            return await self._store(bank, speed)
        except CompanionError as error:
            return str(error)
        finally:
            self._flight.apply_to_list(after_swap_ended, self._clock.now_s())

    def stop(self) -> bool:
        """End the exchange that is under way before its next part; return whether it may be cancelled."""
        self._is_stopped = True
        return self._is_reading

    async def _store(self, bank: tuple[MissionItem, ...], speed: MissionItem) -> str:
        if not self._layout().returns:
            await self._make_room(speed)
        armed_now = [is_armed(self._bank(index)) for index in (0, 1)]
        index = armed_now.index(False) if False in armed_now else 0
        for written in (disarmed(self._bank(index), speed), disarmed(bank, speed)):
            if not await self._write(index, written):
                return STOPPED
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
        if differs:
            self._unsure.add(index)
            return differs
        is_whole = await self._write(index, bank)
        other = 1 - index
        return "" if is_whole and await self._write(other, disarmed(self._bank(other), speed)) else STOPPED

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

    async def _write(self, index: int, bank: Sequence[MissionItem]) -> bool:
        """Write the items of a return bank that differ; return whether that was not stopped."""
        stored, is_unsure = self._bank(index), index in self._unsure
        numbered = _numbered(bank, self._first(index))
        for offset in range(0, RETURN_ITEMS, PART_ITEMS):
            part = range(offset, offset + PART_ITEMS)
            other = [number for number in part if is_unsure or numbered[number] != stored[number]]
            if not other:
                continue
            if self._is_stopped:
                return False
            written = numbered[other[0] : other[-1] + 1]
            self._unsure.add(index)  # A write that fails may have been carried out.
            await self._link.write(written)
            self._flight.apply_to_list(after_written, written)
            if not is_unsure:
                self._unsure.discard(index)
        self._unsure.discard(index)
        return True


def _numbered(items: Sequence[MissionItem], first: int) -> tuple[MissionItem, ...]:
    """Return items numbered from a sequence on, none of them current."""
    return tuple(replace(item, sequence=first + n, is_current=False) for n, item in enumerate(items))
