"""MAVSDK's readings on simulated time, message for message as it was measured to make them.

Its time-outs count the computer's clock, so that under faults a simulated flight would depend on the
computer. This client keeps the same times on the service's clock: it asks again every 0.5 s, five times.
"""

import asyncio

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.errors import TransferError
from companion.link.missions.autopilot_link import AutopilotLink
from companion.link.missions.mission_items import item_of

REPEAT_S, REPEATS = 0.5, 5
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
        if frame.message_id in (44, 47, 73):
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

    async def download(self):
        return await self._read("download", 0)

    async def download_rally_points(self):
        return await self._read("rally points", 2)

    async def _read(self, operation, kind):
        async with self._transfer_lock:
            self._require_autopilot()
            self._inbox = asyncio.Queue()
            try:
                return await self._download(operation, kind)
            except TransferError:
                self._cancel_on_autopilot()
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
