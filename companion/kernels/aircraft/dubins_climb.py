"""Dubins paths with climb ("Dubins airplane"): bounded curvature in the plane, bounded climb angle.

The climb angle is the same all along a path, so the planar path has to be at least ``|dz|/tan(γ)`` long.

* Low: the shortest planar path is long enough.
* High: whole helix turns at the start make it so; their number is the largest that leaves their radius
  at least ``rho``, and the radius then meets the length exactly.
* Medium: less than a turn is missing. An arc at the start or the end, on either side, and any of the six
  words between are tried for a path of exactly that length. For poses close together there may be none
  (a closed curve is at least one circle long): then the shortest longer one found is taken, one helix
  turn at the most, and the climb is less steep.

Symbols: ``dz`` height to gain, ``γ`` climb (or descent) limit, ``need`` the planar length it asks for.

References
----------
Owen, Beard, McLain, "Implementing Dubins airplane paths on fixed-wing UAVs", Handbook of Unmanned
Aerial Vehicles (2015), section 4: low, medium and high altitude.
Chitsaz, LaValle, "Time-optimal paths for a Dubins airplane", CDC 2007.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from companion.kernels.aircraft.dubins import TWO_PI, sample, shortest, turn_of, word
from companion.kernels.arrays import FloatArray

LOW, MEDIUM, HIGH = 0, 1, 2
ANY = -1
KIND, T, P, Q, FIRST, LAST, TURNS, RADIUS, FLAT, RISE = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
SIZE = 10  # of a path's description
NUM_STEPS = 48  # of the arc that lengthens a path, before halving
NUM_HALVINGS = 50
CLOSE = 1e-9  # in radii: lengths that count as equal


@nb.njit(cache=True, nogil=True, error_model="numpy")
def turned(
    x: float, y: float, theta: float, angle: float, rho: float, forwards: bool
) -> tuple[float, float, float]:
    """The pose after an arc, left where ``angle`` is positive, or the pose before one that ends here."""
    sign = 1.0 if angle >= 0.0 else -1.0
    end = theta + angle if forwards else theta - angle
    x += sign * rho * (math.sin(end) - math.sin(theta))
    y -= sign * rho * (math.cos(end) - math.cos(theta))
    return x, y, end


@nb.njit(cache=True, nogil=True, error_model="numpy")
def with_arc(
    x0: float, y0: float, theta0: float, x1: float, y1: float, theta1: float, rho: float, kind: int,
    angle: float, at_start: bool, out: FloatArray,
) -> float:  # fmt: skip
    """Length [radii] of an arc and a word, in this order or the other; infinite where it does not exist.

    ``kind`` :data:`ANY` takes the shortest word. ``out`` (4,) receives the word's segments and number.
    """
    if at_start:
        x0, y0, theta0 = turned(x0, y0, theta0, angle, rho, True)
    else:
        x1, y1, theta1 = turned(x1, y1, theta1, angle, rho, False)
    if kind == ANY:
        out[3] = shortest(x0, y0, theta0, x1, y1, theta1, rho, out)
        return abs(angle) + out[0] + out[1] + out[2]
    dx, dy = x1 - x0, y1 - y0
    line = math.atan2(dy, dx)
    exists, t, p, q = word(kind, math.sqrt(dx * dx + dy * dy) / rho, theta0 - line, theta1 - line)
    out[0], out[1], out[2], out[3] = t, p, q, kind
    return abs(angle) + t + p + q if exists else math.inf


@nb.njit(cache=True, nogil=True, error_model="numpy")
def lengthened(
    x0: float, y0: float, theta0: float, x1: float, y1: float, theta1: float, rho: float, need: float,
    best: float, path: FloatArray,
) -> float:  # fmt: skip
    """Shortest path of at least ``need`` radii found by an arc before or after a word, into ``path``.

    ``best`` is the length of what ``path`` holds already. The length with the shortest word, and then
    with each word, is followed over the arc's angle; where it passes ``need`` without a jump, halving
    finds the angle. Returns the length.
    """
    segments = np.empty(4)
    for choice in range(28):
        kind = ANY if choice < 4 else choice // 4 - 1
        at_start, side = choice % 2 == 0, 1.0 if choice % 4 < 2 else -1.0
        low, f_low = 0.0, math.inf
        for step in range(NUM_STEPS + 1):
            high = side * TWO_PI * step / NUM_STEPS
            f_high = with_arc(x0, y0, theta0, x1, y1, theta1, rho, kind, high, at_start, segments)
            angle, length = high, f_high
            if math.isfinite(f_low) and (f_low - need) * (f_high - need) < 0.0 and math.isfinite(f_high):
                a, b, f_a = low, high, f_low
                for _ in range(NUM_HALVINGS):
                    middle = 0.5 * (a + b)
                    f = with_arc(x0, y0, theta0, x1, y1, theta1, rho, kind, middle, at_start, segments)
                    if (f_a - need) * (f - need) <= 0.0:
                        b = middle
                    else:
                        a, f_a = middle, f
                # Of the two ends the one that is long enough: at a jump they differ.
                angle = b
                length = with_arc(x0, y0, theta0, x1, y1, theta1, rho, kind, b, at_start, segments)
                if length < need - CLOSE:
                    angle = a
                    length = with_arc(x0, y0, theta0, x1, y1, theta1, rho, kind, a, at_start, segments)
            if need - CLOSE <= length < best - CLOSE:
                best = length
                path[KIND], path[T], path[P], path[Q] = segments[3], segments[0], segments[1], segments[2]
                path[FIRST], path[LAST] = (angle, 0.0) if at_start else (0.0, angle)
                path[TURNS] = 0.0
                if best <= need + CLOSE:
                    return best
            low, f_low = high, f_high
    return best


@nb.njit(cache=True, nogil=True, error_model="numpy")
def shortest_climb(
    x0: float, y0: float, z0: float, theta0: float, x1: float, y1: float, z1: float, theta1: float,
    rho: float, climb_max: float, descent_max: float, path: FloatArray,
) -> int:  # fmt: skip
    """Path between two poses with climb; returns which case it is.

    ``path`` (SIZE,) receives: the word's number and its segments in radii; the angles of the arcs before
    and after it, left positive; whole helix turns before it and their radius [m]; planar length and
    rise [m].
    """
    segments = np.empty(3)
    kind = shortest(x0, y0, theta0, x1, y1, theta1, rho, segments)
    flat, rise = segments[0] + segments[1] + segments[2], z1 - z0
    path[:] = 0.0
    path[KIND], path[T], path[P], path[Q] = kind, segments[0], segments[1], segments[2]
    path[RADIUS], path[RISE] = rho, rise
    need = abs(rise) / math.tan(climb_max if rise > 0.0 else descent_max) / rho
    if need <= flat + CLOSE:
        path[FLAT] = rho * flat
        return LOW
    whole = math.floor((need - flat) / TWO_PI)
    if whole >= 1.0:
        path[TURNS], path[RADIUS] = whole, rho * (need - flat) / (TWO_PI * whole)
        path[FLAT] = rho * need
        return HIGH
    path[TURNS] = 1.0
    path[FLAT] = rho * lengthened(x0, y0, theta0, x1, y1, theta1, rho, need, flat + TWO_PI, path)
    return MEDIUM


@nb.njit(cache=True, nogil=True)
def climb_length(path: FloatArray) -> float:
    """Length of a path in space [m]."""
    return math.sqrt(path[FLAT] ** 2 + path[RISE] ** 2)


@nb.njit(cache=True, nogil=True)
def climb_angle(path: FloatArray) -> float:
    """Climb angle all along a path [rad]; 0 where there is no path to speak of."""
    return math.atan2(path[RISE], path[FLAT]) if path[FLAT] > 1e-6 else 0.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def climb_distance(
    x0: float, y0: float, z0: float, theta0: float, x1: float, y1: float, z1: float, theta1: float,
    rho: float, climb_max: float, descent_max: float,
) -> float:  # fmt: skip
    """Length of the path between two poses with climb [m]."""
    path = np.empty(SIZE)
    shortest_climb(x0, y0, z0, theta0, x1, y1, z1, theta1, rho, climb_max, descent_max, path)
    return climb_length(path)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def sample_climb(
    x0: float, y0: float, z0: float, theta0: float, path: FloatArray, rho: float, s: float, pose: FloatArray
) -> None:
    """Pose (x, y, z, theta, phi) after ``s`` metres of a path in space, into ``pose`` (5,)."""
    length = climb_length(path)
    share = min(1.0, s / length) if length > 0.0 else 1.0
    left = share * path[FLAT]
    kind = int(path[KIND])
    x, y, theta = x0, y0, theta0
    helix = TWO_PI * path[RADIUS] * path[TURNS]
    if left < helix:
        x, y, theta = turned(x, y, theta, turn_of(kind, 0) * left / path[RADIUS], path[RADIUS], True)
        left = 0.0
    else:
        left -= helix
        theta += turn_of(kind, 0) * TWO_PI * path[TURNS]  # samples turn on, they do not jump back
        arc = min(left, rho * abs(path[FIRST]))
        x, y, theta = turned(x, y, theta, math.copysign(arc / rho, path[FIRST]), rho, True)
        left -= arc
        middle = min(left, rho * (path[T] + path[P] + path[Q]))
        flat = np.empty(3)
        sample(x, y, theta, kind, path[T : Q + 1], rho, middle, flat)
        left -= middle
        x, y, theta = flat[0], flat[1], flat[2]
        if left > 0.0:
            x, y, theta = turned(x, y, theta, math.copysign(left / rho, path[LAST]), rho, True)
    pose[0], pose[1], pose[2], pose[3] = x, y, z0 + share * path[RISE], theta
    pose[4] = climb_angle(path)
