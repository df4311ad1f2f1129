"""Calls that the autopilot answers: missions to and from it, the current item, the mode.

What is written, and what is read back of it, goes by :mod:`~companion.link.missions.mission_transfer`: a
swap has seconds, may be over a link that loses every fifth frame, writes only a part of an ArduPlane's
list, and is timed by our clock; so are fences read, every second, giving way to all else. MAVSDK reads lists
that others made, and rally points.

``set_current`` and ``set_mode`` do not go through MAVSDK either: its set-current waits for ever when the
autopilot stores no mission, and queues every later transfer behind. They wait by our clock.
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
from companion.link.missions.mavsdk_reader import MISSION_MESSAGES, MavsdkReader
from companion.link.missions.mission_items import check_upload
from companion.link.missions.mission_transfer import OPENING, MissionDownload, RoundTrip, Upload
from companion.link.wire.decoded_frame import (
    CommandAck,
    DecodedFrame,
    MissionAck,
    MissionCount,
    MissionQuestion,
    MissionTold,
)
from companion.types.events import Dialect, Heartbeat, MissionCurrent
from companion.types.mavlink_enums import Command, CommandResult, ComponentId, MissionType, name_of
from companion.types.mission import MissionItem

_INSIST_S = 4.5  # for so long a command is sent again until it is answered
_REPEAT_MIN_S, _REPEAT_MAX_S = 0.5, 1.5  # PX4 tells a new item with its next MISSION_CURRENT, within 1 s
_TICK_S = 0.04  # between looks at whether an item must be sent again
_WINDOW = 6  # items of an ArduPlane's list that are asked for at once; a PX4 answers one at a time


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
        self,
        codec: Codec,
        clock: Clock,
        send: Callable[[bytes], None],
        *,
        timeout_s: float = 30.0,
    ) -> None:
        self.counters: Counter[str] = Counter()
        self._codec = codec
        self._clock = clock
        self._send = send
        self._mavsdk = MavsdkReader(codec, send, self.counters, timeout_s)
        self.dialect: Dialect | None = None
        self._waiters: list[tuple[Callable[[object], bool], asyncio.Future[object]]] = []
        self._turn = asyncio.Lock()
        self._current: MissionCurrent | None = None
        self._round_trip = RoundTrip()
        self._moving: tuple[Upload | MissionDownload, Callable[[int], bytes]] | None = None
        self._moved = asyncio.Event()

    @property
    def mission_mode(self) -> str:
        """The flight mode in which missions are flown, in the autopilot's words."""
        return "the mission mode" if self.dialect is None else MISSION_MODES[self.dialect]

    @property
    def current(self) -> MissionCurrent | None:
        """The autopilot's last report on the mission that it flies."""
        return self._current

    @property
    def round_trip_s(self) -> float:
        """How long the line takes there and back, by the last exchanges; 0 before one [s]."""
        return self._round_trip.least_s

    @property
    def home_altitude_amsl_m(self) -> float | None:
        """Height that the autopilot's relative altitudes count from, None until it is heard."""
        return self._codec.home_altitude_amsl_m

    @property
    def is_exchanging(self) -> bool:
        """Whether a mission or fence is on its way, in either direction."""
        return self._turn.locked()

    def is_part_of_exchange(self, frame: DecodedFrame) -> bool:
        """Whether a frame gets an exchange on that is under way."""
        return self.is_exchanging and frame.message_id in MISSION_MESSAGES

    @property
    def is_our_turn(self) -> bool:
        """Whether a call is under way and the next word is MAVSDK's, not the autopilot's."""
        return self._mavsdk.is_our_turn

    def give_up_turn(self) -> None:
        """MAVSDK has nothing to say: what it was passed was a repetition, or a part of the answer."""
        self._mavsdk.give_up_turn()

    def receive(self, frame: DecodedFrame) -> None:
        """Take a received frame; those of other systems and of no concern are ignored."""
        if (frame.system_id, frame.component_id) != (self._codec.vehicle_system_id, ComponentId.AUTOPILOT1):
            return
        for event in frame.events:
            if isinstance(event, Heartbeat):
                self.dialect = event.dialect
            elif isinstance(event, MissionCurrent):
                self._current = event
            self._tell(event)
        if frame.reply is not None:
            self._tell(frame.reply)
            self._move_on(frame.reply)
            if isinstance(frame.reply, MissionQuestion) and not self._is_uploading:
                self._free()  # nobody uploads: it was begun by a count that came late
        self._mavsdk.receive(frame)

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
        return await self._sent(items, may_finish, is_part=False)

    async def write(self, items: Sequence[MissionItem]) -> None:
        """Overwrite a part of an ArduPlane's list; the rest, and its length, stay as they are.

        Parameters
        ----------
        items : sequence of MissionItem
            Numbered in order as in the list.

        Raises
        ------
        TransferError
            When it was not acknowledged; what that part holds then is not known.
        """
        await self._sent(items, None, is_part=True)

    async def _sent(
        self, items: Sequence[MissionItem], may_finish: Callable[[], bool] | None, *, is_part: bool
    ) -> int:
        async with self._exchange():
            upload = Upload(items, self._round_trip, self._clock.now_s(), may_finish)
            first = items[0].sequence

            def frame_of(number: int) -> bytes:
                if number == OPENING:
                    return self._codec.mission_opening(first, len(items), is_part=is_part)
                return self._codec.mission_item(items[number - first])

            await self._moved_whole(upload, frame_of, "upload")
            return upload.opaque_id

    async def read_back(self) -> tuple[MissionItem, ...]:
        """Read an ArduPlane's mission, several items at a time; item 0 is the home slot.

        Raises
        ------
        TransferError
            When it could not be read completely.
        """
        async with self._exchange():
            return await self._read_list("download", _WINDOW, MissionType.MISSION)

    async def _read_list(self, operation: str, window: int, kind: MissionType) -> tuple[MissionItem, ...]:
        """Read one of the autopilot's lists, so many items at once."""
        reading = MissionDownload(self._round_trip, self._clock.now_s(), window, kind)

        def frame_of(number: int) -> bytes:
            return self._codec.mission_question(None if number == OPENING else number, kind)

        await self._moved_whole(reading, frame_of, operation, kind)
        self._send(self._codec.mission_accepted(kind))
        return reading.items

    async def _moved_whole(
        self,
        transfer: Upload | MissionDownload,
        frame_of: Callable[[int], bytes],
        operation: str,
        kind: int = MissionType.MISSION,
    ) -> None:
        """Carry out a transfer of our own."""
        self._moving = transfer, frame_of
        self._moved.clear()
        ticking = asyncio.create_task(self._ticking())
        try:
            await self._moved.wait()
        except asyncio.CancelledError:
            if isinstance(transfer, Upload):
                self._send(self._codec.mission_cancel())
            raise
        finally:
            self._moving = None
            ticking.cancel()
        if transfer.failure:
            self.counters[transfer.failure.lower()] += 1
            self._free(kind)
            raise TransferError(operation, transfer.failure)

    async def _ticking(self) -> None:
        while True:
            self._move_on(None)
            await self._clock.sleep_until(self._clock.now_s() + _TICK_S)

    def _move_on(self, told: object) -> None:
        """Let a transfer of our own take what was told, and send what is due."""
        if self._moving is None:
            return
        (transfer, frame_of), now = self._moving, self._clock.now_s()
        match transfer, told:
            case _, MissionAck():
                transfer.note_ack(told, now)
            case Upload(), MissionQuestion():
                transfer.note_question(told, now)
            case MissionDownload(), MissionCount():
                transfer.note_count(told, now)
            case MissionDownload(), MissionTold():
                transfer.note_item(told, now)
        for number in transfer.due(now):
            self._send(frame_of(number))
        if transfer.failure is not None:
            self._moved.set()

    @property
    def _is_uploading(self) -> bool:
        return self._moving is not None and isinstance(self._moving[0], Upload)

    async def download(self) -> tuple[MissionItem, ...]:
        """Read the autopilot's mission back; on ArduPlane with the home slot as item 0.

        Raises
        ------
        TransferError
            When it could not be read completely.
        """
        return await self._read(self._mavsdk.download)

    async def download_fence(self) -> tuple[MissionItem, ...]:
        """Read the autopilot's fence; gives way to every other exchange.

        Raises
        ------
        TransferError
            When it could not be read completely.
        """
        async with self._turn:
            window = 1 if self._require_autopilot().swaps_whole_lists else _WINDOW
            return await self._read_list("fence", window, MissionType.FENCE)

    async def download_rally_points(self) -> tuple[MissionItem, ...]:
        """Read the autopilot's rally points.

        Raises
        ------
        TransferError
            When they could not be read completely.
        """
        return await self._read(self._mavsdk.download_rally_points)

    async def _read(self, read: Callable[[], Awaitable[tuple[MissionItem, ...]]]) -> tuple[MissionItem, ...]:
        async with self._exchange():
            try:
                return await read()
            except TransferError:
                self._free()
                raise

    async def set_current(self, sequence: int, is_ahead: Callable[[], bool] | None = None) -> None:
        """Make the autopilot fly to an item now, directly from where it is.

        Raises
        ------
        TransferError
            When it refuses, or does not answer within 4.5 s; it is not asked again once ``is_ahead``
            denies it.
        """
        is_by_command = self._require_autopilot().sets_current_by_command

        def make(attempt: int) -> bytes:
            if is_by_command:
                return self._codec.set_current_command(sequence, attempt)
            return self._codec.set_current_message(sequence)

        answer = await self._insisted(
            make,
            lambda told: (
                _is_result_of(told, Command.DO_SET_MISSION_CURRENT)
                or (isinstance(told, MissionCurrent) and told.sequence == sequence)
            ),
            is_ahead,
        )
        _require_success("set_current", answer)

    async def wait_for_mission_current(self, is_it: Callable[[MissionCurrent], bool], wait_s: float) -> bool:
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
        answer = await self._insisted(
            lambda _: self._codec.set_mode(number), lambda told: _is_result_of(told, Command.DO_SET_MODE)
        )
        _require_success("set_mode", answer)

    def abandon(self) -> None:
        """Fail whatever is under way, at once."""
        self._mavsdk.abandon()
        if self._moving is not None:
            self._moving[0].abandon()
            self._moved.set()
        for _, future in self._waiters:
            if not future.done():
                future.set_result(None)

    async def close(self) -> None:
        """End MAVSDK; a call of it under way fails."""
        await self._mavsdk.close()

    async def _insisted(
        self,
        make: Callable[[int], bytes],
        is_answer: Callable[[object], bool],
        may_repeat: Callable[[], bool] | None = None,
    ) -> object | None:
        """Send until it is answered, as often as the link's round trip suggests; None without an answer."""
        until_s = self._clock.now_s() + _INSIST_S
        wait_s = min(_REPEAT_MAX_S, max(_REPEAT_MIN_S, 2.0 * self._round_trip.repeat_s))
        attempt = 0
        while (left_s := until_s - self._clock.now_s()) > 1e-6:
            if attempt and may_repeat is not None and not may_repeat():
                return None
            answer = await self._asked(make(attempt), is_answer, wait_s=min(wait_s, left_s))
            if answer is not None:
                return answer
            attempt += 1
        return None

    async def _asked(
        self, data: bytes, is_answer: Callable[[object], bool], *, wait_s: float
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
        if self.dialect is None:
            raise NoAutopilotError("no heartbeat of an autopilot was received")
        return self.dialect

    @contextlib.asynccontextmanager
    async def _exchange(self) -> AsyncIterator[None]:
        """An exchange by itself; a reading that gives way ends for it."""
        transfer = None if self._moving is None else self._moving[0]
        if isinstance(transfer, MissionDownload) and transfer.mission_type == MissionType.FENCE:
            transfer.abandon()
            self._moved.set()
        async with self._turn:
            self._require_autopilot()
            yield

    def _free(self, mission_type: int = MissionType.MISSION) -> None:
        """Tell a PX4 that a transfer is over: it would be busy for 5 s, and 5 more at each new try."""
        if self.dialect is not None and self.dialect.stays_busy:
            self._send(self._codec.mission_cancel(mission_type))


def _is_result_of(told: object, command: int) -> bool:
    """Whether something that was told ends a command."""
    if not isinstance(told, CommandAck) or told.command != command:
        return False
    return told.result != CommandResult.IN_PROGRESS


def _require_success(operation: str, answer: object | None) -> None:
    """TransferError without an answer, and where it refuses."""
    if answer is None:
        raise TransferError(operation, "no answer")
    if isinstance(answer, CommandAck) and answer.result != CommandResult.ACCEPTED:
        raise TransferError(operation, name_of(CommandResult, answer.result))
