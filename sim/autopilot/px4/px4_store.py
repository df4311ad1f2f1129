"""Missions, fences and rally points as PX4 keeps them: whole, exact, and named by a checksum.

References
----------
PX4 ``mavlink_mission.cpp``: the id of a list is CRC-32 (polynomial EDB88320, start 0, no inversion at
the end) over frame, command, autocontinue, the four parameters, x, y and z of all items. The recorded
flight of a real one (``tests/data/px4-1.17dev-replace.tlog``) has the ids that this gives.

PX4 ``FeasibilityChecker.cpp``: what makes a mission flyable.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace

from companion.types.mission import Command, MavFrame, MissionItem
from ...mission_types import MissionKind, Verdict
from ...projection import FastProjection

MAX_ITEMS = 10_000
_POLYNOMIAL = 0xEDB88320
_POSITIONED = frozenset({16, 17, 19, 21, 22, 31})
_FRAMELESS = frozenset(
    {20, 93, 177, 178, 179, 183, 189, 195, 197, 200, 201, 203, 205, 206, 214, 530, 531, 532, 2000, 2001}
)
_GLOBAL_FRAMES = {0: 5, 5: 5, 3: 6, 6: 6}  # Frames as sent, and as read back.
_FENCE_COMMANDS = frozenset(range(5000, 5005))
_RALLY_COMMANDS = frozenset({5100})
_RELATIVE = (3, 6)


def _table() -> tuple[int, ...]:
    entries = []
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = (value >> 1) ^ _POLYNOMIAL if value & 1 else value >> 1
        entries.append(value)
    return tuple(entries)


_TABLE = _table()


def mission_id(items: Sequence[MissionItem]) -> int:
    """Checksum by which PX4 names a list; 0 for an empty one."""
    crc = 0
    for item in items:
        parameters = (math.nan if value is None else value for value in item.parameters)
        packed = struct.pack("<BHB4f", item.frame, item.command, int(item.autocontinue), *parameters)
        packed += struct.pack("<iif", item.latitude_e7, item.longitude_e7, item.altitude_m)
        for byte in packed:
            crc = (crc >> 8) ^ _TABLE[(crc ^ byte) & 0xFF]
    return crc


def verdict_on(kind: MissionKind, item: MissionItem) -> Verdict:
    """Return whether an item is taken during an upload; much that cannot be flown is."""
    if kind is not MissionKind.MISSION:
        known = _FENCE_COMMANDS if kind is MissionKind.FENCE else _RALLY_COMMANDS
        if item.command not in known:
            return Verdict.UNSUPPORTED
        return Verdict.ACCEPTED if item.frame in _GLOBAL_FRAMES else Verdict.UNSUPPORTED_FRAME
    if item.frame == MavFrame.MISSION:
        return Verdict.ACCEPTED if item.command in _FRAMELESS else Verdict.UNSUPPORTED
    if item.frame not in _GLOBAL_FRAMES:
        return Verdict.UNSUPPORTED_FRAME
    return Verdict.ACCEPTED if item.command in _POSITIONED else Verdict.UNSUPPORTED


def read_back(item: MissionItem, *, is_current: bool) -> MissionItem:
    """Return an item as a download gives it: exact but for the frame's number."""
    return replace(item, frame=_GLOBAL_FRAMES.get(item.frame, item.frame), is_current=is_current)


@dataclass(frozen=True, slots=True)
class StoredList:
    """A list and its checksum."""

    items: tuple[MissionItem, ...] = ()
    identity: int = 0


def stored(items: Sequence[MissionItem]) -> StoredList:
    """Return a list as it is switched to, with its checksum; which item was marked current is not kept."""
    kept = tuple(replace(item, is_current=False) for item in items)
    return StoredList(kept, mission_id(kept))


def why_infeasible(
    items: Sequence[MissionItem], requirement: int, glide_deg: float, projection: FastProjection
) -> str:
    """Return why a mission is not flown; '' if it is.

    Parameters
    ----------
    items : sequence of MissionItem
        The mission, in its order.
    requirement : int
        ``MIS_TKO_LAND_REQ``: 0 none, 1 takeoff, 2 landing, 3 both, 4 both or none.
    glide_deg : float
        ``FW_LND_ANG``, the steepest approach [deg].
    projection : FastProjection
        Degrees to local metres, for distances and heights.
    """
    if not items:
        return "no mission"
    starts, lands = _places_of(items, Command.DO_LAND_START), _places_of(items, Command.NAV_LAND)
    order = _order_fault(starts, lands)
    approaches = (_approach_fault(items[n - 1], items[n], glide_deg, projection) for n in lands)
    wrong = order or next(filter(None, approaches), "")
    has_takeoff = bool(_places_of(items, Command.NAV_TAKEOFF))
    return wrong or _requirement_fault(requirement, has_takeoff=has_takeoff, has_landing=bool(lands))


def _places_of(items: Sequence[MissionItem], command: Command) -> list[int]:
    return [number for number, item in enumerate(items) if item.command == command]


def _order_fault(starts: Sequence[int], lands: Sequence[int]) -> str:
    """Return what is wrong with the order of the land starts and the landings in the list."""
    if len(starts) > 1:
        return "more than one land start"
    if lands and lands[0] == 0:
        return "starts with land waypoint"
    if starts and (not lands or starts[0] > lands[-1] - 1):
        return "invalid land start"
    return ""


def _requirement_fault(requirement: int, *, has_takeoff: bool, has_landing: bool) -> str:
    """Return what is missing for ``MIS_TKO_LAND_REQ``."""
    refusals = {
        1: "" if has_takeoff else "takeoff waypoint required",
        2: "" if has_landing else "landing waypoint/pattern required",
        3: "" if has_takeoff and has_landing else "takeoff or landing item missing",
        4: "" if has_takeoff == has_landing else "takeoff and landing go together",
    }
    return refusals.get(requirement, "")


def _approach_fault(
    before: MissionItem, land: MissionItem, glide_deg: float, projection: FastProjection
) -> str:
    """Return what is wrong with the leg to a landing."""
    if before.command not in _POSITIONED:
        return ""
    fall = _height(before, projection) - _height(land, projection)
    if fall <= 0.0:
        return "the approach waypoint must be above the landing point"
    here = projection.local(before.latitude_e7 * 1e-7, before.longitude_e7 * 1e-7)
    there = projection.local(land.latitude_e7 * 1e-7, land.longitude_e7 * 1e-7)
    distance = math.dist(here, there)
    if before.command == Command.NAV_LOITER_TO_ALT:
        radius = abs(before.parameters[1] or 0.0)
        if distance <= radius:
            return "the landing point must be outside the orbit radius"
        distance = math.sqrt(distance**2 - radius**2)
    elif before.command != Command.NAV_WAYPOINT:
        return "unsupported landing approach entrance waypoint type"
    if fall > math.tan(math.radians(glide_deg + 0.1)) * distance:
        return "the landing glide slope is steeper than the vehicle setting"
    return ""


def _height(item: MissionItem, projection: FastProjection) -> float:
    """Height above the origin's level [m]; home stands on it."""
    base = 0.0 if item.frame in _RELATIVE else projection.frame.altitude_amsl_m
    return item.altitude_m - base
