"""Return paths in an ArduPlane's list, and the item at which a return to launch joins them.

With RTL_AUTOLAND 4 a return to launch joins the closest leg behind any DO_RETURN_PATH_START: the autopilot
flies directly to the item at which that leg ends, and on from there. With RTL_AUTOLAND 2, which versions
before 4.6.2 have, too, it flies to the item behind the closest DO_LAND_START, and on from there. Several of
these, each with a place of its own, let it join the ends of legs there as well (:func:`start_places`).

The list has two return banks behind the banks of missions. One holds the return path; the other is written,
and only then takes its place. A bank that holds a start is armed. While it is not, items that command an
airspeed stand in its starts' places, and nothing joins it.

A bank's last item is a jump: to the operator's landing, or to a tag that no item has. ArduPlane's search ends
at such a jump. It would otherwise take the way from the end of one bank to the next for a leg. (ArduPlane
refuses to store a jump to item 0, with which its search would end, too.)

References
----------
ArduPlane 4.7 ``AP_Mission::jump_to_closest_mission_leg``, ``distance_to_mission_leg``, ``get_next_cmd``,
``get_landing_sequence_start``; MAVLink ``common.xml``, MAV_CMD_DO_RETURN_PATH_START, MAV_CMD_DO_LAND_START.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from companion.frames import FloatArray, LocalFrame
from companion.kernels.arrays import IntArray
from companion.mission.operator import is_service_speed, position_of
from companion.types.mission import Command, MavFrame, MissionItem

RETURN_ITEMS = 32  # Items of a return bank.
RETURN_WAYPOINTS_MAX = RETURN_ITEMS - 3  # The start, the end and the last jump need an item each.
UNUSED_TAG = 65_000.0  # A tag that no operator uses.
FOR_EVER = -1.0  # The repeat count of a DO_JUMP that repeats without end.
LOOPS_MAX = 64  # ArduPlane follows at most this many jumps in a row.
JUMPS = frozenset({Command.DO_JUMP, Command.DO_JUMP_TAG})
_LANDINGS = frozenset({Command.NAV_LAND, Command.DO_LAND_START})
Located = Callable[[MissionItem], tuple[float, float, float] | None]
STARTS = frozenset({Command.DO_RETURN_PATH_START, Command.DO_LAND_START})


def _command(command: Command, one: float = 0.0, two: float = 0.0) -> MissionItem:
    """Return a command with its first parameters."""
    return MissionItem(0, command, MavFrame.MISSION, (one, two, 0.0, 0.0), 0, 0, 0.0)


NOWHERE = _command(Command.DO_JUMP_TAG, UNUSED_TAG, FOR_EVER)  # A jump at which ArduPlane's search ends.


def return_bank(
    waypoints: Sequence[MissionItem],
    starts: Sequence[tuple[int, MissionItem]],
    end: MissionItem | None,
    landing: int | None,
) -> tuple[MissionItem, ...]:
    """Return a bank that is armed.

    Parameters
    ----------
    waypoints : sequence of MissionItem
        Waypoints of the return path, at most :data:`RETURN_WAYPOINTS_MAX`.
    starts : sequence of (int, MissionItem)
        The number of a waypoint, from 0, and a start before it, in their order. Those for which the bank has
        no room are left out, the last ones first.
    end : MissionItem or None
        The circle at its end; None if it ends at the operator's landing.
    landing : int or None
        Sequence of the operator's first item of the landing.
    """
    is_circle = landing is None or end is not None
    last = NOWHERE if is_circle else _command(Command.DO_JUMP, float(landing or 0), FOR_EVER)
    filling = last if end is None else end
    items: list[MissionItem] = []
    fitting = starts[: RETURN_WAYPOINTS_MAX + 1 - len(waypoints)]
    for number, waypoint in enumerate(waypoints):
        items += [start for before, start in fitting if before == number]
        items.append(waypoint)
    items += [filling] * (RETURN_ITEMS - 1 - len(items))
    return (*items, last)


def path_start() -> MissionItem:
    """Return the start of a return path of which any leg is joined."""
    return _command(Command.DO_RETURN_PATH_START)


def landing_start(place: MissionItem) -> MissionItem:
    """Return a start that has the place of a waypoint, by which ArduPlane chooses the closest one."""
    return replace(place, command=Command.DO_LAND_START, parameters=(0.0, 0.0, 0.0, 0.0))


def start_places(corners_enu_m: FloatArray, num_flown: int) -> list[tuple[int, FloatArray]]:
    """Return places of starts from which a return flies to the end of the leg that the aircraft is on.

    They lie equally far before and behind each corner, at most half a leg, so that the closest of them
    belongs to the leg on which the aircraft is. Only legs that are flown anyway have them, and the leg behind
    those.

    Parameters
    ----------
    corners_enu_m : ndarray, shape (N + 1, 3)
        The place where the return path leaves the flown path's begin, and its waypoints [m].
    num_flown : int
        Number of the first legs, which the aircraft flies anyway.

    Returns
    -------
    list of (int, ndarray of shape (3,))
        The number of the waypoint that is flown to, from 0, and the place of a start [m], in their order.
    """
    along = np.diff(corners_enu_m, axis=0)
    lengths = np.linalg.norm(along, axis=1)
    # Distance of starts from the corner at the beginning of each leg; the path's begin and end have none.
    away = [0.0, *(0.5 * np.minimum(lengths[1:], lengths[:-1])), 0.0]
    found = []
    for leg, begin in enumerate(corners_enu_m[: min(num_flown + 1, len(along))]):
        behind, before = away[leg], lengths[leg] - away[leg + 1]
        is_last = leg == num_flown
        metres = {behind} if leg and is_last else {behind, before} if leg else {before}
        found += [(leg, begin + at / max(lengths[leg], 1e-9) * along[leg]) for at in sorted(metres)]
    return found


def disarmed(bank: Sequence[MissionItem], speed: MissionItem) -> tuple[MissionItem, ...]:
    """Return a bank that nothing joins.

    Parameters
    ----------
    bank : sequence of MissionItem
        A bank.
    speed : MissionItem
        The item that commands the airspeed, in the places of the starts.
    """
    return tuple(replace(speed, sequence=item.sequence) if item.command in STARTS else item for item in bank)


def blank_bank(speed: MissionItem) -> tuple[MissionItem, ...]:
    """Return a bank without a return path, of items that command the airspeed."""
    return (speed,) * (RETURN_ITEMS - 1) + (NOWHERE,)


def is_armed(bank: Sequence[MissionItem]) -> bool:
    """Return whether a return joins a bank."""
    return any(item.command in STARTS for item in bank)


def num_return_items(items: Sequence[MissionItem]) -> int:
    """Return how many items at the end of a list belong to return banks: two, or a part of blank ones."""
    banks = [items[end - RETURN_ITEMS : end] for end in (len(items) - RETURN_ITEMS, len(items))]
    if len(items) > 2 * RETURN_ITEMS and all(map(_is_bank, banks)):
        return 2 * RETURN_ITEMS
    blank = 0  # An upload of the first, blank banks may have been broken off.
    while blank < len(items) and _is_blank(items[len(items) - 1 - blank]):
        blank += 1
    behind_circle = blank < len(items) and items[len(items) - 1 - blank].command == Command.NAV_LOITER_UNLIM
    return blank if behind_circle else 0


def _is_bank(bank: Sequence[MissionItem]) -> bool:
    """Return whether items have the shape of a return bank."""
    return (bank[0].command in STARTS or _is_blank(bank[0])) and bank[-1].command in JUMPS


def _is_blank(item: MissionItem) -> bool:
    """Return whether an item is one of a blank bank: an airspeed, or the jump to nowhere."""
    return is_service_speed(item) or item.command == Command.DO_JUMP_TAG


def joined_item(
    items: Sequence[MissionItem],
    frame: LocalFrame,
    home_amsl_m: float | None,
    place_enu_m: tuple[float, float, float],
    start: Command,
) -> int | None:
    """Return the sequence of the item that a return to launch flies to; None if there is no return path.

    Parameters
    ----------
    items : sequence of MissionItem
        The whole list.
    frame : LocalFrame
        The mission file's frame.
    home_amsl_m : float or None
        Height of home, from which relative altitudes count [m].
    place_enu_m : tuple of float
        The aircraft's position [m].
    start : Command
        The command with which return paths begin.
    """
    (joined,) = joined_items(items, frame, home_amsl_m, np.array([place_enu_m]), start)
    return int(joined) or None


def joined_items(
    items: Sequence[MissionItem],
    frame: LocalFrame,
    home_amsl_m: float | None,
    places_enu_m: FloatArray,
    start: Command,
) -> IntArray:
    """Return the sequences (K,) of the items that returns to launch from several positions fly to.

    Parameters
    ----------
    items, frame, home_amsl_m, start
        Same as in :func:`joined_item`.
    places_enu_m : ndarray, shape (K, 3)
        Positions of the aircraft [m].

    Returns
    -------
    ndarray, shape (K,)
        0 if there is no return path.
    """
    best = np.zeros(len(places_enu_m), dtype=np.int64)
    nearest = np.full(len(places_enu_m), math.inf)
    # Of equally near landings the autopilot takes the first, of return paths the last.
    is_landing = start is Command.DO_LAND_START
    legs_of, is_nearer = (_first_from, np.less) if is_landing else (_legs_from, np.less_equal)
    located = partial(position_of, frame=frame, home_amsl_m=home_amsl_m)
    for item in items[1:]:
        if item.command != start:
            continue
        legs = list(legs_of(items, item.sequence, located, places_enu_m))
        if not legs:
            continue
        ends, away = np.array([end for end, _ in legs]), np.array([distances for _, distances in legs])
        is_chosen = is_nearer(away.min(axis=0), nearest)
        best = np.where(is_chosen, ends[away.argmin(axis=0)], best)
        nearest = np.minimum(nearest, away.min(axis=0))
    return best


def _first_from(
    items: Sequence[MissionItem], start: int, located: Located, places: FloatArray
) -> Iterator[tuple[int, FloatArray]]:
    """Yield the waypoint behind a start, and the distances (K,) of the start from ``places`` (K, 3) [m].

    A start without a place is where that waypoint is.
    """
    for item in followed(items, start):
        position = located(item)
        if position is not None:
            own = located(replace(items[start], command=Command.NAV_WAYPOINT))
            yield item.sequence, np.linalg.norm(places - np.array(own or position), axis=1)
            return


def _legs_from(
    items: Sequence[MissionItem], start: int, located: Located, places: FloatArray
) -> Iterator[tuple[int, FloatArray]]:
    """Yield where each leg of one return path ends, and its distances (K,) [m] from ``places`` (K, 3) [m]."""
    before = None
    for item in followed(items, start):
        position = located(item)
        if position is not None:
            end = np.array(position)
            along = end if before is None else end - before
            if before is None or along.any():
                away = np.linalg.norm(places - _nearest_on(before, end, places), axis=1)
                yield item.sequence, away
                before = end
        if item.command in _LANDINGS and item.sequence != start:
            break


def _nearest_on(begin: FloatArray | None, end: FloatArray, places: FloatArray) -> FloatArray:
    """Return the points (K, 3) nearest to ``places`` (K, 3) of a leg from ``begin`` (3,) to ``end`` (3,) [m].

    Without a begin that is the end.
    """
    if begin is None:
        return np.broadcast_to(end, places.shape)
    along = end - begin
    shares = np.clip((places - begin) @ along / (along @ along), 0.0, 1.0)
    nearest: FloatArray = begin + shares[:, None] * along
    return nearest


def followed(items: Sequence[MissionItem], start: int) -> list[MissionItem]:
    """Return the items from a sequence on in the order in which they are flown, jumps followed.

    They end with a landing or the list, at a jump that leads nowhere, or where an item would be flown again.
    """
    found: list[MissionItem] = []
    seen: set[int] = set()
    sequence, loops = start, 0
    while 0 <= sequence < len(items) and sequence not in seen:
        item = items[sequence]
        seen.add(sequence)
        if item.command == Command.DO_JUMP_TAG:  # The operator's tags are not followed.
            break
        if item.command == Command.DO_JUMP:
            loops += 1
            sequence = int(item.parameters[0] or 0)
            if sequence == 0 or loops > LOOPS_MAX:
                break
            continue
        found.append(item)
        sequence += 1
        if item.command == Command.NAV_LAND:
            break
    return found
