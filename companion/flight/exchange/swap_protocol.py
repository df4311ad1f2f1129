"""What is asked of a swap, whoever's autopilot it is; and what the swaps of all autopilots share."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

from companion.clock import Clock
from companion.flight.exchange.entry import LATER_S, entry_of, may_be_entered
from companion.flight.state.flight_state import StateOwner
from companion.flight.state.list_state import FlownPath, PendingSwap, after_reading, after_waiting
from companion.flight.state.mission_construction import ConstructedMission
from companion.link.missions.autopilot_link import AutopilotLink
from companion.mission.list_layout import Layout, TwoBankLayout
from companion.mission.mission_id import mission_id
from companion.mission.operator import Operator
from companion.mission.swap import SwapOutcome
from companion.mission.waypoints import Waypoints, sequence_of_waypoint
from companion.planning.plan_runner import PlanBrokenOffError
from companion.tracking.ownship import OwnshipEstimator
from companion.types.mission import MissionItem
from companion.types.state import Ownship

LOOK_S = 0.2  # between looks at whether a way leads in


@dataclass(frozen=True, slots=True)
class SwapOrder:
    """A mission to be handed over.

    Parameters
    ----------
    flown : FlownPath
        Path and mission, as they are flown once it is entered.
    waypoints : Waypoints
        What the mission carries out.
    layout : Layout
        The list's once it is flown.
    identity : int
        The name that a PX4 gives it.
    enter_s : float
        When the aircraft is where it begins, by the clock [s].
    is_urgent : bool
        Whether it is entered before, as soon as a way leads in.
    """

    flown: FlownPath
    waypoints: Waypoints
    layout: Layout
    identity: int
    enter_s: float
    is_urgent: bool = False

    def pending(self, asked_s: float, identity: int) -> PendingSwap:
        """What is pending once it was asked for."""
        return PendingSwap(asked_s, self.layout, self.flown, self.waypoints, identity)


def order_for(
    shaped: ConstructedMission,
    layout: Layout,
    *,
    plan_number: int,
    enter_s: float,
    is_urgent: bool = False,
    is_short: bool = False,
) -> SwapOrder:
    """Put a path into the list as it is laid out.

    Parameters
    ----------
    shaped : ConstructedMission
        What is to be flown.
    layout : Layout
        The list's now.
    plan_number : int
        The number of the plan behind it.
    enter_s : float
        When the aircraft is where the path begins, by the clock [s].
    is_urgent : bool
        Whether it is to be flown as soon as may be.
    is_short : bool
        Whether a first mission on an ArduPlane leaves the idle bank out. It is stored sooner then, and the
        next one later: that has to be uploaded whole.
    """
    items = layout.items_for(shaped.part)
    if isinstance(layout, TwoBankLayout) and layout.flown is None and not is_short:
        layout = replace(layout, flown=items)
    mission, after = layout.with_new(items, plan_number)
    flown = FlownPath(shaped.path, mission, shaped.covered_until_s, cost=shaped.cost)
    return SwapOrder(flown, shaped.waypoints, after, mission_id(mission.items), enter_s, is_urgent)


@dataclass(frozen=True, slots=True)
class SwapParts:
    """What every swap works with.

    Parameters
    ----------
    flight : StateOwner
        The flight's state; what is found out of the list is applied to it.
    link : AutopilotLink
        To the autopilot.
    ownship : OwnshipEstimator
        Where the aircraft is.
    clock : Clock
        The service's.
    """

    flight: StateOwner
    link: AutopilotLink
    ownship: OwnshipEstimator
    clock: Clock

    def state(self) -> Ownship | None:
        """The aircraft's state now; None while it is not known."""
        return self.ownship.state(self.clock.now_s())

    def may_act(self) -> bool:
        """Whether the pilot leaves the list to us now."""
        return self.flight.state.may_write

    def may_be_entered(self, order: SwapOrder) -> bool:
        """Whether a mission can be entered at all; where the pilot flies, it is only kept ready."""
        ownship, state = self.state(), self.flight.state
        if ownship is None or not state.may_act:
            return True
        return may_be_entered(state, ownship, order.flown.path, order.waypoints)

    async def until_due(self, order: SwapOrder, lasts_s: float = 0.0) -> None:
        """Wait until what is sent now has the aircraft enter where the path begins, ``lasts_s`` later [s].

        Or before, where the order is urgent and a way leads in from where the aircraft will be then.

        Raises
        ------
        PlanBrokenOffError
            If nobody wants it any more.
        """
        due_s = order.enter_s - lasts_s
        self.flight.apply_to_list(after_waiting, -math.inf if order.is_urgent else due_s)
        while (now_s := self.clock.now_s()) < due_s:
            if order.is_urgent and Entry(self, order, lasts_s).sequence() is not None:
                break
            if why := self.flight.listed.unwanted:
                raise PlanBrokenOffError(why)
            await self.clock.sleep_until(min(due_s, now_s + LOOK_S))
        self.flight.apply_to_list(after_waiting, -math.inf)

    async def read(self) -> tuple[MissionItem, ...]:
        """The autopilot's list; quickly where it is known to be an ArduPlane's."""
        is_bank = isinstance(self.flight.listed.layout, TwoBankLayout)
        read = await (self.link.read_back() if is_bank else self.link.download())
        self.flight.apply_to_list(after_reading, self.clock.now_s(), len(read))
        return read


class Entry:
    """Where a mission is entered: chosen when it is asked first, and from then on only confirmed.

    Parameters
    ----------
    parts : SwapParts
        Where the aircraft is, and when.
    order : SwapOrder
        What is entered.
    lasts_s : float
        How long it takes from now until the aircraft is sent there [s].
    late_s : float
        How much later what is asked again may still take effect [s].

    Attributes
    ----------
    asked_s : float
        When it was asked last [s].
    """

    def __init__(
        self, parts: SwapParts, order: SwapOrder, lasts_s: float = 0.0, *, late_s: float = 0.0
    ) -> None:
        self._parts = parts
        self._order = order
        self._late_s = late_s
        self._until_s = parts.clock.now_s() + lasts_s
        self._number: int | None = None
        self.asked_s = parts.clock.now_s()

    def sequence(self) -> int | None:
        """Sequence of the item that is flown to; None if none is, or that one no more."""
        self.asked_s = now_s = self._parts.clock.now_s()
        ownship, order = self._parts.state(), self._order
        if ownship is None:
            return None
        # Asked again, it is for the last word: what is still to be sent may go out at once.
        in_s = max(0.0, self._until_s - now_s) if self._number is None else 0.0
        way_to = partial(
            entry_of,
            self._parts.flight.state,
            ownship,
            order.flown.path,
            order.waypoints,
            number=self._number,
        )
        number = way_to(in_s)
        if number is None:
            return None
        # Over a slow line the aircraft is farther than it is known to be, and farther still when it is told.
        slow_s = self._parts.link.round_trip_s
        late_s = max(0.0 if self._number is None else self._late_s, slow_s if slow_s > LATER_S else 0.0)
        if late_s > 0.0 and way_to(in_s + late_s, number=number) is None:
            return None
        self._number = number
        return sequence_of_waypoint(order.flown.mission, number)


class SwapProtocol(Protocol):
    """How one kind of autopilot keeps a list, and how a new mission gets into it and is flown.

    Attributes
    ----------
    wants_landing : bool
        Whether the autopilot is at a loss with a mission that does not end in a landing.
    """

    wants_landing: bool

    def without_ours(self, read: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
        """The operator's items in a list as read."""
        ...

    def layout_of(self, read: tuple[MissionItem, ...], operator: Operator, current: int, /) -> Layout:
        """How ours are to stand in a list as read, in which the item ``current`` is flown."""
        ...

    def span_of_ours(self, read: tuple[MissionItem, ...], layout: Layout, /) -> tuple[int, int] | None:
        """First sequence of the part of ours that may be flown, and the one behind its last; None without."""
        ...

    def layout_as_flown(self, layout: Layout, ours: tuple[MissionItem, ...], /) -> Layout:
        """The layout where a part of ours was found to be flown."""
        ...

    async def carry_out(self, order: SwapOrder) -> tuple[SwapOutcome, str]:
        """Store a mission and enter it at its instant; broken off, what was flown stays whole."""
        ...
