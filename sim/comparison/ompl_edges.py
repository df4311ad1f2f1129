"""Edges between two poses for other planners: whether an edge can be flown, and its cost by (9).

An edge is the shortest Dubins path, its height growing evenly along it, in steps of at most what is flown
in τ. One call of compiled code judges it whole.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from companion.frames import FloatArray
from companion.kernels.aircraft.dubins import sample, shortest, turn_of
from companion.kernels.arrays import Float1D, Limits, Scene
from companion.kernels.native.kernel import kernel
from companion.kernels.native.struct import Struct
from companion.kernels.search.path_edit import is_clear, path_cost
from companion.kernels.workspace import PathRows, Workspace
from companion.planning.explore import Exploration

Pose = tuple[float, float, float, float]  # east, north, up [m], direction [rad]

ROWS_MAX = 2_000


class EdgeWorld(Struct):
    """The data by which edges are judged.

    ``rows`` receive an edge, ``segments`` (3,) are used up; ``delta`` is δ_q.
    """

    limits: Limits
    scene: Scene
    rows: PathRows
    work: Workspace
    segments: Float1D
    delta: float


@kernel
def lay(world: EdgeWorld, a: Pose, b: Pose) -> int:
    """Write an edge into the world's rows; return their number, 0 if it is too steep or too long."""
    limits, segments, rows = world.limits, world.segments, world.rows
    kind = shortest(a[0], a[1], a[3], b[0], b[1], b[3], limits.r_min, segments)
    length = limits.r_min * (segments[0] + segments[1] + segments[2])
    rise = b[2] - a[2]
    climb = math.atan2(rise, length) if rise != 0.0 else 0.0
    n = max(1, int(math.ceil(length / (limits.v_cruise * limits.tau) - 1e-9)))  # noqa: RUF046 - numba's is no int
    if climb > limits.climb_max or climb < -limits.descent_max or n >= ROWS_MAX:
        return 0
    at = rows.states[0]
    at[0], at[1], at[2], at[3], at[4], at[5] = a[0], a[1], a[2], a[3], climb, limits.v_cruise
    step = length / n
    for k in range(1, n + 1):
        at = rows.states[k]
        sample(a[0], a[1], a[3], kind, segments, limits.r_min, step * k, at[:3])
        at[3], at[4], at[5] = at[2], climb, limits.v_cruise
        at[2] = a[2] + rise * k / n
        middle, passed, turn = step * (k - 0.5) / limits.r_min, 0.0, 0.0
        for segment in range(3):
            if passed <= middle:
                turn = turn_of(kind, segment)
            passed += segments[segment]
        rows.rates[k, 0] = turn * limits.v_cruise / limits.r_min
        rows.times[k] = rows.times[k - 1] + step / limits.v_cruise
    return n + 1


@kernel
def is_free(world: EdgeWorld, a: Pose, b: Pose) -> bool:
    """Return whether an edge is within the limits and bounds, and keeps the margin from obstacles."""
    n = lay(world, a, b)
    rows, box = world.rows, world.limits.bounds
    for k in range(n):
        for axis in range(3):
            if rows.states[k, axis] < box[2 * axis] or rows.states[k, axis] > box[2 * axis + 1]:
                return False
    return n > 0 and is_clear(rows, 1, n, world.scene.obstacles, world.limits)


@kernel
def cost(world: EdgeWorld, a: Pose, b: Pose) -> float:
    """Cost of an edge by (9); infinite where it cannot be flown."""
    n = lay(world, a, b)
    return path_cost(world.rows, 1, n, world.delta, world.scene, world.work) if n > 0 else math.inf


class Edges:
    """Judges edges in the world of one search.

    Parameters
    ----------
    exploration : Exploration
        Exploration whose world, limits and weights are used; it is not searched.

    Attributes
    ----------
    weight : float
        Cost of a metre by (9).
    """

    def __init__(self, exploration: Exploration) -> None:
        problem = exploration.problem
        self.weight = problem.settings.weights_cost[0] / problem.snapshot.unit_m
        self._speed = exploration.limits.v_cruise
        self._rows = PathRows(np.zeros((ROWS_MAX, 6)), np.zeros(ROWS_MAX), np.zeros((ROWS_MAX, 2)))
        self._world = EdgeWorld(
            exploration.limits, exploration.scene(), self._rows, exploration.work, np.empty(3),
            float(exploration.tree.delta[0]),
        )  # fmt: skip

    def is_free(self, first: Pose, second: Pose) -> bool:
        """Return whether an edge is within the limits and bounds, and keeps the margin from obstacles."""
        return is_free(self._world, first, second)

    def cost(self, first: Pose, second: Pose) -> float:
        """Cost by (9); infinite where the edge cannot be flown, or threat levels are above the limit."""
        return cost(self._world, first, second)

    def states_along(self, poses: list[Pose]) -> FloatArray:
        """States a step apart along edges, shape (N, 6), as the planner's rows.

        Parameters
        ----------
        poses : list of Pose
            Poses at which the edges meet.
        """
        laid = [np.array([[*poses[0], 0.0, self._speed]])]
        for a, b in itertools.pairwise(poses):
            n = lay(self._world, a, b)
            laid.append(self._rows.states[1:n].copy())
        return np.concatenate(laid)
