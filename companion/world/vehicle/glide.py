"""The range of a glide with the engine stopped: a turn towards a place, then a straight glide, in wind.

The glide moves with the air. Seen from the air, the aircraft turns on a circle and flies straight on, and a
place on the ground moves against the wind while it does so. The time of arrival is the fixed point of that:
it converges for every wind below the airspeed of the glide.

References
----------
M. Coombes, W.-H. Chen, P. Render, "Reachability analysis of landing sites for forced landing of a UAS",
Journal of Intelligent & Robotic Systems 73, 2014: reach as a turn and a straight glide in uniform wind.

L. E. Dubins, "On curves of minimal length with a constraint on average curvature", American Journal of
Mathematics 79, 1957: a turn and a straight line are the shortest way to a place at any course.

J. D. Anderson, *Aircraft Performance and Design*, 1999, chapters 5 and 6: induced drag grows with the square
of the load factor n, and is half of the drag at the airspeed of the best glide, and less above it. The sink
in a turn is then at most (1 + n²)/2 times that of straight flight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray, speed_made_good

GRAVITY_M_S2 = 9.80665
ARRIVAL_TOLERANCE_S = 1e-6  # Two estimates of the time of arrival this close count as the fixed point.
ARRIVAL_STEPS_MAX = 200  # More steps than these are needed only in wind of almost the airspeed.
UNDAMPED_STEPS = 50  # Later steps are halved: a turn that is just a full circle or just none may alternate.
TURN_TOLERANCE_RAD = 1e-6  # A turn that lacks less than this to a full circle is rounding, and no turn.
TRACK_TURN_RAD = math.radians(15.0)  # A turn is sampled at least this closely.


@dataclass(frozen=True, slots=True)
class GlideModel:
    """The glide of an aircraft whose engine has stopped.

    Parameters
    ----------
    ratio : float
        Horizontal metres per metre of height in straight flight and still air, above 0.
    airspeed_m_s : float
        True airspeed of the glide, taken as horizontal, above 0 [m/s].
    turn_radius_m : float
        Radius of turns through the air, above 0 [m].

    Raises
    ------
    ValueError
        For a number that is not finite and above 0.
    """

    ratio: float
    airspeed_m_s: float
    turn_radius_m: float

    def __post_init__(self) -> None:
        numbers = (self.ratio, self.airspeed_m_s, self.turn_radius_m)
        if not all(0.0 < number < math.inf for number in numbers):
            raise ValueError(f"ratio, airspeed and turn radius of a glide are finite and above 0: {numbers}")

    @property
    def sink_m_s(self) -> float:
        """Rate of sink in straight flight [m/s]."""
        return self.airspeed_m_s / self.ratio

    @property
    def turn_sink_m_s(self) -> float:
        """Rate of sink in a turn [m/s]."""
        sideways = self.airspeed_m_s**2 / (GRAVITY_M_S2 * self.turn_radius_m)
        return self.sink_m_s * (1.0 + 0.5 * sideways**2)

    def reach_m(self, height_m: float, course_rad: float, wind_enu_m_s: tuple[float, float]) -> float:
        """Return how far a straight glide leads over the ground [m].

        Parameters
        ----------
        height_m : float
            Height that is given up [m].
        course_rad : float
            Course over the ground, clockwise from north [rad].
        wind_enu_m_s : tuple of float
            Velocity of the air, east and north [m/s].
        """
        speed = speed_made_good(course_rad, self.airspeed_m_s, wind_enu_m_s)
        return speed * max(height_m, 0.0) / self.sink_m_s


@dataclass(frozen=True, slots=True)
class Glide:
    """A turn and a straight glide to a place.

    Parameters
    ----------
    begin_enu_m : tuple of float
        Where it begins [m].
    heading_rad : float
        Heading through the air there, clockwise from north [rad].
    turned_rad : float
        Change of the heading, positive to the right [rad].
    turn_s, straight_s : float
        Duration of the turn and of the straight glide [s].
    lost_m : float
        Height that is lost on the way [m].
    model : GlideModel
        The aircraft.
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north [m/s].
    """

    begin_enu_m: tuple[float, float, float]
    heading_rad: float
    turned_rad: float
    turn_s: float
    straight_s: float
    lost_m: float
    model: GlideModel
    wind_enu_m_s: tuple[float, float]

    @property
    def duration_s(self) -> float:
        """Time until the arrival [s]."""
        return self.turn_s + self.straight_s

    @property
    def arrival_up_m(self) -> float:
        """Height at the arrival [m]."""
        return self.begin_enu_m[2] - self.lost_m

    def track(self, floor_m: float = -math.inf) -> FloatArray:
        """Return places of the glide, its begin and its end among them, shape (K, 3) [m].

        Parameters
        ----------
        floor_m : float
            No place is given as lower than this [m].
        """
        num = max(1, math.ceil(abs(self.turned_rad) / TRACK_TURN_RAD))
        shares = np.linspace(0.0, 1.0, num + 1)
        headings = self.heading_rad + self.turned_rad * shares
        side, radius = math.copysign(1.0, self.turned_rad), self.model.turn_radius_m
        begin, wind = np.array(self.begin_enu_m), np.array(self.wind_enu_m_s)
        places = np.empty((num + 2, 3))
        places[:-1, 0] = begin[0] + side * radius * (math.cos(self.heading_rad) - np.cos(headings))
        places[:-1, 1] = begin[1] + side * radius * (np.sin(headings) - math.sin(self.heading_rad))
        places[:-1, :2] += self.turn_s * shares[:, None] * wind
        places[:-1, 2] = begin[2] - self.turn_s * shares * self.model.turn_sink_m_s
        along = np.array([math.sin(headings[-1]), math.cos(headings[-1])])
        moved = self.straight_s * (self.model.airspeed_m_s * along + wind)
        places[-1, :2], places[-1, 2] = places[-2, :2] + moved, self.arrival_up_m
        places[:, 2] = np.maximum(places[:, 2], floor_m)
        return places


def heading_of(course_rad: float, airspeed_m_s: float, wind_enu_m_s: tuple[float, float]) -> float:
    """Return the heading through the air on a course over the ground, by the wind triangle [rad].

    Parameters
    ----------
    course_rad : float
        Course over the ground, clockwise from north [rad].
    airspeed_m_s : float
        Airspeed, above 0 [m/s].
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north [m/s].
    """
    across = wind_enu_m_s[0] * math.cos(course_rad) - wind_enu_m_s[1] * math.sin(course_rad)
    return course_rad - math.asin(max(-1.0, min(1.0, across / airspeed_m_s)))


def glide_to(
    model: GlideModel,
    begin_enu_m: tuple[float, float, float],
    heading_rad: float,
    place_enu_m: tuple[float, float],
    wind_enu_m_s: tuple[float, float],
) -> Glide | None:
    """Return the shortest turn and straight glide over a place; None if the wind keeps the aircraft from it.

    Parameters are those of :func:`glides_to`.
    """
    return next(iter(glides_to(model, begin_enu_m, heading_rad, place_enu_m, wind_enu_m_s)), None)


def glides_to(
    model: GlideModel,
    begin_enu_m: tuple[float, float, float],
    heading_rad: float,
    place_enu_m: tuple[float, float],
    wind_enu_m_s: tuple[float, float],
) -> list[Glide]:
    """Return glides over a place that begin with a turn to either side, the shorter first.

    The list has no glide that the wind keeps from the place.

    Parameters
    ----------
    model : GlideModel
        The aircraft.
    begin_enu_m : tuple of float
        Where the glide begins, east, north, up [m].
    heading_rad : float
        Heading through the air there, clockwise from north [rad].
    place_enu_m : tuple of float
        East and north of the place [m].
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north [m/s].
    """
    away = place_enu_m[0] - begin_enu_m[0], place_enu_m[1] - begin_enu_m[1]
    found = []
    for side in (1.0, -1.0):
        way = _arrival(model, heading_rad, away, wind_enu_m_s, side)
        if way is not None:
            turned, turn_s, straight_s = way
            lost = turn_s * model.turn_sink_m_s + straight_s * model.sink_m_s
            found.append(
                Glide(begin_enu_m, heading_rad, turned, turn_s, straight_s, lost, model, wind_enu_m_s)
            )
    return sorted(found, key=lambda glide: glide.duration_s)


def _arrival(
    model: GlideModel,
    heading_rad: float,
    away_m: tuple[float, float],
    wind_enu_m_s: tuple[float, float],
    side: float,
) -> tuple[float, float, float] | None:
    """Return change of heading [rad], time of the turn and of the straight glide [s] for one side of turning.

    ``away_m`` is the place, east and north of the begin; ``side`` is 1 for a turn to the right. The result
    is None where the place stays within the circle of the turn, or the wind is too strong.
    """
    speed = model.airspeed_m_s
    # From the time of a straight glide on, an aircraft that points at the place is not led round a circle.
    after_s = math.hypot(*away_m) / speed_made_good(math.atan2(*away_m), speed, wind_enu_m_s)
    for step in range(ARRIVAL_STEPS_MAX):
        east, north = (value - wind * after_s for value, wind in zip(away_m, wind_enu_m_s, strict=True))
        way = _turn_and_straight((east, north), heading_rad, side * model.turn_radius_m)
        if way is None:  # Later the wind may have moved the place out of the circle.
            after_s += model.turn_radius_m / speed
            continue
        turned, straight_m = way
        turn_s, straight_s = abs(turned) * model.turn_radius_m / speed, straight_m / speed
        change_s = turn_s + straight_s - after_s
        if abs(change_s) <= ARRIVAL_TOLERANCE_S:
            return turned, turn_s, straight_s
        after_s += change_s if step < UNDAMPED_STEPS else 0.5 * change_s
    return None


def _turn_and_straight(
    place_m: tuple[float, float], heading_rad: float, radius_m: float
) -> tuple[float, float] | None:
    """Return the turn [rad] and the straight line [m] from the origin to a place in still air.

    ``radius_m`` is positive for a turn to the right. The result is None for a place within the circle.
    """
    east = place_m[0] - radius_m * math.cos(heading_rad)
    north = place_m[1] + radius_m * math.sin(heading_rad)
    square = east**2 + north**2 - radius_m**2
    if square < 0.0:
        return None
    straight = math.sqrt(square)
    final = math.atan2(east, north) + math.atan2(radius_m, straight)
    side = math.copysign(1.0, radius_m)
    turn = (side * (final - heading_rad)) % (2.0 * math.pi)
    if turn > 2.0 * math.pi - TURN_TOLERANCE_RAD:
        turn = 0.0
    return side * turn, straight
