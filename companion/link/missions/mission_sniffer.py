"""Missions as they were heard on the wire: what an autopilot holds after others' transfers and our own.

ArduPlane cuts its list to a new count at once and overwrites it item by item, its home slot excepted;
broken off, it holds a mix. PX4 takes a list over when it acknowledges the last item.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field, replace

from companion.link.wire.framing import RawFrame
from companion.types.events import Dialect
from companion.types.mission import MissionItem

WRITE_PARTIAL, ITEM, COUNT, CLEAR_ALL, ACK, ITEM_INT = 38, 39, 44, 45, 47, 73
_LAYOUTS = {ITEM_INT: struct.Struct("<4f2if2H6B"), ITEM: struct.Struct("<7f2H6B")}
_TARGET = 32  # of both items: target system, then component
_INVALID_SEQUENCE = 13
_AUTOPILOT = 1
_MISSION = 0  # MAV_MISSION_TYPE_MISSION

Items = tuple[MissionItem | None, ...]


def item_from_payload(message_id: int, payload: bytes) -> tuple[MissionItem, int]:
    """Item of a MISSION_ITEM or MISSION_ITEM_INT, and its mission type."""
    layout = _LAYOUTS[message_id]
    values = layout.unpack(payload[: layout.size].ljust(layout.size, b"\0"))
    one, two, three, four, x, y, altitude, sequence, command, _, _, frame, current, goes_on, kind = values
    scale = 1 if message_id == ITEM_INT else 1e7
    places = [round(scale * value) if math.isfinite(value) else 0 for value in (x, y)]
    one, two, three, four = (None if math.isnan(value) else value for value in (one, two, three, four))
    return MissionItem(
        sequence, command, frame, (one, two, three, four), places[0], places[1], altitude, bool(current),
        bool(goes_on),
    ), kind  # fmt: skip


def as_sent(item: MissionItem) -> MissionItem:
    """An item with its numbers as a message carries them, in single precision."""
    one, two, three, four = (None if value is None else _single(value) for value in item.parameters)
    return replace(item, parameters=(one, two, three, four), altitude_m=_single(item.altitude_m))


def _single(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


@dataclass(slots=True)
class _Transfer:
    """One under way: how many items, and those heard."""

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
    """A mission, or a part of one, that was sent whole: by whom, until when, and whether it was taken."""

    stamp_s: float
    client: tuple[int, int]
    items: tuple[MissionItem, ...]
    is_accepted: bool = False


class MissionSniffer:
    """Follows the mission transfers of one vehicle.

    Attributes
    ----------
    items : tuple of MissionItem or None
        What it holds: None where an item is not known; None altogether before anything was heard.
    settled : tuple of MissionItem or None
        The last list that it held as a whole.
    uploads : list of Upload
        In order, by whomever; broken ones are not among them.
    num_broken : int
        Uploads that ended otherwise.
    """

    def __init__(self) -> None:
        self.dialect: Dialect | None = None
        self.items: Items | None = None
        self.settled: tuple[MissionItem, ...] | None = None
        self.uploads: list[Upload] = []
        self.num_broken = 0
        self._up: dict[tuple[int, int], _Transfer] = {}
        self._down: dict[tuple[int, int], _Transfer] = {}

    def feed(self, frame: RawFrame, vehicle: int, stamp_s: float) -> None:
        """Take a frame of either direction; what is no part of a mission's transfer is left alone."""
        payload = frame.payload.ljust(40, b"\0")
        is_told = (frame.system_id, frame.component_id) == (vehicle, _AUTOPILOT)
        client = (frame.system_id, frame.component_id)
        kind = frame.message_id
        if kind == COUNT and payload[4] == _MISSION:
            count = int.from_bytes(payload[:2], "little")
            if is_told:
                self._down[payload[2], payload[3]] = _Transfer(count)
                self._note_whole(self._down[payload[2], payload[3]])
            elif payload[2] in (0, vehicle):
                self._begin(client, count)
        elif kind in _LAYOUTS:
            item, mission_type = item_from_payload(kind, frame.payload)
            target = payload[_TARGET], payload[_TARGET + 1]
            if mission_type == _MISSION and is_told:
                self._read(target, item)
            elif mission_type == _MISSION and target[0] in (0, vehicle):
                self._written(client, item, stamp_s)
        elif kind == WRITE_PARTIAL and not is_told and payload[6] == _MISSION:
            first, last = (int.from_bytes(payload[at : at + 2], "little") for at in (0, 2))
            if payload[4] in (0, vehicle) and first <= last:
                self._up[client] = _Transfer(last - first + 1, first)
        elif kind == ACK and is_told and payload[3] == _MISSION:
            self._acknowledged((payload[0], payload[1]), payload[2])
        elif kind == CLEAR_ALL and not is_told and payload[2] == _MISSION:
            self._up.pop(client, None)

    def _begin(self, client: tuple[int, int], count: int) -> None:
        before = self._up.get(client)
        if before is not None and before.items:
            self.num_broken += 1
        self._up[client] = _Transfer(count)
        if self.dialect is not Dialect.PX4:
            held = self.items or ()
            self.items = (*held[:count], *(None,) * (count - len(held)))

    def _written(self, client: tuple[int, int], item: MissionItem, stamp_s: float) -> None:
        transfer = self._up.get(client)
        if transfer is None or not 0 <= item.sequence - transfer.first < transfer.count:
            return
        was_whole = transfer.is_whole
        transfer.items[item.sequence] = item
        held = list(self.items or ())
        is_home = item.sequence == 0 and bool(held) and held[0] is not None
        if self.dialect is not Dialect.PX4 and item.sequence < len(held) and not is_home:
            held[item.sequence] = replace(item, is_current=False)
            self.items = tuple(held)
        if transfer.is_whole and not was_whole:
            self.uploads.append(Upload(stamp_s, client, transfer.in_order))

    def _acknowledged(self, client: tuple[int, int], result: int) -> None:
        transfer = self._up.get(client)
        if transfer is None or result == _INVALID_SEQUENCE:  # the upload goes on
            return
        del self._up[client]
        if result != 0 or not transfer.is_whole:
            self.num_broken += 1
            return
        if self.dialect is Dialect.PX4:
            self.items = tuple(replace(item, is_current=False) for item in transfer.in_order)
        self._settle()
        last = next((n for n in reversed(range(len(self.uploads))) if self.uploads[n].client == client), None)
        if last is not None:
            self.uploads[last] = replace(self.uploads[last], is_accepted=True)

    def _read(self, client: tuple[int, int], item: MissionItem) -> None:
        transfer = self._down.get(client)
        if transfer is not None and item.sequence < transfer.count:
            transfer.items[item.sequence] = replace(item, is_current=False)
            self._note_whole(transfer)

    def _note_whole(self, transfer: _Transfer) -> None:
        """A list that was read whole is what is held."""
        if transfer.is_whole:
            self.items = transfer.in_order
            self._settle()

    def _settle(self) -> None:
        known = tuple(item for item in self.items or () if item is not None)
        if self.items is not None and len(known) == len(self.items):
            self.settled = known
