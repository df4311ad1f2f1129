"""The verified swap: upload, read back, compare, and only then fly it.

ArduPlane acknowledges an upload it then stores differently, and goes on with the item it has cached
(FIELD of the autopilots' measured behaviour): only reading back proves what is stored, and only
DO_SET_MISSION_CURRENT makes it fly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import Enum
from typing import Protocol

from companion.errors import LinkError
from companion.types.mission import Command, Frame, Mission, MissionItem

ALTITUDE_TOLERANCE_M = 0.011  # ArduPlane truncates to whole centimetres
FIRST_COMMAND_WITHOUT_PLACE = 100
# The parameter that says how an item of ours is flown, and its rounding: the airspeed, and the radius
# with its sign, of which whole metres are kept.
PARAMETERS: dict[int, tuple[int, float]] = {
    Command.DO_CHANGE_SPEED: (1, 0.06),
    Command.NAV_LOITER_UNLIM: (2, 1.0),
}
SAME_FRAME: dict[int, int] = {
    Frame.GLOBAL_INT: Frame.GLOBAL,
    Frame.GLOBAL_RELATIVE_ALT_INT: Frame.GLOBAL_RELATIVE_ALT,
}


class MissionLink(Protocol):
    """What the swap needs of the link."""

    async def upload(self, items: Sequence[MissionItem]) -> int:
        """Replace the autopilot's list."""
        ...

    async def download(self) -> tuple[MissionItem, ...]:
        """Read it back."""
        ...

    async def set_current(self, sequence: int) -> None:
        """Fly to an item now."""
        ...


class SwapOutcome(Enum):
    """How a swap ended. Whatever it is, the bank flown before is whole in the autopilot."""

    FLOWN = "flown"
    STALE = "stale"  # the aircraft has passed the entry meanwhile; not entered
    REFUSED = "refused"  # the autopilot or the link refused; not entered
    DIFFERS = "differs"  # read back differently; not entered
    WITHDRAWN = "withdrawn"  # the pilot took over meanwhile; not entered


def difference(sent: Sequence[MissionItem], read: Sequence[MissionItem]) -> str:
    """What is stored differently from what was sent, '' if nothing that matters.

    Known roundings do not count: frames come back in their float form, altitudes truncated to
    centimetres, a loiter's radius to metres, a waypoint's hold time and yaw as 0; item 0 is the home
    slot and is not ours.
    """
    if len(sent) != len(read):
        return f"{len(read)} items instead of {len(sent)}"
    for ours, theirs in zip(sent[1:], read[1:], strict=True):
        where = f"item {ours.sequence}"
        if ours.command != theirs.command:
            return f"{where}: command {theirs.command} instead of {ours.command}"
        index, rounding = PARAMETERS.get(ours.command, (0, math.inf))
        parameter, stored = ours.parameters[index] or 0.0, theirs.parameters[index] or 0.0
        if not abs(parameter - stored) <= rounding:
            return f"{where}: parameter {index + 1} {stored:g} instead of {parameter:g}"
        if ours.command >= FIRST_COMMAND_WITHOUT_PLACE:
            continue  # DO_ items have no place, and their frame is not kept
        if SAME_FRAME.get(ours.frame, ours.frame) != theirs.frame and ours.frame != theirs.frame:
            return f"{where}: frame {theirs.frame} instead of {ours.frame}"
        if (ours.latitude_e7, ours.longitude_e7) != (theirs.latitude_e7, theirs.longitude_e7):
            return f"{where}: stands elsewhere"
        if not math.isclose(ours.altitude_m, theirs.altitude_m, abs_tol=ALTITUDE_TOLERANCE_M, rel_tol=1e-6):
            return f"{where}: altitude {theirs.altitude_m} m instead of {ours.altitude_m} m"
    return ""


async def store(link: MissionLink, mission: Mission) -> tuple[SwapOutcome | None, str]:
    """Upload a list and read it back; None and '' when it is stored as sent."""
    try:
        await link.upload(mission.items)
    except LinkError as error:
        reason = str(error)
        # A lost last acknowledgement ends in an error although all is stored: reading back decides.
        try:
            read = await link.download()
        except LinkError as again:
            return SwapOutcome.REFUSED, f"{reason}; {again}"
        if difference(mission.items, read):
            return SwapOutcome.REFUSED, reason
        return None, ""
    try:
        read = await link.download()
    except LinkError as error:
        return SwapOutcome.REFUSED, str(error)
    differs = difference(mission.items, read)
    return (SwapOutcome.DIFFERS, differs) if differs else (None, "")


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
    if not may_act():
        return SwapOutcome.WITHDRAWN, "the mode was changed"
    sequence = entry()
    if sequence is None:
        return SwapOutcome.STALE, "the entry lies behind the aircraft"
    try:
        await link.set_current(sequence)
    except LinkError as error:
        return SwapOutcome.REFUSED, str(error)
    return SwapOutcome.FLOWN, f"item {sequence} of {len(mission.items)}"
