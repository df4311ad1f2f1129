"""PX4's identifier of a mission: a checksum over what it stores and flies."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Sequence

from companion.types.mission import MissionItem

_ALL_ONES = 0xFFFFFFFF  # zlib starts with this value and XORs with it at the end; PX4 does neither.


def mission_id(items: Sequence[MissionItem]) -> int:
    """Return the CRC-32 over a mission's items, except for which of them is current.

    It covers frame, command, autocontinue, parameters 1 to 4, latitude, longitude and altitude of each item
    as sent; polynomial EDB88320 (reversed), start and final XOR 0.

    Parameters
    ----------
    items : sequence of MissionItem
        The items as uploaded; NaN stands for parameters that are not set.

    References
    ----------
    PX4 ``mavlink_mission.cpp``, ``crc32_for_mission_item``; MAVLink MISSION_ACK.opaque_id,
    MISSION_CURRENT.mission_id.
    """
    remainder = 0
    for item in items:
        one, two, three, four = (math.nan if value is None else value for value in item.parameters)
        packed = struct.pack(
            "<BHBffffiif", item.frame, item.command, item.autocontinue, one, two, three, four,
            item.latitude_e7, item.longitude_e7, item.altitude_m,
        )  # fmt: skip
        remainder = zlib.crc32(packed, remainder ^ _ALL_ONES) ^ _ALL_ONES
    return remainder
