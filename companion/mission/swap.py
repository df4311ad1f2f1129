"""A verified swap: how it may end, what it needs of the link, and how a stored list is entered."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from functools import partial
from typing import Protocol

from companion.errors import LinkError
from companion.types.events import MissionCurrent
from companion.types.mission import Mission, MissionItem


class MissionLink(Protocol):
    """What the swap needs of the link."""

    async def upload(self, items: Sequence[MissionItem], may_finish: Callable[[], bool] | None = None) -> int:
        """Replace the autopilot's list; the id it is given, 0 without one."""
        ...

    async def write(self, items: Sequence[MissionItem]) -> None:
        """Overwrite a part of an ArduPlane's list."""
        ...

    async def read_back(self) -> tuple[MissionItem, ...]:
        """Read an ArduPlane's list."""
        ...

    async def download(self) -> tuple[MissionItem, ...]:
        """Read any autopilot's list."""
        ...

    async def set_current(self, sequence: int, is_ahead: Callable[[], bool] | None = None) -> None:
        """Fly to an item now; not asked again once it is no more ahead."""
        ...

    @property
    def current(self) -> MissionCurrent | None:
        """What the autopilot told last of the mission it flies."""
        ...

    async def wait_for_mission_current(self, is_it: Callable[[MissionCurrent], bool], wait_s: float) -> bool:
        """Wait for it to tell something; whether it did in time."""
        ...


class SwapOutcome(Enum):
    """How a swap ended. Whatever it is, what was flown before is whole, or the new one is flown."""

    FLOWN = "flown"
    STALE = "stale"  # the aircraft has passed the entry meanwhile; not entered
    REFUSED = "refused"  # the autopilot or the link refused; not entered
    DIFFERS = "differs"  # read back differently; not entered
    WITHDRAWN = "withdrawn"  # the pilot took over meanwhile; not entered
    FOREIGN = "foreign"  # somebody else has uploaded a mission; not touched


NO_WAY_IN = SwapOutcome.STALE, "no way into it would keep clear"


def entry_now(entry: Callable[[], int | None], may_act: Callable[[], bool]) -> int | tuple[SwapOutcome, str]:
    """Sequence at which a list is entered now, or why it is not."""
    if not may_act():
        return SwapOutcome.WITHDRAWN, "the mode was changed"
    sequence = entry()
    return (SwapOutcome.STALE, "the entry lies behind the aircraft") if sequence is None else sequence


def is_still_ahead(sequence: int, entry: Callable[[], int | None], may_act: Callable[[], bool]) -> bool:
    """Whether an entry chosen before can still be flown to, and the pilot leaves it to us."""
    first = entry()
    return may_act() and first is not None and first <= sequence


async def enter(
    link: MissionLink, mission: Mission, entry: Callable[[], int | None], may_act: Callable[[], bool]
) -> tuple[SwapOutcome, str]:
    """Fly a stored list from the entry that still lies ahead.

    Parameters
    ----------
    link : MissionLink
        To the autopilot.
    mission : Mission
        The stored list.
    entry : callable
        Sequence of the first item that lies ahead, None if none does; asked at the last moment.
    may_act : callable
        Whether the pilot still leaves it to us.
    """
    sequence = entry_now(entry, may_act)
    if not isinstance(sequence, int):
        return sequence
    try:
        await link.set_current(sequence, partial(is_still_ahead, sequence, entry, may_act))
    except LinkError as error:
        return SwapOutcome.REFUSED, str(error)
    return SwapOutcome.FLOWN, f"item {sequence} of {len(mission.items)}"
