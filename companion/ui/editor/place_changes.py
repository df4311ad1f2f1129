"""Places that are moved, drawn and removed on the map, each kept the way the file writes it.

A place may be written in metres, in degrees or in UTM. The map knows metres. A moved place is converted back
to what stands in the file, and a new place is written the way the start is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import count

import numpy as np
from pydantic import ValidationError

from companion.config import Bounds
from companion.config.conversion.fence_walls import common_area, walls_about
from companion.config.conversion.mission_composition import WALL_REACH_M
from companion.config.explain import explained
from companion.config.sections.geographic_places import crs_of_zone, local_section
from companion.config.sections.section_base import DEGREES, LINE_DEGREES, LINE_METRES, METRES, UTM
from companion.config.source import Document, KeyPath
from companion.errors import ConfigError
from companion.frames import LocalFrame, transformer_between
from companion.ui.editor.text_edits import parsed, replaced, value_at, with_item, with_key, without

DIGITS_M = 1  # Metres are written to a decimetre.
DIGITS_DEG = 7  # Degrees are written to a centimetre.
Corner = Sequence[float]


def moved(text: str, frame: LocalFrame, path: KeyPath, by_m: Corner) -> str:
    """Return a text in which a place, a corner, or all corners of a polygon are moved.

    Parameters
    ----------
    text : str
        The mission file.
    frame : LocalFrame
        Frame of the file's origin.
    path : tuple
        Path of the section with the place or polygon, or of one corner of ``…_enu_m``, however it is written.
    by_m : sequence of float
        Way to the east and to the north [m].

    Raises
    ------
    ConfigError
        If there is no place.
    """
    document = parsed(text)
    path = _as_written(document.data, path)
    section = value_at(document.data, path)
    if isinstance(section, tuple) and len(path) > 1:
        keys = [(*path, 0), (*path, 1)]
        is_degrees = str(path[-2]).endswith(LINE_DEGREES)
        return replaced(text, dict(zip(keys, _shifted(frame, section, by_m, is_degrees), strict=True)))
    if not isinstance(section, dict):
        raise document.error(path, "a place that can be moved")
    return replaced(text, _moved_section(frame, path, section, by_m))


def _moved_section(
    frame: LocalFrame, path: KeyPath, section: Mapping[str, object], by_m: Corner
) -> dict[KeyPath, object]:
    """Return the new values of a section's place; those of its polygon, if it has none."""
    if METRES[0] in section:
        steps = zip(METRES, by_m, strict=True)
        return {(*path, key): round(_number(section[key]) + step, DIGITS_M) for key, step in steps if step}
    if DEGREES[0] in section:
        place = [_number(section[key]) for key in DEGREES]
        values = zip(DEGREES, _shifted(frame, place, by_m, True), strict=True)
        return {(*path, key): value for key, value in values}
    if UTM in section:
        return _moved_utm(frame, (*path, UTM), section[UTM], by_m)
    lines = [key for key in section if key.endswith((LINE_METRES, LINE_DEGREES))]
    return {
        place: value for key in lines for place, value in _moved_line(frame, (*path, key), section[key], by_m)
    }


def _moved_line(
    frame: LocalFrame, path: KeyPath, corners: object, by_m: Corner
) -> Iterator[tuple[KeyPath, float]]:
    """Yield path and value of each coordinate of a polygon."""
    is_degrees = str(path[-1]).endswith(LINE_DEGREES)
    assert isinstance(corners, Sequence)
    for number, corner in enumerate(corners):
        for axis, value in enumerate(_shifted(frame, corner, by_m, is_degrees)):
            yield (*path, number, axis), value


def bounded(text: str, frame: LocalFrame, box_m: Corner) -> str:
    """Return a text with other bounds.

    Parameters
    ----------
    text : str
        The mission file.
    frame : LocalFrame
        Frame of the file's origin.
    box_m : sequence of float
        West, east, south and north [m].

    Raises
    ------
    ConfigError
        If the file has no bounds.
    """
    west, east, south, north = box_m
    section = value_at(parsed(text).data, ("bounds",))
    if isinstance(section, dict) and DEGREES[0] in section:
        # Parallels and meridians are bent: the box lies within them, so that they must not cut it.
        easts, norths = np.meshgrid([west, 0.5 * (west + east), east], [south, north])
        latitudes, longitudes = frame.places_from_local(easts, norths)
        degrees = {
            DEGREES[0]: [latitudes[0].min(), latitudes[1].max()],
            DEGREES[1]: [longitudes[:, 0].min(), longitudes[:, 2].max()],
        }
        values: dict[str, list[float]] = {
            key: [round(float(value), DIGITS_DEG) for value in pair] for key, pair in degrees.items()
        }
    else:
        pairs = zip(METRES, ((west, east), (south, north)), strict=True)
        values = {key: [round(value, DIGITS_M) for value in pair] for key, pair in pairs}
    return replaced(
        text,
        {("bounds", key, side): value for key, pair in values.items() for side, value in enumerate(pair)},
    )


def fenced(text: str, frame: LocalFrame, corners_m: Sequence[Corner]) -> str:
    """Return a text with walls where a fence ends within the bounds, as an import makes them.

    Parameters
    ----------
    text : str
        The mission file.
    frame : LocalFrame
        Frame of the file's origin.
    corners_m : sequence of sequence of float
        Corners of the area to stay in, east and north [m].

    Raises
    ------
    ConfigError
        If the bounds are wrong, or the corners enclose no area.
    """
    inside = common_area([np.array(corners_m)]) if len(corners_m) > 2 else None
    if inside is None:
        expected = "corners that enclose an area, with edges that do not cross"
        raise ConfigError("request", None, "value", f"{len(corners_m)} corners", expected)
    document = parsed(text)
    bounds = _bounds_in(document, frame)
    (west, east), (south, north), (low, high) = bounds.east_m, bounds.north_m, bounds.up_m
    heights = {"base_m": max(low - WALL_REACH_M, -1_000.0), "top_m": min(high + WALL_REACH_M, 20_000.0)}
    present = value_at(document.data, ("obstacles",))
    obstacles = present if isinstance(present, tuple) else ()
    names = {entry.get("name") for entry in obstacles if isinstance(entry, dict)}
    free = (name for name in map("fence wall {}".format, count(1)) if name not in names)
    for number, wall in enumerate(walls_about(inside, (west, east, south, north)), len(obstacles)):
        entry = {"name": next(free), "polygon_enu_m": wall.round(DIGITS_M).tolist(), **heights}
        text = drawn(text, frame, ("obstacles", number), entry)
    return text


def _bounds_in(document: Document, frame: LocalFrame) -> Bounds:
    """Return the bounds of a file.

    Raises
    ------
    ConfigError
        If they are wrong.
    """
    section = value_at(document.data, ("bounds",))
    try:
        return Bounds.model_validate(local_section(document, frame, Bounds, ("bounds",), section))
    except ValidationError as error:
        found = [{**entry, "loc": ("bounds", *entry["loc"])} for entry in error.errors(include_url=False)]
        raise explained(document, found) from None


def drawn(text: str, frame: LocalFrame, path: KeyPath, value: object) -> str:
    """Return a text with one more element or corner; an element is written in degrees if the start is.

    Parameters
    ----------
    text : str
        The mission file.
    frame : LocalFrame
        Frame of the file's origin.
    path : tuple
        Path of the new entry: one of a list of sections, or of one of corners ``…_enu_m``.
    value : object
        The element or corner in metres.

    Raises
    ------
    ConfigError
        If there is no such list.
    """
    document = parsed(text)
    where = _as_written(document.data, path)
    if isinstance(value, list):
        line = str(where[-2])
        if (
            line.endswith(LINE_METRES)
            and is_in_degrees(document.data)
            and not _has(document.data, where[:-1])
        ):
            line = line.removesuffix(LINE_METRES) + LINE_DEGREES  # A new line is written as the start is.
        if not line.endswith(LINE_DEGREES):
            return with_item(text, where, value)
        corner = _shifted(frame, value, (0.0, 0.0), None)
        return with_item(text, (*where[:-2], line, where[-1]), corner)
    return with_item(text, where, _in_degrees(frame, value) if is_in_degrees(document.data) else value)


def removed(text: str, path: KeyPath) -> str:
    """Return a text without an element, a corner or a key.

    Raises
    ------
    ConfigError
        If there is none.
    """
    return without(text, _as_written(parsed(text).data, path))


def is_in_degrees(data: object) -> bool:
    """Return whether the start of a parsed file is in degrees; new places are then in degrees, too."""
    start = value_at(data, ("start",))
    return isinstance(start, dict) and DEGREES[0] in start


def set_value(text: str, path: KeyPath, value: object) -> str:
    """Return a text in which a key holds a value; the same text if it does so already.

    Raises
    ------
    ConfigError
        If there can be no such key.
    """
    present = value_at(parsed(text).data, path)
    is_same = present == value and isinstance(present, bool) is isinstance(value, bool)
    return text if is_same and value is not None else with_key(text, path, value)


def _as_written(data: object, path: KeyPath) -> KeyPath:
    """Return a path in which ``…_enu_m`` is ``…_lat_lon_deg``, if the file has that."""
    for at, part in enumerate(path):
        if isinstance(part, str) and part.endswith(LINE_METRES):
            other = part.removesuffix(LINE_METRES) + LINE_DEGREES
            section = value_at(data, path[:at])
            if isinstance(section, dict) and part not in section and other in section:
                return (*path[:at], other, *path[at + 1 :])
    return path


def _has(data: object, path: KeyPath) -> bool:
    return value_at(data, path) is not None


def _number(value: object) -> float:
    """Return a number, 0 for anything else: the check says that it is none."""
    return float(value) if isinstance(value, int | float) else 0.0


def _shifted(frame: LocalFrame, place: object, by_m: Corner, is_degrees: bool | None) -> list[float]:
    """Return a place after a step, written as it was; ``None`` is for metres that become degrees."""
    assert isinstance(place, Sequence)
    first, second = (_number(value) for value in place)
    if is_degrees is False:
        return [round(first + by_m[0], DIGITS_M), round(second + by_m[1], DIGITS_M)]
    east, north = first, second
    if is_degrees:
        east, north, _ = frame.local_from_global(first, second, frame.altitude_amsl_m)
    latitude, longitude, _ = frame.global_from_local(east + by_m[0], north + by_m[1], 0.0)
    return [round(latitude, DIGITS_DEG), round(longitude, DIGITS_DEG)]


def _moved_utm(frame: LocalFrame, path: KeyPath, place: object, by_m: Corner) -> dict[KeyPath, object]:
    """Return easting and northing of a place after a step, in the zone that stands there."""
    assert isinstance(place, dict)
    crs = crs_of_zone(str(place["zone"]))
    keys = ("easting_m", "northing_m")
    easting, northing = (_number(place[key]) for key in keys)
    east, north = transformer_between(crs, frame.crs).transform(easting, northing)
    values = frame.transformer_to(crs).transform(east + by_m[0], north + by_m[1])
    return {(*path, key): round(float(value), DIGITS_M) for key, value in zip(keys, values, strict=True)}


def _in_degrees(frame: LocalFrame, value: object) -> object:
    """Return a new element with its places in degrees; the order of its keys is kept."""
    assert isinstance(value, dict)
    new: dict[str, object] = {}
    for key, entry in value.items():
        if key == METRES[0]:
            place = [entry, value[METRES[1]]]
            new |= zip(DEGREES, _shifted(frame, place, (0.0, 0.0), None), strict=True)
        elif key.endswith(LINE_METRES):
            corners = [_shifted(frame, corner, (0.0, 0.0), None) for corner in entry]
            new[key.removesuffix(LINE_METRES) + LINE_DEGREES] = corners
        elif key != METRES[1]:
            new[key] = entry
    return new
