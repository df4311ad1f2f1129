"""The landing sequence, or the leg of a return path, that a return to launch joins, as in ArduPlane 4.7."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence

from companion.types.mission import Command, MissionItem
from ...mission_types import is_navigation
from ..telemetry import Target

_SEARCHED_MAX = 1_000  # Items that are looked at, over all return paths.
_JUMPS_MAX = 64


def closest_start(
    items: Sequence[MissionItem], position_of: Callable[[MissionItem], Target], here: Target
) -> int | None:
    """Sequence of the closest DO_LAND_START; None without one.

    It is where it says, or without a place where the next item with one is.

    Parameters
    ----------
    items, position_of, here
        As in :func:`closest_leg`.
    """
    found, least = None, math.inf
    for start in items[1:]:
        if start.command == Command.DO_LAND_START:
            placed = (item for item in items[start.sequence :] if _is_placed(item) or item is start)
            item = next((item for item in placed if item.latitude_e7 or item.longitude_e7), None)
            away = math.inf if item is None else math.dist(position_of(item), here)
            if away < least:
                found, least = start.sequence, away
    return found


def closest_leg(
    items: Sequence[MissionItem], position_of: Callable[[MissionItem], Target], here: Target
) -> int | None:
    """Sequence of the item at which the closest leg behind a DO_RETURN_PATH_START ends; None without one.

    Parameters
    ----------
    items : sequence of MissionItem
        The stored mission.
    position_of : callable
        Returns an item's east, north, up [m].
    here : tuple of float
        The aircraft's position [m].
    """
    left, found, least = _SEARCHED_MAX, None, math.inf
    for start in items[1:]:
        if start.command == Command.DO_RETURN_PATH_START:
            walked = list(itertools.islice(_walk(items, start.sequence), left))
            left -= len(walked)
            if left <= 0:
                return found
            end, away = _closest_on(walked, position_of, here)
            if end is not None and away <= least:
                found, least = end, away
    return found


def _closest_on(
    walked: Sequence[MissionItem], position_of: Callable[[MissionItem], Target], here: Target
) -> tuple[int | None, float]:
    """Sequence of the end of the closest leg of one path, and its distance [m]."""
    end, away, before = None, math.inf, None
    for item in walked:
        if _is_placed(item):
            place = position_of(item)
            distance = _distance(before or place, place, here) if place != before else math.inf
            if distance < away:
                end, away = item.sequence, distance
            before = place
    return end, away


def _is_placed(item: MissionItem) -> bool:
    """Return whether an item is flown to."""
    return is_navigation(item.command) and bool(item.latitude_e7 or item.longitude_e7)


def _walk(items: Sequence[MissionItem], sequence: int) -> Iterator[MissionItem]:
    """Items from one on, jumps followed; it ends with a landing, the list, or at a jump to no item.

    A jump to a tag leads nowhere: no item has one here.
    """
    jumps = 0
    while sequence < len(items):
        item = items[sequence]
        if item.command == Command.DO_JUMP_TAG:
            return
        if item.command != Command.DO_JUMP:
            yield item
            if item.command in (Command.NAV_LAND, Command.DO_LAND_START):
                return
            sequence += 1
            continue
        target, jumps = int(item.parameters[0] or 0), jumps + 1
        if not 1 <= target < len(items) or jumps > _JUMPS_MAX:
            return
        sequence = target


def _distance(begin: Target, end: Target, here: Target) -> float:
    """Distance of a point from a leg [m]."""
    along = [b - a for a, b in zip(begin, end, strict=True)]
    away = [h - a for a, h in zip(begin, here, strict=True)]
    square = sum(value * value for value in along)
    share = 0.0 if square == 0.0 else sum(a * b for a, b in zip(along, away, strict=True)) / square
    share = max(0.0, min(1.0, share))
    return math.dist(here, [a + share * b for a, b in zip(begin, along, strict=True)])
