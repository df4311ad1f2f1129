"""Downloads of the autopilot's lists by MAVSDK. Only this module imports MAVSDK.

MAVSDK runs in this process on a ``raw://`` connection: messages that it needs are passed in, and messages
that it sends are passed to the transport. Only its messages of the mission protocol are sent. Its heartbeats
and requests are dropped, since ``Codec``, ``Streams`` and ``answer`` do that part.

Notes
-----
MAVSDK's time-outs follow the computer's clock, not the service's: it repeats a request every 0.5 s, five
times (measured with 4.1.0). A simulation must stop its time while MAVSDK is about to send, and continue when
a frame was lost.
"""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import mavsdk.logging
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.mission_raw import MissionRaw, MissionRawError, MissionRawResult

from companion.errors import NoAutopilotError, TransferError
from companion.link.messages.codec import COMPONENT_ID, Codec
from companion.link.missions.mission_items import item_of, log_of_mavsdk
from companion.link.wire.decoded_frame import DecodedFrame
from companion.link.wire.framing import raw_frame
from companion.types.events import Heartbeat
from companion.types.mavlink_enums import MessageId
from companion.types.mission import MissionItem

MISSION_MESSAGES = frozenset(
    {
        MessageId.MISSION_WRITE_PARTIAL_LIST,
        MessageId.MISSION_ITEM,
        MessageId.MISSION_REQUEST,
        MessageId.MISSION_REQUEST_LIST,
        MessageId.MISSION_COUNT,
        MessageId.MISSION_CLEAR_ALL,
        MessageId.MISSION_ACK,
        MessageId.MISSION_REQUEST_INT,
        MessageId.MISSION_ITEM_INT,
    }
)
_DISCOVERY_S = 5.0
_ACKNOWLEDGE_S = 0.5
_END_S = 6.0  # Discovery cannot be aborted, nor the download of rally points, which repeats requests for 3 s.
_UNDESTROYED: list[object] = []


class MavsdkReader:
    """Downloads the autopilot's lists, one at a time.

    Parameters
    ----------
    codec : Codec
        Codec of the link; it knows the vehicle's ids.
    send : callable
        Passes bytes to the transport.
    counters : Counter of str
        Counts dropped frames of MAVSDK.
    timeout_s : float
        Wall-clock limit of one transfer, beyond MAVSDK's own limits.
    """

    def __init__(
        self,
        codec: Codec,
        send: Callable[[bytes], None],
        counters: Counter[str],
        timeout_s: float,
    ) -> None:
        self._counters = counters
        self._codec = codec
        self._send = send
        self._timeout_s = timeout_s
        self._pending_calls = 0
        self._is_our_turn = False
        self._heartbeat: bytes | None = None
        self._has_acknowledged = asyncio.Event()
        self._mavsdk: Any = None
        self._missions: Any = None
        self._systems: list[Any] = []
        self._pending_answer: asyncio.Future[Any] | None = None
        self._answered = threading.Event()  # Set in MAVSDK's thread when the last call has ended.
        self._answered.set()

    @property
    def is_mavsdk_turn(self) -> bool:
        """Whether MAVSDK is about to send the next message of a transfer, not the autopilot.

        Simulated time stands still meanwhile. Otherwise the simulated duration would depend on how long
        MAVSDK's threads take.
        """
        return self._pending_calls > 0 and self._is_our_turn

    def end_mavsdk_turn(self) -> None:
        """Record that MAVSDK will send nothing: it received a repetition, or a part of the answer."""
        self._is_our_turn = False

    def receive(self, frame: DecodedFrame) -> None:
        """Take a frame of the autopilot."""
        if any(isinstance(event, Heartbeat) for event in frame.events):
            self._heartbeat = self._codec.unsigned(frame.raw)
        is_awaited = self._pending_calls > 0 and frame.message_id in MISSION_MESSAGES
        if self._mavsdk is not None and (is_awaited or frame.message_id == MessageId.HEARTBEAT):
            self._is_our_turn = self._is_our_turn or is_awaited
            self._mavsdk.pass_received_raw_bytes(self._codec.unsigned(frame.raw))

    async def download(self) -> tuple[MissionItem, ...]:
        """Download the mission; raises TransferError if it is incomplete."""
        return await self._downloaded("download", lambda missions: missions.download_mission_async)

    async def download_rally_points(self) -> tuple[MissionItem, ...]:
        """Download the rally points; raises TransferError if they are incomplete."""
        return await self._downloaded("rally points", lambda missions: missions.download_rallypoints_async)

    async def close(self) -> None:
        """Stop MAVSDK; a call that is under way fails."""
        instance, systems, missions = self._mavsdk, self._systems, self._missions
        self._mavsdk = self._missions = None
        self.abandon()
        _cancel(missions)
        if instance is not None:
            await asyncio.to_thread(_end, instance, systems, missions, self._answered)

    def abandon(self) -> None:
        """Fail a call that is under way."""
        if self._pending_answer is not None:
            _settle(self._pending_answer, None)

    async def _downloaded(self, operation: str, chosen: Callable[[Any], Any]) -> tuple[MissionItem, ...]:
        missions = await self._connected()
        start = chosen(missions)
        result, items = await self._transfer(
            lambda done: start(lambda result, items, _: done(result, items)), operation
        )
        if result is not MissionRawResult.SUCCESS:
            raise TransferError(operation, result.name)
        return tuple(item_of(raw) for raw in items)

    async def _connected(self) -> Any:  # noqa: ANN401
        """Return MAVSDK's mission plugin; starts MAVSDK if it does not run."""
        if self._missions is not None:
            return self._missions
        loop = asyncio.get_running_loop()
        mavsdk.logging.log_subscribe(log_of_mavsdk)
        self._mavsdk = Mavsdk(Configuration.create_manual(self._codec.own_ids[0], COMPONENT_ID, False))
        self._mavsdk.add_any_connection("raw://")
        self._mavsdk.subscribe_raw_bytes_to_be_sent(lambda data: _call_in_loop(loop, self._outgoing, data))
        systems = self._systems = []
        answered = self._answered = threading.Event()
        with self._call() as found:

            def note(system: Any) -> None:  # noqa: ANN401
                systems.append(system)
                _call_in_loop(loop, _settle, found, system)
                answered.set()

            self._mavsdk.first_autopilot_async(_DISCOVERY_S, note)
            # Passing the last heartbeat saves waiting for the next one.
            self._mavsdk.pass_received_raw_bytes(self._heartbeat)
            try:
                system = await found
            except asyncio.CancelledError:
                await self.close()
                raise
        if system is None:
            await self.close()
            raise NoAutopilotError("MAVSDK did not find the autopilot")
        self._missions = MissionRaw(system)
        return self._missions

    def _outgoing(self, data: bytes) -> None:
        """Send a message of MAVSDK, in the event loop."""
        frame = raw_frame(data)
        message_id = frame.message_id
        if message_id in MISSION_MESSAGES:
            # An acknowledgement ends a download: nothing answers it, and the call is about to return.
            self._is_our_turn = message_id == MessageId.MISSION_ACK
            self._send(self._codec.renumbered(data))
            if message_id == MessageId.MISSION_ACK:
                self._has_acknowledged.set()
        else:
            self._counters["mavsdk_dropped"] += 1

    async def _transfer(
        self,
        start: Callable[[Callable[[Any, Any], None]], None],
        operation: str,
    ) -> tuple[Any, Any]:
        """Run one call of MAVSDK; stop it if it takes too long or its caller is cancelled."""
        loop = asyncio.get_running_loop()
        self._has_acknowledged.clear()
        answered = self._answered = threading.Event()
        with self._call() as future:

            def done(result: Any, data: Any) -> None:  # noqa: ANN401
                _call_in_loop(loop, _settle, future, (result, data))
                answered.set()

            start(done)
            try:
                answer = await asyncio.wait_for(future, self._timeout_s)
            except TimeoutError:
                await self.close()  # A call that hangs would block every later one.
                raise TransferError(operation, f"not finished after {self._timeout_s:g} s") from None
            except asyncio.CancelledError:
                _cancel(self._missions)
                raise
            if answer is None:
                raise TransferError(operation, "the link was closed")
            result, data = answer
            if result is MissionRawResult.SUCCESS:
                # The result may arrive before our acknowledgement, which would then be sent after the call.
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._has_acknowledged.wait(), _ACKNOWLEDGE_S)
            return result, data

    @contextlib.contextmanager
    def _call(self) -> Iterator[asyncio.Future[Any]]:
        """Count a call of MAVSDK as under way; yields the future of its answer."""
        self._pending_answer = asyncio.get_running_loop().create_future()
        self._count(+1)
        try:
            yield self._pending_answer
        finally:
            self._pending_answer = None
            self._count(-1)

    def _count(self, change: int) -> None:
        self._pending_calls += change
        self._is_our_turn = change > 0


def _cancel(missions: Any) -> None:  # noqa: ANN401
    """Cancel a call; MAVSDK raises if there is none, or if it downloads rally points."""
    if missions is not None:
        with contextlib.suppress(MissionRawError):
            missions.cancel_mission_download()


def _end(instance: Any, systems: list[Any], missions: Any, answered: threading.Event) -> None:  # noqa: ANN401
    """Destroy MAVSDK once none of its callbacks is pending; MAVSDK 4.1.0 would end the process otherwise.

    Destroying a plugin frees the callbacks of its calls, although an answer may be pending in MAVSDK's
    thread. MAVSDK answers in order, so the answer to one more call shows that no other is pending. The
    systems must not be garbage collected before that. An instance that does not answer is kept for the life
    of the process.
    """
    is_silent = threading.Event()

    def last(system: Any) -> None:  # noqa: ANN401
        systems.append(system)
        is_silent.set()

    if answered.wait(_END_S):
        instance.first_autopilot_async(0.0, last)
    if is_silent.wait(_END_S):
        instance.destroy()
    else:
        _UNDESTROYED.append((instance, systems, missions))


atexit.register(mavsdk.logging.log_unsubscribe)  # MAVSDK's threads must not call an interpreter that ends.


def _call_in_loop(loop: asyncio.AbstractEventLoop, function: Callable[..., None], *values: object) -> None:
    """Call a function in the event loop, from any thread of MAVSDK, unless the loop has ended."""
    if not loop.is_closed():
        loop.call_soon_threadsafe(function, *values)


def _settle(future: asyncio.Future[Any], value: object) -> None:
    if not future.done():
        future.set_result(value)
