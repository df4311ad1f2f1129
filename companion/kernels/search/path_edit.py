"""Paths as rows of poses: joining them by Dubins edges, checking and costing them.

A path is ``states`` (N, 6) with arrival ``times`` (N,) and, for each row but the first, the turn rate
``w`` and climb rate ``wp`` of the edge that ends there, ``rates`` (N, 2).
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from companion.kernels.aircraft import dubins
from companion.kernels.aircraft.motion import OK, STRAIGHT_RATE, state_status, straight_after, wrapped
from companion.kernels.arrays import (
    FloatArray,
    Limits,
    Obstacles,
    Pursuers,
    Search,
    ThreatModel,
    Threats,
)
from companion.kernels.geometry.prism_distance import segment_clear
from companion.kernels.search.dynamic_domain_rrt import turn_cost
from companion.kernels.threat.fuzzy_threat import MAX_THREATS, line_threat
from companion.kernels.threat.reachability import dt_positions

JOINED, NOT_FLYABLE, TOO_LONG = 0, 1, 2
ONE_TURN_M = 0.1  # of straight flight between two like turns is none
HEIGHT_TOLERANCE_M = 1e-3
UNSURE = 0.25  # of the least turn, from which an edge is neither straight nor a turn
TURN_TOLERANCE = 1e-3  # of the turn rate limit, for edges sampled across the end of a turn


@nb.njit(cache=True, nogil=True)
def keeps_turns_apart(kind: int, segments: FloatArray, limits: Limits) -> bool:
    """Whether two turns of a Dubins word have ``straight_min`` between them, or are one turn."""
    least = STRAIGHT_RATE * limits.tau
    if segments[0] < least or segments[2] < least:
        return segments[1] < least or dubins.turn_of(kind, 1) == 0.0 or max(segments[0], segments[2]) < least
    if dubins.turn_of(kind, 1) != 0.0:
        return False
    straight = segments[1] * limits.r_min
    same = dubins.turn_of(kind, 0) == dubins.turn_of(kind, 2)
    return straight >= limits.straight_min or (same and straight < ONE_TURN_M)


@nb.njit(cache=True, nogil=True)
def ramp(
    top: float, start: float, end: float, most: float, steps: int, angles: FloatArray, ds: float
) -> float:
    """Climb angles (steps + 1,) from ``start`` over ``top`` to ``end``, each at most ``most`` from the next.

    Returns the height they gain over steps of ``ds`` on the ground [m]: an edge climbs at the mean of
    its ends' angles.
    """
    gained = 0.0
    angles[0] = start
    for k in range(1, steps + 1):
        up = min(top, start + most * k, end + most * (steps - k))
        angles[k] = max(up, start - most * k, end - most * (steps - k)) if k < steps else end
        gained += ds * math.tan(0.5 * (angles[k] + angles[k - 1]))
    return gained


@nb.njit(cache=True, nogil=True)
def climb_profile(
    rise: float, start: float, end: float, ds: float, steps: int, v: float, limits: Limits, angles: FloatArray
) -> bool:
    """Climb angles (steps + 1,) that gain ``rise`` within climb angle and pitch rate; False if none do."""
    most = limits.pitch_rate_max * ds / v
    if abs(end - start) > most * steps:
        return False
    low, high = -limits.descent_max, limits.climb_max
    below = ramp(low, start, end, most, steps, angles, ds) - rise
    above = ramp(high, start, end, most, steps, angles, ds) - rise
    if below > HEIGHT_TOLERANCE_M or above < -HEIGHT_TOLERANCE_M:
        return False
    for _ in range(40):  # false position, Illinois variant: the gain rises with the top
        middle = high if above == below else high - above * (high - low) / (above - below)
        at = ramp(middle, start, end, most, steps, angles, ds) - rise
        if abs(at) <= HEIGHT_TOLERANCE_M:
            return True
        if at > 0.0:
            high, above, below = middle, at, 0.5 * below
        else:
            low, below, above = middle, at, 0.5 * above
    return False


@nb.njit(cache=True, nogil=True)
def join(
    states: FloatArray, times: FloatArray, rates: FloatArray, n: int, goal: FloatArray, limits: Limits
) -> tuple[int, int]:
    """Append a Dubins edge from row ``n - 1`` to the pose ``goal`` (6,), sampled about every le.

    The climb angle goes from the start's to the goal's over whatever :func:`climb_profile` finds for
    the height between. Returns the status and the new number of rows.
    """
    start = states[n - 1]
    segments, pose = np.empty(3), np.empty(3)
    rho = limits.r_min
    kind = dubins.shortest(start[0], start[1], start[3], goal[0], goal[1], goal[3], rho, segments)
    length = rho * (segments[0] + segments[1] + segments[2])
    v = start[5]
    if length < 1.0 or abs(v - goal[5]) > 0.5 or not keeps_turns_apart(kind, segments, limits):
        return NOT_FLYABLE, n
    steepest = max(limits.climb_max, limits.descent_max)
    if abs(goal[2] - start[2]) > math.tan(steepest) * length:
        return NOT_FLYABLE, n
    is_level = goal[2] == start[2] and goal[4] == 0.0 and start[4] == 0.0
    le = v * limits.tau * (1.0 if is_level else math.cos(steepest))
    steps = max(1, int(math.ceil(length / le - 1e-6)))
    if n + steps > states.shape[0]:
        return TOO_LONG, n
    ds, angles = length / steps, np.zeros(steps + 1)
    if limits.dimension == 3 and not climb_profile(
        goal[2] - start[2], start[4], goal[4], ds, steps, v, limits, angles
    ):
        return NOT_FLYABLE, n
    x0, y0, theta0, z = start[0], start[1], start[3], start[2]
    for k in range(1, steps + 1):
        dubins.sample(x0, y0, theta0, kind, segments, rho, ds * k, pose)
        mean = 0.5 * (angles[k] + angles[k - 1])
        dt = ds / (v * math.cos(mean))
        z += ds * math.tan(mean)
        row = states[n]
        row[0], row[1], row[2] = pose[0], pose[1], z if k < steps else goal[2]
        row[3], row[4], row[5] = wrapped(pose[2]), angles[k], v
        times[n] = times[n - 1] + dt
        rates[n, 0] = wrapped(row[3] - states[n - 1, 3]) / dt
        rates[n, 1] = (row[4] - states[n - 1, 4]) / dt
        n += 1
    return JOINED, n


@nb.njit(cache=True, nogil=True)
def is_flyable(
    states: FloatArray, times: FloatArray, rates: FloatArray, n: int, first: int, limits: Limits
) -> bool:
    """Whether rows ``first`` to ``n`` keep bounds, turn radius, climb angles and the straight-flight rule.

    The rule is followed from row 0, where no turn has been flown yet.
    """
    return is_flyable_after(0, limits.straight_min, states, times, rates, n, first, limits)


@nb.njit(cache=True, nogil=True)
def is_flyable_after(
    turn: int, straight: float, states: FloatArray, times: FloatArray, rates: FloatArray, n: int, first: int,
    limits: Limits,
) -> bool:  # fmt: skip
    """:func:`is_flyable` with the turn and straight length flown before row 0."""
    for k in range(1, n):
        dt = times[k] - times[k - 1]
        w = rates[k, 0]
        length = dt * 0.5 * (states[k, 5] + states[k - 1, 5])
        if k >= first:
            if state_status(states[k], limits) != OK:
                return False
            slow = min(states[k, 5], states[k - 1, 5])
            if abs(w) > slow * math.cos(states[k - 1, 4]) / limits.r_min * (1.0 + TURN_TOLERANCE) + 1e-9:
                return False
            if abs(rates[k, 1]) > limits.pitch_rate_max * (1.0 + TURN_TOLERANCE):
                return False
            if states[k, 4] > limits.climb_max + 1e-6 or states[k, 4] < -limits.descent_max - 1e-6:
                return False
            if UNSURE * STRAIGHT_RATE < abs(w) * dt <= STRAIGHT_RATE:
                return False
            if breaks_turn_rule(turn, straight, w, limits):
                return False
        turn, straight = straight_after(turn, straight, w, length)
    return True


@nb.njit(cache=True, nogil=True)
def breaks_turn_rule(turn: int, straight: float, w: float, limits: Limits) -> bool:
    """Whether an edge of turn rate ``w`` begins a turn too soon after another."""
    sign = 1 if w > STRAIGHT_RATE else (-1 if w < -STRAIGHT_RATE else 0)
    return sign != 0 and sign != turn and (turn != 0 or straight < limits.straight_min - 1e-6)


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
def path_cost(
    states: FloatArray, times: FloatArray, first: int, n: int, delta: float, pursuers: Pursuers,
    walls: Obstacles, threats: Threats, model: ThreatModel, search: Search,
) -> float:  # fmt: skip
    """Sum of (9) over the edges that end in rows ``first`` to ``n - 1``; infinite above the level limit."""
    scratch = np.empty((MAX_THREATS, 2))
    points = np.zeros((max(pursuers.count.shape[0], 1), 4))
    reach = pursuers.model[:, 1].copy()
    total = 0.0
    for k in range(first, n):
        p, q = states[k - 1], states[k]
        dt_positions(pursuers, q[0], q[1], q[2], times[k], search.k_pursuer, walls, points)
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
