"""The text of a mission file for a composed mission: places in degrees, with comments, remarks at its top."""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence

import yaml

from companion.config import MissionConfig
from companion.config.conversion.aircraft_classes import CLASSES, sections_text
from companion.config.conversion.found_places import Degrees, FoundPlace, Kind
from companion.config.conversion.mission_composition import Composed, Wishes
from companion.config.source import written_text
from companion.plain_text import printable

DESCRIPTION_MAX = 500
DIGITS = 9  # Decimals of a degree: the last one is a tenth of a millimetre.
_NAME_MAX, _SHORT_NAME_MAX, _MISSION_NAME_MAX = 64, 24, 64
# What is made anew from the places; every other section of a mission is kept as it is.
_WRITTEN_HERE = {
    "name", "description", "dimension", "unit_m", "origin", "bounds", "start", "goals", "radars",
    "dynamic_threats", "obstacles", "glide",
}  # fmt: skip
_SECTIONS = tuple(name for name in MissionConfig.model_fields if name not in _WRITTEN_HERE)
_SIMULATION = """\
# Weather of the simulator; it matters for companion sitl only.
simulation:
  wind_speed_m_s: 3
  wind_from_deg: 240
  turbulence: light
"""


def mission_name(words: str) -> str:
    """Return a name that a mission may have, made of any words."""
    return _plain(words, r"[^A-Za-z0-9._-]+", "-")[:_MISSION_NAME_MAX] or "mission"


def text_of_mission(mission: Composed, wishes: Wishes, description: str, head: Sequence[str] = ()) -> str:
    """Return the text of a mission file.

    Parameters
    ----------
    mission : Composed
        The mission's places.
    wishes : Wishes
        The mission's name, and where all else comes from.
    description : str
        Description for people.
    head : sequence of str
        Lines of comment at the top.
    """
    writer = _Writer(mission)
    places = writer.sections(wishes)
    remarks = [*mission.remarks, *writer.renamed]
    comments = [*head, *(["Not taken, or taken otherwise than it was found:"] if remarks else [])]
    comments += [f"- {remark}" for remark in remarks]
    origin, bounds = mission.origin, mission.bounds
    unit = CLASSES[wishes.aircraft].unit_m if wishes.like is None else float(wishes.like.unit_m)
    box = ", ".join(
        f"{key}: [{_number(low)}, {_number(high)}]"
        for key, low, high in zip(("east_m", "north_m", "up_m"), bounds[0::2], bounds[1::2], strict=True)
    )
    lines = [
        *(f"# {printable(comment)}" for comment in comments),
        f"name: {written_text(wishes.name)}",
        f"description: {json.dumps(printable(description)[:DESCRIPTION_MAX])}",
        f"dimension: {mission.dimension}              # 2: at the start's height; 3: plans climb and descend",
        f"unit_m: {_number(unit)}",
        "# Heights below (up_m, base_m, top_m) are metres above the origin's altitude.",
        f"origin: {{{_place((origin.latitude_deg, origin.longitude_deg))}, "
        f"altitude_amsl_m: {_number(origin.altitude_amsl_m)}}}",
        f"bounds: {{{box}}}  # plans stay in this box",
        *places,
    ]
    return "\n".join(lines) + "\n" + _rest(wishes)


def remarks_of(text: str) -> list[str]:
    """Return the remarks at the top of a mission file's text."""
    comments = re.match(r"(?:#.*\n)*", text)
    lines = comments.group().splitlines() if comments else []
    return [line.removeprefix("# - ") for line in lines if line.startswith("# - ")]


def _rest(wishes: Wishes) -> str:
    """Return the sections that no place is in."""
    if wishes.like is None:
        return sections_text(CLASSES[wishes.aircraft]) + _SIMULATION
    given = wishes.like.model_dump(mode="json", exclude_unset=True, include=set(_SECTIONS), exclude_none=True)
    return yaml.safe_dump({key: given[key] for key in _SECTIONS if key in given}, sort_keys=False)


def _number(value: object) -> str:
    """Return a number without needless digits."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):
        return str(value)
    written = f"{float(str(value)):.{DIGITS}f}".rstrip("0").rstrip(".")
    return "0" if written == "-0" else written


def _place(corner: Degrees) -> str:
    return f"latitude_deg: {_number(corner[0])}, longitude_deg: {_number(corner[1])}"


def _plain(words: str, others: str, filler: str) -> str:
    """Return words with accents and other characters replaced, beginning with a letter or digit."""
    plain = unicodedata.normalize("NFKD", words).encode("ascii", "ignore").decode()
    return re.sub(r"^[^A-Za-z0-9]+", "", re.sub(others, filler, plain)).strip(filler)


class _Writer:
    """Writes the sections of places, and gives each a name of its own."""

    def __init__(self, mission: Composed) -> None:
        self._mission = mission
        self.renamed: list[str] = []

    def sections(self, wishes: Wishes) -> list[str]:
        """Return the lines of start, goals, threats, obstacles and glide."""
        places = self._mission.places
        start = self._mission.start
        lines = [f"start: {{{_place(start.corners[0])}, {self._values(start.values)}}}"]
        goals = places.get(Kind.GOAL, ())
        lines += (
            ["goals:"]
            if goals
            else ["goals: from_autopilot  # the waypoints of the mission in the autopilot"]
        )
        for goal in goals:
            comment = f"  # {printable(goal.name)}" if goal.name else ""
            lines.append(f"  - {{{_place(goal.corners[0])}, {self._values(goal.values)}}}{comment}")
        for key, kind in (("radars", Kind.RADAR), ("dynamic_threats", Kind.MOVING_THREAT)):
            lines += self._list(key, places.get(kind, ()), "")
        lines += self._list("obstacles", places.get(Kind.OBSTACLE, ()), "")
        like = wishes.like
        if like is not None and like.glide is not None:
            lines += self._glide(like)
        return lines

    def _glide(self, like: MissionConfig) -> list[str]:
        assert like.glide is not None
        places = self._mission.places
        lines = [
            "glide:",
            f"  ratio: {_number(like.glide.ratio)}",
            f"  airspeed_m_s: {_number(like.glide.airspeed_m_s)}",
        ]
        lines += self._list("fields", places.get(Kind.FIELD, ()), "  ", _SHORT_NAME_MAX)
        return lines + self._list("people", places.get(Kind.PEOPLE, ()), "  ", _SHORT_NAME_MAX)

    def _list(
        self, key: str, places: Sequence[FoundPlace], indent: str, name_max: int = _NAME_MAX
    ) -> list[str]:
        if not places:
            return []
        taken: set[str] = set()
        lines = [f"{indent}{key}:"]
        for place in places:
            name = self._name(place, taken, name_max)
            where = self._where(place)
            values = self._values(place.values)
            lines.append(f"{indent}  - {{name: {json.dumps(name)}, {where}{', ' if values else ''}{values}}}")
        return lines

    @staticmethod
    def _where(place: FoundPlace) -> str:
        """Return the keys of a place's point, its polygon, or its point and route."""
        if place.kind in (Kind.OBSTACLE, Kind.PEOPLE):
            return f"polygon_lat_lon_deg: {_pairs(place.corners)}"
        if len(place.corners) > 1:
            return f"{_place(place.corners[0])}, route_lat_lon_deg: {_pairs(place.corners[1:])}"
        return _place(place.corners[0])

    @staticmethod
    def _values(values: Mapping[str, object]) -> str:
        return ", ".join(f"{key}: {_written(value)}" for key, value in values.items())

    def _name(self, place: FoundPlace, taken: set[str], name_max: int) -> str:
        """Return a name that the mission file accepts, and that no other of the list has."""
        base = _plain(place.name, r"[^A-Za-z0-9 ._-]", "_")[:name_max] or place.kind.value
        name, number = base, 2
        while name in taken:
            suffix = f"_{number}"
            name, number = base[: name_max - len(suffix)] + suffix, number + 1
        taken.add(name)
        if place.name and name != place.name:
            self.renamed.append(f"{place.where}: named {name!r} here")
        return name


def _written(value: object) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_written, value)) + "]"
    return json.dumps(value) if isinstance(value, str) else _number(value)


def _pairs(corners: Iterable[Degrees]) -> str:
    return "[" + ", ".join(f"[{_number(lat)}, {_number(lon)}]" for lat, lon in corners) + "]"
