"""Keep a checked return path in the autopilot's list while the service flies.

An ArduPlane with RTL_AUTOLAND 2 or 4 joins it in a return to launch, whoever begins that and whether or not
the service still runs. The return path is planned like any path, from a place that the aircraft is about to
pass, to the operator's landing, else to a circle over home, else to a rally point. It is planned again before
a return from the flown path would no longer keep clear. One that would need more than the battery holds does
not replace one by which the aircraft can still return: it returns by that one before it ends.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from companion.flight.exchange.return_exchange import STOPPED, ReturnExchange
from companion.flight.monitors.energy_watch import EnergyWatch
from companion.flight.prediction.energy_ahead import affords
from companion.flight.prediction.outward_path import outward_path
from companion.flight.prediction.return_mission import (
    ReturnMission,
    covered_s,
    return_mission,
    turns_about,
    with_bank,
)
from companion.flight.prediction.return_places import (
    begin_return,
    is_return_wanted,
    may_renew,
    return_places,
)
from companion.flight.replanning.plan_maker import return_request
from companion.flight.replanning.replanning_parts import ReplanningParts
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import FlightState
from companion.flight.state.progress import start_after
from companion.planning.problem import GoalRegion
from companion.types.path import Path
from companion.types.plan import Plan
from companion.types.state import Ownship

LOOK_S = 2.0  # Period with which the return path is judged.
# The return path follows the flown path for one of these times, the first that does, and then turns back. Up
# to there a return that begins on the flown path joins it without a turn.
AHEAD_S = (20.0, 10.0, 30.0, 5.0)
# A return path is renewed when it covers the flown path for less than the first time; also, that long after
# the last one, when a return that begins in the second time would turn about to join it.
RENEWED_S, AHEAD_MIN_S = 12.0, 4.0
# After a return path could not be made or stored, it is tried again after this time; after `LOOK_S` if the
# stored one ends sooner.
AGAIN_S = 6.0
FAILURES_MAX = 5  # An autopilot that refuses this often in a row is not asked again.
STOP_S = 1.0  # An exchange that should end is cancelled after this time.


class WayHome:
    """Keeps the return path up to date.

    Parameters
    ----------
    parts : ReplanningParts
        The parts of replanning.
    energy : EnergyWatch
        Knows what is left on board.

    Attributes
    ----------
    stored : ReturnMission or None
        The return path in the autopilot's list.
    """

    def __init__(self, parts: ReplanningParts, energy: EnergyWatch) -> None:
        self._parts, self._energy = parts, energy
        self._exchange = ReturnExchange(parts.handover.protocols.parts)
        self._storing: asyncio.Task[None] | None = None
        self._next_s = self._ahead_until_s = -math.inf
        self._judged: Path | None = None
        self._num_failures = 0
        self.stored: ReturnMission | None = None

    async def keep_up(self) -> None:
        """Judge the return path, and renew it if that is due; nothing is done while one is being stored.

        Raises
        ------
        PlanBrokenOffError
            If a surprise broke off the plan of a return path.
        """
        parts, now = self._parts, self._parts.clock.now_s()
        state, ownship = parts.flight.state, parts.world_model.ownship.state(now)
        if ownship is None or not self._is_due(state, now):
            return
        self._next_s, self._judged = now + LOOK_S, None if state.flown is None else state.flown.path
        covers_s = covered_s(state, ownship, state.mission_list.stored)
        if covers_s >= RENEWED_S and self._is_ahead(state, ownship, now):
            self._energy.note_last_way_home(math.inf)
            return
        self._ahead_until_s = now + RENEWED_S
        found = await self._planned(state, ownship)
        self._next_s = parts.clock.now_s() + (LOOK_S if 0.0 < covers_s <= AGAIN_S else AGAIN_S)
        if found is not None:
            left = self._energy.now(parts.clock.now_s())
            is_afforded = covers_s <= 0.0 or affords(state, ownship, with_bank(state, found.bank), left)
            self._store_if_afforded(
                found, now + covers_s, is_afforded=is_afforded, is_due=covers_s < RENEWED_S
            )

    def _store_if_afforded(
        self, found: ReturnMission, ends_s: float, *, is_afforded: bool, is_due: bool
    ) -> None:
        """Store a return path that the battery affords; else the stored one is the last, which ends then."""
        self._energy.note_last_way_home(ends_s if is_due and not is_afforded else math.inf)
        if is_afforded and self._parts.flight.state.may_act:
            self._storing = asyncio.create_task(self._store(found))

    def _is_ahead(self, state: FlightState, ownship: Ownship, now_s: float) -> bool:
        """Return whether a return joins the return path without turning about, or a new one is recent."""
        return now_s < self._ahead_until_s or not turns_about(
            state, ownship, state.mission_list.stored, AHEAD_MIN_S
        )

    def _is_due(self, state: FlightState, now_s: float) -> bool:
        """Return whether the return path is to be judged: once in a while, or since another path is flown."""
        is_storing = self._storing is not None and not self._storing.done()
        if is_storing or not is_return_wanted(state) or self._num_failures >= FAILURES_MAX:
            return False
        is_other = state.flown is not None and state.flown.path is not self._judged
        return is_other or now_s >= self._next_s

    def renew_rest(self) -> bool:
        """Let the service plan the rest of a return that follows the stored path; return whether it does."""
        flight, stored, current = self._parts.flight, self.stored, self._parts.handover.reader.current
        ownship = self._parts.world_model.ownship.state(self._parts.clock.now_s())
        if stored is None or current is None or ownship is None or not may_renew(flight.state):
            return False
        begin_return(flight, ownship, stored, current)
        self._parts.announcer.decide(DecisionKind.RETURN, "its rest is planned", tell="return renewed")
        return True

    async def stop(self) -> None:
        """End the exchange of a return path, because a mission may be handed over."""
        storing = self._storing
        if storing is None or storing.done():
            return
        if not self._exchange.stop():
            alarm = asyncio.create_task(self._parts.clock.sleep_until(self._parts.clock.now_s() + STOP_S))
            await asyncio.wait({storing, alarm}, return_when=asyncio.FIRST_COMPLETED)
            alarm.cancel()
        self.break_off()
        with contextlib.suppress(asyncio.CancelledError):
            await storing

    def break_off(self) -> None:
        """Cancel the exchange of a return path."""
        if self._storing is not None:
            self._storing.cancel()

    async def _planned(self, state: FlightState, ownship: Ownship) -> ReturnMission | None:
        """Plan to the places where a return may end, in their order, until one can be reached.

        If no path that is found covers the flown path for long, paths away from it are planned, too.
        """
        parts, best = self._parts, None
        begun = start_after(state, ownship, 0.0)
        if begun.rest is None:
            return None
        snapshot = parts.world_model.snapshot(parts.clock.now_s())
        places = return_places(state, ownship.position_enu_m)
        for keeps_away, ahead_s, (place, is_landing) in product((False, True), AHEAD_S, places):
            start = start_after(state, ownship, ahead_s)
            if start.rest is None:
                continue
            world = snapshot
            if keeps_away:
                world = snapshot.with_prisms(outward_path(begun.rest, float(start.rest.times_s[0])))
            conclude = partial(_concluded, state, ownship, begun.rest, place, is_landing=is_landing)
            request = return_request(state, start, world, place)
            _, found = await parts.maker.make(request, conclude, may_break_off=True)
            if found is not None and (best is None or found.covered_s > best.covered_s):
                best = found
            if best is not None and best.covered_s >= RENEWED_S:
                break
        return best if best is not None and best.covered_s > 0.0 else None

    async def _store(self, found: ReturnMission) -> None:
        """Store a return path, and record how that ended."""
        failure = await self._exchange.store(found.bank, found.speed)
        self._num_failures = 0 if not failure else self._num_failures + (failure != STOPPED)
        if failure:
            self._parts.announcer.decide(DecisionKind.RETURN, f"not stored: {failure}")
        else:
            self._announce(found)

    def _announce(self, found: ReturnMission) -> None:
        """Record that a return path is stored; inform the pilot of the first one."""
        length_km = 1e-3 * float(found.path.travelled_m[-1])
        why = {"covered_s": found.covered_s, "length_km": length_km}
        tell = "return path" if self.stored is None else ""
        text = f"stored, {length_km:.1f} km"
        self._parts.announcer.decide(DecisionKind.RETURN, text, why=why, tell=tell, length=f"{length_km:.1f}")
        self.stored = found


def _concluded(
    state: FlightState, ownship: Ownship, flown: Path, place: GoalRegion, plan: Plan, *, is_landing: bool
) -> ReturnMission | None:
    """Return a plan, behind a part of the flown path, as a return path; None if it does not reach its end."""
    if plan.path is None or not plan.reaches_goal or len(flown) < 2:
        return None
    away = np.linalg.norm(flown.positions_enu_m - plan.path.positions_enu_m[0], axis=1)
    row = max(int(np.argmin(away)) - 1, 0)
    out, times_s = flown.until(row), flown.times_s
    row_m = float(np.linalg.norm(flown.positions_enu_m[row + 1] - flown.positions_enu_m[row]))
    # The aircraft flies a little faster or slower than its path says, but the path's times have no gap.
    begins_s = times_s[row] + (times_s[row + 1] - times_s[row]) * away[row] / max(row_m, 1.0)
    planned = replace(plan.path, times_s=plan.path.times_s - plan.path.times_s[0] + begins_s)
    path = out.followed_by(planned, shares_row=False)
    return return_mission(state, ownship, path, float(out.travelled_m[-1]), place, is_landing=is_landing)
