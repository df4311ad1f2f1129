"""Costs of candidate sub goals (paper 4.2, formulas (4)–(6))."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from companion.kernels.arrays import FloatArray, IntArray, Limits, Obstacles, ThreatModel, Threats
from companion.kernels.geometry.distance_field import spread_wave
from companion.kernels.geometry.prism_distance import boxes_on_segment, clearance, distance_to_edge_squared
from companion.kernels.threat.fuzzy_threat import MAX_THREATS, point_threat

FREE, OCCUPIED, CONSTRAINED, HIGH_RISK = 0, 1, 2, 3
WAVE_CELLS = 49  # of the wave's square grid, each way
DETOUR_MAX = 1.25  # way round obstacles, in horizons, beyond which a candidate is removed
CLIMB_SHARE = 0.8  # of the climb angle, kept for the way from a sub goal to the goal


@nb.njit(cache=True, nogil=True)
def obstructed_length(
    px: float, py: float, pz: float, qx: float, qy: float, qz: float, obstacles: Obstacles,
    weights: FloatArray, unit: float, scratch: FloatArray,
) -> float:  # fmt: skip
    """L of (6): weighted length, heights and widths of the bounding boxes crossed [planning units]."""
    length = math.sqrt((qx - px) ** 2 + (qy - py) ** 2 + (qz - pz) ** 2)
    total = weights[0] * length
    for b in range(boxes_on_segment(px, py, pz, qx, qy, qz, obstacles, scratch)):
        total += weights[1] * scratch[b, 0] + weights[2] * scratch[b, 1]
    return total / unit


@nb.njit(cache=True, nogil=True)
def is_on_the_way(above: float, flat: float, limits: Limits) -> bool:
    """Whether the goal, ``flat`` metres away and ``above`` metres lower, is within the climb angles."""
    if limits.dimension == 2:
        return True
    climb, descent = CLIMB_SHARE * limits.climb_max, CLIMB_SHARE * limits.descent_max
    return -flat * math.tan(climb) <= above <= flat * math.tan(descent)


@nb.njit(cache=True, nogil=True)
def score(
    points: FloatArray, end: FloatArray, goal: FloatArray, elapsed: float, obstacles: Obstacles,
    threats: Threats, dts: FloatArray, model: ThreatModel, limits: Limits, gamma: FloatArray,
    weights: FloatArray, level_max: float, costs: FloatArray, reasons: IntArray,
) -> None:  # fmt: skip
    """Cost (5) of every candidate and why it is removed, if it is.

    ``points`` (S, 3); ``end`` (6,) state at the end of the last local path, reached after ``elapsed``
    seconds; ``dts`` (D, 5) x y z speed RD_max; ``gamma`` (4,) C_γ; ``weights`` (3,) L_γ. ``costs`` and
    ``reasons`` (S,) are filled; a removed point keeps its cost.

    The paper leaves open which flight constraints remove a point. Here: bounds, climb and descent
    angle to it and (:func:`is_on_the_way`) from it, and a way round obstacles inside the horizon.
    """
    radius = math.sqrt(
        (points[0, 0] - end[0]) ** 2 + (points[0, 1] - end[1]) ** 2 + (points[0, 2] - end[2]) ** 2
    )
    wave = np.empty((WAVE_CELLS, WAVE_CELLS))
    cell = 2.0 * radius / (WAVE_CELLS - 1)
    origin = end[:2] - radius
    spread_wave(end[0], end[1], end[2], radius, limits.margin, limits.bounds, obstacles, origin, cell, wave)
    scratch = np.empty((obstacles.heights.shape[0] + 1, 2))
    pairs = np.empty((MAX_THREATS, 2))
    positions, reach = np.ones((dts.shape[0], 4)), dts[:, 4].copy()
    positions[:, :3] = dts[:, :3]
    for s in range(points.shape[0]):
        x, y, z = points[s]
        dx, dy, dz = x - end[0], y - end[1], z - end[2]
        flat = math.sqrt(dx * dx + dy * dy)
        length = math.sqrt(flat * flat + dz * dz)
        phi = math.atan2(dz, flat)
        cost = gamma[0] * obstructed_length(
            end[0], end[1], end[2], x, y, z, obstacles, weights, model.unit, scratch
        )
        cost += gamma[1] * obstructed_length(
            x, y, z, goal[0], goal[1], goal[2], obstacles, weights, model.unit, scratch
        )
        radii, crossed = 0.0, 0
        for r in range(threats.radars.shape[0]):
            r_max = threats.radars[r, 3]
            away = distance_to_edge_squared(threats.radars[r, 0], threats.radars[r, 1], end[0], end[1], x, y)
            if threats.known[r] == 1 and away <= r_max * r_max:
                radii += r_max / model.unit
                crossed += 1
        if crossed > 0:
            cost += gamma[2] * radii / crossed
        worst = 0.0
        for d in range(dts.shape[0]):
            away = distance_to_edge_squared(dts[d, 0], dts[d, 1], end[0], end[1], x, y)
            if away <= dts[d, 4] * dts[d, 4]:
                way = dts[d, 3] * (elapsed + length / max(end[5], 1.0)) / model.unit
                worst = max(worst, math.sqrt(way))
        cost += gamma[3] * worst
        costs[s] = cost
        reasons[s] = FREE
        mu, nu = point_threat(
            x, y, z, math.atan2(dy, dx), phi, limits.v_cruise, 0.0, threats, positions, reach, model, pairs
        )
        b = limits.bounds
        if clearance(x, y, z, obstacles, 2.0 * limits.margin + 1.0) < limits.margin:
            reasons[s] = OCCUPIED
        elif not (b[0] <= x <= b[1] and b[2] <= y <= b[3] and b[4] <= z <= b[5]):
            reasons[s] = CONSTRAINED
        elif phi > limits.climb_max + 1e-9 or phi < -limits.descent_max - 1e-9:
            reasons[s] = CONSTRAINED
        elif not is_on_the_way(z - goal[2], math.hypot(goal[0] - x, goal[1] - y), limits):
            reasons[s] = CONSTRAINED
        elif wave[int(round((x - end[0] + radius) / cell)), int(round((y - end[1] + radius) / cell))] > (
            DETOUR_MAX * radius
        ):
            reasons[s] = CONSTRAINED
        elif mu - nu > level_max:
            reasons[s] = HIGH_RISK
