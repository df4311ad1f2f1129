"""``QGC WPL 110``, the table of items that Mission Planner and MAVProxy store as ``.waypoints``.

Twelve columns, parted by tabs or blanks: number, current, frame, command, four parameters, latitude,
longitude, altitude, autocontinue. Item 0 is home. Fences and rally points are stored in the same way, in
files of their own.
"""

from __future__ import annotations

from companion.config.conversion.formats.foreign_file import foreign_text
from companion.config.conversion.formats.item_places import Item, take_items
from companion.config.conversion.found_places import Importer, Kind
from companion.types.mavlink_enums import Command

HEADER = "QGC WPL 110"
_COLUMNS = 12
_COMMAND_MAX = 65_535


def take_waypoints(importer: Importer, data: bytes) -> None:
    """Take the places of a waypoint file; errors as those of :func:`items_of_waypoints`."""
    take_items(importer, items_of_waypoints(importer, data))


def items_of_waypoints(importer: Importer, data: bytes) -> list[Item]:
    """Return the items of a waypoint file; its home is taken as a place.

    Raises
    ------
    ConfigError
        If it is of another version, a line is not whole, or a value is wrong.
    """
    header, *lines = foreign_text(importer, data).splitlines()
    if " ".join(header.split()) != HEADER:
        raise importer.error("header", header.strip(), HEADER, 1)
    items = []
    for number, line in enumerate(lines, 2):
        cells = line.split()
        if not cells:
            continue
        if len(cells) != _COLUMNS:
            raise importer.error(f"line {number}", f"{len(cells)} columns", f"{_COLUMNS} columns", number)
        index, _, frame, command, *parameters = (
            importer.number(f"line {number} column {column}", cell) for column, cell in enumerate(cells, 1)
        )
        for key, code in (("frame", frame), ("command", command)):
            if not 0 <= code <= _COMMAND_MAX or code != int(code):
                raise importer.error(f"line {number} {key}", f"{code:g}", "a whole number", number)
        latitude, longitude, altitude = parameters[4:7]
        if index == 0 and command == Command.NAV_WAYPOINT:
            _take_home(importer, latitude, longitude, altitude)
            continue
        label = f"item {index:g}"
        items.append(Item(label, int(command), int(frame), parameters[:4], latitude, longitude, altitude))
    return items


def _take_home(importer: Importer, latitude: float, longitude: float, altitude_m: float) -> None:
    if not latitude and not longitude:
        importer.leave("home", "item 0", "it has no place")
        return
    place = importer.degrees("item 0", latitude, longitude)
    importer.add(Kind.ORIGIN, [place], "", {"altitude_amsl_m": altitude_m}, "item 0, home")
