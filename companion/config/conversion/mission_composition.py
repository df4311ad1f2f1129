"""Composes a mission file of places that were found in other files.

What a mission file needs in addition to places comes from a class of aircraft, or from another mission
file. Nothing is guessed of start and goals: without them the error says what to add.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.config import MissionConfig
from companion.config.conversion.aircraft_classes import CLASSES, DEFAULT_CLASS
from companion.config.conversion.fence_walls import common_area, walls_about
from companion.config.conversion.found_places import FoundPlace, Importer, Kind
from companion.config.conversion.mission_places import places_of
from companion.config.sections.geographic_places import DISTANCE_MAX_M
from companion.errors import ConfigError
from companion.frames import FloatArray, LocalFrame, course_from_direction

HEIGHT_M = 100.0  # Height over home where no file says one.
FIELD_RADIUS_M = 50.0
MARGIN_MIN_M = 500.0  # Without a fence, the bounds reach this far beyond all places, or four turns.
MARGIN_TURNS = 4.0
BELOW_M, ABOVE_M = 40.0, 60.0  # The bounds reach this far below and above all heights that are flown.
LOWEST_M = 20.0
WALL_REACH_M = 100.0  # A wall without heights reaches this far beyond the bounds.
HOME_TOLERANCE_M = 1.0

_TOP_KEYS = ("top_m", "top_amsl_m", "height_m")


@dataclass(frozen=True, slots=True)
class Wishes:
    """The settings that a user states in addition to the files.

    Parameters
    ----------
    name : str
        Name of the mission.
    aircraft : str
        Class of the aircraft, one of :data:`CLASSES`.
    like : MissionConfig or None
        Mission from which all comes that the files do not have.
    home : tuple of float or None
        Latitude, longitude [deg] and altitude [m] of home, in place of that in the files.
    height_m : float
        Height over home of goals without a height [m].
    goals_from_autopilot : bool
        True to leave the goals to the mission in the autopilot.
    """

    name: str
    aircraft: str = DEFAULT_CLASS
    like: MissionConfig | None = None
    home: tuple[float, float, float] | None = None
    height_m: float = HEIGHT_M
    goals_from_autopilot: bool = False


@dataclass(frozen=True, slots=True)
class Composed:
    """The places of a mission, complete, with heights above the origin.

    Parameters
    ----------
    origin : LocalFrame
        Origin of the mission.
    bounds : tuple of float
        Lowest and highest east, north and up [m].
    start : FoundPlace
        The start, with ``up_m`` and ``course_deg``.
    dimension : int
        2 if all is at one height, else 3.
    places : mapping
        Goals, obstacles, radars, moving threats, fields and people, by kind.
    remarks : tuple of str
        What was taken otherwise than it was found, or not at all.
    """

    origin: LocalFrame
    bounds: tuple[float, float, float, float, float, float]
    start: FoundPlace
    dimension: int
    places: Mapping[Kind, Sequence[FoundPlace]]
    remarks: tuple[str, ...]


def composed(importers: Sequence[Importer], wishes: Wishes) -> Composed:
    """Return a mission of the places in files.

    Parameters
    ----------
    importers : sequence of Importer
        The files' places.
    wishes : Wishes
        What the user says beside them.

    Raises
    ------
    ConfigError
        If something that a mission needs is missing, or places contradict each other.
    """
    return _Composition(importers, wishes).composed()


class _Composition:
    def __init__(self, importers: Sequence[Importer], wishes: Wishes) -> None:
        self._wishes = wishes
        self._files = ", ".join(importer.file for importer in importers)
        self._remarks: list[str] = [remark for importer in importers for remark in importer.remarks]
        self._homes = [self._home_in(importer) for importer in importers]
        self._origin = self._find_origin()
        self._remark_homes([place for importer in importers for place in importer.places])
        found: dict[Kind, list[FoundPlace]] = {kind: [] for kind in Kind}
        for importer, home in zip(importers, self._homes, strict=True):
            shift = 0.0 if home is None else home.altitude_amsl_m - self._origin.altitude_amsl_m
            for place in importer.places:
                resolved = self._resolved(place, shift)
                found[resolved.kind].append(resolved)
        self._found = found
        self._check_distances()
        if wishes.like is not None:
            self._add_missing(places_of(wishes.like))

    def _missing(self, key: str, expected: str, place: FoundPlace | None = None) -> ConfigError:
        return ConfigError(self._files if place is None else place.where, None, key, "nothing", expected)

    @staticmethod
    def _home_in(importer: Importer) -> LocalFrame | None:
        """Return the first home of a file that has an altitude."""
        for place in importer.places:
            altitude = place.values.get("altitude_amsl_m")
            if place.kind is Kind.ORIGIN and isinstance(altitude, float | int):
                return LocalFrame(*place.corners[0], altitude_amsl_m=float(altitude))
        return None

    def _find_origin(self) -> LocalFrame:
        if self._wishes.home is not None:
            return LocalFrame(*self._wishes.home)
        for home in self._homes:
            if home is not None:
                return home
        if self._wishes.like is not None:
            return self._wishes.like.frame
        raise self._missing(
            "home", "a home with its altitude in one of the files, or --home LAT,LON,ALTITUDE"
        )

    def _remark_homes(self, places: Iterable[FoundPlace]) -> None:
        """Remark on each home in the files that is not the one from which the mission's metres count."""
        for home in places:
            if home.kind is not Kind.ORIGIN:
                continue
            if "altitude_amsl_m" not in home.values:
                self._remarks.append(f"{home.where}: not taken: it has no altitude")
                continue
            altitude_m = float(str(home.values["altitude_amsl_m"]))
            east, north, up = self._origin.local_from_global(*home.corners[0], altitude_m)
            if not math.hypot(east, north, up) <= HOME_TOLERANCE_M:
                away = f"{math.hypot(east, north):.0f} m from the home that counts, {up:+.0f} m"
                self._remarks.append(f"{home.where}: not taken: it is {away}")

    def _add_missing(self, places: Sequence[FoundPlace]) -> None:
        """Add what no file has from another mission."""
        has_home = self._wishes.home is not None or any(self._homes)
        groups = ({Kind.BOUNDS, Kind.FENCE}, {Kind.OBSTACLE, Kind.NO_FLY})
        absent = {kind for kind in Kind if not self._found[kind]}
        for group in groups:
            if not group <= absent:
                absent -= group
        if has_home:
            absent.discard(Kind.START)
        if self._wishes.goals_from_autopilot:
            absent.discard(Kind.GOAL)
        assert self._wishes.like is not None
        shift = float(self._wishes.like.origin.altitude_amsl_m) - self._origin.altitude_amsl_m
        for place in places:
            if place.kind in absent:
                self._found[place.kind].append(self._resolved(place, shift))

    def _check_distances(self) -> None:
        """Check that all places are near home: far ones are slips, and cannot be measured from it."""
        for place in (place for places in self._found.values() for place in places):
            if place.kind is Kind.TAKEOFF:  # Only its height counts; its place is often not set.
                continue
            distances = np.hypot(*self._local([place]).T)
            far = int(np.argmax(np.where(np.isfinite(distances), distances, np.inf)))
            if not distances[far] <= DISTANCE_MAX_M:
                latitude, longitude = place.corners[far]
                away = f"{distances[far] / 1000.0:.0f} km"
                found = f"{latitude:.6f}, {longitude:.6f}, which is {away} from home"
                expected = f"a place within {DISTANCE_MAX_M / 1000.0:.0f} km of home"
                raise ConfigError(place.where, None, "place", found, expected)

    def _resolved(self, place: FoundPlace, shift_m: float) -> FoundPlace:
        """Return a place whose heights are above the origin."""
        values = dict(place.values)
        if place.kind is Kind.ORIGIN:
            return place
        for over_home, over_sea in (("up_m", "altitude_amsl_m"), ("base_m", "base_amsl_m")):
            self._take_height(place, values, over_home, over_sea, shift_m)
        if place.kind is Kind.OBSTACLE:
            if sum(key in values for key in _TOP_KEYS) > 1:
                raise ConfigError(place.where, None, "top", "two heights", f"one of {', '.join(_TOP_KEYS)}")
            if "height_m" in values:
                values["top_m"] = float(str(values.pop("height_m"))) + float(str(values.get("base_m", 0.0)))
            else:
                self._take_height(place, values, "top_m", "top_amsl_m", shift_m)
            if "top_m" not in values:
                self._remarks.append(f"{place.where}: no height: closed at all heights")
                return replace(place, kind=Kind.NO_FLY, values={})
            top = float(str(values["top_m"]))
            values.setdefault("base_m", 0.0 if top > 0.0 else top - 10.0)
        if place.kind is Kind.BOUNDS:
            for key in values.keys() & {"lowest_up_m", "highest_up_m"}:
                values[key] = round(float(str(values[key])) + shift_m, 3)
        return replace(place, values=values)

    def _take_height(
        self, place: FoundPlace, values: dict[str, object], over_home: str, over_sea: str, shift_m: float
    ) -> None:
        """Put a height above the origin where one above home or above the sea is."""
        if over_home in values and over_sea in values:
            raise ConfigError(
                place.where, None, over_sea, str(values[over_sea]), f"left out beside {over_home}"
            )
        if over_home in values:
            values[over_home] = round(float(str(values[over_home])) + shift_m, 3)
        elif over_sea in values:
            over = float(str(values.pop(over_sea))) - self._origin.altitude_amsl_m
            values[over_home] = round(over, 3)

    def composed(self) -> Composed:
        """Return the mission."""
        goals = self._goals()
        start = self._start(goals)
        goals = [self._with_height(goal, float(str(start.values["up_m"]))) for goal in goals]
        heights = [float(str(place.values["up_m"])) for place in (start, *goals)]
        low, high = min(heights), max(heights)
        up = (max(low - BELOW_M, min(LOWEST_M, low - 5.0)), high + ABOVE_M)
        box, walls = self._fence(start, goals)
        for place in self._found[Kind.BOUNDS][:1]:
            up = tuple(  # type: ignore[assignment]
                float(str(place.values.get(key, usual)))
                for key, usual in zip(("lowest_up_m", "highest_up_m"), up, strict=True)
            )
        walls = [*walls, *self._found[Kind.NO_FLY]]
        closed = {"base_m": max(up[0] - WALL_REACH_M, -1_000.0), "top_m": min(up[1] + WALL_REACH_M, 20_000.0)}
        obstacles = [
            replace(wall, kind=Kind.OBSTACLE, name=wall.name or "no-fly zone", values=closed)
            for wall in walls
        ]
        like = self._wishes.like
        is_level = low == high and (like is None or like.dimension == 2)
        kept = {Kind.GOAL: goals, Kind.OBSTACLE: [*self._found[Kind.OBSTACLE], *obstacles]}
        places = kept | self._threats() | self._glide_places()
        return Composed(self._origin, (*box, *up), start, 2 if is_level else 3, places, tuple(self._remarks))

    def _goals(self) -> list[FoundPlace]:
        goals, like = self._found[Kind.GOAL], self._wishes.like
        if self._wishes.goals_from_autopilot:
            self._remarks += [f"{goal.where}: not taken: goals are the autopilot's" for goal in goals]
            return []
        if goals or (like is not None and like.goals_from_autopilot):
            return goals
        raise self._missing(
            "goals",
            "waypoints, a route, or places of kind goal in one of the files, or --goals-from-autopilot",
        )

    def _start(self, goals: Sequence[FoundPlace]) -> FoundPlace:
        """Return the start: as it is given, or above home at the height of the take-off."""
        starts, takeoffs = self._found[Kind.START], self._found[Kind.TAKEOFF]
        for other in (*starts[1:], *takeoffs[1:]):
            self._remarks.append(
                f"{other.where}: not taken: a mission has one start, and this is a second one"
            )
        home = self._wishes.home or next(filter(None, self._homes), None)
        if starts:
            start = starts[0]
            if takeoffs and "up_m" in start.values:
                self._remarks.append(f"{takeoffs[0].where}: not taken: the start has a height")
        elif home is not None:
            where = (self._origin.latitude_deg, self._origin.longitude_deg)
            start = FoundPlace(Kind.START, (where,), "home", {}, "home")
        else:
            raise self._missing("start", "a home, or a place of kind start in one of the files, or --home")
        values = dict(start.values)
        heights = [place.values["up_m"] for place in (*takeoffs, *goals) if "up_m" in place.values]
        values.setdefault("up_m", heights[0] if heights else self._wishes.height_m)
        if "course_deg" not in values:
            values["course_deg"] = self._course_deg(start, goals)
        return replace(start, values=values)

    def _course_deg(self, start: FoundPlace, goals: Sequence[FoundPlace]) -> float:
        """Return the course from the start to the first goal elsewhere."""
        points = self._local([start, *goals])
        for step in points[1:] - points[0]:
            if math.hypot(*step) > 1.0:
                return round(math.degrees(course_from_direction(math.atan2(step[1], step[0]))), 1)
        return 0.0

    def _with_height(self, goal: FoundPlace, start_m: float) -> FoundPlace:
        if "up_m" in goal.values:
            return goal
        self._remarks.append(f"{goal.where}: no height: taken at {start_m:g} m, as the start")
        return replace(goal, values={**goal.values, "up_m": start_m})

    def _local(self, places: Iterable[FoundPlace]) -> FloatArray:
        """Return east and north of all corners of places, (N, 2) [m]."""
        corners = np.array([corner for place in places for corner in place.corners], dtype=np.float64)
        return np.column_stack(self._origin.places_from_global(corners[:, 0], corners[:, 1]))

    def _fence(
        self, start: FoundPlace, goals: Sequence[FoundPlace]
    ) -> tuple[tuple[float, float, float, float], list[FoundPlace]]:
        """Return the bounds, west, east, south and north [m], and walls where a fence ends within them."""
        bounds, fences = self._found[Kind.BOUNDS], self._found[Kind.FENCE]
        for other in bounds[1:]:
            self._remarks.append(
                f"{other.where}: not taken: a mission has bounds once, and these are a second one"
            )
        inside = common_area([self._local([fence]) for fence in fences]) if fences else None
        if fences and inside is None:
            named = ", ".join(fence.where for fence in fences)
            raise ConfigError(
                named, None, "fence", "no common area", "edges that do not cross, and room within all"
            )
        if bounds:
            points = self._local(bounds[:1])
        elif inside is not None:
            points = np.array(inside.bounds).reshape(2, 2)
        else:
            points = self._surroundings(start, goals)
        low, high = points.min(axis=0).round(3), points.max(axis=0).round(3)
        box = (float(low[0]), float(high[0]), float(low[1]), float(high[1]))
        if inside is None:
            return box, []
        return box, [self._wall(corners, n) for n, corners in enumerate(walls_about(inside, box), 1)]

    def _surroundings(self, start: FoundPlace, goals: Sequence[FoundPlace]) -> FloatArray:
        """Return the lowest and highest east and north of a box with room about all places, (2, 2) [m]."""
        like, turn = self._wishes.like, CLASSES[self._wishes.aircraft].turn_radius_min_m
        turn = turn if like is None else float(like.vehicle.turn_radius_min_m)
        kinds = (Kind.OBSTACLE, Kind.NO_FLY, Kind.RADAR)
        seen = [place for kind in kinds for place in self._found[kind]]
        points = self._local([start, *goals, *seen])
        beyond = max(MARGIN_MIN_M, MARGIN_TURNS * turn)
        return np.vstack([np.floor(points.min(axis=0) - beyond), np.ceil(points.max(axis=0) + beyond)])

    def _wall(self, corners: FloatArray, number: int) -> FoundPlace:
        """Return a wall; its ``corners`` (N, 2) are east and north [m]."""
        latitudes, longitudes = self._origin.places_from_local(corners[:, 0], corners[:, 1])
        places = tuple(zip(latitudes.tolist(), longitudes.tolist(), strict=True))
        return FoundPlace(Kind.NO_FLY, places, f"fence wall {number}", {}, "fence")

    def _threats(self) -> dict[Kind, Sequence[FoundPlace]]:
        """Return radars and moving threats, which need a radius; the latter a speed, too."""
        needed = {
            Kind.RADAR: ("max_threat_radius_m",),
            Kind.MOVING_THREAT: ("max_threat_radius_m", "speed_m_s"),
        }
        for kind, keys in needed.items():
            for place in self._found[kind]:
                for key in keys:
                    if key not in place.values:
                        raise self._missing(key, f"a number: a {kind.value} needs it", place)
        return {kind: self._found[kind] for kind in needed}

    def _glide_places(self) -> dict[Kind, Sequence[FoundPlace]]:
        """Return fields and people; they need a section ``glide``, which only another mission has."""
        found = {kind: self._found[kind] for kind in (Kind.FIELD, Kind.PEOPLE)}
        like = self._wishes.like
        if like is None or like.glide is None:
            why = "it needs a section glide, from --like; the service reads the autopilot's rally points"
            self._remarks += [
                f"{place.where}: not taken: {why}" for places in found.values() for place in places
            ]
            return {}
        fields = []
        for place in found[Kind.FIELD]:
            values = {"radius_m": FIELD_RADIUS_M, "up_m": 0.0} | dict(place.values)
            if like.terrain is not None:
                values.pop("up_m")  # The map has it.
            fields.append(replace(place, values=values))
        return {Kind.FIELD: fields, Kind.PEOPLE: found[Kind.PEOPLE]}
