"""The least margin between two timed paths that end in circles.

A path is rows of time, east, north and up. Between rows the aircraft moves in a straight line at constant
speed. From the last row on it is anywhere in a disc about the last place. If its first disc has a radius, it
is anywhere in that disc, about the first place, until the second row. Before the first row it is at the first
place. Two aircraft keep clear if their horizontal or their vertical distance suffices, so the margin
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

from companion.kernels.arrays import Float1D, Float2D, Int1D
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
    rows: Float2D, first: int, last: int, discs: Float1D, k: int, t: float
) -> tuple[float, float, float, float, float, float, float]:
    """Return place, velocity and radius of the disc on the leg that begins at row ``k`` [m, m/s, m].

    The path is rows ``first`` to ``last - 1`` of ``rows`` (N, 4): time [s], east, north, up [m]. ``discs``
    (≥ 2,) begins with the radii of the first and of the last disc [m].
    """
    if k >= last - 1:
        return rows[last - 1, 1], rows[last - 1, 2], rows[last - 1, 3], 0.0, 0.0, 0.0, discs[1]
    if k < first or (k == first and discs[0] > 0.0):
        return rows[first, 1], rows[first, 2], rows[first, 3], 0.0, 0.0, 0.0, discs[0]
    length = rows[k + 1, 0] - rows[k, 0]
    after = t - rows[k, 0]
    vx = quotient(rows[k + 1, 1] - rows[k, 1], length)
    vy = quotient(rows[k + 1, 2] - rows[k, 2], length)
    vz = quotient(rows[k + 1, 3] - rows[k, 3], length)
    return rows[k, 1] + after * vx, rows[k, 2] + after * vy, rows[k, 3] + after * vz, vx, vy, vz, 0.0


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
    rows: Float2D, discs: Float1D, others: Float2D, first: int, last: int, other_discs: Float1D,
    since: float, apart: float, up: float,
) -> float:  # fmt: skip
    """Return the least margin of two paths from an instant on, for ever [m]; negative if they conflict.

    One path is all of ``rows`` (N, 4), the other is rows ``first`` to ``last - 1`` of ``others`` (M, 4): time
    [s], east, north, up [m]. Their ``discs`` (≥ 2,) and ``other_discs`` (≥ 2,) begin with the radii of the
    first and of the last disc [m]. ``apart`` and ``up`` are the horizontal and vertical distances, one of
    which has to be kept [m].
    """
    num = rows.shape[0]
    i, j = row_before(rows, 0, num, since), row_before(others, first, last, since)
    t, least = since, math.inf
    while True:
        ended, other_ended = i >= num - 1, j >= last - 1
        px, py, pz, vx, vy, vz, disc = place_at(rows, 0, num, discs, i, t)
        qx, qy, qz, ux, uy, uz, other_disc = place_at(others, first, last, other_discs, j, t)
        until = t
        if not ended:
            until = rows[i + 1, 0]
        if not other_ended:
            until = others[j + 1, 0] if ended else min(until, others[j + 1, 0])
        wide = apart + disc + other_disc
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
    rows: Float2D,
    discs: Float1D,
    others: Float2D,
    other_discs: Float1D,
    since: float,
    apart: float,
    up: float,
) -> float:
    """Return :func:`margin_of_paths` of two whole paths [m].

    ``rows`` (N, 4) and ``others`` (M, 4) have time [s], east, north, up [m]; ``discs`` (≥ 2,) and
    ``other_discs`` (≥ 2,) begin with the radii of the first and of the last disc [m].
    """
    return margin_of_paths(rows, discs, others, 0, others.shape[0], other_discs, since, apart, up)


@kernel
def first_conflict(
    rows: Float2D, discs: Float1D, others: Float2D, offsets: Int1D, limits: Float2D, since: float
) -> int:
    """Return the first of many paths that conflicts with one path from an instant on; -1 if none does.

    The path is ``rows`` (N, 4) with time [s], east, north, up [m]; ``discs`` (≥ 2,) begins with the radii of
    its first and its last disc [m]. Path p of the others is rows ``offsets[p]`` to ``offsets[p + 1] - 1`` of
    ``others`` (M, 4), ``offsets`` (P + 1,). ``limits`` (P, 4) has the radii of its discs, and the horizontal
    and vertical distances, one of which has to be kept [m].
    """
    for p in range(limits.shape[0]):
        margin = margin_of_paths(
            rows, discs, others, offsets[p], offsets[p + 1], limits[p], since, limits[p, 2], limits[p, 3]
        )
        if margin < 0.0:
            return p
    return -1
