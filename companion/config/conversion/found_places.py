"""Places that were found in files: what each is, where it is, and what is known of it.

An :class:`Importer` collects the places of one file, and remarks on all that it could not take. Each kind of
place has properties, named as in the mission file; :data:`PROPERTIES` lists them.
"""

from __future__ import annotations

import collections
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from companion.errors import ConfigError
from companion.frames import LocalFrame
from companion.mission.fences import CIRCLE_SIDES

PLACES_MAX = 20_000
CORNERS_MAX = 200_000
NUMBER_MAX = 1e7
RADIUS_MAX_M = 100_000.0
EXCERPT_MAX = 80  # Characters of a wrong value in a message.
LISTED_MAX = 20  # Longer lists of numbers are cut in remarks.

Degrees = tuple[float, float]


class Kind(StrEnum):
    """The role of a place in a mission."""

    ORIGIN = "origin"
    BOUNDS = "bounds"
    START = "start"
    TAKEOFF = "takeoff"
    GOAL = "goal"
    OBSTACLE = "obstacle"
    FENCE = "fence"
    NO_FLY = "no_fly"
    RADAR = "radar"
    MOVING_THREAT = "moving_threat"
    FIELD = "field"
    PEOPLE = "people"


AREAS = frozenset({Kind.BOUNDS, Kind.OBSTACLE, Kind.FENCE, Kind.NO_FLY, Kind.PEOPLE})
# Words by which people name kinds, in properties and as names of folders; plurals are understood, too.
WORDS = {kind.value: kind for kind in Kind if kind is not Kind.TAKEOFF} | {
    "home": Kind.ORIGIN,
    "target": Kind.GOAL,
    "waypoint": Kind.GOAL,
    "building": Kind.OBSTACLE,
    "tower": Kind.OBSTACLE,
    "geofence": Kind.FENCE,
    "inclusion": Kind.FENCE,
    "exclusion": Kind.NO_FLY,
    "vehicle": Kind.MOVING_THREAT,
    "landing_field": Kind.FIELD,
    "rally": Kind.FIELD,
}
_POINT: dict[str, type] = {"up_m": float, "altitude_amsl_m": float}
_AREA: dict[str, type] = {"radius_m": float}
_PRISM: dict[str, type] = {
    "base_m": float,
    "top_m": float,
    "base_amsl_m": float,
    "top_amsl_m": float,
    "height_m": float,
}
PROPERTIES: dict[Kind, dict[str, type]] = {
    Kind.ORIGIN: {"altitude_amsl_m": float},
    Kind.BOUNDS: {"lowest_up_m": float, "highest_up_m": float},
    Kind.START: _POINT | {"course_deg": float},
    Kind.TAKEOFF: _POINT,
    Kind.GOAL: _POINT | {"acceptance_radius_m": float},
    Kind.OBSTACLE: _PRISM | _AREA,
    Kind.FENCE: _AREA,
    Kind.NO_FLY: _AREA,
    Kind.RADAR: _POINT
    | {"max_threat_radius_m": float, "boundary_coefficient_per_m": float, "known_beforehand": bool}
    | {"model": str, "model_values": tuple},
    Kind.MOVING_THREAT: _POINT
    | {"max_threat_radius_m": float, "speed_m_s": float, "turn_radius_m": float, "behaviour": str}
    | {"identity": str, "system_id": int},
    Kind.FIELD: _POINT | {"radius_m": float},
    Kind.PEOPLE: _AREA,
}
_ALIASES = {
    Kind.RADAR: {"radius_m": "max_threat_radius_m"},
    Kind.MOVING_THREAT: {"radius_m": "max_threat_radius_m"},
    Kind.OBSTACLE: {"height": "height_m"},
}
_TRUTHS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


@dataclass(frozen=True, slots=True)
class FoundPlace:
    """One place of a file.

    Parameters
    ----------
    kind : Kind
        What it is.
    corners : tuple of tuple of float
        Latitude and longitude [deg]: of a point, of the corners of an area, or of a vehicle and its route.
    name : str
        Name as in the file; may be empty.
    values : mapping
        Properties of the kind that are known, see :data:`PROPERTIES`.
    where : str
        File, and the place's name or number in it, for messages.
    """

    kind: Kind
    corners: tuple[Degrees, ...]
    name: str = ""
    values: Mapping[str, object] = field(default_factory=dict)
    where: str = ""


def kind_named(word: str) -> Kind | None:
    """Return the kind that a word names, such as ``Buildings``; None if it names none."""
    plain = word.strip().lower().replace("-", "_").replace(" ", "_")
    return WORDS.get(plain) or WORDS.get(plain.removesuffix("s"))


def circle(centre: Degrees, radius_m: float, *, is_inside: bool) -> tuple[Degrees, ...]:
    """Return a polygon for a circle.

    Parameters
    ----------
    centre : tuple of float
        Latitude and longitude [deg].
    radius_m : float
        Radius [m].
    is_inside : bool
        True for a polygon within the circle, as a fence needs; False for one around it, as an obstacle does.
    """
    reach = radius_m if is_inside else radius_m / math.cos(math.pi / CIRCLE_SIDES)
    angles = np.arange(CIRCLE_SIDES) * 2.0 * math.pi / CIRCLE_SIDES
    frame = LocalFrame(*centre, altitude_amsl_m=0.0)
    latitudes, longitudes = frame.places_from_local(reach * np.sin(angles), reach * np.cos(angles))
    return tuple(zip(latitudes.tolist(), longitudes.tolist(), strict=True))


class Importer:
    """Collects the places of one file.

    Parameters
    ----------
    file : str
        Name of the file, for messages.
    default_kind : Kind or None
        Kind of the places of which the file does not say it.
    """

    def __init__(self, file: str, default_kind: Kind | None = None) -> None:
        self.file = file
        self.default_kind = default_kind
        self.places: list[FoundPlace] = []
        self._remarks: list[str] = []
        self._unknown: collections.Counter[str] = collections.Counter()
        self._left: dict[tuple[str, str], list[str]] = {}
        self._num_corners = 0

    @property
    def remarks(self) -> tuple[str, ...]:
        """One line for each part of the file that was left out or changed."""
        left = [
            f"{self.file}: {what}{_listed(numbers)}: {why}" for (what, why), numbers in self._left.items()
        ]
        unknown = [
            f"{self.file}: property {name!r} of {count} feature(s): not taken: a mission file has no such key"
            for name, count in self._unknown.items()
        ]
        return (*self._remarks, *left, *unknown)

    def remark(self, what: str, why: str) -> None:
        """Remark on something, once."""
        line = f"{self.file}: {what}: {why}"
        if line not in self._remarks:
            self._remarks.append(line)

    def leave(self, what: str, number: object, why: str) -> None:
        """Remark on something that is not taken; numbers of the same with the same reason share a line."""
        self._left.setdefault((what, f"not taken: {why}"), []).append(str(number))

    def error(self, key: str, value: object, expected: str, line: int | None = None) -> ConfigError:
        """Return the error for something in the file."""
        words = value if isinstance(value, str) else "" if value is None else repr(value)
        return ConfigError(self.file, line, key, words[:EXCERPT_MAX] or "nothing", expected)

    def number(self, key: str, value: object, low: float = -NUMBER_MAX, high: float = NUMBER_MAX) -> float:
        """Return a number, which may be written as text.

        Raises
        ------
        ConfigError
            If it is none, not finite, or out of range.
        """
        try:
            number = math.nan if isinstance(value, bool) or value is None else float(str(value))
        except ValueError:
            number = math.nan
        if not low <= number <= high:
            raise self.error(key, value, f"a number from {low:g} to {high:g}")
        return number

    def degrees(self, key: str, latitude: object, longitude: object) -> Degrees:
        """Return a place.

        Raises
        ------
        ConfigError
            If a number is out of range.
        """
        return (
            self.number(f"{key} latitude", latitude, -90.0, 90.0),
            self.number(f"{key} longitude", longitude, -180.0, 180.0),
        )

    def add(
        self, kind: Kind, corners: Iterable[Degrees], name: str, properties: Mapping[str, object], label: str
    ) -> None:
        """Add a place, or an area with a radius about its middle.

        Parameters
        ----------
        kind : Kind
            What it is.
        corners : iterable of tuple of float
            Latitude and longitude [deg].
        name : str
            Name as in the file.
        properties : mapping
            Properties as in the file; those that the kind does not have are remarked.
        label : str
            How the file's reader finds it there, such as ``feature 3``.

        Raises
        ------
        ConfigError
            If a property is wrong, or there are too many places.
        """
        places = tuple(corners)
        self._num_corners += len(places)
        if len(self.places) >= PLACES_MAX or self._num_corners > CORNERS_MAX:
            raise self.error("file", "more places", f"at most {PLACES_MAX} places, {CORNERS_MAX} corners")
        values = self.values(kind, properties, label)
        if kind in AREAS:
            radius = values.pop("radius_m", None)
            if len(places) == 1 and isinstance(radius, float):
                reach = self.number(f"{label} radius_m", radius, 0.1, RADIUS_MAX_M)
                places = circle(places[0], reach, is_inside=kind is Kind.FENCE)
                self.remark(
                    f"{label} {name}".strip(), f"a circle is taken as a polygon of {CIRCLE_SIDES} sides"
                )
            places = _open(places)
            if len(places) < 3:
                self.leave(f"{kind.value} {name}".strip(), label, "an area has three corners, or radius_m")
                return
        where = f"{self.file}: {label}" + (f" {name!r}" if name else "")
        self.places.append(FoundPlace(kind, places, name, values, where))

    def values(self, kind: Kind, properties: Mapping[str, object], label: str) -> dict[str, object]:
        """Return those properties that a kind has, as numbers, lists of them, truths and text.

        Raises
        ------
        ConfigError
            If one is wrong.
        """
        found: dict[str, object] = {}
        for written, value in properties.items():
            name = _ALIASES.get(kind, {}).get(written, written)
            wanted = PROPERTIES[kind].get(name)
            if wanted is None:
                self._unknown[written] += 1
            elif value is not None and value != "":
                found[name] = self._value(f"{label} {written}", value, wanted)
        return found

    def _value(self, key: str, value: object, wanted: type) -> object:
        if wanted is bool:
            if str(value).strip().lower() not in _TRUTHS:
                raise self.error(key, value, "true or false")
            return _TRUTHS[str(value).strip().lower()]
        if wanted is str:
            return str(value).strip()
        if wanted is tuple:
            parts = value if isinstance(value, list | tuple) else re.split(r"[\s,;]+", str(value).strip())
            return tuple(self.number(key, part) for part in parts)
        number = self.number(key, value)
        return int(number) if wanted is int else number


def _listed(numbers: Sequence[str]) -> str:
    shown = ", ".join(number for number in numbers[:LISTED_MAX] if number)
    more = f" and {len(numbers) - LISTED_MAX} more" if len(numbers) > LISTED_MAX else ""
    return f" {shown}{more}" if shown else ""


def _open(corners: tuple[Degrees, ...]) -> tuple[Degrees, ...]:
    """Return corners without repetitions, and without the first one again at the end."""
    kept = [corner for index, corner in enumerate(corners) if index == 0 or corner != corners[index - 1]]
    while len(kept) > 1 and kept[0] == kept[-1]:
        kept.pop()
    return tuple(kept)
