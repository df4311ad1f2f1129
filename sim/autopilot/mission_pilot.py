"""Flying of mission items, which all autopilots here do alike once an item has begun."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence

from companion.frames import wrapped_angle
from companion.types.mission import Command, MavFrame, MissionItem
from ..mission_types import is_navigation
from ..projection import FastProjection
from ..vehicle.control import Circle, Flight, Leg, progress_on
from ..vehicle.outer_loops import Point
from .autopilot_parameters import Parameters
from .base import Autopilot
from .telemetry import Home, Target

RELATIVE_FRAMES = (MavFrame.GLOBAL_RELATIVE_ALT, MavFrame.GLOBAL_RELATIVE_ALT_INT)
TERRAIN_FRAMES = (MavFrame.GLOBAL_TERRAIN_ALT, MavFrame.GLOBAL_TERRAIN_ALT_INT)
_TAKEOFF_REACH_M = 5000.0
_LOITERS = (17, 18, 19, 31)
# A circle to a height is left on a course that differs by less from that to the next item: 10° in ArduPlane's
# ``ModeLoiter::isHeadingLinedUp``, 12° in PX4 (MIS_YAW_ERR).
_LEAVING_RAD = math.radians(10.0)
_LEAVING_RADII = 1.2  # The course is not waited for if the next item is nearer to the middle (PX4).
_HEIGHT_REACHED_M = 5.0


class MissionPilot(Autopilot):
    """Turns items into steering, and decides when they are done.

    Parameters
    ----------
    flight, projection, parameters, home
        As of :class:`sim.autopilot.base.Autopilot`.

    Attributes
    ----------
    always_waits_for_course : bool
        Whether a circle to a height is left on the course to the next item even if the item does not ask.
    """

    always_waits_for_course = False

    def __init__(
        self, flight: Flight, projection: FastProjection, parameters: Parameters, home: Home
    ) -> None:
        super().__init__(flight, projection, parameters, home)
        self._previous: Target | None = None
        self._begun_us = 0
        self._arrived_us: int | None = None
        self._turned_rad = 0.0
        self._is_at_height = False
        self._bearing_rad = 0.0
        self._speed_m_s: float | None = None

    @abstractmethod
    def _has_passed(self, leg: Leg, item: MissionItem) -> bool:
        """Return whether the end of a leg counts as reached."""

    def _steer_item(self, item: MissionItem) -> None:
        """Steer for a navigation item: from the last target if there is one, else from here."""
        self._begun_us, self._arrived_us, self._turned_rad = self.now_us, None, 0.0
        self._is_at_height = False
        estimate = self.flight.estimate
        target = self._position(item)
        if item.command == Command.NAV_TAKEOFF:
            # Straight ahead, up to the height.
            reach, course = _TAKEOFF_REACH_M, estimate.course_rad
            end = (estimate.east_m + reach * math.sin(course), estimate.north_m + reach * math.cos(course))
            self.flight.steering = Leg(self.flight.position, end, target[2], target[2])
            self.telemetry.target = target
        elif item.command in _LOITERS:
            radius = item.parameters[1 if item.command == Command.NAV_LOITER_TO_ALT else 2] or 0.0
            self._steer_circle(target[:2], radius or self.parameters["WP_LOITER_RAD"], target[2])
        else:
            start = self._previous or (estimate.east_m, estimate.north_m, estimate.up_m)
            follows = item.frame in TERRAIN_FRAMES
            self.flight.steering = Leg(start[:2], target[:2], start[2], target[2], follows)
            self.telemetry.target = target
        self._previous = None if item.command == Command.NAV_TAKEOFF else target

    def _steer_circle(self, centre: tuple[float, float], radius_m: float, height_m: float) -> None:
        """Circle, clockwise unless the radius is negative."""
        direction = -1 if radius_m < 0 else 1
        radius = max(self._circled_radius(abs(radius_m)), 1.0)
        self.flight.steering = Circle(centre, radius, direction, height_m)
        self.telemetry.target = (*centre, height_m)

    def _nearest_rally_point(self, items: Sequence[MissionItem]) -> Target | None:
        """East, north, up of the nearest of a list's items [m]; None where there are none."""
        here = self.flight.position
        places = [self._position(item) for item in items]
        return min(places, key=lambda place: math.dist(place[:2], here), default=None)

    def _circled_radius(self, radius_m: float) -> float:
        """Radius that is flown where one is commanded [m]."""
        return radius_m

    def has_arrived(self, item: MissionItem) -> bool:
        """Return whether a navigation item is done."""
        steering = self.flight.steering
        if item.command == Command.NAV_LAND:
            return False  # A landing is done on the ground, which ends the flight.
        if item.command == Command.NAV_TAKEOFF:
            is_waiting = self.now_us - self._begun_us < 100_000
            return not is_waiting and self.flight.estimate.up_m >= self._position(item)[2] - 2.0
        if isinstance(steering, Leg):
            return self._has_passed(steering, item)
        if isinstance(steering, Circle) and item.command != Command.NAV_LOITER_UNLIM:
            return self._has_circled(steering, item)
        return not isinstance(steering, Circle)

    def do(self, item: MissionItem) -> None:
        """Change speed; all else is skipped."""
        if item.command == Command.DO_CHANGE_SPEED:
            self._change_speed(item.parameters[0] or 0.0, item.parameters[1] or 0.0)

    def _distance_to_end(self, leg: Leg) -> float:
        estimate = self.flight.estimate
        return math.hypot(leg.end[0] - estimate.east_m, leg.end[1] - estimate.north_m)

    def _is_abeam(self, leg: Leg) -> bool:
        return progress_on(leg, self.flight.position) >= 1.0

    def _is_on_circle(self) -> bool:
        steering = self.flight.steering
        if not isinstance(steering, Circle):
            return False
        east, north = self.flight.position
        return math.hypot(east - steering.centre[0], north - steering.centre[1]) < 1.25 * steering.radius_m

    def _has_circled(self, circle: Circle, item: MissionItem) -> bool:
        """Return whether a loiter's turns, time or height are done; counted from when the circle is met.

        A circle to a height is left towards the next item (``verify_loiter_to_alt`` of ArduPlane,
        ``MissionBlock::is_mission_item_reached_or_completed`` of PX4).
        """
        east, north = self.flight.position
        bearing = math.atan2(east - circle.centre[0], north - circle.centre[1])
        if self._arrived_us is None:
            if self._is_on_circle():
                self._arrived_us, self._bearing_rad = self.now_us, bearing
            return False
        self._turned_rad += circle.direction * wrapped_angle(bearing - self._bearing_rad)
        self._bearing_rad = bearing
        if item.command == Command.NAV_LOITER_TURNS:
            return self._turned_rad >= 2.0 * math.pi * (item.parameters[0] or 1.0)
        if item.command == Command.NAV_LOITER_TIME:
            return self.now_us - self._arrived_us >= 1_000_000 * (item.parameters[0] or 0.0)
        self._is_at_height |= abs(self.flight.estimate.up_m - circle.height_m) < _HEIGHT_REACHED_M
        waits = self.always_waits_for_course or bool(item.parameters[0])
        return self._is_at_height and (not waits or self._points_to_next(circle, item))

    def _points_to_next(self, circle: Circle, item: MissionItem) -> bool:
        """Return whether the course over ground leads to the next navigation item, or there is none."""
        follows = (entry for entry in self.mission_items[item.sequence + 1 :] if is_navigation(entry.command))
        place = next((self._position(entry)[:2] for entry in follows), None)
        if place is None or math.dist(circle.centre, place) < _LEAVING_RADII * circle.radius_m:
            return True
        east, north = self.flight.position
        bearing = math.atan2(place[0] - east, place[1] - north)
        return abs(wrapped_angle(bearing - self.flight.estimate.course_rad)) < _LEAVING_RAD

    def _position(self, item: MissionItem) -> Target:
        """East, north, up of an item [m]; 0/0 stands for the present position."""
        if item.latitude_e7 == 0 and item.longitude_e7 == 0:
            east, north = self.flight.position
        else:
            east, north = self.projection.local(item.latitude_e7 * 1e-7, item.longitude_e7 * 1e-7)
        return east, north, self._height(item.frame, item.altitude_m, (east, north))

    def _height(self, frame: int, altitude_m: float, place: Point) -> float:
        ground = self.flight.stored_ground
        if frame in TERRAIN_FRAMES and ground is not None:
            return ground.up_m(*place) + altitude_m
        if frame in (*RELATIVE_FRAMES, *TERRAIN_FRAMES):
            return self.home.up_m + altitude_m
        return altitude_m - self.projection.frame.altitude_amsl_m

    def _change_speed(self, kind: float, speed_m_s: float) -> bool:
        """Set the airspeed until the next mode change; ground speed (kind 1) is taken and not followed."""
        if kind == 0.0 and speed_m_s == -2.0:
            self._speed_m_s = None
            return True
        if kind == 0.0 and self.parameters["AIRSPEED_MIN"] <= speed_m_s <= self.parameters["AIRSPEED_MAX"]:
            self._speed_m_s = speed_m_s
            return True
        return kind == 1.0
