"""Paths as rows of poses: joining them by Dubins edges, checking and costing them.

A path is ``states`` (N, 6) with arrival ``times`` (N,) and, for each row but the first, the turn rate
``w`` and climb rate ``wp`` of the edge that ends there, ``rates`` (N, 2).
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from companion.kernels import dubins
from companion.kernels.geometry import segment_clear
from companion.kernels.layout import (
    FloatArray,
    Limits,
    Obstacles,
    Pursuers,
    Search,
    ThreatModel,
    Threats,
)
from companion.kernels.motion import OK, STRAIGHT_RATE, state_status, straight_after, wrapped
from companion.kernels.reachability import MAX_NEAR, is_reachable, near_pursuer_nodes
from companion.kernels.search import turn_cost
from companion.kernels.threat import MAX_THREATS, line_threat

JOINED, NOT_FLYABLE, TOO_LONG = 0, 1, 2
TURN_TOLERANCE = 1e-3  # of the turn rate limit, for edges sampled across the end of a turn


@nb.njit(cache=True, nogil=True)
def join(
    states: FloatArray, times: FloatArray, rates: FloatArray, n: int, goal: FloatArray, limits: Limits
) -> tuple[int, int]:
    """Append a Dubins edge from row ``n - 1`` to the pose ``goal`` (6,), sampled about every le.

    Height changes evenly along it. Returns the status and the new number of rows.
    """
    start = states[n - 1]
    segments, pose = np.empty(3), np.empty(3)
    rho = limits.r_min
    kind = dubins.shortest(start[0], start[1], start[3], goal[0], goal[1], goal[3], rho, segments)
    length = rho * (segments[0] + segments[1] + segments[2])
    v = start[5]
    if length < 1.0 or abs(v - goal[5]) > 0.5:
        return NOT_FLYABLE, n
    phi = math.atan2(goal[2] - start[2], length)
    if phi > limits.climb_max + 1e-9 or phi < -limits.descent_max - 1e-9:
        return NOT_FLYABLE, n
    if abs(phi - start[4]) > limits.pitch_rate_max * limits.tau:
        return NOT_FLYABLE, n
    if abs(goal[4] - phi) > limits.pitch_rate_max * limits.tau:
        return NOT_FLYABLE, n
    steps = max(1, int(math.ceil(length * math.sqrt(1.0 + math.tan(phi) ** 2) / (v * limits.tau) - 1e-6)))
    if n + steps > states.shape[0]:
        return TOO_LONG, n
    ds = length / steps
    dt = ds / (v * math.cos(phi))
    x0, y0, z0, theta0 = start[0], start[1], start[2], start[3]
    rise = goal[2] - z0
    for k in range(1, steps + 1):
        dubins.sample(x0, y0, theta0, kind, segments, rho, ds * k, pose)
        row = states[n]
        row[0], row[1], row[2] = pose[0], pose[1], z0 + rise * k / steps
        row[3], row[4], row[5] = wrapped(pose[2]), phi, v
        times[n] = times[n - 1] + dt
        rates[n, 0] = wrapped(row[3] - states[n - 1, 3]) / dt
        rates[n, 1] = (phi - states[n - 1, 4]) / dt
        n += 1
    return JOINED, n


@nb.njit(cache=True, nogil=True)
def is_flyable(
    states: FloatArray, times: FloatArray, rates: FloatArray, n: int, first: int, limits: Limits
) -> bool:
    """Whether rows ``first`` to ``n`` keep bounds, turn radius, climb angles and the straight-flight rule.

    The rule is followed from row 0, where no turn has been flown yet.
    """
    turn, straight = 0, limits.straight_min
    for k in range(1, n):
        dt = times[k] - times[k - 1]
        w = rates[k, 0]
        length = dt * 0.5 * (states[k, 5] + states[k - 1, 5])
        sign = 1 if w > STRAIGHT_RATE else (-1 if w < -STRAIGHT_RATE else 0)
        if k >= first:
            if state_status(states[k], limits) != OK:
                return False
            slow = min(states[k, 5], states[k - 1, 5])
            if abs(w) > slow * math.cos(states[k - 1, 4]) / limits.r_min * (1.0 + TURN_TOLERANCE) + 1e-9:
                return False
            if states[k, 4] > limits.climb_max + 1e-6 or states[k, 4] < -limits.descent_max - 1e-6:
                return False
            if sign != 0 and sign != turn and (turn != 0 or straight < limits.straight_min - 1e-6):
                return False
        turn, straight = straight_after(turn, straight, w, length)
    return True


@nb.njit(cache=True, nogil=True)
def is_clear(
    states: FloatArray,
    rates: FloatArray,
    times: FloatArray,
    first: int,
    n: int,
    obstacles: Obstacles,
    margin: float,
) -> bool:
    """Whether the edges that end in rows ``first`` to ``n - 1`` keep the margin from obstacles."""
    for k in range(first, n):
        p, q = states[k - 1], states[k]
        chord = math.sqrt((q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2 + (q[2] - p[2]) ** 2)
        sagitta = 0.125 * chord * abs(rates[k, 0]) * (times[k] - times[k - 1])
        if not segment_clear(p[0], p[1], p[2], q[0], q[1], q[2], obstacles, margin + sagitta):
            return False
    return True


@nb.njit(cache=True, nogil=True)
def dt_positions(
    pursuers: Pursuers,
    x: float,
    y: float,
    z: float,
    time: float,
    k: int,
    obstacles: Obstacles,
    out: FloatArray,
) -> None:
    """Nearest estimated position of every DT to a pose at a time, from the TTrees as they are.

    ``out`` (D, 4) receives positions and 1 where the DT can be there in time.
    """
    near = np.empty(MAX_NEAR, dtype=np.int64)
    boundary, estimate = np.empty(2), np.empty(3)
    for d in range(pursuers.count.shape[0]):
        out[d, 3] = 0.0
        rd, v = pursuers.model[d, 1], pursuers.model[d, 0]
        away = math.hypot(pursuers.position[d, 0, 0] - x, pursuers.position[d, 0, 1] - y)
        if away - rd > v * max(0.0, time - pursuers.time[d, 0]):
            continue
        best = math.inf
        for m in range(near_pursuer_nodes(pursuers, d, x, y, k, near)):
            if is_reachable(pursuers, d, near[m], x, y, z, time, obstacles, boundary, estimate):
                d2 = (estimate[0] - x) ** 2 + (estimate[1] - y) ** 2
                if d2 < best:
                    best = d2
                    out[d, 0], out[d, 1], out[d, 2], out[d, 3] = estimate[0], estimate[1], estimate[2], 1.0


@nb.njit(cache=True, nogil=True)
def path_cost(
    states: FloatArray, times: FloatArray, first: int, n: int, delta: float, pursuers: Pursuers,
    obstacles: Obstacles, threats: Threats, model: ThreatModel, search: Search,
) -> float:  # fmt: skip
    """Sum of (9) over the edges that end in rows ``first`` to ``n - 1``; infinite above the level limit."""
    scratch = np.empty((MAX_THREATS, 2))
    points = np.zeros((max(pursuers.count.shape[0], 1), 4))
    reach = pursuers.model[:, 1].copy()
    total = 0.0
    for k in range(first, n):
        p, q = states[k - 1], states[k]
        dt_positions(pursuers, q[0], q[1], q[2], times[k], search.k_pursuer, obstacles, points)
        chord = math.sqrt((q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2 + (q[2] - p[2]) ** 2)
        level = line_threat(
            p[0], p[1], p[2], q[0], q[1], q[2], q[5], delta, threats, points, reach, model,
            search.secondary, scratch,
        )  # fmt: skip
        if level > search.level_max:
            total = math.inf
        total += (
            search.cost_distance * chord / search.unit
            + search.cost_turn * turn_cost(p, q[0], q[1], q[2])
            + search.cost_threat * level
        )
    return total


@nb.njit(cache=True, nogil=True)
def splice(
    states: FloatArray, times: FloatArray, rates: FloatArray, n: int, i: int, via: FloatArray, use_via: bool,
    j: int, limits: Limits, out_states: FloatArray, out_times: FloatArray, out_rates: FloatArray,
) -> tuple[int, int, int]:  # fmt: skip
    """Copy a path with rows ``i`` to ``j`` replaced by Dubins edges, over the pose ``via`` if asked.

    Returns the status, the new number of rows and the row that ``j`` has become. Rows after it keep
    their shape and move in time.
    """
    out_states[: i + 1], out_times[: i + 1], out_rates[: i + 1] = (
        states[: i + 1],
        times[: i + 1],
        rates[: i + 1],
    )
    m = i + 1
    if use_via:
        status, m = join(out_states, out_times, out_rates, m, via, limits)
        if status != JOINED:
            return status, m, m
    status, m = join(out_states, out_times, out_rates, m, states[j], limits)
    if status != JOINED:
        return status, m, m
    at = m - 1
    if m + n - 1 - j > out_states.shape[0]:
        return TOO_LONG, m, at
    for k in range(j + 1, n):
        out_states[m], out_rates[m] = states[k], rates[k]
        out_times[m] = out_times[m - 1] + times[k] - times[k - 1]
        m += 1
    return JOINED, m, at
