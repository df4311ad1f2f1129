"""Conversion of mission items from the wire and from MAVSDK, and validation of a list before its upload."""

from __future__ import annotations

import logging
import math
import struct
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from companion.errors import TransferError
from companion.types.mavlink_enums import MessageId
from companion.types.mission import MissionItem

# Four parameters, two coordinates, altitude, sequence, command, and six bytes.
ITEM_LAYOUTS: dict[int, struct.Struct] = {
    MessageId.MISSION_ITEM_INT: struct.Struct("<4f2if2H6B"),
    MessageId.MISSION_ITEM: struct.Struct("<7f2H6B"),
}

_log = logging.getLogger(__name__)


def log_of_mavsdk(_level: int, message: str, _file: str | None, _line: int) -> bool:
    """Take MAVSDK's log, which it would print; errors reach the callers as results."""
    _log.debug("%s", message)
    return True


def check_upload(items: Sequence[MissionItem]) -> None:
    """Check that a list can be uploaded.

    Raises
    ------
    TransferError
        If the items are not numbered from 0, or not exactly one item is current.
    """
    if [item.sequence for item in items] != list(range(len(items))):
        raise TransferError("upload", "the items are not numbered from 0 in order")
    if sum(item.is_current for item in items) != 1:
        raise TransferError("upload", "not exactly one item is current")


def item_of(message: Any) -> MissionItem:  # noqa: ANN401
    """Convert an item of MAVSDK, which has the fields of MISSION_ITEM_INT; NaN parameters become None."""
    one, two, three, four = (
        None if math.isnan(value) else float(value)
        for value in (message.param1, message.param2, message.param3, message.param4)
    )
    return MissionItem(
        sequence=message.seq,
        command=message.command,
        frame=message.frame,
        parameters=(one, two, three, four),
        latitude_e7=message.x,
        longitude_e7=message.y,
        altitude_m=float(message.z),
        is_current=bool(message.current),
        autocontinue=bool(message.autocontinue),
    )


def item_from_payload(message_id: int, payload: bytes) -> tuple[MissionItem, int]:
    """Decode a MISSION_ITEM or MISSION_ITEM_INT into an item and its mission type."""
    layout = ITEM_LAYOUTS[message_id]
    values = layout.unpack(payload[: layout.size].ljust(layout.size, b"\0"))
    one, two, three, four, x, y, altitude, sequence, command, _, _, frame, current, goes_on, kind = values
    scale = 1 if message_id == MessageId.MISSION_ITEM_INT else 1e7
    places = [round(scale * value) if math.isfinite(value) else 0 for value in (x, y)]
    one, two, three, four = (None if math.isnan(value) else value for value in (one, two, three, four))
    return MissionItem(
        sequence, command, frame, (one, two, three, four), places[0], places[1], altitude, bool(current),
        bool(goes_on),
    ), kind  # fmt: skip


def as_sent(item: MissionItem) -> MissionItem:
    """Return the item with its numbers in single precision, as a message carries them."""
    one, two, three, four = (None if value is None else _single(value) for value in item.parameters)
    return replace(item, parameters=(one, two, three, four), altitude_m=_single(item.altitude_m))


def _single(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])
