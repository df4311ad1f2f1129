"""The heights of an operator's items over the ground of a map, for ``companion check --items``."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.table import Table

from companion.assurance.surroundings.ground_heights import GroundHeights
from companion.config import MissionConfig
from companion.config.conversion.formats.foreign_file import foreign_bytes, reader_of
from companion.config.conversion.formats.item_places import Item, title_of
from companion.config.conversion.formats.plan_file import items_of_plan
from companion.config.conversion.formats.waypoint_file import items_of_waypoints
from companion.config.conversion.found_places import Importer, Kind
from companion.config.sections.terrain_map import ground_heights_of
from companion.errors import ConfigError
from companion.frames import FloatArray
from companion.mission.operator import FIRST_WITHOUT_PLACE, TERRAIN_FRAMES, position_of
from companion.plain_text import printable
from companion.types.mission import Command, MissionItem

LEG_SAMPLES = 200  # Places by which a leg that follows the ground is drawn.
READERS: dict[str, Callable[[Importer, bytes], Sequence[Item]]] = {
    ".plan": items_of_plan,
    ".waypoints": items_of_waypoints,
    ".txt": items_of_waypoints,
}


@dataclass(frozen=True, slots=True)
class ItemOverGround:
    """An item that has a position, and its height over ground.

    Parameters
    ----------
    name : str
        The item's number in the file, and the name of the command.
    position_enu_m : tuple of float
        East, north, up of the origin [m].
    over_ground_m : float
        Height over the ground below it [m].
    leg_lowest_m : float or None
        Least height over ground on the leg from the item before [m]; None for the first item and for the leg
        to a landing. A take-off counts with the height that it climbs to.
    follows_ground : bool
        Whether the autopilot follows the ground on the leg from the item before, since both ends of the leg
        have heights over terrain.
    """

    name: str
    position_enu_m: tuple[float, float, float]
    over_ground_m: float
    leg_lowest_m: float | None
    follows_ground: bool = False


def items_over_ground(file: Path, mission: MissionConfig) -> list[ItemOverGround]:
    """Return the items of a mission that have a position, in their order.

    Heights over home count from the home of the file. If the file does not have its height, they count from
    the ground below the mission file's start.

    Parameters
    ----------
    file : Path
        ``.plan``, ``.waypoints`` or ``.txt``, as ground stations write them.
    mission : MissionConfig
        The mission file; it needs a section ``terrain``.

    Raises
    ------
    ConfigError
        If there is no map, the file cannot be read or is wrong, an item lies outside the bounds, or less than
        two items have a position.
    """
    ground = ground_heights_of(mission)
    if ground is None:
        raise ConfigError("command line", None, "--items", file.name, "a mission file with a section terrain")
    importer = Importer(file.name)
    entries = reader_of(file, READERS)(importer, foreign_bytes(file))
    found: list[ItemOverGround] = []
    before: MissionItem | None = None
    for entry, item, place in _placed(importer, entries, mission, ground):
        over_m = place[2] - float(ground.up_m(np.array([place]))[0])
        follows = before is not None and {before.frame, item.frame} <= TERRAIN_FRAMES
        found.append(ItemOverGround(f"{entry.label}, {title_of(entry)}", place, over_m, None, follows))
        if before is not None and item.command != Command.NAV_LAND:
            found[-1] = replace(found[-1], leg_lowest_m=_leg_lowest_m(ground, *found[-2:]))
        before = item
    if len(found) < 2:
        raise importer.error("items", f"{len(found)} with a position", "an operator's mission of two or more")
    return found


def items_table(items: Sequence[ItemOverGround], mission: MissionConfig) -> Table:
    """Return the heights for the terminal; its caption says how many legs are lower than allowed."""
    least_m = 0.0 if mission.terrain is None else float(mission.terrain.height_min_m)
    legs = [item.leg_lowest_m for item in items if item.leg_lowest_m is not None]
    low = sum(leg < least_m for leg in legs)
    caption = f"{low} of {len(legs)} legs come below {least_m:g} m over ground (terrain.height_min_m)"
    table = Table(title="operator's items over ground", caption=caption)
    table.add_column("item")
    for column in ("up", "over ground", "lowest on the leg to it"):
        table.add_column(column, justify="right")
    for item in items:
        leg = "–" if item.leg_lowest_m is None else f"{item.leg_lowest_m:.0f} m"
        heights = (f"{item.position_enu_m[2]:.0f} m", f"{item.over_ground_m:.0f} m", leg)
        table.add_row(printable(item.name), *heights)
    return table


def items_document(items: Sequence[ItemOverGround]) -> list[dict[str, object]]:
    """Return the items for ``--json``, lengths rounded to centimetres."""
    return [
        {
            "item": item.name,
            "position_enu_m": [round(value, 2) for value in item.position_enu_m],
            "over_ground_m": round(item.over_ground_m, 2),
            "leg_lowest_m": None if item.leg_lowest_m is None else round(item.leg_lowest_m, 2),
            "follows_ground": item.follows_ground,
        }
        for item in items
    ]


def line_of(items: Sequence[ItemOverGround], mission: MissionConfig) -> FloatArray:
    """Return the line through the items, along the ground where the autopilot follows it.

    Parameters
    ----------
    items : sequence of ItemOverGround
        Two items or more.
    mission : MissionConfig
        The mission file, with a section ``terrain``.

    Returns
    -------
    ndarray, shape (N, 3)
        East, north, up of the origin [m].
    """
    ground = ground_heights_of(mission)
    lines = [np.array([items[0].position_enu_m])]
    for begin, end in itertools.pairwise(items):
        line = np.array([begin.position_enu_m, end.position_enu_m])
        if end.follows_ground and ground is not None:
            share = np.linspace(0.0, 1.0, LEG_SAMPLES)[:, None]
            line = line[0] + share * (line[1] - line[0])
            line[:, 2] = ground.up_m(line) + np.linspace(begin.over_ground_m, end.over_ground_m, LEG_SAMPLES)
        lines.append(line[1:])
    return np.concatenate(lines)


def _placed(
    importer: Importer, entries: Sequence[Item], mission: MissionConfig, ground: GroundHeights
) -> Iterator[tuple[Item, MissionItem, tuple[float, float, float]]]:
    """Yield the items that have a position: as written, as an autopilot stores them, and the position [m]."""
    home_m = _home_amsl_m(importer, mission, ground)
    for number, entry in enumerate(entries):
        if entry.command >= FIRST_WITHOUT_PLACE:
            continue
        item = _mission_item(importer, entry, number)
        place = position_of(item, mission.frame, home_m, ground)
        if place is None:
            continue
        if not _is_within_bounds(mission, place):
            where = f"{place[0]:.0f} m east, {place[1]:.0f} m north"
            raise importer.error(entry.label, where, "a place within the bounds of the mission file")
        yield entry, item, place


def _mission_item(importer: Importer, item: Item, number: int) -> MissionItem:
    """Return an item as an autopilot stores it, for its place alone."""
    latitude, longitude = importer.degrees(item.label, item.latitude or 0.0, item.longitude or 0.0)
    altitude = importer.number(f"{item.label} altitude", item.altitude or 0.0, -1_000.0, 20_000.0)
    unset = (None, None, None, None)
    return MissionItem(
        number, item.command, item.frame, unset, round(1e7 * latitude), round(1e7 * longitude), altitude
    )


def _home_amsl_m(importer: Importer, mission: MissionConfig, ground: GroundHeights) -> float:
    """Return the height from which heights over home count [m]."""
    for place in importer.places:
        altitude = place.values.get("altitude_amsl_m")
        if place.kind is Kind.ORIGIN and isinstance(altitude, float):
            return altitude
    start = np.array([[mission.start.east_m, mission.start.north_m]])
    return float(ground.up_m(start)[0]) + mission.frame.altitude_amsl_m


def _is_within_bounds(mission: MissionConfig, place: tuple[float, float, float]) -> bool:
    """Return whether the map covers a place."""
    sides = (mission.bounds.east_m, mission.bounds.north_m)
    return all(low <= at <= high for at, (low, high) in zip(place, sides, strict=False))


def _leg_lowest_m(ground: GroundHeights, begin: ItemOverGround, end: ItemOverGround) -> float:
    """Return the least height over ground on the leg between two items [m]."""
    if end.follows_ground:
        return min(begin.over_ground_m, end.over_ground_m)
    _, up_m, ground_m = ground.profile(np.array([begin.position_enu_m, end.position_enu_m])).T
    return float((up_m - ground_m).min())
