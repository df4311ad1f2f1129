"""Follows mission transfers on the wire to know the autopilot's list after transfers of anybody.

ArduPlane truncates its list to the new count at once and overwrites it item by item, except the home item.
After an aborted upload it holds a mix. PX4 takes the new list when it acknowledges the last item.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field, replace

from companion.link.missions.mission_items import ITEM_LAYOUTS, item_from_payload
from companion.link.wire.framing import RawFrame
from companion.types.events import Dialect
from companion.types.mavlink_enums import ComponentId, MessageId, MissionResult, MissionType
from companion.types.mission import MissionItem

_TARGET = 32  # Offset of the target system in both item messages; the target component follows.

Items = tuple[MissionItem | None, ...]

ITEMS_MAX = 2_000  # Longer lists are not followed, and longer announcements are not trusted.
CLIENTS_MAX = 64  # Transfers are followed for the clients that began last.


@dataclass(slots=True)
class _Transfer:
    """A transfer under way: its number of items, and the items seen."""

    count: int
    first: int = 0
    items: dict[int, MissionItem] = field(default_factory=dict)

    @property
    def is_whole(self) -> bool:
        return len(self.items) == self.count

    @property
    def in_order(self) -> tuple[MissionItem, ...]:
        return tuple(self.items[number] for number in sorted(self.items))


@dataclass(frozen=True, slots=True)
class Upload:
    """A mission, or a part of one, that was sent completely, with its time, sender and acceptance."""

    stamp_s: float
    client: tuple[int, int]
    items: tuple[MissionItem, ...]
    is_accepted: bool = False


class MissionSniffer:
    """Follows the mission transfers of one vehicle.

    Attributes
    ----------
    items : tuple of MissionItem or None
        The autopilot's list, with None for unknown items; None before the first transfer.
    settled : tuple of MissionItem or None
        The last list that was known completely.
    uploads : list of Upload
        Complete uploads of anybody, in order.
    num_broken : int
        Number of other uploads.
    """

    def __init__(self) -> None:
        self.dialect: Dialect | None = None
        self.items: Items | None = None
        self.settled: tuple[MissionItem, ...] | None = None
        self.uploads: list[Upload] = []
        self.num_broken = 0
        self._up: dict[tuple[int, int], _Transfer] = {}
        self._down: dict[tuple[int, int], _Transfer] = {}

    def set_dialect(self, dialect: Dialect | None) -> None:
        """Follow the lists as this autopilot handles them from now on."""
        self.dialect = dialect

    def feed(self, frame: RawFrame, vehicle: int, stamp_s: float) -> None:
        """Take a frame of either direction; frames outside mission transfers are ignored."""
        source = (frame.system_id, frame.component_id)
        if source == (vehicle, ComponentId.AUTOPILOT1):
            self._feed_received(frame)
        else:
            self._feed_sent(frame, source, vehicle, stamp_s)

    def _feed_received(self, frame: RawFrame) -> None:
        """Take a frame of the autopilot: an item of a download, or an acknowledgement."""
        payload = frame.payload.ljust(40, b"\0")
        if frame.message_id == MessageId.MISSION_COUNT and payload[4] == MissionType.MISSION:
            transfer = _Transfer(int.from_bytes(payload[:2], "little"))
            _start_transfer(self._down, (payload[2], payload[3]), transfer)
            self._note_whole(transfer)
        elif frame.message_id in ITEM_LAYOUTS:
            item, mission_type = item_from_payload(frame.message_id, frame.payload)
            if mission_type == MissionType.MISSION:
                self._note_downloaded((payload[_TARGET], payload[_TARGET + 1]), item)
        elif frame.message_id == MessageId.MISSION_ACK and payload[3] == MissionType.MISSION:
            self._acknowledged((payload[0], payload[1]), payload[2])

    def _feed_sent(self, frame: RawFrame, client: tuple[int, int], vehicle: int, stamp_s: float) -> None:
        """Take a frame of a client, which may belong to an upload to this vehicle."""
        payload = frame.payload.ljust(40, b"\0")
        kind, asked = frame.message_id, (0, vehicle)
        if kind == MessageId.MISSION_COUNT and payload[4] == MissionType.MISSION:
            if payload[2] in asked:
                self._begin(client, int.from_bytes(payload[:2], "little"))
        elif kind in ITEM_LAYOUTS and payload[_TARGET] in asked:
            item, mission_type = item_from_payload(kind, frame.payload)
            if mission_type == MissionType.MISSION:
                self._note_uploaded(client, item, stamp_s)
        elif kind == MessageId.MISSION_WRITE_PARTIAL_LIST and payload[6] == MissionType.MISSION:
            if payload[4] in asked:
                self._begin_part(client, *struct.unpack_from("<HH", payload))
        elif kind == MessageId.MISSION_CLEAR_ALL and payload[2] == MissionType.MISSION:
            self._up.pop(client, None)

    def _begin(self, client: tuple[int, int], count: int) -> None:
        before = self._up.get(client)
        if before is not None and before.items:
            self.num_broken += 1
        _start_transfer(self._up, client, _Transfer(count))
        if not self._swaps_whole_lists and count > ITEMS_MAX:
            self.items = None  # The list's length changed, and a list this long is not followed.
        elif not self._swaps_whole_lists:
            held = self.items or ()
            self.items = (*held[:count], *(None,) * (count - len(held)))

    @property
    def _swaps_whole_lists(self) -> bool:
        """Before its first heartbeat the autopilot is assumed to overwrite its list in place."""
        return self.dialect is not None and self.dialect.swaps_whole_lists

    def _begin_part(self, client: tuple[int, int], first: int, last: int) -> None:
        if first <= last:
            _start_transfer(self._up, client, _Transfer(last - first + 1, first))

    def _note_uploaded(self, client: tuple[int, int], item: MissionItem, stamp_s: float) -> None:
        transfer = self._up.get(client)
        if transfer is None or not 0 <= item.sequence - transfer.first < transfer.count:
            return
        was_whole = transfer.is_whole
        transfer.items[item.sequence] = item
        held = list(self.items or ())
        is_home = item.sequence == 0 and bool(held) and held[0] is not None
        if not self._swaps_whole_lists and item.sequence < len(held) and not is_home:
            held[item.sequence] = replace(item, is_current=False)
            self.items = tuple(held)
        if transfer.is_whole and not was_whole:
            self.uploads.append(Upload(stamp_s, client, transfer.in_order))

    def _acknowledged(self, client: tuple[int, int], result: int) -> None:
        transfer = self._up.get(client)
        if transfer is None or result == MissionResult.INVALID_SEQUENCE:  # The upload continues.
            return
        del self._up[client]
        if result != MissionResult.ACCEPTED or not transfer.is_whole:
            self.num_broken += 1
            return
        if self._swaps_whole_lists:
            self.items = tuple(replace(item, is_current=False) for item in transfer.in_order)
        self._settle()
        last = next((n for n in reversed(range(len(self.uploads))) if self.uploads[n].client == client), None)
        if last is not None and transfer.count:
            self.uploads[last] = replace(self.uploads[last], is_accepted=True)

    def _note_downloaded(self, client: tuple[int, int], item: MissionItem) -> None:
        transfer = self._down.get(client)
        if transfer is not None and item.sequence < transfer.count:
            transfer.items[item.sequence] = replace(item, is_current=False)
            self._note_whole(transfer)

    def _note_whole(self, transfer: _Transfer) -> None:
        """Take a completely downloaded list as the autopilot's list."""
        if transfer.is_whole:
            self.items = transfer.in_order
            self._settle()

    def _settle(self) -> None:
        known = tuple(item for item in self.items or () if item is not None)
        if self.items is not None and len(known) == len(self.items):
            self.settled = known


def _start_transfer(
    transfers: dict[tuple[int, int], _Transfer], client: tuple[int, int], transfer: _Transfer
) -> None:
    """Follow a client's transfer; if there are too many, the oldest one is dropped."""
    transfers.pop(client, None)
    if len(transfers) >= CLIENTS_MAX:
        del transfers[next(iter(transfers))]
    transfers[client] = transfer
