"""Missions as the autopilot stores them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Command(IntEnum):
    """MAV_CMD numbers the program sends or tells apart (MAVLink common.xml)."""

    NAV_WAYPOINT = 16
    NAV_LOITER_UNLIM = 17
    NAV_LOITER_TURNS = 18
    NAV_LOITER_TIME = 19
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    NAV_LOITER_TO_ALT = 31
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178
    DO_LAND_START = 189


class MavFrame(IntEnum):
    """MAV_FRAME numbers (MAVLink common.xml)."""

    GLOBAL = 0
    MISSION = 2
    GLOBAL_RELATIVE_ALT = 3
    GLOBAL_INT = 5
    GLOBAL_RELATIVE_ALT_INT = 6


@dataclass(frozen=True, slots=True)
class MissionItem:
    """MISSION_ITEM_INT: latitude and longitude in 1e-7 degrees, altitude in metres of its frame.

    ``None`` is a parameter that is not set (NaN on the wire).
    """

    sequence: int
    command: int
    frame: int
    parameters: tuple[float | None, float | None, float | None, float | None]
    latitude_e7: int
    longitude_e7: int
    altitude_m: float
    is_current: bool = False
    autocontinue: bool = True


@dataclass(frozen=True, slots=True)
class Mission:
    """A whole mission list as uploaded, and the item at which it is entered.

    Parameters
    ----------
    items : tuple of MissionItem
        In order; on ArduPlane item 0 is the home slot.
    entry : int
        Sequence at which flying it starts.
    plan_number : int
        Which plan it carries out; counted by the daemon.
    """

    items: tuple[MissionItem, ...]
    entry: int
    plan_number: int
