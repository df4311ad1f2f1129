"""The dynamic threat: a ground vehicle that knows the mission and drives to cut it off, or drives a route."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.frames import FloatArray, wrapped_angle
from .reports import PROMPT
from .roads import Roads, polyline_points

CLEARANCE_M = 12.0
_REPLAN_US = 1_000_000
_SPACING_M = 40.0
_ARRIVED_M = 8.0
_PIVOT_RAD_S = 0.8


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """The pursuer's knowledge of the aircraft.

    Parameters
    ----------
    position : tuple of float
        East, north [m].
    speed_m_s : float
        Ground speed that the pursuer assumes.
    route : tuple of tuple of float
        East and north of the mission points still ahead [m].
    revision : int
        Changes whenever the mission does.
    """

    position: tuple[float, float]
    speed_m_s: float
    route: tuple[tuple[float, float], ...]
    revision: int


class Pursuer:
    """A vehicle of limited speed and turn radius that never enters an obstacle.

    If its turn radius would lead it into a wall, it stops and turns on the spot. All its reports arrive.

    Parameters
    ----------
    roads : Roads
        Graph of the paths that it can drive.
    position : tuple of float
        East and north at which it starts: east, north [m].
    speed_m_s : float
        Speed at which it drives [m/s]; 0 stands still.
    turn_radius_m : float
        Smallest turn radius [m].
    """

    emitter, source = mavlink.ADSB_EMITTER_TYPE_SERVICE_SURFACE, PROMPT
    up_m = climb_m_s = 0.0

    def __init__(
        self, roads: Roads, position: tuple[float, float], speed_m_s: float, turn_radius_m: float
    ) -> None:
        self._roads = roads
        self.position = position
        self.course_rad = 0.0
        self.speed_m_s = 0.0
        self._speed_max_m_s = speed_m_s
        self._turn_radius_m = turn_radius_m
        self._way: list[tuple[float, float]] = []
        self._is_hunting = True
        self._next_plan_us = 0
        self._visible: dict[tuple[float, float], tuple[int, FloatArray]] = {}

    @property
    def velocity_m_s(self) -> tuple[float, float]:
        """East and north velocity [m/s]."""
        return self.speed_m_s * math.sin(self.course_rad), self.speed_m_s * math.cos(self.course_rad)

    def step(self, now_us: int, duration_s: float, target: TargetEstimate) -> None:
        """Plan if it is time, and drive on."""
        if self._speed_max_m_s <= 0.0:
            return
        if self._is_hunting and now_us >= self._next_plan_us:
            self._next_plan_us = now_us + _REPLAN_US
            self._way = self._intercept(target)
        self._drive(duration_s)

    def follow(self, route: tuple[tuple[float, float], ...]) -> None:
        """Pursue nobody: drive straight from place to place (east, north [m]), and stop at the last."""
        self._way = list(route)
        self._is_hunting = False

    def _intercept(self, target: TargetEstimate) -> list[tuple[float, float]]:
        """Path to the first mission point that it reaches before the aircraft, else to the least late one."""
        ahead = polyline_points([target.position, *target.route], _SPACING_M)
        flown = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(ahead, axis=0).T))])
        is_clear = self._roads.is_clear(ahead)
        if not is_clear.any():
            return []
        points, arrival_s = ahead[is_clear], flown[is_clear] / max(target.speed_m_s, 1.0)
        origin = np.array(self.position)
        to_corner, entry = self._roads.reach(origin)
        direct = self._roads.distances(origin, points)
        lengths, exits = self._by_corners(points, to_corner, target)
        driven = np.minimum(direct, lengths)
        if not np.isfinite(driven).any():
            return []
        # The aircraft loiters at the last point, so that the pursuer can wait there.
        late_s = driven / self._speed_max_m_s - arrival_s
        in_time = np.flatnonzero(late_s <= 0.0)
        chosen = int(in_time[0]) if len(in_time) else int(np.argmin(late_s))
        goal = (float(points[chosen, 0]), float(points[chosen, 1]))
        if direct[chosen] <= lengths[chosen]:
            return [goal]
        last = int(exits[chosen])
        return [*self._roads.way(int(entry[last]), last), goal]

    def _by_corners(
        self, points: FloatArray, to_corner: FloatArray, target: TargetEstimate
    ) -> tuple[FloatArray, np.ndarray[tuple[int], np.dtype[np.int64]]]:
        """Shortest ways [m] over the graph to the points, and the corner each is left from: shape (N,) each.

        ``points`` has shape (N, 2), ``to_corner``, the ways to the graph's corners, shape (C,) [m].

        What a point sees does not change with time, and missions change seldom: it is remembered.
        """
        if len(to_corner) == 0:
            return np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
        if len(self._visible) > 4000:
            self._visible.clear()
        seen = np.empty((len(points), len(to_corner)))
        for index, point in enumerate(points):
            key = (round(float(point[0]), 1), round(float(point[1]), 1))
            known = self._visible.get(key)
            if known is None:
                known = (target.revision, self._roads.distances(point, self._roads.corners))
                self._visible[key] = known
            seen[index] = known[1]
        totals = to_corner + seen
        exits = np.argmin(totals, axis=1)
        return totals[np.arange(len(points)), exits], exits

    def _drive(self, duration_s: float) -> None:
        """Follow the way by pure pursuit."""
        while self._way and math.dist(self.position, self._way[0]) < self._arrival_distance():
            self._way.pop(0)
        if not self._way:
            self.speed_m_s = 0.0
            return
        east, north = self._way[0][0] - self.position[0], self._way[0][1] - self.position[1]
        error = wrapped_angle(math.atan2(east, north) - self.course_rad)
        turn = self._speed_max_m_s / self._turn_radius_m * duration_s
        course = self.course_rad + max(-turn, min(turn, error))
        length = self._speed_max_m_s * duration_s
        position = (
            self.position[0] + length * math.sin(course),
            self.position[1] + length * math.cos(course),
        )
        margin = self._turn_radius_m * min(1.0, abs(error))
        ahead = (position[0] + margin * math.sin(course), position[1] + margin * math.cos(course))
        circles = abs(error) > 1.0 and math.hypot(east, north) < 2.0 * self._turn_radius_m
        if circles or not (self._roads.is_free(*position) and self._roads.is_free(*ahead)):
            self.speed_m_s = 0.0
            pivot = _PIVOT_RAD_S * duration_s
            self.course_rad += max(-pivot, min(pivot, error))
            if abs(error) > pivot:
                return
            if not self._roads.is_free(*position):
                return
        else:
            self.course_rad = course
        self.speed_m_s = self._speed_max_m_s
        self.position = position

    def _arrival_distance(self) -> float:
        return _ARRIVED_M if len(self._way) > 1 else max(2.0, self._speed_max_m_s * 0.1)
