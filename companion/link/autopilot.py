"""Missions to and from the autopilot. The only place that knows MAVSDK.

MAVSDK runs in this process on a ``raw://`` connection: what it needs to hear is passed in, what it
wants to say is handed to the transport. It speaks the mission protocol and nothing else: its
heartbeats and questions are dropped, since ``Codec``, ``Streams`` and ``answer`` do that part.

Notes
-----
MAVSDK's time-outs count the computer's clock, not ours. Measured with 4.1.0:

- What it asks (a download's items, the count of an upload) it asks again every 0.5 s, five times.
- An item of an upload it sends when asked, and never again by itself: a lost one comes back because
  the autopilot asks again (ArduPlane after 1 s, PX4 after 0.25 s). After 2.5 s of silence the
  transfer ends with TIMEOUT. A lost last acknowledgement ends so, too, though all is stored: only
  reading back tells.

A simulation's time has to be held while it is MAVSDK's turn, and to go on when a frame was lost.

``set_current`` and ``set_mode`` do not go through MAVSDK: its set-current waits for ever when the
autopilot stores no mission, and queues every later transfer behind. They wait by our clock.
"""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import mavsdk.logging
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from mavsdk.plugins.mission_raw import MissionRaw, MissionRawResult

from companion.clock import Clock
from companion.errors import NoAutopilotError, TransferError
from companion.link.codec import COMPONENT_ID, Codec
from companion.link.flight_modes import custom_mode_of
from companion.link.frame import RESULTS, CommandAck, Frame, MissionAck
from companion.link.framing import raw_frame
from companion.link.items import check_upload, item_of, log_of_mavsdk
from companion.link.nudge import Nudge
from companion.types.events import Dialect, Heartbeat, MissionCurrent
from companion.types.mission import MissionItem

_HEARTBEAT, _MISSION_ACK, _MISSION_ITEM_INT = 0, 47, 73
_QUESTIONS = frozenset({40, 51})
_SEQUENCE = slice(28, 30)  # of MISSION_ITEM_INT's payload
_MISSION_MESSAGES = frozenset({38, 39, 40, 43, 44, 45, 47, 51, 73})
_COMMAND_SET_CURRENT, _COMMAND_SET_MODE = 224, 176
_IN_PROGRESS = 5
_TRIES = 3
_REPLY_S = 1.5  # PX4 tells the new item with its next MISSION_CURRENT, up to a second later
_DISCOVERY_S = 5.0
_ACKNOWLEDGE_S = 0.5


class AutopilotLink:
    """Calls that the autopilot answers.

    Parameters
    ----------
    codec : Codec
        The link's; it knows the vehicle's ids.
    clock : Clock
        For the waits of ``set_current`` and ``set_mode``.
    send : callable
        Takes bytes for the transport.
    on_pending_change : callable, optional
        Told ``pending_calls`` whenever it changes.
    timeout_s : float
        Wall-clock limit of one transfer, beyond MAVSDK's own limits.
    """

    def __init__(
        self,
        codec: Codec,
        clock: Clock,
        send: Callable[[bytes], None],
        *,
        on_pending_change: Callable[[int], None] | None = None,
        timeout_s: float = 30.0,
    ) -> None:
        self.counters: Counter[str] = Counter()
        self._codec = codec
        self._clock = clock
        self._send = send
        self._on_pending_change = on_pending_change
        self._timeout_s = timeout_s
        self._pending_calls = 0
        self._is_our_turn = False
        self._dialect: Dialect | None = None
        self._heartbeat: bytes | None = None
        self._mission_ack: MissionAck | None = None
        self._waiters: list[tuple[Callable[[object], bool], asyncio.Future[object]]] = []
        self._turn = asyncio.Lock()
        self._has_acknowledged = asyncio.Event()
        self._mavsdk: Any = None
        self._missions: Any = None
        self._under_way: asyncio.Future[Any] | None = None
        self._current: MissionCurrent | None = None
        self._last_item: tuple[int, Callable[[], bool]] | None = None
        self._nudge: Nudge | None = None

    @property
    def dialect(self) -> Dialect | None:
        """Whose missions the autopilot flies; None until it is heard."""
        return self._dialect

    @property
    def current(self) -> MissionCurrent | None:
        """What the autopilot told last of the mission it flies."""
        return self._current

    @property
    def pending_calls(self) -> int:
        """How many calls of MAVSDK are under way."""
        return self._pending_calls

    @property
    def is_our_turn(self) -> bool:
        """Whether a call is under way and the next word is MAVSDK's, not the autopilot's.

        Simulated time stands still meanwhile: MAVSDK's threads would else take as much of it as they
        happen to need.
        """
        return self._pending_calls > 0 and self._is_our_turn

    def give_up_turn(self) -> None:
        """MAVSDK has nothing to say: what it was passed was a repetition, or a part of the answer."""
        self._is_our_turn = False

    def receive(self, frame: Frame) -> None:
        """Take a received frame; those of other systems and of no concern are ignored."""
        if (frame.system_id, frame.component_id) != (self._codec.vehicle_system_id, 1):
            return
        for event in frame.events:
            if isinstance(event, Heartbeat):
                self._dialect, self._heartbeat = event.dialect, self._codec.unsigned(frame.raw)
            elif isinstance(event, MissionCurrent):
                self._current = event
            self._tell(event)
        if frame.reply is not None:
            self._tell(frame.reply)
            if isinstance(frame.reply, MissionAck) and frame.reply.mission_type == 0:
                self._mission_ack = frame.reply
        if self._mavsdk is not None and (
            frame.message_id in _MISSION_MESSAGES or frame.message_id == _HEARTBEAT
        ):
            if self._nudge is not None:
                if frame.message_id in _QUESTIONS:
                    self._nudge.note_question(self._codec.unsigned(frame.raw), self._clock.now_s())
                elif isinstance(frame.reply, MissionAck) and self._nudge.is_noise(frame.reply.result):
                    return
            self._is_our_turn = self._is_our_turn or frame.message_id in _MISSION_MESSAGES
            self._mavsdk.pass_received_raw_bytes(self._codec.unsigned(frame.raw))

    async def upload(self, items: Sequence[MissionItem], may_finish: Callable[[], bool] | None = None) -> int:
        """Replace the autopilot's mission.

        Parameters
        ----------
        items : sequence of MissionItem
            The whole list, numbered from 0, exactly one of them current.
        may_finish : callable, optional
            Asked before the last item leaves, with which PX4 switches over; if it may not, the upload
            is cancelled instead, and the autopilot keeps what it has.

        Returns
        -------
        int
            The mission's opaque id, 0 where the autopilot gives none. PX4 accepts missions that
            it will not fly, so this is no proof of more than storage.

        Raises
        ------
        TransferError
            When it was not acknowledged; what the autopilot holds then is not known.
        """
        check_upload(items)
        async with self._turn:
            missions = await self._connected()
            self._mission_ack = None
            self._last_item = None if may_finish is None else (len(items) - 1, may_finish)
            raw_items = [_raw_item(item) for item in items]
            self._nudge = Nudge()
            nudging = asyncio.create_task(self._nudged(self._nudge))
            try:
                result, _ = await self._transfer(
                    lambda done: missions.upload_mission_async(
                        raw_items, lambda result, _: done(result, None)
                    ),
                    "upload",
                    missions.cancel_mission_upload,
                )
            finally:
                self._nudge = None
                nudging.cancel()
            if result is not MissionRawResult.SUCCESS:
                raise TransferError("upload", result.name)
            self._last_item = None
            return self._mission_ack.opaque_id if self._mission_ack is not None else 0

    async def _nudged(self, nudge: Nudge) -> None:
        """Let MAVSDK send an item again whenever that is due."""
        while True:
            await self._clock.sleep_until(self._clock.now_s() + 0.1)
            question = nudge.due(self._clock.now_s())
            if question is not None and self._mavsdk is not None:
                self._is_our_turn = True
                self._mavsdk.pass_received_raw_bytes(question)

    async def download(self) -> tuple[MissionItem, ...]:
        """Read the autopilot's mission back; on ArduPlane with the home slot as item 0.

        Raises
        ------
        TransferError
            When it could not be read completely.
        """
        return await self._downloaded("download", lambda missions: missions.download_mission_async)

    async def download_fence(self) -> tuple[MissionItem, ...]:
        """Read the autopilot's fence.

        Raises
        ------
        TransferError
            When it could not be read completely.
        """
        return await self._downloaded("fence", lambda missions: missions.download_geofence_async)

    async def _downloaded(self, operation: str, chosen: Callable[[Any], Any]) -> tuple[MissionItem, ...]:
        async with self._turn:
            missions = await self._connected()
            start = chosen(missions)
            result, items = await self._transfer(
                lambda done: start(lambda result, items, _: done(result, items)),
                operation,
                missions.cancel_mission_download,
                is_acknowledged_by_us=True,
            )
            if result is not MissionRawResult.SUCCESS:
                raise TransferError(operation, result.name)
            return tuple(item_of(raw) for raw in items)

    async def set_current(self, sequence: int, is_ahead: Callable[[], bool] | None = None) -> None:
        """Make the autopilot fly to an item now, directly from where it is.

        Raises
        ------
        TransferError
            When it refuses, or does not answer three tries; none is made once ``is_ahead`` denies it.
        """
        if self._dialect is Dialect.ARDUPILOT:
            make = partial(self._codec.set_current_command, sequence)
            await self._command("set_current", _COMMAND_SET_CURRENT, make, is_ahead)
            return
        self._require_autopilot()

        def is_current(told: object) -> bool:
            return isinstance(told, MissionCurrent) and told.sequence == sequence

        for attempt in range(_TRIES):
            if attempt and is_ahead is not None and not is_ahead():
                break
            if await self._asked(self._codec.set_current_message(sequence), is_current) is not None:
                return
        raise TransferError("set_current", f"item {sequence} did not become current")

    async def told(self, is_it: Callable[[MissionCurrent], bool], wait_s: float) -> bool:
        """Wait for a MISSION_CURRENT, by our clock; whether one came in time."""
        answer = await self._asked(
            b"", lambda what: isinstance(what, MissionCurrent) and is_it(what), wait_s=wait_s
        )
        return answer is not None

    async def set_mode(self, mode: str) -> None:
        """Select a flight mode by its name, as ``Heartbeat.mode`` has it.

        Raises
        ------
        TransferError
            When there is no such mode, or the autopilot does not take it.
        """
        number = custom_mode_of(self._require_autopilot(), mode)
        if number is None:
            raise TransferError("set_mode", f"no mode {mode}")
        await self._command("set_mode", _COMMAND_SET_MODE, lambda _: self._codec.set_mode(number))

    async def close(self) -> None:
        """End MAVSDK; a call under way fails."""
        instance, self._mavsdk, self._missions = self._mavsdk, None, None
        if instance is not None:
            await asyncio.to_thread(instance.destroy)
        if self._under_way is not None:
            _settle(self._under_way, None)  # nobody else will

    async def _command(
        self,
        operation: str,
        command: int,
        make: Callable[[int], bytes],
        may_repeat: Callable[[], bool] | None = None,
    ) -> None:
        self._require_autopilot()

        def is_answer(told: object) -> bool:
            return isinstance(told, CommandAck) and told.command == command and told.result != _IN_PROGRESS

        for attempt in range(_TRIES):
            if attempt and may_repeat is not None and not may_repeat():
                break
            ack = await self._asked(make(attempt), is_answer)
            if isinstance(ack, CommandAck):
                if ack.result != 0:
                    raise TransferError(operation, RESULTS.get(ack.result, f"result {ack.result}"))
                return
        raise TransferError(operation, "no answer")

    async def _asked(
        self, data: bytes, is_answer: Callable[[object], bool], *, wait_s: float = _REPLY_S
    ) -> object | None:
        """Send, and return what is told in reply in time, or None."""
        future: asyncio.Future[object] = asyncio.get_running_loop().create_future()
        waiter = (is_answer, future)
        self._waiters.append(waiter)
        alarm = asyncio.create_task(self._clock.sleep_until(self._clock.now_s() + wait_s))
        try:
            if data:
                self._send(data)
            waited: set[asyncio.Future[Any]] = {future, alarm}
            await asyncio.wait(waited, return_when=asyncio.FIRST_COMPLETED)
            return future.result() if future.done() else None
        finally:
            alarm.cancel()
            self._waiters.remove(waiter)

    def _tell(self, what: object) -> None:
        for is_answer, future in self._waiters:
            if not future.done() and is_answer(what):
                future.set_result(what)

    def _require_autopilot(self) -> Dialect:
        if self._dialect is None:
            raise NoAutopilotError("no heartbeat of an autopilot was heard")
        return self._dialect

    async def _connected(self) -> Any:  # noqa: ANN401
        """Return MAVSDK's mission plugin, starting MAVSDK when it does not run."""
        self._require_autopilot()
        if self._missions is not None:
            return self._missions
        loop = asyncio.get_running_loop()
        mavsdk.logging.log_subscribe(log_of_mavsdk)
        self._mavsdk = Mavsdk(Configuration.create_manual(self._codec.own_ids[0], COMPONENT_ID, False))
        self._mavsdk.add_any_connection("raw://")
        self._mavsdk.subscribe_raw_bytes_to_be_sent(lambda data: _hand_over(loop, self._outgoing, data))
        with self._call() as found:
            self._mavsdk.first_autopilot_async(
                _DISCOVERY_S, lambda system: _hand_over(loop, _settle, found, system)
            )
            # The one heard last, or discovery would wait for the next.
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
        """Pass on what MAVSDK wants sent, in the loop."""
        frame = raw_frame(data)
        message_id = frame.message_id
        if message_id == _MISSION_ITEM_INT and not self._may_leave(frame.payload):
            return
        if message_id in _MISSION_MESSAGES:
            # An acknowledgement ends a download: nothing answers it, and the call is about to return.
            self._is_our_turn = message_id == _MISSION_ACK
            self._send(self._codec.renumbered(data))
            if message_id == _MISSION_ACK:
                self._has_acknowledged.set()
        else:
            self.counters["mavsdk_dropped"] += 1

    def _may_leave(self, payload: bytes) -> bool:
        """Whether an item may be sent; the last one of a withdrawn upload may not, and ends it."""
        if self._nudge is None:
            return False  # an answer of MAVSDK's to a question from before the upload was broken off
        if self._last_item is None:
            return True
        number, may_finish = self._last_item
        if (
            int.from_bytes(payload.ljust(_SEQUENCE.stop, b"\0")[_SEQUENCE], "little") != number
            or may_finish()
        ):
            return True
        self.counters["withdrawn"] += 1
        if self._missions is not None:
            self._missions.cancel_mission_upload()
        return False

    async def _transfer(
        self,
        start: Callable[[Callable[[Any, Any], None]], None],
        operation: str,
        cancel: Callable[[], Any],
        *,
        is_acknowledged_by_us: bool = False,
    ) -> tuple[Any, Any]:
        """Run one call of MAVSDK; stop it when it lasts too long or its caller is cancelled."""
        loop = asyncio.get_running_loop()
        self._has_acknowledged.clear()
        with self._call() as future:
            start(lambda result, data: _hand_over(loop, _settle, future, (result, data)))
            try:
                answer = await asyncio.wait_for(future, self._timeout_s)
            except TimeoutError:
                await self.close()  # a call that hangs would hold up every later one
                self._free()
                raise TransferError(operation, f"not finished after {self._timeout_s:g} s") from None
            except asyncio.CancelledError:
                cancel()
                raise
            if answer is None:
                raise TransferError(operation, "the link was closed")
            result, data = answer
            if result is not MissionRawResult.SUCCESS:
                self._free()
            if is_acknowledged_by_us and result is MissionRawResult.SUCCESS:
                # The result may overtake our acknowledgement, which then would leave after the call.
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._has_acknowledged.wait(), _ACKNOWLEDGE_S)
            return result, data

    def _free(self) -> None:
        """Tell a PX4 that a transfer is over: it would be busy for 5 s, and 5 more at each new try."""
        if self._dialect is Dialect.PX4:
            self._send(self._codec.mission_cancel())

    @contextlib.contextmanager
    def _call(self) -> Iterator[asyncio.Future[Any]]:
        """Count a call of MAVSDK as under way; yields the future of its answer."""
        self._under_way = asyncio.get_running_loop().create_future()
        self._count(+1)
        try:
            yield self._under_way
        finally:
            self._under_way = None
            self._count(-1)

    def _count(self, change: int) -> None:
        self._pending_calls += change
        self._is_our_turn = change > 0
        if self._on_pending_change is not None:
            self._on_pending_change(self._pending_calls)


atexit.register(mavsdk.logging.log_unsubscribe)  # its threads must not call into an ending interpreter


def _hand_over(loop: asyncio.AbstractEventLoop, function: Callable[..., None], *values: object) -> None:
    """Call in the loop's thread, from any of MAVSDK's; a loop that ended needs nothing any more."""
    if not loop.is_closed():
        loop.call_soon_threadsafe(function, *values)


def _settle(future: asyncio.Future[Any], value: object) -> None:
    if not future.done():
        future.set_result(value)


def _raw_item(item: MissionItem) -> Any:  # noqa: ANN401
    one, two, three, four = (math.nan if value is None else value for value in item.parameters)
    return RawItem(
        seq=item.sequence,
        frame=int(item.frame),
        command=int(item.command),
        current=int(item.is_current),
        autocontinue=int(item.autocontinue),
        param1=one,
        param2=two,
        param3=three,
        param4=four,
        x=item.latitude_e7,
        y=item.longitude_e7,
        z=item.altitude_m,
        mission_type=0,
    )
