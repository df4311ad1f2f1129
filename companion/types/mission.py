"""Missions as the autopilot stores them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from companion.types.mavlink_enums import Command, MavFrame

__all__ = ["ALL_SLOPES", "ARDUPLANE_SLOPES", "Command", "MavFrame", "Mission", "MissionItem", "SlopeMin"]


class SlopeMin(NamedTuple):
    """The changes of height along a leg that an autopilot flies as a slope.

    A leg with a smaller change is flown level, at the height of its end: ArduPlane's ALT_SLOPE_MIN, with
    which its FLIGHT_OPTIONS may also have every climb flown so.

    Parameters
    ----------
    climb_m : float
        Smallest climb that is flown as a slope [m].
    descent_m : float
        Smallest descent that is flown as a slope [m].
    """

    climb_m: float
    descent_m: float

    def is_level(self, change_m: float) -> bool:
        """Return whether a leg with a change of height upwards [m] is flown level."""
        return -self.descent_m < change_m < self.climb_m


ALL_SLOPES = SlopeMin(0.0, 0.0)  # A PX4 flies every leg as a slope.
ARDUPLANE_SLOPES = SlopeMin(15.0, 15.0)  # The default of ALT_SLOPE_MIN.


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
