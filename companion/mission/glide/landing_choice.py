"""The field to which an aircraft without thrust glides, and how it loses the height that is left over.

A field is reached by a turn and a straight glide. Height that is left there is flown off on a circle before
the field, from any point of which a final glide to the field is clear. The circle lies against the wind
where that is possible, and far enough from the field that the height needed for the final changes
continuously along the circle: the final begins when no more height is left than it needs.

References
----------
M. Coombes, W.-H. Chen, P. Render, "Reachability analysis of landing sites for forced landing of a UAS",
Journal of Intelligent & Robotic Systems 73, 2014.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely

from companion.assurance.checker import Checker
from companion.assurance.surroundings.ground_heights import GroundHeights
from companion.frames import FloatArray, wrapped_angle
from companion.mission.glide.glide_ground import is_circle_over_ground, is_glide_over_ground, is_level
from companion.types.threat import Obstacle
from companion.world.vehicle.glide import GRAVITY_M_S2, Glide, GlideModel, glide_to, glides_to

RESERVE_M = 20.0  # Height over a field that must be left by the model: wind and ratio are not known exactly.
# Circles need this bank where the wind makes them fastest: autopilots allow 45° or more.
CIRCLE_BANK_RAD = math.radians(40.0)
# Distance of the circle from the field in radii; beyond 3 no turn from the circle contains the field.
CIRCLE_AWAY = 3.3
OVERHEAD = 2.2  # On its way to the circle the aircraft keeps this many turn radii from the field.
SIDES = 12  # Directions that are tried for the circle.
RING_SIDES = 24  # A circle is checked as a polygon of this many sides.
RING_MARGIN_M = 25.0  # Distance that circles keep from obstacles: an aircraft enters them in a swing.
ROOMY_MARGIN_M = 70.0  # Circles with this clearance are preferred: a final may begin with a turn outwards.
TRACK_MARGIN_M = 25.0  # Distance that glides keep from obstacles: they begin a little elsewhere.
LOW_SHARE = 0.15  # A glide is checked again with this share more loss of height.
# The autopilot may turn to either side towards a place that is this far behind, by heading or by course.
EITHER_TURN_RAD = math.radians(135.0)
# Open ground is sought on this many courses, at these shares of the reach.
OPEN_COURSES, OPEN_SHARES = 16, (0.9, 0.7, 0.5, 0.3, 0.15)
OPEN_RADIUS_M = 60.0  # Radius of a place on open ground.
CLEAR_OF_PEOPLE_M = 150.0  # Farther from people and obstacles, one open ground is as good as another.

Place = tuple[float, float, float]
Wind = tuple[float, float]


class LandingPlace(NamedTuple):
    """A place to come down: its name, its middle on the ground [m], and its radius [m]."""

    name: str
    position_enu_m: Place
    radius_m: float


class Begin(NamedTuple):
    """The begin of a glide: east, north, up [m], heading through the air [rad], and the wind [m/s].

    ``earliest`` is where the autopilot may begin it already, if that is known.
    """

    position_enu_m: Place
    heading_rad: float
    wind_enu_m_s: Wind
    earliest: Begin | None = None


class Approach(NamedTuple):
    """A circle before a field: its middle at the height at which the final begins at the latest [m]."""

    centre_enu_m: Place
    radius_m: float


class LandingChoice(NamedTuple):
    """A field within reach.

    Parameters
    ----------
    place : LandingPlace
        The field.
    direct : Glide
        The glide straight to it.
    to_circle : Glide
        The glide to the circle before it.
    approach : Approach
        The circle.
    """

    place: LandingPlace
    direct: Glide
    to_circle: Glide
    approach: Approach

    @property
    def spare_m(self) -> float:
        """Height that is left over the field after the glide straight to it [m]."""
        return self.direct.arrival_up_m - self.place.position_enu_m[2]

    @property
    def away_m(self) -> float:
        """Horizontal distance of the field [m]."""
        return math.dist(self.direct.begin_enu_m[:2], self.place.position_enu_m[:2])


@dataclass(frozen=True)
class GlideOptions:
    """Everything that a choice of fields depends on, apart from the aircraft's state.

    Parameters
    ----------
    model : GlideModel
        The glide.
    places : tuple of LandingPlace
        Fields, home and rally points.
    people : tuple of ndarray, each of shape (K, 2)
        Corners of the areas that must not be come down in [m].
    obstacles : tuple of Obstacle
        Obstacles and fences.
    checker : Checker
        The independent check over the same obstacles, without the ground.
    flat_ground_m : float
        Height of open ground without a map [m].
    ground : GroundHeights, optional
        The ground of a map.
    """

    model: GlideModel
    places: tuple[LandingPlace, ...]
    people: tuple[FloatArray, ...]
    obstacles: tuple[Obstacle, ...]
    checker: Checker
    flat_ground_m: float
    ground: GroundHeights | None = None
    _approaches: dict[tuple[LandingPlace, Wind], tuple[Approach, ...]] = field(default_factory=dict)

    @cached_property
    def areas(self) -> shapely.Geometry:
        """The areas with people."""
        return shapely.unary_union([shapely.Polygon(corners).convex_hull for corners in self.people])

    @cached_property
    def walls(self) -> shapely.Geometry:
        """The obstacles on the map."""
        return shapely.unary_union(
            [shapely.Polygon(entry.polygon_enu_m).buffer(0) for entry in self.obstacles]
        )

    @cached_property
    def allowed(self) -> tuple[LandingPlace, ...]:
        """The places that lie wholly outside of the areas with people."""
        return tuple(
            place
            for place in self.places
            if self.areas.is_empty
            or self.areas.distance(shapely.Point(place.position_enu_m[:2])) > place.radius_m
        )

    def is_clear(self, track_enu_m: FloatArray, margin_m: float = TRACK_MARGIN_M) -> bool:
        """Return whether a track keeps a distance from all obstacles.

        Parameters
        ----------
        track_enu_m : ndarray, shape (K, 3)
            Places of the track, in order [m].
        margin_m : float
            The distance [m].
        """
        found = self.checker.check_track(track_enu_m, margin_m, may_come_back=True)
        return not any(entry.rule in ("clearance", "finite") for entry in found)

    def ground_up_m(self, east_m: float, north_m: float) -> float:
        """Return the height of the ground at a place [m]."""
        if self.ground is None:
            return self.flat_ground_m
        return float(self.ground.up_m(np.array([[east_m, north_m]]))[0])

    def is_glide_clear(self, glide: Glide, place: LandingPlace) -> bool:
        """Return whether a glide is clear, and also if it loses more height than the model says.

        Parameters
        ----------
        glide : Glide
            The glide, to the place or to the circle before it.
        place : LandingPlace
            The place.
        """
        floor_m = place.position_enu_m[2]
        track = glide.track(floor_m)
        if not self.is_clear(track):
            return False
        if self.ground is not None and not is_glide_over_ground(
            self.ground, glide, floor_m, place.radius_m, TRACK_MARGIN_M, LOW_SHARE
        ):
            return False
        lower = track.copy()
        lower[:, 2] = np.maximum(track[:, 2] - LOW_SHARE * (track[0, 2] - track[:, 2]), floor_m)
        return self.is_clear(lower)

    def approaches(self, place: LandingPlace, wind_enu_m_s: Wind) -> tuple[Approach, ...]:
        """Return the circles before a place that are clear: those with much room, then against the wind."""
        key = place, wind_enu_m_s
        if key not in self._approaches:
            found = _circles(self.model, place, wind_enu_m_s)
            clear = [entry for entry in found if self._is_approach_clear(place, entry, RING_MARGIN_M)]
            roomy = [entry for entry in clear if self._is_approach_clear(place, entry, ROOMY_MARGIN_M)]
            self._approaches[key] = (*roomy, *(entry for entry in clear if entry not in roomy))
        return self._approaches[key]

    def _is_approach_clear(self, place: LandingPlace, approach: Approach, margin_m: float) -> bool:
        """Return whether a circle keeps a margin [m], and the finals from all of its points are clear."""
        angles = np.linspace(0.0, 2.0 * math.pi, RING_SIDES + 1)
        ring = np.array(approach.centre_enu_m) + approach.radius_m * np.column_stack(
            [np.sin(angles), np.cos(angles), np.zeros(len(angles))]
        )
        if not self.is_clear(ring, margin_m):
            return False
        if self.ground is not None and not is_circle_over_ground(
            self.ground, ring[:-1], place.position_enu_m, place.radius_m
        ):
            return False
        finals = np.repeat(ring[:-1:2], 2, axis=0)  # From each point to the field, and back.
        finals[1::2] = place.position_enu_m
        finals[1::2, 2] += 1.0
        return self.is_clear(finals)


def circle_radius_m(model: GlideModel, wind_enu_m_s: Wind) -> float:
    """Return the radius of a circle that can be flown over the ground in wind [m].

    Parameters
    ----------
    model : GlideModel
        The glide.
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north [m/s].
    """
    return max(model.turn_radius_m, narrowest_m(model.airspeed_m_s + math.hypot(*wind_enu_m_s)))


def narrowest_m(speed_m_s: float) -> float:
    """Return the radius of a turn at the bank of circles, at a speed [m/s], in metres."""
    return speed_m_s**2 / (GRAVITY_M_S2 * math.tan(CIRCLE_BANK_RAD))


def _circles(model: GlideModel, place: LandingPlace, wind_enu_m_s: Wind) -> Iterator[Approach]:
    """Yield circles about a place, that from which the final is against the wind first."""
    radius = circle_radius_m(model, wind_enu_m_s)
    away = CIRCLE_AWAY * radius
    east, north, up = place.position_enu_m
    against = math.atan2(-wind_enu_m_s[0], -wind_enu_m_s[1]) if any(wind_enu_m_s) else 0.0
    height = away / model.ratio
    for number in range(SIDES):  # 0, +1, -1, +2, ... steps off the wind.
        course = against + (2 * (number % 2) - 1) * ((number + 1) // 2) * 2.0 * math.pi / SIDES
        centre = east - away * math.sin(course), north - away * math.cos(course), up + height
        yield Approach(centre, radius)


def choice_for(options: GlideOptions, begin: Begin, place: LandingPlace) -> LandingChoice | None:
    """Return how a place is reached; None if it is not, or not clear of obstacles.

    Parameters
    ----------
    options : GlideOptions
        The glide, the obstacles and the fields.
    begin : Begin
        Where the glide begins.
    place : LandingPlace
        The place.
    """
    direct = _glide(options.model, begin, place.position_enu_m)
    ground = place.position_enu_m[2]
    if direct is None or direct.arrival_up_m < ground or not options.is_glide_clear(direct, place):
        return None
    rated: list[tuple[bool, float, int, LandingChoice, list[Glide]]] = []
    for number, approach in enumerate(options.approaches(place, begin.wind_enu_m_s)):
        ways = likely_ways(options.model, begin, approach.centre_enu_m)
        if not ways:
            continue
        if begin.earliest is not None:
            ways += likely_ways(as_flown(options.model), begin.earliest, approach.centre_enu_m)
        found = LandingChoice(place, direct, ways[0], approach)
        left = left_after_circle_m(options.model, found)
        is_easy = left >= RESERVE_M and not _is_overhead(found)
        rated.append((not is_easy, float(number) if is_easy else -left, number, found, ways))
    for *_, found, ways in sorted(rated, key=lambda entry: entry[:3]):
        if all(options.is_glide_clear(way, place) for way in ways):
            return found
    return None


def as_flown(model: GlideModel) -> GlideModel:
    """Return the glide with turns as narrow as autopilots fly them."""
    return replace(model, turn_radius_m=min(model.turn_radius_m, narrowest_m(model.airspeed_m_s)))


def likely_ways(model: GlideModel, begin: Begin, place_enu_m: Place) -> list[Glide]:
    """Return the glides over a place with the turns that the autopilot may choose, the shorter first.

    Parameters
    ----------
    model : GlideModel
        The glide.
    begin : Begin
        Where it begins.
    place_enu_m : tuple of float
        East, north, up of the place [m].
    """
    ways = glides_to(model, begin.position_enu_m, begin.heading_rad, place_enu_m[:2], begin.wind_enu_m_s)
    (east, north), heading, speed = begin.position_enu_m[:2], begin.heading_rad, model.airspeed_m_s
    bearing = math.atan2(place_enu_m[0] - east, place_enu_m[1] - north)
    wind_east, wind_north = begin.wind_enu_m_s
    course = math.atan2(speed * math.sin(heading) + wind_east, speed * math.cos(heading) + wind_north)
    behind = max(abs(wrapped_angle(bearing - angle)) for angle in (heading, course))
    return ways if behind >= EITHER_TURN_RAD else ways[:1]


def _glide(model: GlideModel, begin: Begin, place: Place) -> Glide | None:
    return glide_to(model, begin.position_enu_m, begin.heading_rad, place[:2], begin.wind_enu_m_s)


def left_after_circle_m(model: GlideModel, choice: LandingChoice) -> float:
    """Return the height left over the field if the aircraft turns back to it from the circle's middle [m].

    Parameters
    ----------
    model : GlideModel
        The glide.
    choice : LandingChoice
        The field, with the glide to the circle.
    """
    there = choice.to_circle
    at = (*choice.approach.centre_enu_m[:2], there.arrival_up_m)
    place, wind = choice.place.position_enu_m, there.wind_enu_m_s
    back = glide_to(model, at, there.heading_rad + there.turned_rad, place[:2], wind)
    return -math.inf if back is None else back.arrival_up_m - place[2]


def _is_overhead(choice: LandingChoice) -> bool:
    """Return whether the way to the circle leads over the field, where the way back has no direction."""
    place = shapely.Point(choice.place.position_enu_m[:2])
    way = shapely.LineString(choice.to_circle.track()[:, :2])
    return bool(way.distance(place) < OVERHEAD * choice.to_circle.model.turn_radius_m)


def choices(
    options: GlideOptions, begin: Begin, places: Sequence[LandingPlace] | None = None
) -> Iterator[LandingChoice]:
    """Yield the places within reach, that with most height left first.

    Parameters
    ----------
    options : GlideOptions
        The glide, the obstacles and the fields.
    begin : Begin
        Where the glide begins.
    places : sequence of LandingPlace, optional
        The places; by default all that are allowed.
    """
    glides = [
        (glide.arrival_up_m - place.position_enu_m[2], number, place)
        for number, place in enumerate(options.allowed if places is None else places)
        if (glide := _glide(options.model, begin, place.position_enu_m)) is not None
    ]
    for spare, _, place in sorted(glides, key=lambda entry: (-entry[0], entry[1])):
        found = choice_for(options, begin, place) if spare >= 0.0 else None
        if found is not None:
            yield found


def best_field(options: GlideOptions, begin: Begin) -> LandingChoice | None:
    """Return the field with most height left; None without a field within reach.

    Parameters
    ----------
    options : GlideOptions
        The glide, the obstacles and the fields.
    begin : Begin
        Where the glide begins.
    """
    return next(choices(options, begin), None)


def open_ground(options: GlideOptions, begin: Begin) -> LandingChoice | None:
    """Return where to come down without a field: on level ground, far from people and obstacles.

    Parameters
    ----------
    options : GlideOptions
        The glide, the obstacles, and the areas with people.
    begin : Begin
        Where the glide begins.
    """
    east, north, up = begin.position_enu_m
    height = up - options.ground_up_m(east, north)
    rated = []
    for number in range(OPEN_COURSES):
        course = begin.heading_rad + 2.0 * math.pi * number / OPEN_COURSES
        reach = options.model.reach_m(height, course, begin.wind_enu_m_s)
        for share in OPEN_SHARES:
            at = east + share * reach * math.sin(course), north + share * reach * math.cos(course)
            clearance_m = min(CLEAR_OF_PEOPLE_M, *_distances(options, at))
            if clearance_m > 0.0:
                place = LandingPlace("open ground", (*at, options.ground_up_m(*at)), OPEN_RADIUS_M)
                is_steep = options.ground is not None and not is_level(
                    options.ground, place.position_enu_m, OPEN_RADIUS_M
                )
                rated.append((is_steep, -clearance_m, number, -share, place))
    for *_, place in sorted(rated, key=lambda entry: entry[:4]):
        found = choice_for(options, begin, place)
        if found is not None:
            return found
    return None


def _distances(options: GlideOptions, place_m: tuple[float, float]) -> tuple[float, float]:
    """Return the distances of a place from people and from obstacles [m]; infinite without any."""
    point = shapely.Point(place_m)
    people, walls = options.areas, options.walls
    return (
        math.inf if people.is_empty else float(people.distance(point)),
        math.inf if walls.is_empty else float(walls.distance(point)),
    )
