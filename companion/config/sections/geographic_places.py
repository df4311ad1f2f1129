"""Places in degrees or UTM, converted to metres east and north of the origin before the models read a file.

Wherever a section has ``east_m`` and ``north_m``, a file may give ``latitude_deg`` and ``longitude_deg``, or
``utm``, instead; and wherever it has a list such as ``polygon_enu_m``, a list such as
``polygon_lat_lon_deg``. The models say where that is: a section added later needs nothing more.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import get_origin

import numpy as np
from pydantic import BaseModel, ValidationError

from companion.config.explain import explained
from companion.config.models import MissionConfig, Origin
from companion.config.sections.section_base import (
    DEGREES,
    LINE_DEGREES,
    LINE_METRES,
    METRES,
    UTM,
    instead_of_metres,
    section_in,
)
from companion.config.source import Document, KeyPath
from companion.errors import ConfigError
from companion.frames import LocalFrame, transformer_between

DISTANCE_MAX_M = 200_000.0  # A place farther from the origin is a slip, such as a wrong sign.
LIMITS_DEG = {"latitude_deg": 90.0, "longitude_deg": 180.0}
UTM_LIMITS_M = {"easting_m": (100_000.0, 900_000.0), "northing_m": (0.0, 10_000_000.0)}
_ZONE = re.compile(r"(0?[1-9]|[1-5][0-9]|60)([C-HJ-NP-X])")
_BANDS = "CDEFGHJKLMNPQRSTUVWX"  # Each is eight degrees high, from 80 degrees south; X has twelve.
_BAND_TOLERANCE_DEG = 0.5  # A place near the edge of a band may be written with the next letter.
_NORTHERN, _SOUTHERN = 32_600, 32_700  # EPSG's numbers of the UTM zones begin here.


def local_document(document: Document) -> Document:
    """Return a document in which every place is in metres east and north of the origin.

    Parameters
    ----------
    document : Document
        The parsed mission file.

    Raises
    ------
    ConfigError
        If a place is given twice, by half, out of range, or far from the origin.
    """
    if not _has_degrees(MissionConfig, document.data):
        return document
    conversion = _Conversion(document, frame_of(document))
    data = conversion.converted(MissionConfig, document.data, ())
    places = document.places | conversion.places
    return replace(document, data=data, places=places, written=conversion.written)


def _has_degrees(model: type[BaseModel], value: object) -> bool:
    """Return whether a place in a section, or in the sections in it, is in degrees or UTM."""
    if isinstance(value, tuple):
        return any(_has_degrees(model, entry) for entry in value)
    if not isinstance(value, dict):
        return False
    if not value.keys().isdisjoint(instead_of_metres(model)):
        return True
    sections = ((key, section_in(field.annotation)) for key, field in model.model_fields.items())
    return any(inner is not None and _has_degrees(inner[0], value.get(key)) for key, inner in sections)


def local_section(
    document: Document, frame: LocalFrame, model: type[BaseModel], path: KeyPath, section: object
) -> object:
    """Return one section of a document with its places in metres east and north of the origin.

    Parameters
    ----------
    document : Document
        The parsed mission file.
    frame : LocalFrame
        Frame of the file's origin.
    model : type of BaseModel
        Model of the section.
    path : tuple
        Path of the section in the document.
    section : object
        Content of the section.

    Raises
    ------
    ConfigError
        If a place of the section is wrong.
    """
    return _Conversion(document, frame).converted(model, section, path)


def frame_of(document: Document) -> LocalFrame:
    """Return the frame of the file's origin, whose keys are checked first.

    Raises
    ------
    ConfigError
        If the origin is missing or wrong.
    """
    assert isinstance(document.data, dict)
    if "origin" not in document.data:
        raise document.error(("origin",), "a section with the point from which metres count")
    try:
        origin = Origin.model_validate(document.data["origin"])
    except ValidationError as error:
        found = [{**entry, "loc": ("origin", *entry["loc"])} for entry in error.errors(include_url=False)]
        raise explained(document, found) from None
    return LocalFrame(float(origin.latitude_deg), float(origin.longitude_deg), float(origin.altitude_amsl_m))


def crs_of_zone(name: str) -> str:
    """Return PROJ's name of a UTM zone's coordinate system, such as that of ``55H``.

    Raises
    ------
    ValueError
        If there is no such zone.
    """
    zone = _ZONE.fullmatch(name.upper())
    if zone is None:
        raise ValueError(name)
    base = _SOUTHERN if _BANDS.index(zone[2]) < _BANDS.index("N") else _NORTHERN
    return f"EPSG:{base + int(zone[1])}"


class _Conversion:
    """Converts the places of one document, and keeps the line that each came from."""

    def __init__(self, document: Document, frame: LocalFrame) -> None:
        self._document = document
        self._frame = frame
        self.places: dict[KeyPath, tuple[int, int, int]] = {}
        self.written: dict[KeyPath, str] = {}

    def converted(self, model: type[BaseModel], value: object, path: KeyPath) -> object:
        """Return what a section's key holds, in metres; a list of sections likewise."""
        if isinstance(value, tuple):
            return tuple(self.converted(model, entry, (*path, index)) for index, entry in enumerate(value))
        if not isinstance(value, dict):
            return value
        section = dict(value)
        for key in value.keys() & model.model_fields.keys():
            inner = section_in(model.model_fields[key].annotation)
            if inner is not None:
                section[key] = self.converted(inner[0], value[key], (*path, key))
        given = [key for key in instead_of_metres(model) if key in section]
        metres = self._metres(model, section, given, path) if given else {}
        return {key: entry for key, entry in section.items() if key not in given} | metres

    def _metres(
        self, model: type[BaseModel], section: dict[str, object], given: Sequence[str], path: KeyPath
    ) -> dict[str, object]:
        """Return in metres what the given keys of a section hold."""
        metres: dict[str, object] = {}
        if not {*DEGREES, UTM}.isdisjoint(given):
            is_box = get_origin(model.model_fields[METRES[0]].annotation) is tuple
            metres |= self._box(path, section) if is_box else self._point(path, section)
        for key in given:
            if key.endswith(LINE_DEGREES):
                metres |= self._line(path, key, section)
        return metres

    def _point(self, path: KeyPath, section: dict[str, object]) -> dict[str, object]:
        """Return east and north of a section's place."""
        self._one_way(path, section)
        if UTM in section:
            latitude, longitude = self._from_utm((*path, UTM), section[UTM])
            place, written = (*path, UTM), f"utm {latitude:.6f}, {longitude:.6f}"
        else:
            self._both(path, section)
            latitude, longitude = (self._degrees((*path, key), key, section[key]) for key in DEGREES)
            place, written = (
                (*path, DEGREES[0]),
                f"latitude_deg {latitude:.10g}, longitude_deg {longitude:.10g}",
            )
        east, north = self._local(place, [latitude], [longitude])[0]
        for key, value in zip(METRES, (east, north), strict=True):
            self.places[*path, key] = self._document.places.get(place, (1, 0, 0))
            self.written[*path, key] = f"{value:.1f}, from {written}"
        return {METRES[0]: east, METRES[1]: north}

    def _box(self, path: KeyPath, section: dict[str, object]) -> dict[str, object]:
        """Return the largest box east and north within two parallels and two meridians."""
        if UTM in section:
            raise self._document.error((*path, UTM), "latitude_deg and longitude_deg, or east_m and north_m")
        self._one_way(path, section)
        self._both(path, section)
        (south, north), (west, east) = (self._pair(path, key, section[key]) for key in DEGREES)
        middle = min(max(self._frame.longitude_deg, west), east)  # Where the parallels bulge most.
        latitudes = [south, south, south, north, north, north]
        places = self._local((*path, DEGREES[0]), latitudes, [west, middle, east] * 2)
        corners = np.array(places).reshape(2, 3, 2)
        for key, degrees in zip(METRES, reversed(DEGREES), strict=True):
            self.places[*path, key] = self._document.places[*path, degrees]
        return {
            METRES[0]: (float(corners[:, 0, 0].max()), float(corners[:, 2, 0].min())),
            METRES[1]: (float(corners[0, :, 1].max()), float(corners[1, :, 1].min())),
        }

    def _pair(self, path: KeyPath, key: str, value: object) -> tuple[float, float]:
        if not isinstance(value, tuple) or len(value) != 2:
            raise self._document.error((*path, key), "the lowest value, then a higher one (degrees)")
        low, high = (self._degrees((*path, key, index), key, entry) for index, entry in enumerate(value))
        return low, high

    def _line(self, path: KeyPath, key: str, section: dict[str, object]) -> dict[str, object]:
        """Return the corners of a polygon, or the points of a route, east and north."""
        target = key.removesuffix(LINE_DEGREES) + LINE_METRES
        if target in section:
            raise self._document.error((*path, key), f"either {target} or {key}, not both")
        corners = section[key]
        if not isinstance(corners, tuple):
            raise self._document.error((*path, key), "a list of pairs [latitude, longitude] (degrees)")
        degrees: list[list[float]] = [[], []]
        for index, corner in enumerate(corners):
            place = (*path, key, index)
            if not isinstance(corner, tuple) or len(corner) != 2:
                raise self._document.error(place, "a pair [latitude, longitude] (degrees)")
            for axis, name in enumerate(DEGREES):
                degrees[axis].append(self._degrees((*place, axis), name, corner[axis]))
            self.places[*path, target, index] = self._document.places.get(place, (1, 0, 0))
        self.places[*path, target] = self._document.places.get((*path, key), (1, 0, 0))
        return {target: tuple(self._local((*path, key), *degrees))}

    def _one_way(self, path: KeyPath, section: dict[str, object]) -> None:
        """Check that a place is given in one way only."""
        notations = [[key for key in keys if key in section] for keys in (METRES, DEGREES, (UTM,))]
        given = [way[0] for way in notations if way]
        if len(given) > 1:
            raise self._document.error(
                (*path, given[1]), f"left out, since {given[0]} is given: a place is written in one way"
            )

    def _both(self, path: KeyPath, section: dict[str, object]) -> None:
        for key, other in (DEGREES, DEGREES[::-1]):
            if key not in section:
                raise self._document.error((*path, key), f"a value in degrees, since {other} is given")

    def _number(self, path: KeyPath, value: object, low: float, high: float, unit: str) -> float:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not low <= float(value) <= high:  # type: ignore[arg-type]
            raise self._document.error(path, f"a number from {low:.0f} to {high:.0f} ({unit})")
        return float(value)  # type: ignore[arg-type]

    def _degrees(self, path: KeyPath, key: str, value: object) -> float:
        return self._number(path, value, -LIMITS_DEG[key], LIMITS_DEG[key], f"degrees of {key[:-4]}")

    def _from_utm(self, path: KeyPath, value: object) -> tuple[float, float]:
        """Return latitude and longitude of a place in UTM [deg]."""
        if not isinstance(value, dict) or value.keys() != {"zone", *UTM_LIMITS_M}:
            raise self._document.error(path, "the keys zone, easting_m and northing_m, such as zone: 55H")
        zone = _ZONE.fullmatch(str(value["zone"]).upper())
        if zone is None:
            expected = "a zone from 1 to 60 and the letter of its band, C to X, such as 55H"
            raise self._document.error((*path, "zone"), expected)
        easting, northing = (
            self._number((*path, key), value[key], *limits, "metres") for key, limits in UTM_LIMITS_M.items()
        )
        low = -80.0 + 8.0 * _BANDS.index(zone[2])
        to_degrees = transformer_between(crs_of_zone(str(value["zone"])), "EPSG:4326")
        longitude, latitude = to_degrees.transform(easting, northing)
        high = low + (12.0 if zone[2] == "X" else 8.0)
        if not low - _BAND_TOLERANCE_DEG <= latitude <= high + _BAND_TOLERANCE_DEG:
            expected = f"the letter of the band that the place lies in; its latitude is {latitude:.3f}"
            raise self._document.error((*path, "zone"), expected)
        return float(latitude), float(longitude)

    def _local(
        self, path: KeyPath, latitudes: Sequence[float], longitudes: Sequence[float]
    ) -> list[tuple[float, float]]:
        """Return east and north of places near the origin [m]."""
        east, north = self._frame.places_from_global(np.array(latitudes), np.array(longitudes))
        distances = np.hypot(east, north)
        for index, distance in enumerate(distances):
            if not distance <= DISTANCE_MAX_M:
                raise self._far(path, latitudes[index], longitudes[index], float(distance))
        return list(zip(east.tolist(), north.tolist(), strict=True))

    def _far(self, path: KeyPath, latitude: float, longitude: float, distance_m: float) -> ConfigError:
        far = (
            "farther than can be measured"
            if not math.isfinite(distance_m)
            else f"{distance_m / 1000.0:.0f} km"
        )
        origin = f"{self._frame.latitude_deg:.10g}, {self._frame.longitude_deg:.10g}"
        return self._document.error(
            path,
            f"a place within {DISTANCE_MAX_M / 1000.0:.0f} km of the origin, {origin}",
            value=f"{latitude:.10g}, {longitude:.10g}, which is {far} from it",
        )
