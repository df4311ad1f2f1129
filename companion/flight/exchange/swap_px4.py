"""The swap on PX4: the upload is the entry.

PX4 flies an upload from the moment its last item is in, at the item marked as current, and names what
it stores and flies by a checksum; but it accepts what it then finds it cannot fly. So the item that lies
ahead is marked, the last item held back if it no longer does, and MISSION_CURRENT believed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from companion.errors import LinkError
from companion.flight.exchange.swap_protocol import Entry, SwapOrder, SwapParts
from companion.flight.state.list_state import after_asked, after_exchange
from companion.mission.item_difference import difference
from companion.mission.list_layout import Layout, SingleListLayout, marked, single_list_layout_of
from companion.mission.mission_id import mission_id
from companion.mission.operator import Operator, span_in, without_span
from companion.mission.swap import (
    NO_SAFE_ENTRY,
    MissionLink,
    SwapOutcome,
    enter,
    entry_now,
    is_still_ahead,
)
from companion.types.mavlink_enums import MissionState
from companion.types.mission import Mission, MissionItem

UPLOAD_MAX_S = 60.0
TURNS = 3  # of the event loop, in which an upload that was acknowledged in the same breath ends
FLOWN = frozenset({MissionState.ACTIVE})
STORED = FLOWN | {MissionState.NOT_STARTED}  # while the pilot flies
CONFIRM_S = 2.5  # PX4 tells its mission once a second, and checks a new one within a tenth of that


class Px4Swap:
    """See :class:`companion.flight.exchange.swap_protocol.SwapProtocol`.

    Parameters
    ----------
    parts : SwapParts
        What it works with.
    """

    wants_landing = True

    def __init__(self, parts: SwapParts) -> None:
        self._parts = parts

    def without_ours(self, read: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
        """The operator's items in a list as read."""
        return without_span(read)

    def layout_of(self, _read: tuple[MissionItem, ...], operator: Operator, _current: int, /) -> Layout:
        """Ours between the operator's items up to the goal and those that follow."""
        return single_list_layout_of(operator)

    def span_of_ours(self, read: tuple[MissionItem, ...], _layout: Layout, /) -> tuple[int, int] | None:
        """Where ours are in the list."""
        return span_in(read)

    def layout_as_flown(self, layout: Layout, ours: tuple[MissionItem, ...]) -> Layout:
        """With ours, as they were found."""
        return replace(layout, flown=ours) if isinstance(layout, SingleListLayout) else layout

    async def carry_out(self, order: SwapOrder) -> tuple[SwapOutcome, str]:
        """Begin the upload when the aircraft is nearly there."""
        flight, link, clock = self._parts.flight, self._parts.link, self._parts.clock
        mission = order.flown.mission
        if not self._parts.may_be_entered(order):
            return NO_SAFE_ENTRY
        lasts_s = flight.listed.sending_s(mission)
        await self._parts.until_due(order, lasts_s)
        if flight.listed.suspected:
            return SwapOutcome.FOREIGN, "somebody else has uploaded a mission"
        begun_s = clock.now_s()
        flight.apply_to_list(after_asked, order.pending(begun_s, order.identity))
        entry = Entry(self._parts, order, lasts_s)
        states = FLOWN if flight.state.may_act else STORED
        outcome, reason = await replace_whole(link, mission, entry.sequence, self._parts.may_act, states)
        if outcome is SwapOutcome.FLOWN or entry.asked_s - begun_s > lasts_s:
            flight.apply_to_list(after_exchange, entry.asked_s - begun_s)
        if outcome in (SwapOutcome.REFUSED, SwapOutcome.DIFFERS, SwapOutcome.WITHDRAWN):
            # Whether it is flown is told by the next MISSION_CURRENT.
            flight.apply_to_list(after_asked, order.pending(clock.now_s(), order.identity))
        return outcome, reason


async def replace_whole(
    link: MissionLink,
    mission: Mission,
    entry: Callable[[], int | None],
    may_act: Callable[[], bool],
    states: frozenset[MissionState] = FLOWN,
) -> tuple[SwapOutcome, str]:
    """Replace a PX4's mission and fly it from the item that lies ahead.

    Parameters
    ----------
    link : MissionLink
        To the autopilot.
    mission : Mission
        The whole list.
    entry : callable
        Sequence of the first item that lies ahead, None if none does; asked first, and again before the
        last item leaves.
    may_act : callable
        Whether the pilot still leaves it to us.
    states : frozenset of MissionState
        What the autopilot tells of a mission that it has taken.
    """
    sequence = entry_now(entry, may_act)
    if not isinstance(sequence, int):
        return sequence
    identity = mission_id(mission.items)
    if link.current is not None and link.current.mission_id == identity:
        return await enter(link, mission, lambda: sequence, may_act)  # sent again, its flag is ignored
    may_finish = partial(is_still_ahead, sequence, entry, may_act)
    try:
        given = await _uploaded(link, marked(mission, sequence), may_finish, identity, states)
    except LinkError as error:
        if not may_act():
            return SwapOutcome.WITHDRAWN, "the mode was changed"
        # A lost last acknowledgement ends in an error although all is flown: what it flies tells.
        if await link.wait_for_mission_current(
            lambda told: told.mission_id == identity and told.state in states, CONFIRM_S
        ):
            return SwapOutcome.FLOWN, f"item {sequence} of {len(mission.items)}, {identity:08x}"
        if not may_finish():
            return SwapOutcome.STALE, "the entry was passed during the upload"
        return SwapOutcome.REFUSED, str(error)
    if given not in (0, identity):
        return SwapOutcome.DIFFERS, f"stored as {given:08x} instead of {identity:08x}"
    return await _confirmed(link, mission, sequence, given, states)


async def _uploaded(
    link: MissionLink,
    items: Sequence[MissionItem],
    may_finish: Callable[[], bool],
    identity: int,
    states: frozenset[MissionState],
) -> int:
    """Upload; over, too, once the autopilot tells that it flies it: an acknowledgement can be lost."""
    upload = asyncio.create_task(link.upload(items, may_finish))
    seen = asyncio.create_task(
        link.wait_for_mission_current(
            lambda told: told.mission_id == identity and told.state in states, UPLOAD_MAX_S
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
    link: MissionLink, mission: Mission, sequence: int, identity: int, states: frozenset[MissionState]
) -> tuple[SwapOutcome, str]:
    """See that a PX4 flies what it has accepted; one that names no missions is read back instead."""
    if identity == 0:
        try:
            differs = difference(mission.items, await link.download())
        except LinkError as error:
            return SwapOutcome.REFUSED, str(error)
        if differs:
            return SwapOutcome.DIFFERS, differs
    is_reported = await link.wait_for_mission_current(
        lambda told: told.mission_id == identity and told.sequence >= sequence, CONFIRM_S
    )
    current = link.current
    if is_reported and current is not None and current.state in states | {MissionState.UNKNOWN}:
        return SwapOutcome.FLOWN, f"item {sequence} of {len(mission.items)}, {identity:08x}"
    state = "nothing" if current is None else f"state {current.state}, item {current.sequence}"
    return SwapOutcome.REFUSED, f"accepted, but not flown: the autopilot tells {state}"
