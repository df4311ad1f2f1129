"""Missions on their way to the autopilot: handed over at their instant, recorded, and told.

What is known of the list is part of the flight's state; how an autopilot stores and enters a mission is its
protocol's business.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Coroutine

from companion.errors import CompanionError
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
from companion.flight.state.mission_construction import ConstructedMission
from companion.mission.swap import SwapOutcome
from companion.recording.recorder import Recorder
from companion.types.mission import Mission
from companion.types.record import SwapRecord

GIVEN_UP_S = 0.8  # A plan and an exchange take about as long.
ENTER_EARLY_S = 1.0  # before the plan's start: later the entry would lie behind
WITHDRAWN = SwapOutcome.WITHDRAWN, "the mode was changed"

__all__ = ["Handover", "SwapOutcome"]


class Handover:
    """Swaps of what is flown.

    Parameters
    ----------
    protocols : SwapProtocols
        How missions are stored and entered, and what is worked with: flight state, link, aircraft, clock.
    announcer : Announcer
        Told what came of each.
    checkpoint : Checkpoint
        Keeps the path that is flown, for a restart.
    recorder : Recorder
        Keeps what was sent.
    observer : Observer
        Told how each ended.

    Attributes
    ----------
    protocols : SwapProtocols
        How missions are stored and entered.
    reader : ListReader
        Knows the autopilot's list.
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
        self.protocols = protocols
        self.reader = ListReader(protocols, announcer, checkpoint)
        self._flight, self._link, self._clock = parts.flight, parts.link, parts.clock
        self._announcer = announcer
        self._checkpoint = checkpoint
        self._recorder = recorder
        self._observer = observer
        self._offered: Mission | None = None
        self._exchanging: asyncio.Task[tuple[SwapOutcome, str]] | None = None

    def is_settled(self) -> bool:
        """Whether it is known what is flown; takes it from the autopilot where an answer was lost.

        An entry that was asked for and not acknowledged may well be flown: to write there would change
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
            tell, turn, time = self._announcer.news.of(state, pending.flown.path, None, now)
            self._announcer.decide(DecisionKind.SWAP, text, tell=tell, turn=turn, time=time)
            self._announcer.flown(pending.flown.path.positions_enu_m, "unanswered")
        return True

    def _take(self, swap: PendingSwap | SwapOrder) -> None:
        """Count a mission as flown."""
        flown = swap.flown
        self._flight.apply(after_swap, swap.layout, flown, self._link.current)
        ours = flown.mission.items[slice(*swap.layout.flown_span)]
        self._checkpoint.note_flown(key_of(ours), flown.path, flown.covered_until_s)

    async def hand_over(
        self,
        shaped: ConstructedMission,
        plan_number: int,
        plan_ms: float,
        track_s: float,
        occasion: str,
        *,
        is_urgent: bool = False,
    ) -> SwapOutcome:
        """Hand a mission over when the aircraft is where it begins, and tell what came of it.

        Parameters
        ----------
        shaped : ConstructedMission
            What is to be flown.
        plan_number : int
            Number of the plan behind it.
        plan_ms : float
            The computer's time for it [ms].
        track_s : float
            When the newest track came that it knew, by the clock [s]; not finite without any.
        occasion : str
            Why it was made.
        is_urgent : bool
            Whether it answers a surprise.

        Raises
        ------
        PlanBrokenOffError
            If it was given up.
        """
        is_acting = self._flight.state.may_act
        before = self._flight.state.flown
        enter_s = shaped.start.state.stamp_s - ENTER_EARLY_S if is_acting else 0.0
        begun_s = self._clock.now_s()
        outcome, reason = await self._unless_withdrawn(
            self.swap(shaped, enter_s, plan_number, is_urgent=is_urgent)
        )
        self._observer.exchanged(outcome)
        now, mission, places = self._clock.now_s(), self._offered, shaped.waypoints.positions_enu_m
        if mission is not None:
            self._recorder.swap(
                now,
                SwapRecord(outcome.value, reason, begun_s, now, mission.plan_number, mission.items, places),
            )
        facts = {"occasion": occasion, **shaped.why}
        if outcome is not SwapOutcome.FLOWN:
            self._announcer.count_rejected()
            self._announcer.decide(DecisionKind.REJECTED, f"{outcome.value}: {reason}", plan_ms, why=facts)
            return outcome
        latency = 1e3 * (now - track_s) if math.isfinite(track_s) else None
        self._announcer.flown(places, shaped.verdict.value if is_acting else "ready", latency)
        text = f"{shaped.verdict.value}, {shaped.text}; {reason}"
        kind = DecisionKind.SWAP if is_acting else DecisionKind.READY
        state = self._flight.state
        tell, turn, time = (
            self._announcer.news.of(state, shaped.path, before, now) if is_acting else ("", "", "")
        )
        self._announcer.decide(kind, text, plan_ms, latency, facts, tell=tell, turn=turn, time=time)
        return outcome

    async def swap(
        self, shaped: ConstructedMission, enter_s: float, plan_number: int, *, is_urgent: bool = False
    ) -> tuple[SwapOutcome, str]:
        """Store a mission and enter it at an instant; broken off, what was flown stays whole.

        Parameters
        ----------
        shaped : ConstructedMission
            What is to be flown.
        enter_s : float
            When the aircraft is where the path begins, by the clock [s].
        plan_number : int
            Number of the plan behind it.
        is_urgent : bool
            Whether it is entered before, where a way leads in.
        """
        layout = self._flight.listed.layout
        if layout is None:
            return SwapOutcome.REFUSED, "the autopilot's mission is not known"
        is_first = self._flight.state.flown is None  # nothing checked is left too early then
        order = order_for(
            shaped, layout, plan_number=plan_number, enter_s=enter_s, is_urgent=is_urgent or is_first,
            is_short=is_urgent,
        )  # fmt: skip
        self._offered = order.flown.mission
        self._flight.apply_to_list(after_swap_begun)
        try:
            outcome, reason = await self.protocols.now.carry_out(order)
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
        """Carry out an exchange; :meth:`break_off` ends it where it stands."""
        if not self._flight.state.may_write:  # since the plan was made
            exchange.close()
            return WITHDRAWN
        self._exchanging = asyncio.create_task(exchange)
        try:
            return await self._exchanging
        except asyncio.CancelledError:
            own = asyncio.current_task()
            if own is None or own.cancelling():  # the service itself ends
                raise
            return WITHDRAWN
        finally:
            self._exchanging = None

    @property
    def may_give_up(self) -> bool:
        """Whether a mission that answers no surprise waits, and for longer than another takes."""
        return self._flight.listed.waits_until_s - self._clock.now_s() > GIVEN_UP_S

    def give_up(self, why: str) -> None:
        """Do not enter the mission that waits, if :attr:`may_give_up`: who handed it over is told why."""
        self._flight.apply_to_list(after_unwanted, why)

    def break_off(self) -> None:
        """End an exchange that is under way where it stands."""
        if self._exchanging is not None:
            self._exchanging.cancel()

    async def return_to_launch(self) -> None:
        """Have the autopilot return to launch; the pilot is told if it does not."""
        try:
            await self._link.set_mode("RTL")
        except CompanionError as error:
            text = f"return to launch: {error}"
            self._announcer.decide(DecisionKind.EMERGENCY, text, tell="take over")
