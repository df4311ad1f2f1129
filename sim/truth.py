"""The truth of a flight: its track, the threats, and collisions."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon

from companion.types.threat import Obstacle
from .vehicle.fdm import TrueState
from .vehicle.true_ground import TrueGround

PERIOD_US = 100_000


@dataclass
class Truth:
    """The truth, recorded at 10 Hz by the simulator, and judged independently of everything that plans.

    Parameters
    ----------
    obstacles : tuple of Obstacle
        Obstacles that the aircraft may hit.
    goal_enu_m : (float, float, float) or None
        The last goal [m]; None if the goals are the operator's waypoints.
    ground : TrueGround, optional
        Ground that it may hit; by default it is flat at the origin's height.

    Attributes
    ----------
    path : list of list of float
        Rows ``[t_s, east_m, north_m, up_m, course_rad, climb_rad, speed_m_s]``: course over the ground
        clockwise from north, flight-path angle, true airspeed.
    threat_paths : dict
        Paths by the threats' names, rows ``[t_s, east_m, north_m]``.
    collision : bool
        Whether the flight touched an obstacle or the ground.
    min_obstacle_clearance_m : float
        Smallest horizontal distance to an obstacle while between its base and its top [m];
        infinite if never between them.
    min_ground_height_m : float
        Smallest height over ground [m].
    min_goal_distance_m : float
        Smallest distance to the last goal [m]; infinite without one.
    """

    obstacles: tuple[Obstacle, ...]
    goal_enu_m: tuple[float, float, float] | None
    ground: TrueGround | None = None
    path: list[list[float]] = field(default_factory=list)
    threat_paths: dict[str, list[list[float]]] = field(default_factory=dict)
    collision: bool = False
    min_obstacle_clearance_m: float = math.inf
    min_ground_height_m: float = math.inf
    min_goal_distance_m: float = math.inf

    def __post_init__(self) -> None:
        self._polygons = np.array([Polygon(entry.polygon_enu_m) for entry in self.obstacles], dtype=object)
        self._bases = np.array([entry.base_m for entry in self.obstacles])
        self._tops = np.array([entry.top_m for entry in self.obstacles])
        shapely.prepare(self._polygons)

    @property
    def dt_path(self) -> list[list[float]]:
        """Path of the first threat, or nothing."""
        return next(iter(self.threat_paths.values()), [])

    def record(self, now_s: float, state: TrueState) -> None:
        """Add a row, and check the segment since the last one."""
        horizontal = math.hypot(state.velocity_east_m_s, state.velocity_north_m_s)
        row = [
            now_s,
            state.east_m,
            state.north_m,
            state.up_m,
            math.atan2(state.velocity_east_m_s, state.velocity_north_m_s) % (2.0 * math.pi),
            math.atan2(state.velocity_up_m_s, horizontal),
            state.true_airspeed_m_s,
        ]
        previous = self.path[-1] if self.path else row
        self.path.append(row)
        if self.goal_enu_m is not None:
            self.min_goal_distance_m = min(self.min_goal_distance_m, math.dist(row[1:4], self.goal_enu_m))
        self._check(previous, row)

    def record_threat(self, now_s: float, name: str, position: tuple[float, float]) -> None:
        """Add a row of a threat."""
        self.threat_paths.setdefault(name, []).append([now_s, *position])

    def _check(self, start: list[float], end: list[float]) -> None:
        low, high = min(start[3], end[3]), max(start[3], end[3])
        ground_m = 0.0 if self.ground is None else self.ground.up_m(end[1], end[2])
        self.min_ground_height_m = min(self.min_ground_height_m, end[3] - ground_m)
        if end[3] <= ground_m:
            self.collision = True
        is_level = (self._bases <= high) & (self._tops >= low)
        if not is_level.any():
            return
        segment = LineString([start[1:3], end[1:3]])
        clearance = float(np.min(shapely.distance(self._polygons[is_level], segment)))
        self.min_obstacle_clearance_m = min(self.min_obstacle_clearance_m, clearance)
        if clearance <= 0.0:
            self.collision = True
