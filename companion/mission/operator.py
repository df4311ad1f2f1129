"""What the operator left in the autopilot, and what of it is ours.

The operator's items survive every swap: takeoff and the way to the goal in front of ours, landing and
everything after the goal behind or beside it. After a restart ours are found again by their shape: a
waypoint followed by the airspeed, and at the end a loiter, or the airspeed twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from companion.frames import LocalFrame
from companion.types.mission import Command, MavFrame, MissionItem

GOALS = frozenset(
    {
        Command.NAV_WAYPOINT, Command.NAV_LOITER_UNLIM, Command.NAV_LOITER_TURNS, Command.NAV_LOITER_TIME,
        Command.NAV_LOITER_TO_ALT, Command.NAV_SPLINE_WAYPOINT,
    }
)  # fmt: skip
FIRST_WITHOUT_PLACE = 100
RELATIVE_FRAMES = frozenset({MavFrame.GLOBAL_RELATIVE_ALT, MavFrame.GLOBAL_RELATIVE_ALT_INT})
ABSOLUTE_FRAMES = frozenset({MavFrame.GLOBAL, MavFrame.GLOBAL_INT})
BANK_ITEMS_LIMITS = (20, 60)
SAME_PLACE_M = 1.0


@dataclass(frozen=True, slots=True)
class Operator:
    """The operator's mission.

    Parameters
    ----------
    items : tuple of MissionItem
        Numbered from 0; on ArduPlane item 0 is the home slot.
    tail : int
        Index of the first item that is flown after the last goal; the number of items if none is.
    first : int
        Index of the first item that is flown: 1 behind ArduPlane's home slot.
    """

    items: tuple[MissionItem, ...]
    tail: int
    first: int = 0

    @property
    def has_landing(self) -> bool:
        """Whether it ends in a landing."""
        return any(item.command == Command.NAV_LAND for item in self.items)


@dataclass(frozen=True, slots=True)
class OperatorGoal:
    """A waypoint of the operator's, its number in the list, and the DO_ items to carry out on reaching it."""

    position_enu_m: tuple[float, float, float]
    sequence: int
    actions: tuple[MissionItem, ...] = ()


def landing_start(items: Sequence[MissionItem]) -> int:
    """Index at which what ends a mission begins; the number of items if nothing does.

    That is DO_LAND_START, else the approach to the first landing, else a return to launch.
    """
    for index, item in enumerate(items):
        if item.command == Command.DO_LAND_START:
            return index
    for index, item in enumerate(items):
        if item.command == Command.NAV_LAND:
            # PX4 wants a waypoint or a circle to a height right before it.
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
    """The operator's mission in a list without ours.

    Parameters
    ----------
    items : sequence of MissionItem
        As read, ours taken out.
    frame : LocalFrame
        The mission file's frame.
    home_amsl_m : float or None
        Height that relative altitudes count from, where it is known.
    goal : tuple of float, optional
        East, north [m] of the mission file's last goal, and its acceptance radius: everything behind
        the operator's own waypoint there follows the goal.
    num_home_items : int
        Items at the list's beginning that are not flown: ArduPlane's home slot.
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
    item: MissionItem, frame: LocalFrame, home_amsl_m: float | None
) -> tuple[float, float, float] | None:
    """East, north, up of an item [m]; None if it has no place or its height is not known."""
    altitude = altitude_amsl_of(item, home_amsl_m)
    is_placed = item.command < FIRST_WITHOUT_PLACE and (item.latitude_e7 != 0 or item.longitude_e7 != 0)
    if not is_placed or altitude is None:
        return None
    return frame.local_from_global(item.latitude_e7 * 1e-7, item.longitude_e7 * 1e-7, altitude)


def altitude_amsl_of(item: MissionItem, home_amsl_m: float | None) -> float | None:
    """Height of an item above the sea [m]; None over terrain, or where home's is not known."""
    if item.frame in RELATIVE_FRAMES:
        return None if home_amsl_m is None else home_amsl_m + item.altitude_m
    return item.altitude_m if item.frame in ABSOLUTE_FRAMES else None


def goals_of_operator(
    operator: Operator, frame: LocalFrame, home_amsl_m: float | None
) -> tuple[OperatorGoal, ...]:
    """The operator's waypoints before the landing as goals, each with the DO_ items behind it.

    Waypoints at one place in a row are one goal; jumps are left out, since a route is flown once.
    """
    goals: list[OperatorGoal] = []
    for item in operator.items[operator.first : operator.tail]:
        if item.command >= FIRST_WITHOUT_PLACE:
            if goals and item.command != Command.DO_JUMP:
                goals[-1] = replace(goals[-1], actions=(*goals[-1].actions, item))
            continue
        place = position_of(item, frame, home_amsl_m) if item.command in GOALS else None
        if place is None:
            continue
        if goals and _apart(goals[-1].position_enu_m, place) < SAME_PLACE_M:
            continue
        goals.append(OperatorGoal(place, item.sequence))
    return tuple(goals)


def _apart(one: tuple[float, float, float], other: tuple[float, float, float]) -> float:
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def renumbered(items: Sequence[MissionItem], first: int = 0) -> tuple[MissionItem, ...]:
    """Items numbered in order, none of them current."""
    return tuple(replace(item, sequence=first + n, is_current=False) for n, item in enumerate(items))


def is_speed_of_ours(item: MissionItem) -> bool:
    """Whether an item is the airspeed as we set it: by airspeed, throttle unchanged."""
    return item.command == Command.DO_CHANGE_SPEED and (item.parameters[0], item.parameters[2]) == (0.0, -1.0)


def starts_of_ours(items: Sequence[MissionItem]) -> list[int]:
    """Where a part of ours may begin: a waypoint followed by the airspeed."""
    return [
        index
        for index in range(len(items) - 1)
        if items[index].command == Command.NAV_WAYPOINT and is_speed_of_ours(items[index + 1])
    ]


def banks_in(items: Sequence[MissionItem]) -> tuple[int, int] | None:
    """Where our first bank begins in an ArduPlane's list, and how long a bank is; None without any."""
    low, high = BANK_ITEMS_LIMITS
    for first in starts_of_ours(items):
        half, odd = divmod(len(items) - first, 2)
        for candidate in [len(items) - first] if odd else [half, len(items) - first]:
            ends = range(first + candidate, len(items) + 1, candidate)
            begins = range(first, len(items), candidate)
            if (
                low <= candidate <= high
                and set(begins) <= set(starts_of_ours(items))
                and all(items[end - 1].command == Command.NAV_LOITER_UNLIM for end in ends)
            ):
                return first, candidate
    return None


def span_in(items: Sequence[MissionItem]) -> tuple[int, int] | None:
    """Where our part of a PX4's list begins and ends; None without one."""
    for first in starts_of_ours(items):
        for index in range(first + 2, len(items)):
            is_end = items[index].command == Command.NAV_LOITER_UNLIM or (
                is_speed_of_ours(items[index]) and is_speed_of_ours(items[index - 1])
            )
            if is_end:
                return first, _end_of_repetition(items, index)
    return None


def _end_of_repetition(items: Sequence[MissionItem], index: int) -> int:
    """Index behind the last of equal items in a row; a PX4 marks the one that it flies."""
    same = replace(items[index], sequence=0, is_current=False)
    end = index + 1
    while end < len(items) and replace(items[end], sequence=0, is_current=False) == same:
        end += 1
    return end


def without_banks(items: Sequence[MissionItem]) -> tuple[MissionItem, ...]:
    """The operator's items in an ArduPlane's list as read."""
    banks = banks_in(items)
    return tuple(items) if banks is None else tuple(items[: banks[0]])


def without_span(items: Sequence[MissionItem]) -> tuple[MissionItem, ...]:
    """The operator's items in a PX4's list as read."""
    span = span_in(items)
    return tuple(items) if span is None else (*items[: span[0]], *items[span[1] :])


def shifted_jumps(items: Sequence[MissionItem], behind: int, by: int) -> tuple[MissionItem, ...]:
    """Items with their jumps still leading where they led, when items are put in at an index."""
    return tuple(
        replace(item, parameters=(target + by, *item.parameters[1:]))
        if item.command == Command.DO_JUMP and (target := item.parameters[0] or 0.0) >= behind
        else item
        for item in items
    )
