"""The least margin between two timed paths that end in circles.

A path is rows of time, east, north and up. Between rows the aircraft moves in a straight line at constant
speed. Before the first row it is at the first place, and from the last row on it is anywhere in a disc about
the last place. Two aircraft keep clear if their horizontal or their vertical distance suffices, so the margin
at an instant is the larger of both excesses. While both move in a straight line each excess is a convex
function of time, and so is the larger one. Its minimum is at an end of the interval, at the minimum of one
excess, or where both are equal. All these instants have closed forms, so the minimum is exact.

References
----------
Ericson, *Real-Time Collision Detection* (2005), 5.5.7 (moving sphere against moving sphere).
Boyd and Vandenberghe, *Convex Optimization* (2004), 3.2.3 (the maximum of convex functions is convex).
"""

from __future__ import annotations

import math

from companion.kernels.arrays import Float2D, Int1D
from companion.kernels.native.kernel import inlined, kernel


@inlined
def quotient(numerator: float, denominator: float) -> float:
    """Return a quotient, and 0 where it has no value."""
    return numerator / denominator if denominator != 0.0 else 0.0


@kernel
def row_before(rows: Float2D, first: int, last: int, t: float) -> int:
    """Return the last row of a path that is not after an instant; ``first - 1`` if all are.

    The path is rows ``first`` to ``last - 1`` of ``rows`` (N, 4): time [s], east, north, up [m].
    """
    k = last - 1
    while k >= first and rows[k, 0] > t:
        k -= 1
    return k


@kernel
def place_at(
    rows: Float2D, first: int, last: int, k: int, t: float
) -> tuple[float, float, float, float, float, float]:
    """Return place and velocity on the leg that begins at row ``k``, at rest beyond both ends [m, m/s].

    The path is rows ``first`` to ``last - 1`` of ``rows`` (N, 4): time [s], east, north, up [m].
    """
    if k < first or k >= last - 1:
        end = min(max(k, first), last - 1)
        return rows[end, 1], rows[end, 2], rows[end, 3], 0.0, 0.0, 0.0
    length = rows[k + 1, 0] - rows[k, 0]
    after = t - rows[k, 0]
    vx = quotient(rows[k + 1, 1] - rows[k, 1], length)
    vy = quotient(rows[k + 1, 2] - rows[k, 2], length)
    vz = quotient(rows[k + 1, 3] - rows[k, 3], length)
    return rows[k, 1] + after * vx, rows[k, 2] + after * vy, rows[k, 3] + after * vz, vx, vy, vz


@kernel
def moving_margin(
    dx: float, dy: float, dz: float, wx: float, wy: float, wz: float, length: float, apart: float, up: float
) -> float:
    """Return the least margin while one aircraft moves relative to another in a straight line [m].

    It begins at (dx, dy, dz) [m] with velocity (wx, wy, wz) [m/s] and takes ``length`` [s]. ``apart`` and
    ``up`` are the horizontal and vertical distances, one of which has to be kept [m].
    """
    speed2, along, distance2 = wx * wx + wy * wy, dx * wx + dy * wy, dx * dx + dy * dy
    extra, a, least = apart - up, speed2 - wz * wz, math.inf
    # The least horizontal and the least vertical distance, four instants at which the excesses are equal, and
    # the ends, which matter only where rounding hides those four.
    for n in range(8):
        t = length if n == 7 else 0.0
        if n < 2:
            t = min(max(quotient(-along, speed2) if n == 0 else quotient(-dz, wz), 0.0), length)
        elif n < 6:
            # √(horizontal²) = ±z + extra, squared; a root that is none only adds one more instant.
            sign = 1.0 if n < 4 else -1.0
            half_b = along - wz * dz - sign * extra * wz
            c = distance2 - (sign * dz + extra) * (sign * dz + extra)
            q = -half_b - math.copysign(math.sqrt(max(half_b * half_b - a * c, 0.0)), half_b)
            t = quotient(q, a) if n % 2 == 0 else quotient(c, q)
        if 0.0 <= t <= length:
            ex, ey = dx + t * wx, dy + t * wy
            horizontal, vertical = math.sqrt(ex * ex + ey * ey) - apart, abs(dz + t * wz) - up
            if (n == 0 and horizontal >= vertical) or (n == 1 and vertical >= horizontal):
                return max(horizontal, vertical)  # The larger excess is at its own minimum here.
            least = min(least, max(horizontal, vertical))
    return least


@kernel
def margin_of_paths(
    rows: Float2D, radius: float, others: Float2D, first: int, last: int, other_radius: float,
    since: float, apart: float, up: float,
) -> float:  # fmt: skip
    """Return the least margin of two paths from an instant on, for ever [m]; negative if they conflict.

    One path is all of ``rows`` (N, 4), the other is rows ``first`` to ``last - 1`` of ``others`` (M, 4): time
    [s], east, north, up [m]. The discs at their ends have ``radius`` and ``other_radius`` [m]. ``apart`` and
    ``up`` are the horizontal and vertical distances, one of which has to be kept [m].
    """
    num = rows.shape[0]
    i, j = row_before(rows, 0, num, since), row_before(others, first, last, since)
    t, least = since, math.inf
    while True:
        ended, other_ended = i >= num - 1, j >= last - 1
        px, py, pz, vx, vy, vz = place_at(rows, 0, num, i, t)
        qx, qy, qz, ux, uy, uz = place_at(others, first, last, j, t)
        until = t
        if not ended:
            until = rows[i + 1, 0]
        if not other_ended:
            until = others[j + 1, 0] if ended else min(until, others[j + 1, 0])
        wide = apart + (radius if ended else 0.0) + (other_radius if other_ended else 0.0)
        margin = moving_margin(qx - px, qy - py, qz - pz, ux - vx, uy - vy, uz - vz, until - t, wide, up)
        least = min(least, margin)
        if ended and other_ended:
            return least
        t = until
        while i < num - 1 and rows[i + 1, 0] <= t:
            i += 1
        while j < last - 1 and others[j + 1, 0] <= t:
            j += 1


@kernel
def least_margin(
    rows: Float2D, radius: float, others: Float2D, other_radius: float, since: float, apart: float, up: float
) -> float:
    """Return :func:`margin_of_paths` of two whole paths [m].

    ``rows`` (N, 4) and ``others`` (M, 4) have time [s], east, north, up [m].
    """
    return margin_of_paths(rows, radius, others, 0, others.shape[0], other_radius, since, apart, up)


@kernel
def first_conflict(
    rows: Float2D, radius: float, others: Float2D, offsets: Int1D, limits: Float2D, since: float
) -> int:
    """Return the first of many paths that conflicts with one path from an instant on; -1 if none does.

    The path is ``rows`` (N, 4) with a disc of ``radius`` at its end [m]. Path p of the others is rows
    ``offsets[p]`` to ``offsets[p + 1] - 1`` of ``others`` (M, 4), ``offsets`` (P + 1,). ``limits`` (P, 3) has
    the radius of the disc at its end, and the horizontal and vertical distances, one of which has to be kept
    [m].
    """
    for p in range(limits.shape[0]):
        margin = margin_of_paths(
            rows, radius, others, offsets[p], offsets[p + 1], limits[p, 0], since, limits[p, 1], limits[p, 2]
        )
        if margin < 0.0:
            return p
    return -1
