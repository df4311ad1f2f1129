"""The choice of the flown item by PX4's rules: its index counts all items from 0 and takes effect at once."""

from __future__ import annotations

from typing import Protocol

from companion.types.mission import Command, MissionItem
from ...mission_types import is_navigation

_FOR_EVER = -1


class Navigator(Protocol):
    """The pilot that flies the items."""

    @property
    def mission_items(self) -> tuple[MissionItem, ...]:
        """The stored mission."""

    @property
    def mode(self) -> str:
        """Flight mode."""

    def begin(self, item: MissionItem) -> None:
        """Start a navigation item."""

    def begin_afresh(self) -> None:
        """Fly to what comes next directly from here."""

    def has_arrived(self, item: MissionItem) -> bool:
        """Return whether a navigation item is done."""

    def is_airborne(self) -> bool:
        """Return whether a takeoff has nothing left to do."""

    def do(self, item: MissionItem) -> None:
        """Carry out an item that is not flown to."""

    def reached(self, sequence: int) -> None:
        """Tell that an item is done."""

    def mission_complete(self) -> None:
        """Act on the end of the list."""

    def tell_current(self) -> None:
        """Tell that another item is current."""


class Px4Runner:
    """Index, item being flown, and jump counters.

    Parameters
    ----------
    navigator : Navigator
        Holds the list and flies it.

    Attributes
    ----------
    index : int
        Sequence of the item that is current.
    is_complete : bool
        Whether the list has ended; only commanding the mission mode begins it again.
    """

    def __init__(self, navigator: Navigator) -> None:
        self._navigator = navigator
        self._jumps: dict[int, int] = {}
        self._active: MissionItem | None = None
        self.index = 0
        self.is_complete = False

    def reset(self) -> None:
        """Begin with an empty list."""
        self.index, self._active, self.is_complete = 0, None, False
        self._jumps.clear()

    def stop(self) -> None:
        """Stop, as the mode was left; the index is kept."""
        self._active = None

    def jump(self, sequence: int) -> None:
        """Make an item current: flown to directly in mission mode, else kept for later."""
        self.index = sequence
        self._jumps.clear()
        if self._navigator.mode == "MISSION":
            self._navigator.begin_afresh()
            self._start_from(sequence)

    def resume(self) -> None:
        """Fly the current item; the mode was entered."""
        self.is_complete = False
        self._start_from(self.index)

    def update(self) -> None:
        """Go on to the next item once the present one is done."""
        active = self._active
        if active is None or not self._navigator.has_arrived(active):
            return
        items = self._navigator.mission_items
        follows = items[self.index + 1] if self.index + 1 < len(items) else None
        if follows is None or is_navigation(follows.command):
            self._navigator.reached(self.index)  # For a waypoint right before a DO_ item nothing is reported.
        self._start_from(self.index + 1)
        self._navigator.tell_current()

    def _start_from(self, sequence: int) -> None:
        """Start the first item from here on that is flown; do what lies before it on the way."""
        items = self._navigator.mission_items
        self._active = None
        budget = 4 * len(items) + 4  # Jumps between items that are not flown would never end.
        while sequence < len(items) and budget > 0:
            budget -= 1
            item = items[sequence]
            if item.command == Command.DO_JUMP:
                sequence = self._jumped(item)
            elif item.command == Command.NAV_TAKEOFF and self._navigator.is_airborne():
                sequence += 1
            elif is_navigation(item.command):
                self.index, self._active = sequence, item
                self._navigator.begin(item)
                return
            else:
                self._navigator.do(item)
                sequence += 1
        self.is_complete = True
        self.index = max(len(items) - 1, 0)
        self._navigator.mission_complete()

    def _jumped(self, item: MissionItem) -> int:
        """Sequence after a DO_JUMP, with its counter."""
        target, times = int(item.parameters[0] or 0), int(item.parameters[1] or 0)
        done = self._jumps.get(item.sequence, 0)
        is_spent = times != _FOR_EVER and done >= times
        if not 0 <= target < len(self._navigator.mission_items) or is_spent:
            return item.sequence + 1
        self._jumps[item.sequence] = done + 1
        return target
