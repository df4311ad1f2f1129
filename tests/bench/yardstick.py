"""How fast this computer is: a fixed piece of work like the planner's, timed.

Stored beside a baseline, it tells a slower program from a slower computer.
"""

import math
import time

import numba as nb
import numpy as np

ROUNDS = 9
POINTS, STEPS = 20_000, 20


@nb.njit
def walk(points, order):
    """Distances and angles along a random order of points: memory, square roots and sines."""
    total = 0.0
    for _ in range(STEPS):
        for k in range(order.shape[0] - 1):
            p, q = points[order[k]], points[order[k + 1]]
            dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
            away = math.sqrt(dx * dx + dy * dy + dz * dz)
            if away > 0.5:
                total += math.sin(away) * math.exp(-away)
            else:
                total -= math.atan2(dy, dx)
    return total


def yardstick_s():
    """The least of several times for the same work [s]."""
    rng = np.random.default_rng(1)
    points, order = rng.random((POINTS, 3)), rng.permutation(POINTS)
    walk(points, order)
    best = math.inf
    for _ in range(ROUNDS):
        began = time.perf_counter()
        walk(points, order)
        np.linalg.norm(points - points[order], axis=1).sort()
        best = min(best, time.perf_counter() - began)
    return best
