"""The choice of the flown item by ArduPlane's rules.

The item being flown is a copy: overwriting its slot changes nothing until it is started again. The
index only moves on arrival, by a jump, or when set. Off the list's end the mission is complete.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Protocol

from companion.types.mission import Command, MissionItem
from ...mission_types import is_navigation
from .arduplane_store import MissionStore

_FOR_EVER = -1


class MissionState(IntEnum):
    """MISSION_STATE of MISSION_CURRENT."""

    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    COMPLETE = 5


class Pilot(Protocol):
    """The pilot that flies the items."""

    def begin(self, item: MissionItem) -> None:
        """Start a navigation item."""

    def has_arrived(self, item: MissionItem) -> bool:
        """Return whether a navigation item is done."""

    def do(self, item: MissionItem) -> None:
        """Carry out an item that is not flown to."""

    def reached(self, sequence: int) -> None:
        """Tell that an item is done."""

    def mission_complete(self) -> None:
        """Act on the end of the list."""


class MissionRunner:
    """Index, cached item and jump counters.

    Parameters
    ----------
    store : MissionStore
        Holds the list, which may change at any time.
    pilot : Pilot
        Flies the items.

    Attributes
    ----------
    index : int
        Sequence of the navigation item that is current; may lie beyond a list that was cut.
    active : MissionItem or None
        The copy being flown.
    """

    def __init__(self, store: MissionStore, pilot: Pilot) -> None:
        self._store = store
        self._pilot = pilot
        self._jumps: dict[int, int] = {}
        self.index = 0
        self.active: MissionItem | None = None
        self._is_running = False
        self._is_complete = False

    @property
    def state(self) -> MissionState:
        """The state in MISSION_CURRENT."""
        if len(self._store.mission) <= 1:
            return MissionState.NO_MISSION
        if self._is_complete:
            return MissionState.COMPLETE
        return MissionState.ACTIVE if self._is_running else MissionState.NOT_STARTED

    def stop(self) -> None:
        """Stop, as the mode was left: keep the index, forget the copy."""
        self._is_running = False
        self.active = None

    def resume(self, *, restart: bool) -> None:
        """Start the current item as its slot holds it now, or the first; the mode was entered."""
        is_fresh = restart or self._is_complete or not 1 <= self.index < len(self._store.mission)
        if is_fresh:
            self._jumps.clear()
        self._start_from(1 if is_fresh else self.index)

    def set_current(self, sequence: int, *, reset_jumps: bool = False) -> bool:
        """Move the index, and if running fly there at once; ``False`` when there is no such item."""
        if not 0 <= sequence < len(self._store.mission):
            return False
        if reset_jumps:
            self._jumps.clear()
        if self._is_running:
            self._start_from(max(sequence, 1))
        else:
            self._is_complete = False
            self.index = max(sequence, 1)
        return True

    def update(self) -> None:
        """Go on to the next item once the present one is done.

        With an empty list nothing is checked, so that the aircraft flies on past its old target.
        """
        if not self._is_running or self.active is None or not self._store.mission:
            return
        if self._pilot.has_arrived(self.active):
            self._pilot.reached(self.index)
            self._start_from(self.index + 1)

    def _start_from(self, sequence: int) -> None:
        """Start the first navigation item from here on; do what lies before it on the way."""
        self._is_running = True
        self._is_complete = False
        self.active = None
        budget = 4 * len(self._store.mission) + 4  # Jumps between items that are not flown would never end.
        while sequence < len(self._store.mission) and budget > 0:
            budget -= 1
            item = self._store.mission[sequence]
            if item.command == Command.DO_JUMP:
                sequence = self._jump(item)
            elif is_navigation(item.command):
                self.index, self.active = sequence, item
                self._pilot.begin(item)
                return
            else:
                self._pilot.do(item)
                self._pilot.reached(sequence)
                sequence += 1
        self._is_running = False
        self._is_complete = True
        self._pilot.mission_complete()

    def _jump(self, item: MissionItem) -> int:
        """Sequence after a DO_JUMP, with its counter."""
        target, times = int(item.parameters[0] or 0), int(item.parameters[1] or 0)
        done = self._jumps.get(item.sequence, 0)
        if not 1 <= target < len(self._store.mission) or (times != _FOR_EVER and done >= times):
            return item.sequence + 1
        self._jumps[item.sequence] = done + 1
        return target
