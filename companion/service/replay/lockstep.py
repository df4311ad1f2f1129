"""The service on a clock that others move: what a simulated flight and a replay share.

Time moves in steps and stands still while it is the service's turn to speak: while it plans, and while
MAVSDK's threads prepare an answer. So a flight runs as fast as the computer can, and the same bytes at the
same instants make the service say the same, however slow the computer is.
"""

from __future__ import annotations

import asyncio
import time

from companion.clock import ManualClock
from companion.flight.tasks.app import App
from companion.link.wire.memory_transport import MemoryTransport

STEP_S = 0.02
SETTLE_TURNS = 10  # event-loop turns in which the service's tasks take what a step brought
TURN_TIMEOUT_S = 5.0  # wall clock, for MAVSDK's next word; far beyond what a busy computer needs
_POLL_S = 0.0002


async def step(
    app: App,
    clock: ManualClock,
    theirs: MemoryTransport,
    data: bytes,
    until_s: float,
    turn_timeout_s: float = TURN_TIMEOUT_S,
) -> None:
    """Let bytes arrive now, move the clock, and let the service act on both.

    Parameters
    ----------
    app : App
        The service.
    clock : ManualClock
        The clock that the service reads.
    theirs : MemoryTransport
        The other end of its link.
    data : bytes
        What arrives, at the clock's present reading.
    until_s : float
        Reading of the clock after the step [s].
    turn_timeout_s : float
        How long MAVSDK is waited for, by the computer's clock.
    """
    if data:
        theirs.send(data)
    clock.advance_to(until_s)
    while await _is_waited_for(app, turn_timeout_s):
        pass


async def _is_waited_for(app: App, turn_timeout_s: float) -> bool:
    """Let the service take what it has; then, if it is MAVSDK's turn, wait for its word.

    Returns whether it was: what it said may have begun its next call, which must not begin a step
    later on a slower computer.
    """
    was_waited_for = app.link.autopilot.is_mavsdk_turn
    for _ in range(SETTLE_TURNS):
        await asyncio.sleep(0)
        # MAVSDK may send its last message meanwhile.
        was_waited_for = was_waited_for or app.link.autopilot.is_mavsdk_turn
    waited_from = time.perf_counter()
    # Its threads cannot tell when they are about to speak, so their turn is polled.
    while app.link.autopilot.is_mavsdk_turn:
        if time.perf_counter() - waited_from > turn_timeout_s:
            # Over a bad link what MAVSDK was passed may call for no word: a repetition, say.
            app.link.autopilot.end_mavsdk_turn()
            return False
        await asyncio.sleep(_POLL_S)
    return was_waited_for
