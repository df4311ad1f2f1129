"""The shortest path back to where a plan may begin: inside the bounds, and clear of everything by the margin.

Theory of operation. From the start the aircraft tries turns of several angles to both sides, each followed
by straight flight, climbing or descending if the height is wrong; over ground, by several heights. The
shortest of these paths whose last row is a valid start of a plan wins. The path has to keep the margin from
all obstacles. From an obstacle that the start is already too near to, it keeps most of that distance. A fence
that was drawn around the aircraft is left. Over ground the path is hardly lower or higher than its start.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import numpy as np
import shapely

from companion.frames import FloatArray
from companion.kernels.aircraft.motion import turn_radius
from companion.kernels.arrays import Ground, Limits
from companion.types.threat import Obstacle
from companion.world.ground.cell_lookup import left_over_ground

TURN_STEPS = 16  # A half circle is tried in this many steps; turns go up to a full circle.
LENGTH_MAX_M = 3_000.0  # Recovery paths are not longer than this.
# The limit of the length if the start is only too near to something, but inside the bounds.
NEAR_MAX_M = 500.0
KEPT_SHARE = 0.6  # The path keeps this share of the first distance; the checker requires half.
STRAIGHT_RAD = 1e-3  # Smaller changes of course or climb angle count as none.
NEARER_TOLERANCE_M = 0.25  # A row may seem nearer to an obstacle than the last by this much: rounding.
INSIDE_M = 5.0  # The path ends this far inside the bounds and the margin.
# Changes of height that are tried over ground, each with every fourth turn.
RISES_M, GROUND_TURNS = (0.0, 10.0, -10.0, 25.0, -25.0, 50.0, -50.0, 100.0, -100.0), 4
GROUND_MORE_M = 10.0  # While it turns back, the path may pass the limits over ground by this much more.
OVERSHOOT_RADII = 2.0  # While it turns back, the path may go this many turn radii farther out of bounds.


class ObstacleDistances:
    """Distances from obstacles.

    Parameters
    ----------
    obstacles : sequence of Obstacle
        Prisms to keep clear of.
    """

    def __init__(self, obstacles: Sequence[Obstacle]) -> None:
        self._polygons = np.array([shapely.Polygon(o.polygon_enu_m) for o in obstacles], dtype=object)
        self._heights = np.array([[min(o.base_m, o.top_m), max(o.base_m, o.top_m)] for o in obstacles])
        shapely.prepare(self._polygons)

    def distances(self, places: FloatArray) -> FloatArray:
        """Return the distance of each place from each obstacle, 0 inside it.

        Parameters
        ----------
        places : ndarray, shape (N, 3)
            East, north, up [m].

        Returns
        -------
        ndarray, shape (N, O)
            One column per obstacle [m].
        """
        if not len(self._polygons):
            return np.empty((len(places), 0))
        flat = shapely.distance(shapely.points(places[:, :2])[:, None], self._polygons[None, :])
        up = places[:, 2, None]
        gap = np.maximum(np.maximum(self._heights[:, 0] - up, up - self._heights[:, 1]), 0.0)
        away: FloatArray = np.hypot(flat, gap)
        return away


def recovery_path(
    state: FloatArray, obstacles: Sequence[Obstacle], limits: Limits, ground: Ground
) -> FloatArray | None:
    """Return the shortest recovery path, or None if a plan may begin at the start, or no path is found.

    Parameters
    ----------
    state : ndarray, shape (6,)
        The aircraft's east, north, up [m], direction and climb angle [rad], airspeed [m/s].
    obstacles : sequence of Obstacle
        What the aircraft keeps clear of.
    limits : Limits
        The aircraft's limits, and the bounds.
    ground : Ground
        The ground.

    Returns
    -------
    ndarray, shape (N, 6), or None
        States ``limits.tau`` apart in still air; the first is the start.
    """
    clearance = ObstacleDistances(obstacles)
    is_over_limits = left_over_ground(ground, state[None])[0] < limits.margin
    if not is_over_limits and not _is_outside(state[None], clearance, limits, limits.margin)[0]:
        return None
    best: FloatArray | None = None
    turns = range(0, 2 * TURN_STEPS + 1, GROUND_TURNS if is_over_limits else 1)
    for number, side, rise in product(turns, (1.0, -1.0), RISES_M if is_over_limits else (0.0,)):
        rows = _flown(state, side * math.pi * number / TURN_STEPS, limits, rise)
        end = _end_of(rows, clearance, limits, ground)
        if end is not None and (best is None or end < len(best) - 1):
            best = rows[: end + 1]
    return best


def _flown(state: FloatArray, turn: float, limits: Limits, rise: float) -> FloatArray:
    """Return the states (N, 6) of a turn by an angle [rad], then straight flight, from ``state`` (6,).

    It climbs by ``rise`` [m], or as far as the bounds are away.
    """
    step, radius = state[5] * limits.tau, turn_radius(state[5], limits)
    num = int(LENGTH_MAX_M / step)
    along = step * np.arange(num + 1)
    angle = np.minimum(along / radius, abs(turn))
    side = math.copysign(1.0, turn)
    theta = state[3] + side * angle
    straight = along - angle * radius
    rows = np.empty((num + 1, 6))
    rows[:, 0] = state[0] + side * radius * (np.sin(theta) - math.sin(state[3])) + straight * np.cos(theta)
    rows[:, 1] = state[1] - side * radius * (np.cos(theta) - math.cos(state[3])) + straight * np.sin(theta)
    low, high = limits.bounds[4] + INSIDE_M, limits.bounds[5] - INSIDE_M
    wanted = min(max(state[2] + rise, low), max(low, high)) if limits.dimension == 3 else state[2]
    slope = math.tan(limits.climb_max if wanted > state[2] else -limits.descent_max)
    change = np.clip(along * slope, min(wanted - state[2], 0.0), max(wanted - state[2], 0.0))
    rows[:, 2] = state[2] + change
    climbs = np.arctan2(np.diff(rows[:, 2]), step)
    rows[:, 3] = (theta + math.pi) % (2.0 * math.pi) - math.pi
    rows[:, 4] = np.append(climbs, 0.0) if limits.dimension == 3 else 0.0
    rows[:, 5] = state[5]
    return rows


def _out_of_bounds(rows: FloatArray, limits: Limits, inside: float) -> FloatArray:
    """Return how far ``rows`` (N, ≥ 3) are out of bounds that are narrowed horizontally, (N,) [m]."""
    low, high = limits.bounds.reshape(3, 2).T
    rim = np.array([inside, inside, 0.0])
    out = np.maximum(low + rim - rows[:, :3], rows[:, :3] - (high - rim))
    found: FloatArray = np.maximum(out.max(axis=1), 0.0)
    return found


def _is_outside(rows: FloatArray, clearance: ObstacleDistances, limits: Limits, margin: float) -> FloatArray:
    """Return which of ``rows`` (N, ≥ 3) are no valid start of a plan: (N,)."""
    clear = clearance.distances(rows).min(axis=1, initial=np.inf)
    is_outside: FloatArray = (_out_of_bounds(rows, limits, 0.0) > 0.0) | (clear < margin)
    return is_outside


def _end_of(rows: FloatArray, clearance: ObstacleDistances, limits: Limits, ground: Ground) -> int | None:
    """Return the first of ``rows`` (N, 6) at which a plan may begin, or None without a valid path there."""
    clear = clearance.distances(rows)
    out = _out_of_bounds(rows, limits, INSIDE_M)
    is_level = np.abs(rows[:, 4]) < STRAIGHT_RAD
    left = left_over_ground(ground, rows)
    ready = (
        (out <= 0.0)
        & (left >= limits.margin)
        & (clear.min(axis=1, initial=np.inf) >= limits.margin + INSIDE_M)
        & is_level
    )
    turning = np.abs(np.diff(rows[:, 3], prepend=rows[0, 3])) > STRAIGHT_RAD
    if turning.any():  # A plan may begin with a turn, which needs straight flight before it.
        ends_turn = int(np.flatnonzero(turning)[-1])
        step = rows[0, 5] * limits.tau
        ready[: ends_turn + math.ceil(limits.straight_min / step) + 1] = False
    ends = np.flatnonzero(ready)
    if not len(ends):
        return None
    end = int(ends[0])
    is_shut_out = out[0] > 0.0 or left[0] < limits.margin or clear[0].min(initial=np.inf) <= 0.0
    if not is_shut_out and end * rows[0, 5] * limits.tau > NEAR_MAX_M:
        return None
    if out[: end + 1].max() > out[0] + OVERSHOOT_RADII * limits.r_min:
        return None
    if left[: end + 1].min() < min(left[0], limits.margin) - GROUND_MORE_M:
        return None
    before_end = clear[: end + 1]
    kept = KEPT_SHARE * np.minimum(before_end[0], limits.margin)
    kept[before_end[0] >= limits.margin] = limits.margin
    was_inside = before_end[0] <= 0.0
    gained = np.diff(np.minimum(before_end, limits.margin), axis=0)
    falls = gained.min(axis=0, initial=0.0) < -NEARER_TOLERANCE_M
    if (before_end < kept - NEARER_TOLERANCE_M).any() or (falls & was_inside).any():
        return None
    return end
