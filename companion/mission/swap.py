"""A verified swap of missions: its outcomes, the link functions it needs, and entering a stored list."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from functools import partial
from typing import Protocol

from companion.errors import LinkError
from companion.types.events import MissionCurrent
from companion.types.mission import Mission, MissionItem


class NotApprovedError(Exception):
    """The mission may not be entered, because others have not approved it; its argument says why."""


class Consent(Protocol):
    """The consent of others, such as the members of a team, to a mission."""

    @property
    def is_given(self) -> bool:
        """Whether the mission may be entered now."""

    @property
    def refusal(self) -> str:
        """The reason why the mission may not be entered any more; '' while it may."""

    def hold(self) -> None:
        """Note that the mission is being entered."""


class MissionLink(Protocol):
    """The functions of the link that a swap needs."""

    async def upload(self, items: Sequence[MissionItem], may_finish: Callable[[], bool] | None = None) -> int:
        """Replace the autopilot's list; return its id, 0 if it has none."""
        ...

    async def write(self, items: Sequence[MissionItem]) -> None:
        """Overwrite a part of an ArduPlane's list."""
        ...

    async def read_back(self, *, num_left_out: int = 0) -> tuple[MissionItem, ...]:
        """Read an ArduPlane's list."""
        ...

    async def download(self) -> tuple[MissionItem, ...]:
        """Read any autopilot's list."""
        ...

    async def set_current(self, sequence: int, is_ahead: Callable[[], bool] | None = None) -> None:
        """Fly to an item now; the request is not repeated once ``is_ahead`` is false."""
        ...

    @property
    def current(self) -> MissionCurrent | None:
        """The last message about the mission that the autopilot flies."""
        ...

    async def wait_for_mission_current(self, is_it: Callable[[MissionCurrent], bool], wait_s: float) -> bool:
        """Wait for such a message that fulfils a condition; return whether it came in time."""
        ...


class SwapOutcome(Enum):
    """The result of a swap. In every case either the previous mission is intact, or the new one is flown."""

    FLOWN = "flown"
    STALE = "stale"  # the aircraft has passed the entry; not entered
    REFUSED = "refused"  # the autopilot or the link refused; not entered
    DIFFERS = "differs"  # the list reads back differently; not entered
    WITHDRAWN = "withdrawn"  # the pilot has taken over; not entered
    FOREIGN = "foreign"  # another station has uploaded a mission; not changed


NO_SAFE_ENTRY = SwapOutcome.STALE, "no way into it would keep clear"


def entry_now(entry: Callable[[], int | None], may_act: Callable[[], bool]) -> int | tuple[SwapOutcome, str]:
    """Return the sequence at which a list can be entered now, or why it cannot."""
    if not may_act():
        return SwapOutcome.WITHDRAWN, "the mode was changed"
    sequence = entry()
    return (SwapOutcome.STALE, "the entry lies behind the aircraft") if sequence is None else sequence


def is_still_ahead(sequence: int, entry: Callable[[], int | None], may_act: Callable[[], bool]) -> bool:
    """Return whether a chosen entry is still ahead, and the pilot still leaves control to the service."""
    first = entry()
    return may_act() and first is not None and first <= sequence


async def enter(
    link: MissionLink, mission: Mission, entry: Callable[[], int | None], may_act: Callable[[], bool]
) -> tuple[SwapOutcome, str]:
    """Enter a stored list at the first entry that is still ahead.

    Parameters
    ----------
    link : MissionLink
        The link to the autopilot.
    mission : Mission
        The stored list.
    entry : callable
        Returns the sequence of the first item that is ahead, None if there is none; called at the last
        moment.
    may_act : callable
        Returns whether the pilot still leaves control to the service.
    """
    sequence = entry_now(entry, may_act)
    if not isinstance(sequence, int):
        return sequence
    try:
        await link.set_current(sequence, partial(is_still_ahead, sequence, entry, may_act))
    except LinkError as error:
        return SwapOutcome.REFUSED, str(error)
    return SwapOutcome.FLOWN, f"item {sequence} of {len(mission.items)}"
