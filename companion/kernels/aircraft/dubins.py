"""Dubins paths in the plane: shortest curves of bounded curvature between two poses.

Symbols: ``rho`` turn radius; ``alpha, beta`` start and end direction in the frame of the line
between the poses; ``d`` its length in radii; ``t, p, q`` the three segments in radii.

References
----------
Shkel, Lumelsky, "Classification of the Dubins set", Robotics and Autonomous Systems 34 (2001).
"""

from __future__ import annotations

import math

from companion.kernels.arrays import Float1D
from companion.kernels.native.kernel import inlined, kernel

LSL, RSR, LSR, RSL, RLR, LRL = 0, 1, 2, 3, 4, 5
TWO_PI = 2.0 * math.pi


@inlined
def _mod(angle: float) -> float:
    """Return the angle in [0, 2π); values a rounding below 2π count as 0, so that no full circle appears."""
    a = angle - TWO_PI * math.floor(angle / TWO_PI)
    return 0.0 if a > TWO_PI - 1e-9 else a


@kernel
def word(kind: int, d: float, alpha: float, beta: float) -> tuple[bool, float, float, float]:
    """Segments (t, p, q) of one of the six words, and whether it exists."""
    sa, ca, sb, cb = math.sin(alpha), math.cos(alpha), math.sin(beta), math.cos(beta)
    cab = math.cos(alpha - beta)
    if kind == LSL:
        square = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sa - sb)
        at = math.atan2(cb - ca, d + sa - sb)
        return square >= 0.0, _mod(at - alpha), math.sqrt(max(square, 0.0)), _mod(beta - at)
    if kind == RSR:
        square = 2.0 + d * d - 2.0 * cab + 2.0 * d * (sb - sa)
        at = math.atan2(ca - cb, d - sa + sb)
        return square >= 0.0, _mod(alpha - at), math.sqrt(max(square, 0.0)), _mod(at - beta)
    if kind == LSR:
        square = d * d - 2.0 + 2.0 * cab + 2.0 * d * (sa + sb)
        p = math.sqrt(max(square, 0.0))
        at = math.atan2(-ca - cb, d + sa + sb) - math.atan2(-2.0, p)
        return square >= 0.0, _mod(at - alpha), p, _mod(at - beta)
    if kind == RSL:
        square = d * d - 2.0 + 2.0 * cab - 2.0 * d * (sa + sb)
        p = math.sqrt(max(square, 0.0))
        at = math.atan2(ca + cb, d - sa - sb) - math.atan2(2.0, p)
        return square >= 0.0, _mod(alpha - at), p, _mod(beta - at)
    if kind == RLR:
        cosine = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sa - sb)) / 8.0
        if abs(cosine) > 1.0:
            return False, 0.0, 0.0, 0.0
        p = _mod(TWO_PI - math.acos(cosine))
        t = _mod(alpha - math.atan2(ca - cb, d - sa + sb) + 0.5 * p)
        return True, t, p, _mod(alpha - beta - t + p)
    cosine = (6.0 - d * d + 2.0 * cab + 2.0 * d * (sb - sa)) / 8.0
    if abs(cosine) > 1.0:
        return False, 0.0, 0.0, 0.0
    p = _mod(TWO_PI - math.acos(cosine))
    t = _mod(-alpha + math.atan2(cb - ca, d + sa - sb) + 0.5 * p)
    return True, t, p, _mod(beta - alpha - t + p)


@kernel
def shortest(
    x0: float, y0: float, theta0: float, x1: float, y1: float, theta1: float, rho: float, out: Float1D
) -> int:
    """Shortest word between two poses; its segments (t, p, q) in radii go to ``out`` (3,).

    Returns the word's number.
    """
    dx, dy = x1 - x0, y1 - y0
    line = math.atan2(dy, dx)
    d = math.sqrt(dx * dx + dy * dy) / rho
    alpha, beta = _mod(theta0 - line), _mod(theta1 - line)
    best, best_kind = math.inf, -1
    for kind in range(6):
        exists, t, p, q = word(kind, d, alpha, beta)
        if exists and t + p + q < best:
            best, best_kind = t + p + q, kind
            out[0], out[1], out[2] = t, p, q
    return best_kind


@kernel
def distance(
    x0: float, y0: float, theta0: float, x1: float, y1: float, theta1: float, rho: float, out: Float1D
) -> float:
    """Length of the shortest Dubins path between two poses [m]; its segments go to ``out`` (3,) in radii."""
    shortest(x0, y0, theta0, x1, y1, theta1, rho, out)
    return rho * (out[0] + out[1] + out[2])


@kernel
def turn_of(kind: int, segment: int) -> float:
    """+1 left, -1 right, 0 straight for a word's segment 0, 1 or 2."""
    if segment == 1:
        if kind == RLR:
            return 1.0
        return -1.0 if kind == LRL else 0.0
    if segment == 0:
        return 1.0 if kind in (LSL, LSR, LRL) else -1.0
    return 1.0 if kind in (LSL, RSL, LRL) else -1.0


@kernel
def sample(
    x0: float, y0: float, theta0: float, kind: int, segments: Float1D, rho: float, s: float,
    pose: Float1D,
) -> None:  # fmt: skip
    """Pose (x, y, theta) after ``s`` metres of a word from a start pose, into ``pose`` (3,).

    ``segments`` (3,) t, p, q of the word in radii.
    """
    x, y, theta = x0, y0, theta0
    left = s / rho
    for i in range(3):
        step = min(left, segments[i])
        turn = turn_of(kind, i)
        if turn == 0.0:
            x += rho * step * math.cos(theta)
            y += rho * step * math.sin(theta)
        else:
            x += turn * rho * (math.sin(theta + turn * step) - math.sin(theta))
            y -= turn * rho * (math.cos(theta + turn * step) - math.cos(theta))
            theta += turn * step
        left -= step
        if left <= 0.0:
            break
    pose[0], pose[1], pose[2] = x, y, theta


@kernel
def distance_to_point(x0: float, y0: float, theta0: float, x1: float, y1: float, rho: float) -> float:
    """Shortest length to a point with any final direction [m]: one turn and a straight line.

    Points inside the turning circles are reached by turning the other way first; for them the straight
    distance is returned, a lower bound.
    """
    dx, dy = x1 - x0, y1 - y0
    forward = dx * math.cos(theta0) + dy * math.sin(theta0)
    side = abs(-dx * math.sin(theta0) + dy * math.cos(theta0))
    ex, ey = forward, side - rho  # from the centre of the nearer circle, start at (0, -rho)
    centre = math.sqrt(ex * ex + ey * ey)
    if centre < rho:
        return math.sqrt(dx * dx + dy * dy)
    tangent = math.sqrt(max(0.0, centre * centre - rho * rho))
    angle = math.atan2(ex, -ey) - math.acos(min(1.0, rho / centre))
    return rho * _mod(angle) + tangent
