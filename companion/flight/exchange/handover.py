"""Hand missions over to the autopilot at the right time, record the exchange and inform the pilot.

Knowledge of the list is part of the flight's state. Storing and entering a mission is the autopilot's
`SwapProtocol`.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Coroutine

from companion.errors import CompanionError
from companion.flight.construction.mission_construction import ConstructedMission
from companion.flight.exchange.list_reader import ListReader
from companion.flight.exchange.protocols import SwapProtocols
from companion.flight.exchange.swap_protocol import SwapOrder, order_for
from companion.flight.messages.announcer import Announcer
from companion.flight.messages.observer import Observer
from companion.flight.state.checkpoint import Checkpoint, key_of
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import after_swap
from companion.flight.state.list_state import (
    PendingSwap,
    after_settled,
    after_swap_begun,
    after_swap_ended,
    after_unwanted,
)
from companion.mission.swap import NotApprovedError, SwapOutcome
from companion.recording.recorder import Recorder
from companion.types.mission import Mission
from companion.types.record import SwapRecord

GIVE_UP_WAIT_MIN_S = 0.8  # A new plan and its exchange take about this long: a shorter wait is not given up.
ENTER_EARLY_S = 1.0  # A mission is entered this long before its plan's start; later the entry is passed.
WITHDRAWN = SwapOutcome.WITHDRAWN, "the mode was changed"


class Handover:
    """Swaps of the flown mission.

    Parameters
    ----------
    protocols : SwapProtocols
        The autopilots' protocols, with flight state, link, aircraft and clock.
    announcer : Announcer
        Announces the results to the pilot.
    checkpoint : Checkpoint
        Stores the flown path for a restart.
    recorder : Recorder
        Records the missions that are sent.
    observer : Observer
        Counts the results.

    Attributes
    ----------
    protocols : SwapProtocols
        The autopilots' protocols.
    reader : ListReader
        Reads the autopilot's list.
    """

    def __init__(
        self,
        protocols: SwapProtocols,
        announcer: Announcer,
        checkpoint: Checkpoint,
        recorder: Recorder,
        observer: Observer,
    ) -> None:
        parts = protocols.parts
        self._team = protocols.team
        self.protocols = protocols
        self.reader = ListReader(protocols, announcer, checkpoint)
        self._flight, self._link, self._clock = parts.flight, parts.link, parts.clock
        self._announcer = announcer
        self._checkpoint = checkpoint
        self._recorder = recorder
        self._observer = observer
        self._offered: Mission | None = None
        self._exchanging: asyncio.Task[tuple[SwapOutcome, str]] | None = None
        self._is_reserved = False

    def reserve(self, *, is_reserved: bool) -> None:
        """Hand over no planned mission while the aircraft glides down, and end the exchange of one."""
        if is_reserved and not self._is_reserved:
            self._link.complete_while(lambda: self._is_reserved and self._flight.state.may_act)
            self.break_off()
        self._is_reserved = is_reserved

    async def glide(self, constructed: ConstructedMission) -> tuple[bool, str]:
        """Hand over a mission to a field at once, whatever is reserved; nothing is announced.

        Returns whether it is flown, and the result in words.
        """
        begun_s = self._clock.now_s()
        outcome, reason = await self.swap(constructed, 0.0, 0, is_urgent=True)
        self._note_exchange(constructed, outcome, reason, begun_s)
        is_flown = outcome is SwapOutcome.FLOWN
        if is_flown:
            self._announcer.flown(constructed.waypoints.positions_enu_m, constructed.text)
        return is_flown, f"{outcome.value}, {reason}"

    async def fly_item(self, number: int) -> str:
        """Make an item of the flown mission current; return why the autopilot refuses, '' if it does not.

        Parameters
        ----------
        number : int
            Number of the item, counted from the mission's first.
        """
        flown = self._flight.state.flown
        if flown is None:
            return "no mission of the service is flown"
        try:
            await self._link.set_current(flown.mission.entry + number)
        except CompanionError as error:
            return str(error)
        return ""

    def is_settled(self) -> bool:
        """Return whether the flown mission is known; learn it from the autopilot if an answer was lost.

        An entry that was requested and not acknowledged may well be flown. Writing to that bank would change
        the mission under the aircraft.
        """
        listed, current = self._flight.listed, self._link.current
        pending = listed.pending
        if pending is None or current is None or not listed.has_settled(current):
            return pending is None
        self._flight.apply_to_list(after_settled)
        if listed.is_pending_flown(current):
            self._take(pending)
            text = f"entered at item {current.sequence}, though unanswered"
            state, now = self._flight.state, self._clock.now_s()
            news = self._announcer.news.of(state, pending.flown.path, None, now)
            tell, turn, arrival = news if state.may_act else ("", "", "")
            self._announcer.decide(DecisionKind.SWAP, text, tell=tell, turn=turn, arrival=arrival)
            self._announcer.flown(pending.flown.path.positions_enu_m, "unanswered")
        return True

    def _take(self, swap: PendingSwap | SwapOrder) -> None:
        """Make a mission the flown one in the flight's state and in the checkpoint."""
        flown = swap.flown
        self._flight.apply(after_swap, swap.layout, flown, self._link.current)
        self._team.end(is_flown=True)
        ours = flown.mission.items[slice(*swap.layout.flown_span)]
        self._checkpoint.note_flown(key_of(ours), flown.path, flown.covered_until_s)

    async def hand_over(
        self,
        constructed: ConstructedMission,
        plan_number: int,
        plan_ms: float,
        track_s: float,
        occasion: str,
        *,
        is_urgent: bool = False,
    ) -> SwapOutcome:
        """Hand a mission over when the aircraft reaches its start, and announce the result.

        Parameters
        ----------
        constructed : ConstructedMission
            The mission to be flown.
        plan_number : int
            Number of its plan.
        plan_ms : float
            Computing time of the plan [ms].
        track_s : float
            Arrival time of the newest track that the plan used, by the clock [s]; not finite without tracks.
        occasion : str
            Why the plan was made.
        is_urgent : bool
            Whether the mission answers a surprise.

        Raises
        ------
        PlanBrokenOffError
            If the mission is given up.
        """
        is_acting = self._flight.state.may_act
        before = self._flight.state.flown
        enter_s = constructed.start.state.stamp_s - ENTER_EARLY_S if is_acting else 0.0
        begun_s = self._clock.now_s()
        try:
            if is_acting and (conflict := self._team.propose(constructed)):
                outcome, reason = SwapOutcome.REFUSED, f"it conflicts with {conflict}"
            else:
                outcome, reason = await self._unless_withdrawn(
                    self.swap(constructed, enter_s, plan_number, is_urgent=is_urgent)
                )
        finally:
            if self._flight.listed.pending is None:  # An unanswered request may yet be flown.
                self._team.end(is_flown=False)
        self._note_exchange(constructed, outcome, reason, begun_s)
        now, places = self._clock.now_s(), constructed.waypoints.positions_enu_m
        facts = {"occasion": occasion, **constructed.why}
        if outcome is not SwapOutcome.FLOWN:
            self._announcer.count_rejected()
            self._announcer.decide(DecisionKind.REJECTED, f"{outcome.value}: {reason}", plan_ms, why=facts)
            return outcome
        latency = 1e3 * (now - track_s) if math.isfinite(track_s) else None
        self._announcer.flown(places, constructed.verdict.value if is_acting else "ready", latency)
        text = f"{constructed.verdict.value}, {constructed.text}; {reason}"
        kind = DecisionKind.SWAP if is_acting else DecisionKind.READY
        state = self._flight.state
        tell, turn, arrival = (
            self._announcer.news.of(state, constructed.path, before, now) if is_acting else ("", "", "")
        )
        self._announcer.decide(kind, text, plan_ms, latency, facts, tell=tell, turn=turn, arrival=arrival)
        self._announcer.tell_of_fields(constructed.why)
        return outcome

    def _note_exchange(
        self, constructed: ConstructedMission, outcome: SwapOutcome, reason: str, begun_s: float
    ) -> None:
        """Count and record an exchange."""
        self._observer.exchanged(outcome)
        now, mission, places = self._clock.now_s(), self._offered, constructed.waypoints.positions_enu_m
        if mission is not None:
            self._recorder.swap(
                now,
                SwapRecord(outcome.value, reason, begun_s, now, mission.plan_number, mission.items, places),
            )

    async def swap(
        self, constructed: ConstructedMission, enter_s: float, plan_number: int, *, is_urgent: bool = False
    ) -> tuple[SwapOutcome, str]:
        """Store a mission and enter it at a given time. If interrupted, the flown mission stays intact.

        Parameters
        ----------
        constructed : ConstructedMission
            The mission to be flown.
        enter_s : float
            When the aircraft reaches the start of the path, by the clock [s].
        plan_number : int
            Number of the mission's plan.
        is_urgent : bool
            Whether the mission is entered earlier if a safe entry exists.
        """
        layout = self._flight.listed.layout
        if layout is None:
            return SwapOutcome.REFUSED, "the autopilot's mission is not known"
        # There is no checked mission that could be left too early.
        is_first = self._flight.state.flown is None
        order = order_for(
            constructed, layout, plan_number=plan_number, enter_s=enter_s, is_urgent=is_urgent or is_first,
            is_short=is_urgent,
        )  # fmt: skip
        self._offered = order.flown.mission
        self._flight.apply_to_list(after_swap_begun)
        try:
            outcome, reason = await self.protocols.now.carry_out(order)
        except NotApprovedError as error:
            outcome, reason = SwapOutcome.REFUSED, str(error)
        finally:
            self._flight.apply_to_list(after_swap_ended, self._clock.now_s())
        if outcome in (SwapOutcome.FLOWN, SwapOutcome.STALE, SwapOutcome.FOREIGN):
            self._flight.apply_to_list(after_settled)
        if outcome is SwapOutcome.FLOWN:
            self._take(order)
        return outcome, reason

    async def _unless_withdrawn(
        self, exchange: Coroutine[object, object, tuple[SwapOutcome, str]]
    ) -> tuple[SwapOutcome, str]:
        """Carry out an exchange; :meth:`break_off` cancels it."""
        # The pilot may have taken over, or the thrust be gone, since the plan was made.
        if not self._flight.state.may_write or self._is_reserved:
            exchange.close()
            return WITHDRAWN
        self._exchanging = asyncio.create_task(exchange)
        try:
            return await self._exchanging
        except asyncio.CancelledError:
            own = asyncio.current_task()
            if own is None or own.cancelling():  # The service itself ends.
                raise
            return WITHDRAWN
        finally:
            self._exchanging = None

    @property
    def may_give_up(self) -> bool:
        """Whether a mission that answers no surprise still waits for longer than a new one would take."""
        return self._flight.listed.waits_until_s - self._clock.now_s() > GIVE_UP_WAIT_MIN_S

    def give_up(self, why: str) -> None:
        """Do not enter the waiting mission, if :attr:`may_give_up`; its sender receives the reason."""
        self._flight.apply_to_list(after_unwanted, why)

    def break_off(self) -> None:
        """Cancel the exchange that is under way."""
        if self._exchanging is not None:
            self._exchanging.cancel()

    async def return_to_launch(self) -> None:
        """Command return to launch; inform the pilot if the autopilot does not obey."""
        try:
            await self._link.set_mode("RTL")
        except CompanionError as error:
            text = f"return to launch: {error}"
            self._announcer.decide(DecisionKind.EMERGENCY, text, tell="take over")
