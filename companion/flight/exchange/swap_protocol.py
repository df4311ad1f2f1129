"""The interface of a swap on any kind of autopilot, and the parts that all swaps share."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

from companion.clock import Clock
from companion.flight.construction.mission_construction import ConstructedMission
from companion.flight.exchange.entry import DELAY_VARIATION_S, entry_of, may_be_entered
from companion.flight.state.flight_state import StateOwner
from companion.flight.state.list_state import FlownPath, PendingSwap, after_reading, after_waiting
from companion.link.missions.autopilot_link import AutopilotLink
from companion.mission.list_layout import Layout, TwoBankLayout
from companion.mission.mission_id import mission_id
from companion.mission.operator import Operator
from companion.mission.swap import Consent, NotApprovedError, SwapOutcome
from companion.mission.waypoints import Waypoints, sequence_of_waypoint
from companion.planning.plan_runner import PlanBrokenOffError
from companion.tracking.ownship import OwnshipEstimator
from companion.types.mission import MissionItem
from companion.types.state import Ownship

LOOK_INTERVAL_S = 0.2  # An urgent mission looks for an entry at this interval.


@dataclass(frozen=True, slots=True)
class SwapOrder:
    """A mission to be handed over.

    Parameters
    ----------
    flown : FlownPath
        Path and mission once the mission is entered.
    waypoints : Waypoints
        The mission's waypoints.
    layout : Layout
        The list's layout once the mission is flown.
    identity : int
        PX4's identifier of the mission.
    enter_s : float
        When the aircraft reaches the start of the path, by the clock [s].
    is_urgent : bool
        Whether the mission is entered earlier, as soon as a safe entry exists.
    enters_at : int or None
        Same as in ``ConstructedMission``.
    """

    flown: FlownPath
    waypoints: Waypoints
    layout: Layout
    identity: int
    enter_s: float
    is_urgent: bool = False
    enters_at: int | None = None

    def pending(self, asked_s: float, identity: int) -> PendingSwap:
        """Return the pending swap once the entry is requested."""
        return PendingSwap(asked_s, self.layout, self.flown, self.waypoints, identity)


def order_for(
    constructed: ConstructedMission,
    layout: Layout,
    *,
    plan_number: int,
    enter_s: float,
    is_urgent: bool = False,
    is_short: bool = False,
) -> SwapOrder:
    """Insert a mission into the list.

    Parameters
    ----------
    constructed : ConstructedMission
        The mission to be flown.
    layout : Layout
        The list's present layout.
    plan_number : int
        Number of the mission's plan.
    enter_s : float
        When the aircraft reaches the start of the path, by the clock [s].
    is_urgent : bool
        Whether the mission is entered as soon as possible.
    is_short : bool
        Whether a first mission on an ArduPlane omits the idle bank. It is stored sooner, but the next mission
        later, because its list has to be uploaded completely.
    """
    items = layout.items_for(constructed.part)
    if isinstance(layout, TwoBankLayout) and layout.flown is None and not is_short:
        layout = replace(layout, flown=items)
    mission, after = layout.with_new(items, plan_number)
    flown = FlownPath(constructed.path, mission, constructed.covered_until_s, cost=constructed.cost)
    return SwapOrder(
        flown, constructed.waypoints, after, mission_id(mission.items), enter_s, is_urgent,
        constructed.enters_at,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class SwapParts:
    """The objects that every swap works with.

    Parameters
    ----------
    flight : StateOwner
        The flight's state, to which knowledge of the list is applied.
    link : AutopilotLink
        The link to the autopilot.
    ownship : OwnshipEstimator
        The estimate of the aircraft.
    clock : Clock
        The service's clock.
    consent : Consent
        Without it no mission is entered.
    """

    flight: StateOwner
    link: AutopilotLink
    ownship: OwnshipEstimator
    clock: Clock
    consent: Consent

    def state(self) -> Ownship | None:
        """Return the aircraft's state now; None while it is not known."""
        return self.ownship.state(self.clock.now_s())

    def may_act(self) -> bool:
        """Return whether the pilot leaves the list to the service now."""
        return self.flight.state.may_write

    def may_be_entered(self, order: SwapOrder) -> bool:
        """Return whether a mission can be entered; while the pilot flies, it is only kept ready."""
        ownship, state = self.state(), self.flight.state
        if ownship is None or not state.may_act or order.enters_at is not None:
            return True
        return may_be_entered(state, ownship, order.flown.path, order.waypoints)

    async def until_due(self, order: SwapOrder, duration_s: float = 0.0) -> None:
        """Wait until a mission that takes ``duration_s`` [s] to send is entered at the start of its path.

        An urgent order waits only until a safe entry exists from the aircraft's predicted position.

        Raises
        ------
        PlanBrokenOffError
            If the mission is no longer wanted.
        NotApprovedError
            If others do not let it be entered.
        """
        due_s = order.enter_s - duration_s
        self.flight.apply_to_list(after_waiting, -math.inf if order.is_urgent else due_s)
        while (now_s := self.clock.now_s()) < due_s or not self.consent.is_given:
            is_ready = order.is_urgent and self.consent.is_given
            if is_ready and Entry(self, order, duration_s).sequence() is not None:
                break
            if why := self.flight.listed.unwanted:
                raise PlanBrokenOffError(why)
            if why := self.consent.refusal:
                raise NotApprovedError(why)
            next_look_s = now_s + LOOK_INTERVAL_S
            await self.clock.sleep_until(min(due_s, next_look_s) if now_s < due_s else next_look_s)
        self.consent.hold()
        self.flight.apply_to_list(after_waiting, -math.inf)

    async def read(self, num_left_out: int = 0) -> tuple[MissionItem, ...]:
        """Read the autopilot's list, by the faster method if it is known to be an ArduPlane's.

        Parameters
        ----------
        num_left_out : int
            Number of items at the end of an ArduPlane's list that are not read.
        """
        is_bank = isinstance(self.flight.listed.layout, TwoBankLayout)
        read = await (self.link.read_back(num_left_out=num_left_out) if is_bank else self.link.download())
        self.flight.apply_to_list(after_reading, self.clock.now_s(), len(read) + num_left_out)
        return read


class Entry:
    """The entry of a mission: chosen at the first call, and only confirmed afterwards.

    Parameters
    ----------
    parts : SwapParts
        The aircraft and the clock.
    order : SwapOrder
        The mission to be entered.
    duration_s : float
        Time from now until the aircraft is sent to the entry [s].
    late_s : float
        Delay with which a repeated command may still take effect [s].

    Attributes
    ----------
    asked_s : float
        Time of the last call [s].
    """

    def __init__(
        self, parts: SwapParts, order: SwapOrder, duration_s: float = 0.0, *, late_s: float = 0.0
    ) -> None:
        self._parts = parts
        self._order = order
        self._late_s = late_s
        self._until_s = parts.clock.now_s() + duration_s
        self._number: int | None = None
        self.asked_s = parts.clock.now_s()

    def sequence(self) -> int | None:
        """Return the sequence of the entry; None if there is none, or the chosen one is no longer safe."""
        self.asked_s = now_s = self._parts.clock.now_s()
        ownship, order = self._parts.state(), self._order
        if order.enters_at is not None:
            return order.flown.mission.entry + order.enters_at
        if ownship is None:
            return None
        # A repeated call comes before the last message: what is left to be sent may be sent at once.
        in_s = max(0.0, self._until_s - now_s) if self._number is None else 0.0
        find_entry = partial(
            entry_of,
            self._parts.flight.state,
            ownship,
            order.flown.path,
            order.waypoints,
            number=self._number,
        )
        number = find_entry(in_s)
        if number is None:
            return None
        # With a slow link the aircraft is ahead of its estimate, and the command arrives late as well.
        slow_s = self._parts.link.round_trip_s
        late_s = max(
            0.0 if self._number is None else self._late_s, slow_s if slow_s > DELAY_VARIATION_S else 0.0
        )
        if late_s > 0.0 and find_entry(in_s + late_s, number=number) is None:
            return None
        self._number = number
        return sequence_of_waypoint(order.flown.mission, number)


class SwapProtocol(Protocol):
    """The protocol by which a new mission is stored in one kind of autopilot and entered.

    Parameters
    ----------
    parts : SwapParts
        The objects that the protocol works with.

    Attributes
    ----------
    wants_landing : bool
        Whether the autopilot rejects a mission that does not end in a landing.
    """

    wants_landing: bool
    _parts: SwapParts

    def __init__(self, parts: SwapParts) -> None:
        self._parts = parts

    def without_ours(self, read: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
        """Return the operator's items in a list as read."""
        ...

    def layout_of(self, read: tuple[MissionItem, ...], operator: Operator, current: int, /) -> Layout:
        """Return the layout of a list as read, in which the item ``current`` is flown."""
        ...

    def span_of_ours(self, read: tuple[MissionItem, ...], layout: Layout, /) -> tuple[int, int] | None:
        """Return first and end sequence of the service's items that may be flown; None without."""
        ...

    def layout_as_flown(self, layout: Layout, ours: tuple[MissionItem, ...], /) -> Layout:
        """Return the layout if some of the service's items were found to be flown."""
        ...

    async def carry_out(self, order: SwapOrder) -> tuple[SwapOutcome, str]:
        """Store a mission and enter it at its time. If interrupted, the flown mission stays intact."""
        ...
