"""Mission transfers on simulated time, message for message as MAVSDK was measured to make them.

MAVSDK's time-outs count the computer's clock, so that under faults a simulated flight would depend on
the computer. This client keeps the same times on the service's clock: it asks again every 0.5 s, five
times; an item is sent when asked for, and again every 0.5 s until the next is (``companion.link.nudge``).
"""

import asyncio
import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.errors import TransferError
from companion.link.autopilot import AutopilotLink
from companion.link.items import check_upload
from companion.link.nudge import PATIENCE_S
from companion.types.mission import MissionItem

REPEAT_S, REPEATS = 0.5, 5
INVALID_SEQUENCE = 13
CANCELLED = mavlink.MAV_MISSION_OPERATION_CANCELLED
NAMES = {number: entry.name for number, entry in mavlink.enums["MAV_MISSION_RESULT"].items()}


class TimedLink(AutopilotLink):
    """Everything but the transfers is the link's own."""

    def __init__(self, codec, clock, send):
        super().__init__(codec, clock, send)
        self._inbox = None
        self._reader = mavlink.MAVLink(None)

    def receive(self, frame):
        super().receive(frame)
        if self._inbox is None or (frame.system_id, frame.component_id) != (self._codec.vehicle_system_id, 1):
            return
        if frame.message_id in (39, 40, 44, 47, 51, 73):
            self._inbox.put_nowait(self._reader.decode(bytearray(self._codec.unsigned(frame.raw))))

    async def _next(self, wait_s):
        """The next message, or None after so long."""
        if not self._inbox.empty():
            return self._inbox.get_nowait()
        getting = asyncio.ensure_future(self._inbox.get())
        alarm = asyncio.ensure_future(self._clock.sleep_until(self._clock.now_s() + wait_s))
        try:
            await asyncio.wait({getting, alarm}, return_when=asyncio.FIRST_COMPLETED)
            return getting.result() if getting.done() else None
        finally:
            for task in (getting, alarm):
                task.cancel()
            await asyncio.gather(getting, alarm, return_exceptions=True)

    def _say(self, message):
        self._send(self._codec._packed(message))

    def _cancel(self):
        self._say(mavlink.MAVLink_mission_ack_message(1, 1, CANCELLED, 0))

    async def upload(self, items, may_finish=None):
        check_upload(items)
        async with self._turn:
            self._require_autopilot()
            self._inbox, self._mission_ack = asyncio.Queue(), None
            try:
                return await self._upload(items, may_finish)
            except TransferError:
                self._free()
                raise
            except asyncio.CancelledError:
                self._cancel()
                raise
            finally:
                self._inbox = None

    async def _upload(self, items, may_finish):
        count = mavlink.MAVLink_mission_count_message(1, 1, len(items), 0)
        self._say(count)
        repeats, asked, heard_s = 0, None, 0.0
        while True:
            message = await self._next(REPEAT_S)
            if message is None:
                repeats += 1
                is_over = repeats >= REPEATS if asked is None else self._clock.now_s() - heard_s > PATIENCE_S
                if is_over:
                    raise TransferError("upload", "TIMEOUT")
                if asked is None:
                    self._say(count)
                elif asked < len(items) - 1 or may_finish is None or may_finish():
                    self._say(message_of(items[asked]))
                continue
            kind = message.get_type()
            if kind == "MISSION_ACK" and message.mission_type == 0:
                if message.type == INVALID_SEQUENCE and asked is not None:
                    continue  # an item came twice; the upload goes on
                if message.type != 0:
                    raise TransferError("upload", NAMES.get(message.type, str(message.type)))
                return self._mission_ack.opaque_id if self._mission_ack is not None else 0
            if kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT") and message.seq < len(items):
                asked, heard_s = message.seq, self._clock.now_s()
                if message.seq == len(items) - 1 and may_finish is not None and not may_finish():
                    self._cancel()
                    raise TransferError("upload", "TRANSFER_CANCELLED")
                self._say(message_of(items[message.seq]))

    async def download(self):
        return await self._read("download", 0)

    async def download_fence(self):
        return await self._read("fence", 1)

    async def _read(self, operation, kind):
        async with self._turn:
            self._require_autopilot()
            self._inbox = asyncio.Queue()
            try:
                return await self._download(operation, kind)
            except TransferError:
                self._free()
                raise
            finally:
                self._inbox = None

    async def _asked_until(self, request, is_answer, operation):
        self._say(request)
        for _ in range(REPEATS):
            ends_s = self._clock.now_s() + REPEAT_S
            while (left := ends_s - self._clock.now_s()) > 1e-9:
                message = await self._next(left)
                if message is not None and message.get_type() == "MISSION_ACK" and message.type != 0:
                    raise TransferError(operation, NAMES.get(message.type, str(message.type)))
                if message is not None and is_answer(message):
                    return message
            self._say(request)
        raise TransferError(operation, "TIMEOUT")

    async def _download(self, operation, kind):
        count = await self._asked_until(
            mavlink.MAVLink_mission_request_list_message(1, 1, kind),
            lambda m: m.get_type() == "MISSION_COUNT" and m.mission_type == kind,
            operation,
        )
        items = []
        for sequence in range(count.count):
            raw = await self._asked_until(
                mavlink.MAVLink_mission_request_int_message(1, 1, sequence, kind),
                lambda m, n=sequence: (
                    m.get_type() == "MISSION_ITEM_INT" and (m.seq, m.mission_type) == (n, kind)
                ),
                operation,
            )
            items.append(item_of(raw))
        self._say(mavlink.MAVLink_mission_ack_message(1, 1, 0, kind))
        return tuple(items)


def is_item(message, sequence, kind):
    return message.get_type() == "MISSION_ITEM_INT" and (message.seq, message.mission_type) == (
        sequence,
        kind,
    )


def message_of(item):
    values = (math.nan if value is None else value for value in item.parameters)
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, item.sequence, item.frame, item.command, int(item.is_current), int(item.autocontinue), *values,
        item.latitude_e7, item.longitude_e7, item.altitude_m, 0,
    )  # fmt: skip


def item_of(message):
    values = (message.param1, message.param2, message.param3, message.param4)
    return MissionItem(
        message.seq, message.command, message.frame,
        tuple(None if math.isnan(value) else float(value) for value in values),
        message.x, message.y, float(message.z), bool(message.current), bool(message.autocontinue),
    )  # fmt: skip
