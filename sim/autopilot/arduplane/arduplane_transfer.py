"""The mission protocol as ArduPlane speaks it, one machine a list.

Theory of operation, for each of mission, fence and rally::

    idle ──COUNT──▶ receiving ──last item──▶ idle, ACK ACCEPTED
                      │  ▲ └──bad item────▶ idle, ACK with the reason
                      │  └──wrong sequence: ACK INVALID_SEQUENCE, ask again
                      └──8 s of silence───▶ idle, ACK OPERATION_CANCELLED

Items go to their slots as they come and COUNT cuts the list at once, so whatever ends a transfer
early leaves a mix of the old list and the new one. Items are asked for one at a time, one every
20 ms.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.types.mission import MissionItem
from ...mission_types import MissionKind, Verdict
from ..channel import Channel, Message
from .arduplane_store import MAX_ITEMS, MissionStore

_ITEM_PERIOD_US = 20_000
_REPEAT_US = 1_000_000
_TIMEOUT_US = 8_000_000
_KIND_OF_ALL = 255


@dataclass(slots=True)
class _Upload:
    """A running transfer: the sender, the slots, and its times [µs]."""

    channel: Channel
    system_id: int
    component_id: int
    next: int
    end: int
    received_us: int
    ask_us: int

    def is_from(self, channel: Channel, message: Message) -> bool:
        return (
            channel is self.channel
            and message.get_srcSystem() == self.system_id
            and message.get_srcComponent() == self.component_id
        )


def item_from_message(message: Message) -> MissionItem:
    """Mission item of a MISSION_ITEM_INT or MISSION_ITEM message; NaN parameters become ``None``."""
    values = (message.param1, message.param2, message.param3, message.param4)
    is_integer = message.get_type() == "MISSION_ITEM_INT"
    x, y = (message.x, message.y) if is_integer else (message.x * 1e7, message.y * 1e7)
    if not (math.isfinite(x) and math.isfinite(y)):
        x = y = 2**31 - 1  # Out of any range, so that the item is refused.
    return MissionItem(
        sequence=message.seq,
        command=message.command,
        frame=message.frame,
        parameters=tuple(None if math.isnan(value) else value for value in values),  # type: ignore[arg-type]
        latitude_e7=round(x),
        longitude_e7=round(y),
        altitude_m=message.z,
        is_current=bool(message.current),
        autocontinue=bool(message.autocontinue),
    )


class MissionTransfer:
    """Uploads and downloads of all three lists.

    Parameters
    ----------
    store : MissionStore
        Store that items are written to.
    announce : callable
        Sends a text of a severity to everybody.
    may_clear : callable
        Whether the mission may be cleared now.
    """

    def __init__(
        self, store: MissionStore, announce: Callable[[int, str], None], may_clear: Callable[[], bool]
    ) -> None:
        self._store = store
        self._announce = announce
        self._may_clear = may_clear
        self._uploads: dict[MissionKind, _Upload] = {}
        self._now_us = 0

    @property
    def is_receiving(self) -> bool:
        """Whether a list is being uploaded."""
        return bool(self._uploads)

    def update(self, now_us: int) -> None:
        """Request the next items, and end transfers that went silent."""
        self._now_us = now_us
        for kind, upload in list(self._uploads.items()):
            if now_us - upload.received_us >= _TIMEOUT_US:
                del self._uploads[kind]
                self._announce(mavlink.MAV_SEVERITY_WARNING, "Mission upload timeout")
                self._acknowledge(upload.channel, upload, kind, Verdict.OPERATION_CANCELLED)
            elif now_us >= upload.ask_us:
                upload.ask_us = now_us + _REPEAT_US
                upload.channel.send(
                    mavlink.MAVLink_mission_request_message(
                        upload.system_id, upload.component_id, upload.next, int(kind)
                    )
                )

    def handle(self, channel: Channel, message: Message, now_us: int) -> None:
        """Answer one message of the protocol."""
        self._now_us = now_us
        name = message.get_type()
        kind_number = getattr(message, "mission_type", 0)
        if name == "MISSION_CLEAR_ALL":
            self._clear(channel, message, kind_number)
            return
        if kind_number not in tuple(MissionKind):
            self._reply(channel, message, kind_number, Verdict.UNSUPPORTED)
            return
        kind = MissionKind(kind_number)
        if name == "MISSION_COUNT":
            self._count(channel, message, kind)
        elif name == "MISSION_WRITE_PARTIAL_LIST":
            self._partial(channel, message, kind)
        elif name in ("MISSION_ITEM_INT", "MISSION_ITEM"):
            self._item(channel, message, kind)
        elif name == "MISSION_REQUEST_LIST":
            self._list(channel, message, kind)
        elif name in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
            self._request(channel, message, kind)

    def _reply(self, channel: Channel, message: Message, kind: int, verdict: Verdict) -> None:
        channel.send(
            mavlink.MAVLink_mission_ack_message(
                message.get_srcSystem(), message.get_srcComponent(), int(verdict), kind
            )
        )

    @staticmethod
    def _acknowledge(channel: Channel, upload: _Upload, kind: MissionKind, verdict: Verdict) -> None:
        channel.send(
            mavlink.MAVLink_mission_ack_message(
                upload.system_id, upload.component_id, int(verdict), int(kind)
            )
        )

    def _is_taken(self, channel: Channel, message: Message, kind: MissionKind) -> bool:
        """Refuse another sender while a list is being uploaded."""
        upload = self._uploads.get(kind)
        if upload is None or upload.is_from(channel, message):
            return False
        self._reply(channel, message, int(kind), Verdict.DENIED)
        return True

    def _begin(self, channel: Channel, message: Message, kind: MissionKind, first: int, end: int) -> None:
        self._uploads[kind] = _Upload(
            channel,
            message.get_srcSystem(),
            message.get_srcComponent(),
            first,
            end,
            self._now_us,
            self._now_us + _ITEM_PERIOD_US,
        )

    def _count(self, channel: Channel, message: Message, kind: MissionKind) -> None:
        if self._is_taken(channel, message, kind):
            return
        if message.count > MAX_ITEMS:
            self._reply(channel, message, int(kind), Verdict.NO_SPACE)
            return
        self._store.truncate(kind, message.count)
        if message.count == 0:
            self._uploads.pop(kind, None)
            self._reply(channel, message, int(kind), Verdict.ACCEPTED)
            return
        self._begin(channel, message, kind, 0, message.count)

    def _partial(self, channel: Channel, message: Message, kind: MissionKind) -> None:
        if kind in self._uploads:  # A second upload is denied, even of the same sender (measured).
            self._reply(channel, message, int(kind), Verdict.DENIED)
            return
        first, last, count = message.start_index, message.end_index, len(self._store.items(kind))
        if first < 0 or first > count or last > count or last < first:
            self._announce(mavlink.MAV_SEVERITY_WARNING, "Flight plan update rejected")
            self._reply(channel, message, int(kind), Verdict.ERROR)
            return
        self._begin(channel, message, kind, first, last + 1)

    def _item(self, channel: Channel, message: Message, kind: MissionKind) -> None:
        upload = self._uploads.get(kind)
        if upload is None:
            self._reply(channel, message, int(kind), Verdict.ERROR)
            return
        if self._is_taken(channel, message, kind):
            return
        if message.seq != upload.next:
            self._reply(channel, message, int(kind), Verdict.INVALID_SEQUENCE)
            return
        upload.received_us = self._now_us
        verdict = self._store.put(kind, item_from_message(message))
        if verdict is not Verdict.ACCEPTED:
            del self._uploads[kind]
            self._reply(channel, message, int(kind), verdict)
            return
        upload.next += 1
        upload.ask_us = self._now_us + _ITEM_PERIOD_US
        if upload.next == upload.end:
            del self._uploads[kind]
            self._reply(channel, message, int(kind), Verdict.ACCEPTED)
            text = {MissionKind.FENCE: "Fence received", MissionKind.RALLY: "Rally points received"}
            self._announce(mavlink.MAV_SEVERITY_INFO, text.get(kind, "Flight plan received"))

    def _clear(self, channel: Channel, message: Message, kind_number: int) -> None:
        kinds = list(MissionKind) if kind_number == _KIND_OF_ALL else [kind_number]
        verdict = Verdict.ACCEPTED
        for kind in kinds:
            if kind not in tuple(MissionKind):
                verdict = Verdict.UNSUPPORTED
            elif kind in self._uploads:
                verdict = Verdict.DENIED
            elif kind == MissionKind.MISSION and not self._may_clear():
                verdict = Verdict.ERROR
            else:
                self._store.truncate(MissionKind(kind), 0)
        self._reply(channel, message, kind_number, verdict)

    def _list(self, channel: Channel, message: Message, kind: MissionKind) -> None:
        if kind in self._uploads:
            self._reply(channel, message, int(kind), Verdict.DENIED)
            return
        channel.send(
            mavlink.MAVLink_mission_count_message(
                message.get_srcSystem(), message.get_srcComponent(), len(self._store.items(kind)), int(kind)
            )
        )

    def _request(self, channel: Channel, message: Message, kind: MissionKind) -> None:
        items = self._store.items(kind)
        if self._is_taken(channel, message, kind):
            return
        if message.seq >= len(items):
            self._reply(channel, message, int(kind), Verdict.INVALID_SEQUENCE)
            return
        item = items[message.seq]
        is_integer = message.get_type() == "MISSION_REQUEST_INT"
        build = (
            mavlink.MAVLink_mission_item_int_message if is_integer else mavlink.MAVLink_mission_item_message
        )
        scale = 1 if is_integer else 1e-7
        channel.send(
            build(
                message.get_srcSystem(),
                message.get_srcComponent(),
                message.seq,
                item.frame,
                item.command,
                0,
                1,
                *(math.nan if value is None else value for value in item.parameters),
                item.latitude_e7 * scale,
                item.longitude_e7 * scale,
                item.altitude_m,
                int(kind),
            )
        )
