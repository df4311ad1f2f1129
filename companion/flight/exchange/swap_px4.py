"""The swap on PX4: the upload is the entry.

PX4 flies an upload as soon as its last item has arrived, beginning at the item marked as current. It
identifies its mission by a checksum, but it also accepts missions that it then rejects as not flyable. The
service therefore marks an item ahead, withholds the last item if that one is no longer ahead, and trusts only
MISSION_CURRENT.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from companion.errors import LinkError
from companion.flight.exchange.swap_protocol import Entry, SwapOrder, SwapProtocol
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

UPLOAD_MAX_S = 60.0  # The report that the uploaded mission is flown is awaited for at most this time.
# An acknowledgement may arrive together with the report of the flown mission: the upload then ends within
# this many turns of the event loop.
EVENT_LOOP_TURNS = 3
FLOWN = frozenset({MissionState.ACTIVE})  # The states of a mission that is flown.
STORED = FLOWN | {MissionState.NOT_STARTED}  # The states of a mission that is stored while the pilot flies.
CONFIRM_S = 2.5  # PX4 reports its mission once a second, and checks a new one within a tenth of that.


class Px4Swap(SwapProtocol):
    """See :class:`companion.flight.exchange.swap_protocol.SwapProtocol`."""

    wants_landing = True

    def without_ours(self, read: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
        """Return the operator's items in a list as read."""
        return without_span(read)

    def layout_of(self, _read: tuple[MissionItem, ...], operator: Operator, _current: int, /) -> Layout:
        """Return the layout: the service's items between the operator's up to the goal and the others."""
        return single_list_layout_of(operator)

    def span_of_ours(self, read: tuple[MissionItem, ...], _layout: Layout, /) -> tuple[int, int] | None:
        """Return where the service's items are in the list."""
        return span_in(read)

    def layout_as_flown(self, layout: Layout, ours: tuple[MissionItem, ...]) -> Layout:
        """Return the layout with the service's items as they were found."""
        return replace(layout, flown=ours) if isinstance(layout, SingleListLayout) else layout

    async def carry_out(self, order: SwapOrder) -> tuple[SwapOutcome, str]:
        """Store and enter a mission: start the upload so that it ends when the aircraft reaches the start."""
        flight, link, clock = self._parts.flight, self._parts.link, self._parts.clock
        mission = order.flown.mission
        if not self._parts.may_be_entered(order):
            return NO_SAFE_ENTRY
        duration_s = flight.listed.sending_s(mission)
        await self._parts.until_due(order, duration_s)
        if flight.listed.suspected:
            return SwapOutcome.FOREIGN, "somebody else has uploaded a mission"
        begun_s = clock.now_s()
        flight.apply_to_list(after_asked, order.pending(begun_s, order.identity))
        entry = Entry(self._parts, order, duration_s)
        states = FLOWN if flight.state.may_act else STORED
        outcome, reason = await replace_whole(link, mission, entry.sequence, self._parts.may_act, states)
        if outcome is SwapOutcome.FLOWN or entry.asked_s - begun_s > duration_s:
            flight.apply_to_list(after_exchange, entry.asked_s - begun_s)
        if outcome in (SwapOutcome.REFUSED, SwapOutcome.DIFFERS, SwapOutcome.WITHDRAWN):
            # The next MISSION_CURRENT shows whether the mission is flown.
            flight.apply_to_list(after_asked, order.pending(clock.now_s(), order.identity))
        return outcome, reason


async def replace_whole(
    link: MissionLink,
    mission: Mission,
    entry: Callable[[], int | None],
    may_act: Callable[[], bool],
    states: frozenset[MissionState] = FLOWN,
) -> tuple[SwapOutcome, str]:
    """Replace a PX4's mission and fly it from the item that is ahead.

    Parameters
    ----------
    link : MissionLink
        The link to the autopilot.
    mission : Mission
        The whole list.
    entry : callable
        Returns the sequence of the first item that is ahead, None if there is none. It is called first, and
        again before the last item is sent.
    may_act : callable
        Returns whether the pilot still leaves control to the service.
    states : frozenset of MissionState
        The states that the autopilot reports of an accepted mission.
    """
    sequence = entry_now(entry, may_act)
    if not isinstance(sequence, int):
        return sequence
    identity = mission_id(mission.items)
    if link.current is not None and link.current.mission_id == identity:
        # PX4 ignores the flag in a repeated upload.
        return await enter(link, mission, lambda: sequence, may_act)
    may_finish = partial(is_still_ahead, sequence, entry, may_act)
    try:
        given = await _uploaded(link, marked(mission, sequence), may_finish, identity, states)
    except LinkError as error:
        if not may_act():
            return SwapOutcome.WITHDRAWN, "the mode was changed"
        # If the last acknowledgement is lost, the upload fails although the mission is flown.
        if await link.wait_for_mission_current(
            lambda report: report.mission_id == identity and report.state in states, CONFIRM_S
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
    """Upload until acknowledged, or until the mission is flown: an acknowledgement can be lost."""
    upload = asyncio.create_task(link.upload(items, may_finish))
    seen = asyncio.create_task(
        link.wait_for_mission_current(
            lambda report: report.mission_id == identity and report.state in states, UPLOAD_MAX_S
        )
    )
    try:
        await asyncio.wait({upload, seen}, return_when=asyncio.FIRST_COMPLETED)
        for _ in range(EVENT_LOOP_TURNS):
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
    """Confirm that a PX4 flies what it has accepted; read the list back if it reports no identity."""
    if identity == 0:
        try:
            differs = difference(mission.items, await link.download())
        except LinkError as error:
            return SwapOutcome.REFUSED, str(error)
        if differs:
            return SwapOutcome.DIFFERS, differs
    is_reported = await link.wait_for_mission_current(
        lambda report: report.mission_id == identity and report.sequence >= sequence, CONFIRM_S
    )
    current = link.current
    if is_reported and current is not None and current.state in states | {MissionState.UNKNOWN}:
        return SwapOutcome.FLOWN, f"item {sequence} of {len(mission.items)}, {identity:08x}"
    state = "nothing" if current is None else f"state {current.state}, item {current.sequence}"
    return SwapOutcome.REFUSED, f"accepted, but not flown: the autopilot tells {state}"
