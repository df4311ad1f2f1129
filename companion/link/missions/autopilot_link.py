"""Calls that the autopilot answers: mission transfers, the current item, the flight mode.

Uploads and their verification use :mod:`~companion.link.missions.mission_transfer`. A swap must finish within
seconds, over a link that may lose every fifth frame; it writes only a part of an ArduPlane's list, and its
timing follows the service's clock. Fences are downloaded in the same way, every second, and give way to all
other transfers. MAVSDK downloads lists that others wrote, and rally points.

Commands and parameters do not use MAVSDK either: its set-current waits for ever if the autopilot stores no
mission, and blocks every later transfer. These calls wait by the service's clock.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from typing import Any

from companion.clock import Clock
from companion.errors import NoAutopilotError, TransferError
from companion.link.messages.codec import Codec
from companion.link.messages.flight_modes import MISSION_MODES, custom_mode_of
from companion.link.missions.answers import is_result_of, require_success
from companion.link.missions.mavsdk_reader import MISSION_MESSAGES, MavsdkReader
from companion.link.missions.mission_items import check_upload
from companion.link.missions.mission_transfer import OPENING, MissionDownload, RoundTrip, Upload
from companion.link.wire.decoded_frame import (
    DecodedFrame,
    MissionAck,
    MissionCount,
    MissionItemReceived,
    MissionItemRequest,
    ParameterValue,
)
from companion.types.events import Dialect, Heartbeat, MissionCurrent
from companion.types.mavlink_enums import Command, ComponentId, MissionResult, MissionType
from companion.types.mission import MissionItem

_COMMAND_TIMEOUT_S = 4.5  # A command is repeated for this time until it is answered.
_REPEAT_MIN_S, _REPEAT_MAX_S = 0.5, 1.5  # PX4 reports a new item in its next MISSION_CURRENT, within 1 s.
_TICK_S = 0.04  # Interval between checks whether an item must be sent again.
REST_MAX_S = 2.0  # The rest of an upload that is not wanted any more is sent for at most this time.


class AutopilotLink:
    """Calls that the autopilot answers.

    Parameters
    ----------
    codec : Codec
        Codec of the link; it knows the vehicle's ids.
    clock : Clock
        Clock for waiting and for repeating.
    send : callable
        Passes bytes to the transport.
    timeout_s : float
        Wall-clock limit of one transfer of MAVSDK, beyond MAVSDK's own limits.

    Attributes
    ----------
    dialect : Dialect or None
        Dialect of the autopilot; None until its first heartbeat.
    """

    def __init__(
        self, codec: Codec, clock: Clock, send: Callable[[bytes], None], *, timeout_s: float = 30.0
    ) -> None:
        self.counters: Counter[str] = Counter()
        self._codec = codec
        self._clock = clock
        self._send = send
        self._mavsdk = MavsdkReader(codec, send, self.counters, timeout_s)
        self.dialect: Dialect | None = None
        self._waiters: list[tuple[Callable[[object], bool], asyncio.Future[object]]] = []
        self._transfer_lock = asyncio.Lock()
        self._current: MissionCurrent | None = None
        self._round_trip = RoundTrip()
        self._transfer: tuple[Upload | MissionDownload, Callable[[int], bytes]] | None = None
        self._transfer_ended = asyncio.Event()
        self._gives_way = False
        self._may_complete: Callable[[], bool] = lambda: False

    @property
    def mission_mode(self) -> str:
        """Name of the flight mode that flies missions, as the autopilot calls it."""
        return "the mission mode" if self.dialect is None else MISSION_MODES[self.dialect]

    @property
    def current(self) -> MissionCurrent | None:
        """The autopilot's last report on the mission that it flies."""
        return self._current

    @property
    def round_trip_s(self) -> float:
        """Shortest round trip of the last transfers; 0 before the first one [s]."""
        return self._round_trip.shortest_s

    @property
    def home_altitude_amsl_m(self) -> float | None:
        """Altitude that the autopilot's relative altitudes refer to; None until the autopilot reports it."""
        return self._codec.home_altitude_amsl_m

    @property
    def is_exchanging(self) -> bool:
        """Whether a mission or fence is being transferred, in either direction."""
        return self._transfer_lock.locked()

    def is_part_of_exchange(self, frame: DecodedFrame) -> bool:
        """Return whether a frame belongs to a transfer that is under way."""
        return self.is_exchanging and frame.message_id in MISSION_MESSAGES

    @property
    def is_mavsdk_turn(self) -> bool:
        """Whether MAVSDK is about to send the next message of a transfer, not the autopilot."""
        return self._mavsdk.is_mavsdk_turn

    def end_mavsdk_turn(self) -> None:
        """Record that MAVSDK will send nothing: it received a repetition, or a part of the answer."""
        self._mavsdk.end_mavsdk_turn()

    def receive(self, frame: DecodedFrame) -> None:
        """Take a received frame; frames of other systems are ignored."""
        if (frame.system_id, frame.component_id) != (self._codec.vehicle_system_id, ComponentId.AUTOPILOT1):
            return
        for event in frame.events:
            if isinstance(event, Heartbeat):
                self.dialect = event.dialect
            elif isinstance(event, MissionCurrent):
                self._current = event
            self._notify(event)
        if frame.reply is not None:
            self._notify(frame.reply)
            self._advance(frame.reply)
            if isinstance(frame.reply, MissionItemRequest) and not self._is_uploading:
                # No upload is under way: a MISSION_COUNT that arrived late began this one.
                self._cancel_on_autopilot()
        self._mavsdk.receive(frame)

    async def upload(
        self,
        items: Sequence[MissionItem],
        may_finish: Callable[[], bool] | None = None,
        *,
        gives_way: bool = False,
    ) -> int:
        """Replace the autopilot's mission.

        Parameters
        ----------
        items : sequence of MissionItem
            The whole list, numbered from 0; exactly one item is current.
        may_finish : callable, optional
            Called before the last item is sent, with which PX4 changes to the new mission. If it returns
            false, the upload is cancelled, and the autopilot keeps its mission.
        gives_way : bool
            Whether the transfer is abandoned if another one is to begin.

        Returns
        -------
        int
            The mission's opaque id, 0 if the autopilot has none. This proves only that the mission is stored:
            PX4 accepts missions that it will not fly.

        Raises
        ------
        TransferError
            If the upload was not acknowledged. The content of the autopilot's list is then unknown.
        """
        check_upload(items)
        return await self._upload(items, may_finish, is_part=False, gives_way=gives_way)

    async def write(self, items: Sequence[MissionItem]) -> None:
        """Overwrite a part of an ArduPlane's list; the other items and the length do not change.

        Parameters
        ----------
        items : sequence of MissionItem
            Consecutive items, numbered as in the list.

        Raises
        ------
        TransferError
            If the upload was not acknowledged. The content of that part is then unknown.
        """
        await self._upload(items, None, is_part=True)

    async def _upload(
        self,
        items: Sequence[MissionItem],
        may_finish: Callable[[], bool] | None,
        *,
        is_part: bool,
        gives_way: bool = False,
    ) -> int:
        async with self._exchange(gives_way=gives_way):
            window = self._require_autopilot().items_at_once
            upload = Upload(items, self._round_trip, self._clock.now_s(), may_finish, window)
            first = items[0].sequence

            def frame_of(number: int) -> bytes:
                if number == OPENING:
                    return self._codec.mission_opening(first, len(items), is_part=is_part)
                return self._codec.mission_item(items[number - first])

            await self._run_transfer(upload, frame_of, "upload")
            return upload.opaque_id

    async def read_back(self, *, gives_way: bool = False, num_left_out: int = 0) -> tuple[MissionItem, ...]:
        """Read an ArduPlane's mission, several items at a time; item 0 is the home item.

        Parameters
        ----------
        gives_way : bool
            Whether the transfer is abandoned if another one is to begin.
        num_left_out : int
            Number of items at the end of the list that are not read.

        Raises
        ------
        TransferError
            If it could not be read completely.
        """
        async with self._exchange(gives_way=gives_way):
            return await self._read_list("download", MissionType.MISSION, num_left_out)

    async def _read_list(
        self, operation: str, kind: MissionType, num_left_out: int = 0
    ) -> tuple[MissionItem, ...]:
        """Read one of the autopilot's lists."""
        window = self._require_autopilot().items_at_once
        reading = MissionDownload(self._round_trip, self._clock.now_s(), window, kind, num_left_out)

        def frame_of(number: int) -> bytes:
            return self._codec.mission_request(None if number == OPENING else number, kind)

        await self._run_transfer(reading, frame_of, operation, kind)
        self._send(self._codec.mission_ack(MissionResult.ACCEPTED, kind))
        return reading.items

    async def _run_transfer(
        self,
        transfer: Upload | MissionDownload,
        frame_of: Callable[[int], bytes],
        operation: str,
        kind: int = MissionType.MISSION,
    ) -> None:
        """Run a transfer of our own to its end."""
        self._transfer = transfer, frame_of
        self._transfer_ended.clear()
        ticking = asyncio.create_task(self._ticking())
        try:
            await self._transfer_ended.wait()
        except asyncio.CancelledError:
            if isinstance(transfer, Upload):
                await self._end_cancelled()
            raise
        finally:
            self._transfer = None
            ticking.cancel()
        if transfer.failure:
            self.counters[transfer.failure.lower()] += 1
            self._cancel_on_autopilot(kind)
            raise TransferError(operation, transfer.failure)

    def complete_while(self, is_allowed: Callable[[], bool]) -> None:
        """Complete cancelled uploads to an ArduPlane while that is allowed; by default they are not."""
        self._may_complete = is_allowed

    async def _end_cancelled(self) -> None:
        """End an upload that is not wanted any more.

        A PX4 is told so. An ArduPlane cannot be told: it would deny every other transfer for 8 s. If that is
        allowed, it receives the rest, which is not flown: missions are entered by commands.
        """
        if self.dialect is None or self.dialect.stays_busy or not self._may_complete():
            self._send(self._codec.mission_ack(MissionResult.OPERATION_CANCELLED))
            return
        until_s = self._clock.now_s() + REST_MAX_S
        while not self._transfer_ended.is_set() and self._may_complete():
            if (now_s := self._clock.now_s()) >= until_s:
                break
            await self._clock.sleep_until(min(until_s, now_s + _TICK_S))

    async def _ticking(self) -> None:
        while True:
            self._advance(None)
            await self._clock.sleep_until(self._clock.now_s() + _TICK_S)

    def _advance(self, reply: object) -> None:
        """Pass a reply to our own transfer and send what is due."""
        if self._transfer is None:
            return
        (transfer, frame_of), now = self._transfer, self._clock.now_s()
        match transfer, reply:
            case _, MissionAck():
                transfer.note_ack(reply, now)
            case Upload(), MissionItemRequest():
                transfer.note_request(reply, now)
            case MissionDownload(), MissionCount():
                transfer.note_count(reply, now)
            case MissionDownload(), MissionItemReceived():
                transfer.note_item(reply, now)
        for number in transfer.due(now):
            self._send(frame_of(number))
        if transfer.failure is not None:
            self._transfer_ended.set()

    @property
    def _is_uploading(self) -> bool:
        return self._transfer is not None and isinstance(self._transfer[0], Upload)

    async def download(self) -> tuple[MissionItem, ...]:
        """Read the autopilot's mission; on ArduPlane item 0 is the home item.

        Raises
        ------
        TransferError
            If it could not be read completely.
        """
        return await self._read(self._mavsdk.download)

    async def download_fence(self) -> tuple[MissionItem, ...]:
        """Read the autopilot's fence; gives way to every other transfer.

        Raises
        ------
        TransferError
            If it could not be read completely.
        """
        async with self._transfer_lock:
            return await self._read_list("fence", MissionType.FENCE)

    async def download_rally_points(self) -> tuple[MissionItem, ...]:
        """Read the autopilot's rally points.

        Raises
        ------
        TransferError
            If they could not be read completely.
        """
        return await self._read(self._mavsdk.download_rally_points)

    async def _read(self, read: Callable[[], Awaitable[tuple[MissionItem, ...]]]) -> tuple[MissionItem, ...]:
        async with self._exchange():
            try:
                return await read()
            except TransferError:
                self._cancel_on_autopilot()
                raise

    async def set_current(self, sequence: int, is_ahead: Callable[[], bool] | None = None) -> None:
        """Make the autopilot fly to an item now, directly from its position.

        Raises
        ------
        TransferError
            If it refuses, or does not answer within 4.5 s. The command is not repeated once ``is_ahead``
            returns false.
        """
        is_by_command = self._require_autopilot().sets_current_by_command

        def make(attempt: int) -> bytes:
            if is_by_command:
                return self._codec.set_current_command(sequence, attempt)
            return self._codec.set_current_message(sequence)

        answer = await self._send_until_answered(
            make,
            lambda reply: (
                is_result_of(reply, Command.DO_SET_MISSION_CURRENT)
                or (isinstance(reply, MissionCurrent) and reply.sequence == sequence)
            ),
            is_ahead,
        )
        require_success("set_current", answer)

    async def wait_for_mission_current(self, is_it: Callable[[MissionCurrent], bool], wait_s: float) -> bool:
        """Wait for a MISSION_CURRENT by our clock; returns whether one came in time."""
        answer = await self._send_and_wait(
            b"", lambda what: isinstance(what, MissionCurrent) and is_it(what), wait_s=wait_s
        )
        return answer is not None

    async def set_mode(self, mode: str) -> None:
        """Select a flight mode by its name, as in ``Heartbeat.mode``.

        Raises
        ------
        TransferError
            If there is no such mode, or the autopilot does not accept it.
        """
        number = custom_mode_of(self._require_autopilot(), mode)
        if number is None:
            raise TransferError("set_mode", f"no mode {mode}")
        answer = await self._send_until_answered(
            lambda _: self._codec.set_mode(number), lambda reply: is_result_of(reply, Command.DO_SET_MODE)
        )
        require_success("set_mode", answer)

    async def set_parameter(self, name: str, value: int) -> None:
        """Set a whole-number parameter of the autopilot.

        Raises
        ------
        TransferError
            If the autopilot does not report the new value within 4.5 s.
        """
        bytewise = self._require_autopilot().packs_parameters_bytewise
        answer = await self._send_until_answered(
            lambda _: self._codec.parameter_set(name, value, is_bytewise=bytewise),
            lambda reply: isinstance(reply, ParameterValue) and reply.is_set(name, value, bytewise),
        )
        require_success("set_parameter", answer)

    def abandon(self) -> None:
        """Fail everything that is under way, at once."""
        self._mavsdk.abandon()
        if self._transfer is not None:
            self._transfer[0].abandon()
            self._transfer_ended.set()
        for _, future in self._waiters:
            if not future.done():
                future.set_result(None)

    async def close(self) -> None:
        """Stop MAVSDK; a call that is under way fails."""
        await self._mavsdk.close()

    async def _send_until_answered(
        self,
        make: Callable[[int], bytes],
        is_answer: Callable[[object], bool],
        may_repeat: Callable[[], bool] | None = None,
    ) -> object | None:
        """Send repeatedly until an answer arrives, at intervals of the round trip; None without an answer."""
        until_s = self._clock.now_s() + _COMMAND_TIMEOUT_S
        wait_s = min(_REPEAT_MAX_S, max(_REPEAT_MIN_S, 2.0 * self._round_trip.repeat_s))
        attempt = 0
        while (left_s := until_s - self._clock.now_s()) > 1e-6:
            if attempt and may_repeat is not None and not may_repeat():
                return None
            answer = await self._send_and_wait(make(attempt), is_answer, wait_s=min(wait_s, left_s))
            if answer is not None:
                return answer
            attempt += 1
        return None

    async def _send_and_wait(
        self, data: bytes, is_answer: Callable[[object], bool], *, wait_s: float
    ) -> object | None:
        """Send once and return the answer, None if it does not arrive in time."""
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

    def _notify(self, what: object) -> None:
        for is_answer, future in self._waiters:
            if not future.done() and is_answer(what):
                future.set_result(what)

    def _require_autopilot(self) -> Dialect:
        if self.dialect is None:
            raise NoAutopilotError("no heartbeat of an autopilot was received")
        return self.dialect

    @contextlib.asynccontextmanager
    async def _exchange(self, *, gives_way: bool = False) -> AsyncIterator[None]:
        """Wait for the turn of a transfer; one that gives way, or reads a fence, is abandoned for it."""
        transfer = None if self._transfer is None else self._transfer[0]
        is_fence = isinstance(transfer, MissionDownload) and transfer.mission_type == MissionType.FENCE
        if transfer is not None and (is_fence or self._gives_way):
            transfer.abandon()
            self._transfer_ended.set()
        async with self._transfer_lock:
            self._require_autopilot()
            self._gives_way = gives_way
            try:
                yield
            finally:
                self._gives_way = False

    def _cancel_on_autopilot(self, mission_type: int = MissionType.MISSION) -> None:
        """Tell a PX4 that a transfer is over; it would stay busy for 5 s, and longer at each new attempt."""
        if self.dialect is not None and self.dialect.stays_busy:
            self._send(self._codec.mission_ack(MissionResult.OPERATION_CANCELLED, mission_type))
