"""Separate the operator's items in the autopilot's list from the service's.

The operator's items survive every swap: takeoff and the way to the goal come before the service's items, the
landing and everything after the goal come after them. After a restart the service's items are recognised by
their shape: a waypoint followed by the airspeed, and at the end a loiter, or the airspeed twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.assurance.surroundings.ground_heights import GroundHeights
from companion.frames import LocalFrame
from companion.types.mission import Command, MavFrame, MissionItem
from companion.world.ground.autopilot_ground import AutopilotGround

GOALS = frozenset(
    {
        Command.NAV_WAYPOINT, Command.NAV_LOITER_UNLIM, Command.NAV_LOITER_TURNS, Command.NAV_LOITER_TIME,
        Command.NAV_LOITER_TO_ALT, Command.NAV_SPLINE_WAYPOINT,
    }
)  # fmt: skip
FIRST_WITHOUT_PLACE = 100  # Commands from this number on, the DO_ commands, have no position.
RELATIVE_FRAMES = frozenset({MavFrame.GLOBAL_RELATIVE_ALT, MavFrame.GLOBAL_RELATIVE_ALT_INT})
TERRAIN_FRAMES = frozenset({MavFrame.GLOBAL_TERRAIN_ALT, MavFrame.GLOBAL_TERRAIN_ALT_INT})
ABSOLUTE_FRAMES = frozenset({MavFrame.GLOBAL, MavFrame.GLOBAL_INT})
BANK_ITEMS_LIMITS = (20, 60)  # Least and largest number of items of a bank that is recognised.
SAME_PLACE_M = 1.0  # Goals closer together than this count as one.


@dataclass(frozen=True, slots=True)
class Operator:
    """The operator's mission.

    Parameters
    ----------
    items : tuple of MissionItem
        The items, numbered from 0; on ArduPlane item 0 is the home slot.
    tail : int
        Index of the first item that is flown after the last goal; the number of items if there is none.
    first : int
        Index of the first item that is flown: 1 on ArduPlane, after the home slot.
    """

    items: tuple[MissionItem, ...]
    tail: int
    first: int = 0

    @property
    def has_landing(self) -> bool:
        """Return whether the mission contains a landing."""
        return any(item.command == Command.NAV_LAND for item in self.items)


@dataclass(frozen=True, slots=True)
class OperatorGoal:
    """An operator's waypoint, its number in the list, and the DO_ items to carry out on reaching it."""

    position_enu_m: tuple[float, float, float]
    sequence: int
    actions: tuple[MissionItem, ...] = ()


def landing_start(items: Sequence[MissionItem]) -> int:
    """Return the index at which the ending of a mission begins; the number of items if there is none.

    That is DO_LAND_START, else the approach to the first landing, else a return to launch.
    """
    for index, item in enumerate(items):
        if item.command == Command.DO_LAND_START:
            return index
    for index, item in enumerate(items):
        if item.command == Command.NAV_LAND:
            # PX4 requires a waypoint or a loiter to altitude directly before the landing.
            has_approach = index > 0 and items[index - 1].command in (
                Command.NAV_WAYPOINT,
                Command.NAV_LOITER_TO_ALT,
            )
            return index - 1 if has_approach else index
        if item.command == Command.NAV_RETURN_TO_LAUNCH:
            return index
    return len(items)


def operator_of(
    items: Sequence[MissionItem],
    frame: LocalFrame,
    home_amsl_m: float | None,
    goal: tuple[float, float, float] | None = None,
    *,
    num_home_items: int = 0,
) -> Operator:
    """Return the operator's mission, from a list without the service's items.

    Parameters
    ----------
    items : sequence of MissionItem
        The list as read, without the service's items.
    frame : LocalFrame
        The mission file's frame.
    home_amsl_m : float or None
        Height of home, from which relative altitudes count, if known [m].
    goal : tuple of float, optional
        East and north of the mission file's last goal, and its acceptance radius [m]. Everything after the
        operator's own waypoint there follows the goal.
    num_home_items : int
        Number of items at the start of the list that are not flown: ArduPlane's home slot.
    """
    kept = renumbered(items)
    tail = landing_start(kept)
    if goal is not None:
        for item in reversed(kept[1:tail]):
            place = position_of(item, frame, home_amsl_m)
            if place is None or item.command not in GOALS:
                continue
            if (place[0] - goal[0]) ** 2 + (place[1] - goal[1]) ** 2 <= goal[2] ** 2:
                tail = min(tail, item.sequence + 1)
                break
    return Operator(kept, tail, num_home_items)


def position_of(
    item: MissionItem,
    frame: LocalFrame,
    home_amsl_m: float | None,
    ground: AutopilotGround | GroundHeights | None = None,
) -> tuple[float, float, float] | None:
    """Return east, north, up of an item [m]; None if it has no position or its height is not known."""
    altitude = altitude_amsl_of(item, home_amsl_m)
    is_placed = item.command < FIRST_WITHOUT_PLACE and (item.latitude_e7 != 0 or item.longitude_e7 != 0)
    if is_placed and ground is not None and item.frame in TERRAIN_FRAMES:
        east, north, _ = frame.local_from_global(item.latitude_e7 * 1e-7, item.longitude_e7 * 1e-7, 0.0)
        return east, north, float(ground.up_m(np.array([[east, north]]))[0]) + item.altitude_m
    if not is_placed or altitude is None:
        return None
    return frame.local_from_global(item.latitude_e7 * 1e-7, item.longitude_e7 * 1e-7, altitude)


def altitude_amsl_of(item: MissionItem, home_amsl_m: float | None) -> float | None:
    """Return the height of an item above sea level [m]; None over terrain, or if home's is not known."""
    if item.frame in RELATIVE_FRAMES:
        return None if home_amsl_m is None else home_amsl_m + item.altitude_m
    return item.altitude_m if item.frame in ABSOLUTE_FRAMES else None


def goals_of_operator(
    operator: Operator, frame: LocalFrame, home_amsl_m: float | None, ground: AutopilotGround | None = None
) -> tuple[OperatorGoal, ...]:
    """Return the operator's waypoints before the landing as goals, each with the DO_ items after it.

    Those over terrain need the ground. Consecutive waypoints at one place are one goal. Jumps are omitted,
    since a route is flown once.
    """
    goals: list[OperatorGoal] = []
    for item in operator.items[operator.first : operator.tail]:
        if item.command >= FIRST_WITHOUT_PLACE:
            if goals and item.command != Command.DO_JUMP:
                goals[-1] = replace(goals[-1], actions=(*goals[-1].actions, item))
            continue
        place = position_of(item, frame, home_amsl_m, ground) if item.command in GOALS else None
        if place is None:
            continue
        if goals and _apart(goals[-1].position_enu_m, place) < SAME_PLACE_M:
            continue
        goals.append(OperatorGoal(place, item.sequence))
    return tuple(goals)


def _apart(one: tuple[float, float, float], other: tuple[float, float, float]) -> float:
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def renumbered(items: Sequence[MissionItem], first: int = 0) -> tuple[MissionItem, ...]:
    """Return items numbered in order, none of them current."""
    return tuple(replace(item, sequence=first + n, is_current=False) for n, item in enumerate(items))


def is_service_speed(item: MissionItem) -> bool:
    """Return whether an item sets the airspeed as the service does: airspeed type, throttle unchanged."""
    return item.command == Command.DO_CHANGE_SPEED and (item.parameters[0], item.parameters[2]) == (0.0, -1.0)


def possible_starts(items: Sequence[MissionItem]) -> list[int]:
    """Return where the service's items may begin: at each waypoint followed by the airspeed."""
    return [
        index
        for index in range(len(items) - 1)
        if items[index].command == Command.NAV_WAYPOINT and is_service_speed(items[index + 1])
    ]


def banks_in(items: Sequence[MissionItem]) -> tuple[int, int] | None:
    """Return the start of the first bank in an ArduPlane's list and a bank's length; None without banks."""
    low, high = BANK_ITEMS_LIMITS
    for first in possible_starts(items):
        half, odd = divmod(len(items) - first, 2)
        for candidate in [len(items) - first] if odd else [half, len(items) - first]:
            ends = range(first + candidate, len(items) + 1, candidate)
            begins = range(first, len(items), candidate)
            if (
                low <= candidate <= high
                and set(begins) <= set(possible_starts(items))
                and all(items[end - 1].command == Command.NAV_LOITER_UNLIM for end in ends)
            ):
                return first, candidate
    return None


def span_in(items: Sequence[MissionItem]) -> tuple[int, int] | None:
    """Return the start and end of the service's items in a PX4's list; None without such items."""
    for first in possible_starts(items):
        for index in range(first + 2, len(items)):
            is_end = items[index].command == Command.NAV_LOITER_UNLIM or (
                is_service_speed(items[index]) and is_service_speed(items[index - 1])
            )
            if is_end:
                return first, _end_of_way_on(items, _end_of_repetition(items, index))
    return None


def _end_of_way_on(items: Sequence[MissionItem], end: int) -> int:
    """Return the index after waypoints and the airspeed twice behind a loiter; ``end`` without them."""
    last = end
    while last < len(items) and items[last].command == Command.NAV_WAYPOINT:
        last += 1
    is_way_on = last > end and items[end - 1].command == Command.NAV_LOITER_UNLIM
    return last + 2 if is_way_on and all(map(is_service_speed, items[last : last + 2])) else end


def _end_of_repetition(items: Sequence[MissionItem], index: int) -> int:
    """Return the index after the last of equal consecutive items; which one is current does not matter."""
    same = replace(items[index], sequence=0, is_current=False)
    end = index + 1
    while end < len(items) and replace(items[end], sequence=0, is_current=False) == same:
        end += 1
    return end


def without_banks(items: Sequence[MissionItem]) -> tuple[MissionItem, ...]:
    """Return the operator's items in an ArduPlane's list as read."""
    banks = banks_in(items)
    return tuple(items) if banks is None else tuple(items[: banks[0]])


def without_span(items: Sequence[MissionItem]) -> tuple[MissionItem, ...]:
    """Return the operator's items in a PX4's list as read."""
    span = span_in(items)
    return tuple(items) if span is None else (*items[: span[0]], *items[span[1] :])


def shifted_jumps(items: Sequence[MissionItem], behind: int, by: int) -> tuple[MissionItem, ...]:
    """Return items whose jumps keep their targets when ``by`` items are inserted at an index."""
    return tuple(
        replace(item, parameters=(target + by, *item.parameters[1:]))
        if item.command == Command.DO_JUMP and (target := item.parameters[0] or 0.0) >= behind
        else item
        for item in items
    )
