"""The shortest way back to where plans may begin: inside the bounds, and clear of everything by the margin.

Theory of operation. From the start every turn to either side by so much and the straight flight behind it are
flown row by row, climbing or sinking where the height is wrong. The shortest whose last row is where a plan
may begin wins, if on its way it keeps the margin, of what the start is too near to already most of that
distance. What the start stands in, a fence that was put about it, is left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely

from companion.frames import FloatArray
from companion.kernels.aircraft.motion import turn_radius
from companion.kernels.arrays import Limits
from companion.types.threat import Obstacle

TURN_STEPS = 16  # of half a circle; turns up to a whole one are tried
LENGTH_MAX_M = 3_000.0
NEAR_MAX_M = 500.0  # flown nearer to something than the margin, but within the bounds and in nothing
HELD = 0.6  # of the distance at first is kept; the check asks for half
STRAIGHT_RAD = 1e-3
NEARER_M = 0.25  # by which a row may seem nearer than the last
INSIDE_M = 5.0  # within bounds and margin the way ends
OVERSHOOT_RADII = 2.0  # by which it may go farther out of bounds, turning back


class Surroundings:
    """Obstacles as distances from them.

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
        """How far places are from each obstacle, 0 inside.

        Parameters
        ----------
        places : ndarray, shape (N, 3)
            East, north, up [m].

        Returns
        -------
        ndarray, shape (N, O)
            One column an obstacle [m].
        """
        if not len(self._polygons):
            return np.empty((len(places), 0))
        flat = shapely.distance(shapely.points(places[:, :2])[:, None], self._polygons[None, :])
        up = places[:, 2, None]
        gap = np.maximum(np.maximum(self._heights[:, 0] - up, up - self._heights[:, 1]), 0.0)
        away: FloatArray = np.hypot(flat, gap)
        return away


def recovery_path(state: FloatArray, obstacles: Sequence[Obstacle], limits: Limits) -> FloatArray | None:
    """Rows of the shortest way out, the start first; None where it may begin here, or no way was found.

    Parameters
    ----------
    state : ndarray, shape (6,)
        East, north, up [m], direction and climb angle [rad], airspeed [m/s].
    obstacles : sequence of Obstacle
        What the aircraft keeps clear of.
    limits : Limits
        What it can do, and its bounds.

    Returns
    -------
    ndarray, shape (N, 6), or None
        States, a step of ``limits.tau`` in still air apart.
    """
    around = Surroundings(obstacles)
    if not _is_outside(state[None], around, limits, limits.margin)[0]:
        return None
    best: FloatArray | None = None
    for number in range(2 * TURN_STEPS + 1):
        for side in (1.0, -1.0):
            rows = _flown(state, side * math.pi * number / TURN_STEPS, limits)
            end = _end_of(rows, around, limits)
            if end is not None and (best is None or end < len(best) - 1):
                best = rows[: end + 1]
    return best


def _flown(state: FloatArray, turn: float, limits: Limits) -> FloatArray:
    """States (N, 6) of a turn by so much, then straight on, from ``state`` (6,)."""
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
    wanted = min(max(state[2], low), max(low, high)) if limits.dimension == 3 else state[2]
    slope = math.tan(limits.climb_max if wanted > state[2] else -limits.descent_max)
    change = np.clip(along * slope, min(wanted - state[2], 0.0), max(wanted - state[2], 0.0))
    rows[:, 2] = state[2] + change
    climbs = np.arctan2(np.diff(rows[:, 2]), step)
    rows[:, 3] = (theta + math.pi) % (2.0 * math.pi) - math.pi
    rows[:, 4] = np.append(climbs, 0.0) if limits.dimension == 3 else 0.0
    rows[:, 5] = state[5]
    return rows


def _out_of_bounds(rows: FloatArray, limits: Limits, inside: float) -> FloatArray:
    """How far ``rows`` (N, ≥ 3) are out of the bounds less a rim (N,) [m]; the rim counts level only."""
    low, high = limits.bounds.reshape(3, 2).T
    rim = np.array([inside, inside, 0.0])
    out = np.maximum(low + rim - rows[:, :3], rows[:, :3] - (high - rim))
    found: FloatArray = np.maximum(out.max(axis=1), 0.0)
    return found


def _is_outside(rows: FloatArray, around: Surroundings, limits: Limits, margin: float) -> FloatArray:
    """Whether no plan may begin at ``rows`` (N, ≥ 3): (N,)."""
    clear = around.distances(rows).min(axis=1, initial=np.inf)
    is_outside: FloatArray = (_out_of_bounds(rows, limits, 0.0) > 0.0) | (clear < margin)
    return is_outside


def _end_of(rows: FloatArray, around: Surroundings, limits: Limits) -> int | None:
    """The first of ``rows`` (N, 6) at which a plan may begin; None where the way there is not to be flown."""
    clear = around.distances(rows)
    out = _out_of_bounds(rows, limits, INSIDE_M)
    is_level = np.abs(rows[:, 4]) < STRAIGHT_RAD
    ready = (out <= 0.0) & (clear.min(axis=1, initial=np.inf) >= limits.margin + INSIDE_M) & is_level
    turning = np.abs(np.diff(rows[:, 3], prepend=rows[0, 3])) > STRAIGHT_RAD
    if turning.any():  # a plan may begin with a turn
        ends_turn = int(np.flatnonzero(turning)[-1])
        step = rows[0, 5] * limits.tau
        ready[: ends_turn + math.ceil(limits.straight_min / step) + 1] = False
    ends = np.flatnonzero(ready)
    if not len(ends):
        return None
    end = int(ends[0])
    is_shut_out = out[0] > 0.0 or clear[0].min(initial=np.inf) <= 0.0
    if not is_shut_out and end * rows[0, 5] * limits.tau > NEAR_MAX_M:
        return None
    if out[: end + 1].max() > out[0] + OVERSHOOT_RADII * limits.r_min:
        return None
    way = clear[: end + 1]
    held = HELD * np.minimum(way[0], limits.margin)  # of what it is too near to already
    held[way[0] >= limits.margin] = limits.margin
    leaves = way[0] <= 0.0
    falls = np.diff(np.minimum(way, limits.margin), axis=0).min(axis=0, initial=0.0) < -NEARER_M
    if (way < held - NEARER_M).any() or (falls & leaves).any():
        return None
    return end
