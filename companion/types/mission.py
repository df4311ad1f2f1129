"""Missions as the autopilot stores them."""

from __future__ import annotations

from dataclasses import dataclass

from companion.types.mavlink_enums import Command, MavFrame

__all__ = ["SLOPE_MIN_M", "Command", "MavFrame", "Mission", "MissionItem"]

# ArduPlane's GLIDE_SLOPE_MIN: it flies a leg with a smaller change of height at the height of its end.
SLOPE_MIN_M = 15.0


@dataclass(frozen=True, slots=True)
class MissionItem:
    """MISSION_ITEM_INT: latitude and longitude in 1e-7 degrees, altitude in metres in the item's frame.

    A parameter of ``None`` is not set (NaN on the wire).
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
    """A whole mission list as uploaded, and the item at which the autopilot joins it.

    Parameters
    ----------
    items : tuple of MissionItem
        Items of the list in order; on ArduPlane item 0 is the home item.
    entry : int
        Sequence number of the entry.
    plan_number : int
        Number of the plan that the mission carries out, as the service counts plans.
    """

    items: tuple[MissionItem, ...]
    entry: int
    plan_number: int
