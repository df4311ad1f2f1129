"""The verified swap, as each autopilot needs it.

ArduPlane acknowledges an upload it then stores differently, and goes on with the item it has cached
(measured): only reading back proves what is stored, and only DO_SET_MISSION_CURRENT makes it fly. So:
:func:`store` in the idle bank, read back, compare; then :func:`enter`.

PX4 flies an upload from the moment its last item is in, at the item marked as current, and names what
it stores and flies by a checksum; but it accepts what it then finds it cannot fly. So: :func:`replace_whole`
marks the item that lies ahead, holds the last item back if it no longer does, and believes MISSION_CURRENT.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Sequence
from enum import Enum
from functools import partial
from typing import Protocol

from companion.errors import LinkError
from companion.mission.list_layout import marked
from companion.mission.mission_id import mission_id
from companion.types.events import MissionCurrent
from companion.types.mission import Command, MavFrame, Mission, MissionItem

ALTITUDE_TOLERANCE_M = 0.011  # ArduPlane truncates to whole centimetres
FIRST_COMMAND_WITHOUT_PLACE = 100
SPEED_TOLERANCE_M_S = 0.06
UPLOAD_MAX_S = 60.0
TURNS = 3  # of the event loop, in which an upload that was acknowledged in the same breath ends
CONFIRM_S = 2.5  # PX4 tells its mission once a second, and checks a new one within a tenth of that
# Parameters (by number, from 0) that ArduPlane does not store for a command: they read back as 0.
DROPPED: dict[int, frozenset[int]] = {
    Command.NAV_WAYPOINT: frozenset({0, 3}),
    Command.NAV_LOITER_UNLIM: frozenset({0, 1, 3}),
    Command.NAV_LOITER_TURNS: frozenset({1, 3}),
    Command.NAV_LOITER_TIME: frozenset({1, 3}),
    Command.NAV_TAKEOFF: frozenset({1, 2, 3}),
    Command.NAV_LOITER_TO_ALT: frozenset(),
    Command.DO_CHANGE_SPEED: frozenset({3}),
    Command.DO_JUMP: frozenset(),
}
_ACTIVE = 3  # MISSION_STATE_ACTIVE
SAME_FRAME: dict[int, int] = {
    MavFrame.GLOBAL_INT: MavFrame.GLOBAL,
    MavFrame.GLOBAL_RELATIVE_ALT_INT: MavFrame.GLOBAL_RELATIVE_ALT,
}


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


class ToldLink(MissionLink, Protocol):
    """A link over which the autopilot names the mission it flies."""

    @property
    def current(self) -> MissionCurrent | None:
        """What it told last."""
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


def difference(sent: Sequence[MissionItem], read: Sequence[MissionItem]) -> str:
    """What is stored differently from what was sent, '' if nothing that matters.

    Known roundings of ArduPlane's do not count: frames come back in their float form, altitudes cut to
    centimetres, most parameters to whole numbers, a waypoint's hold time and yaw as 0; item 0 is the home
    slot and is not ours. Parameters of commands whose storage is not known are not compared.
    """
    if len(sent) != len(read):
        return f"{len(read)} items instead of {len(sent)}"
    for ours, theirs in zip(sent[1:], read[1:], strict=True):
        where = f"item {ours.sequence}"
        if ours.command != theirs.command:
            return f"{where}: command {theirs.command} instead of {ours.command}"
        wrong = _wrong_parameter(ours, theirs)
        if wrong is not None:
            stored, sent_value = theirs.parameters[wrong] or 0.0, ours.parameters[wrong] or 0.0
            return f"{where}: parameter {wrong + 1} {stored:g} instead of {sent_value:g}"
        if ours.command >= FIRST_COMMAND_WITHOUT_PLACE:
            continue  # DO_ items have no place, and their frame is not kept
        if SAME_FRAME.get(ours.frame, ours.frame) != theirs.frame and ours.frame != theirs.frame:
            return f"{where}: frame {theirs.frame} instead of {ours.frame}"
        if (ours.latitude_e7, ours.longitude_e7) != (theirs.latitude_e7, theirs.longitude_e7):
            return f"{where}: stands elsewhere"
        if not math.isclose(ours.altitude_m, theirs.altitude_m, abs_tol=ALTITUDE_TOLERANCE_M, rel_tol=1e-6):
            return f"{where}: altitude {theirs.altitude_m} m instead of {ours.altitude_m} m"
    return ""


def _wrong_parameter(ours: MissionItem, theirs: MissionItem) -> int | None:
    """Number, from 0, of the first parameter that is stored as something else."""
    dropped = DROPPED.get(ours.command)
    if dropped is None:
        return None
    for index, (sent, stored) in enumerate(zip(ours.parameters, theirs.parameters, strict=True)):
        wanted, found = sent or 0.0, stored or 0.0
        if index in dropped:
            continue
        if ours.command == Command.DO_CHANGE_SPEED:
            if not abs(wanted - found) <= SPEED_TOLERANCE_M_S:
                return index
        elif not (math.isclose(wanted, found, rel_tol=1e-6, abs_tol=1e-6) or found == math.trunc(wanted)):
            return index
    return None


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
        Of its items, what alone is sent, since the rest is stored already.
    """
    reason = ""
    try:
        if part is None:
            await link.upload(mission.items)
        else:
            await link.write(mission.items[part])
    except LinkError as error:
        reason = str(
            error
        )  # of a lost last acknowledgement, too, although all is stored: reading back decides
    try:
        differs = difference(mission.items, await link.read_back())
    except LinkError as error:
        return SwapOutcome.REFUSED, "; ".join(filter(None, (reason, str(error))))
    if not differs:
        return None, ""
    return (SwapOutcome.REFUSED, reason) if reason else (SwapOutcome.DIFFERS, differs)


def _entry_now(entry: Callable[[], int | None], may_act: Callable[[], bool]) -> int | tuple[SwapOutcome, str]:
    """Sequence at which a list is entered now, or why it is not."""
    if not may_act():
        return SwapOutcome.WITHDRAWN, "the mode was changed"
    sequence = entry()
    return (SwapOutcome.STALE, "the entry lies behind the aircraft") if sequence is None else sequence


def _is_still_ahead(sequence: int, entry: Callable[[], int | None], may_act: Callable[[], bool]) -> bool:
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
    sequence = _entry_now(entry, may_act)
    if not isinstance(sequence, int):
        return sequence
    is_still_ahead = partial(_is_still_ahead, sequence, entry, may_act)

    try:
        await link.set_current(sequence, is_still_ahead)
    except LinkError as error:
        return SwapOutcome.REFUSED, str(error)
    return SwapOutcome.FLOWN, f"item {sequence} of {len(mission.items)}"


async def replace_whole(
    link: ToldLink, mission: Mission, entry: Callable[[], int | None], may_act: Callable[[], bool]
) -> tuple[SwapOutcome, str]:
    """Replace a PX4's mission and fly it from the item that lies ahead.

    Parameters
    ----------
    link : ToldLink
        To the autopilot.
    mission : Mission
        The whole list.
    entry : callable
        Sequence of the first item that lies ahead, None if none does; asked first, and again before the
        last item leaves.
    may_act : callable
        Whether the pilot still leaves it to us.
    """
    sequence = _entry_now(entry, may_act)
    if not isinstance(sequence, int):
        return sequence
    identity = mission_id(mission.items)
    if link.current is not None and link.current.mission_id == identity:
        return await enter(link, mission, lambda: sequence, may_act)  # sent again, its flag would be ignored
    is_still_ahead = partial(_is_still_ahead, sequence, entry, may_act)

    try:
        given = await _uploaded(link, marked(mission, sequence), is_still_ahead, identity)
    except LinkError as error:
        if not may_act():
            return SwapOutcome.WITHDRAWN, "the mode was changed"
        # A lost last acknowledgement ends in an error although all is flown: what it flies tells.
        if await link.wait_for_mission_current(
            lambda told: told.mission_id == identity and told.state == _ACTIVE, CONFIRM_S
        ):
            return SwapOutcome.FLOWN, f"item {sequence} of {len(mission.items)}, {identity:08x}"
        if not is_still_ahead():
            return SwapOutcome.STALE, "the entry was passed during the upload"
        return SwapOutcome.REFUSED, str(error)
    if given not in (0, identity):
        return SwapOutcome.DIFFERS, f"stored as {given:08x} instead of {identity:08x}"
    return await _confirmed(link, mission, sequence, given)


async def _uploaded(
    link: ToldLink, items: Sequence[MissionItem], may_finish: Callable[[], bool], identity: int
) -> int:
    """Upload; over, too, once the autopilot tells that it flies it: an acknowledgement can be lost."""
    upload = asyncio.create_task(link.upload(items, may_finish))
    seen = asyncio.create_task(
        link.wait_for_mission_current(
            lambda told: told.mission_id == identity and told.state == _ACTIVE, UPLOAD_MAX_S
        )
    )
    try:
        await asyncio.wait({upload, seen}, return_when=asyncio.FIRST_COMPLETED)
        for _ in range(TURNS):
            await asyncio.sleep(0)
        if not upload.done() and seen.done() and seen.result():
            return identity
        return await upload
    finally:
        for task in (upload, seen):
            task.cancel()
        await asyncio.gather(upload, seen, return_exceptions=True)


async def _confirmed(
    link: ToldLink, mission: Mission, sequence: int, identity: int
) -> tuple[SwapOutcome, str]:
    """See that a PX4 flies what it has accepted; one that names no missions is read back instead."""
    if identity == 0:
        try:
            differs = difference(mission.items, await link.download())
        except LinkError as error:
            return SwapOutcome.REFUSED, str(error)
        if differs:
            return SwapOutcome.DIFFERS, differs
    is_told = await link.wait_for_mission_current(
        lambda told: told.mission_id == identity and told.sequence >= sequence, CONFIRM_S
    )
    current = link.current
    if is_told and current is not None and current.state in (0, _ACTIVE):
        return SwapOutcome.FLOWN, f"item {sequence} of {len(mission.items)}, {identity:08x}"
    state = "nothing" if current is None else f"state {current.state}, item {current.sequence}"
    return SwapOutcome.REFUSED, f"accepted, but not flown: the autopilot tells {state}"
