"""Runs the service on a clock that others move, for simulated flights and replays.

Time moves in steps and does not move while the service works: while it plans, and while MAVSDK's threads
prepare a message. A flight therefore runs as fast as the computer can, and the same bytes at the same
instants make the service send the same messages, however slow the computer is.
"""

from __future__ import annotations

import asyncio
import time

from companion.clock import ManualClock
from companion.flight.tasks.app import App
from companion.link.wire.memory_transport import MemoryTransport

STEP_S = 0.02
SETTLE_TURNS = 10  # Iterations of the event loop in which the service's tasks handle a step.
# Wall-clock limit for MAVSDK's next message, far above what a busy computer needs. Where a recording lacks an
# answer, MAVSDK repeats its request long before.
TURN_TIMEOUT_S = 5.0
_POLL_S = 0.0002


async def step(
    app: App,
    clock: ManualClock,
    theirs: MemoryTransport,
    data: bytes,
    until_s: float,
    turn_timeout_s: float = TURN_TIMEOUT_S,
) -> None:
    """Deliver bytes now, move the clock, and let the service handle both.

    In more than half of the steps nothing arrives and nobody's time has come. The service has nothing to
    handle then.

    Parameters
    ----------
    app : App
        The service.
    clock : ManualClock
        Clock of the service.
    theirs : MemoryTransport
        Other end of the service's link.
    data : bytes
        Bytes that arrive at the present clock reading.
    until_s : float
        Clock reading after the step [s].
    turn_timeout_s : float
        Time limit for MAVSDK on the computer's clock [s].
    """
    if data:
        theirs.send(data)
    num_woken = clock.advance_to(until_s)
    if not data and not num_woken and clock.is_awaited and not app.link.autopilot.is_mavsdk_turn:
        return
    while await _wait_for_mavsdk(app, turn_timeout_s):
        pass


async def _wait_for_mavsdk(app: App, turn_timeout_s: float) -> bool:
    """Let the service handle what it has; then wait for MAVSDK if it is about to send.

    Returns whether it waited: MAVSDK's message may start its next call, which must not start one step later
    on a slower computer.
    """
    was_waited_for = app.link.autopilot.is_mavsdk_turn
    for _ in range(SETTLE_TURNS):
        await asyncio.sleep(0)
        # MAVSDK may send its last message meanwhile.
        was_waited_for = was_waited_for or app.link.autopilot.is_mavsdk_turn
    waited_from = time.perf_counter()
    # MAVSDK's threads give no notice before they send, so their state is polled.
    while app.link.autopilot.is_mavsdk_turn:
        if time.perf_counter() - waited_from > turn_timeout_s:
            # Over a bad link MAVSDK may have nothing to send, for example after a repetition.
            app.link.autopilot.end_mavsdk_turn()
            return False
        await asyncio.sleep(_POLL_S)
    return was_waited_for
