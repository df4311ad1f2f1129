"""The uncertainty (LQG-MP) and the threat levels along a path of rows."""

from __future__ import annotations

import math

import numpy as np

from companion.kernels.aircraft.lqg_mp import collision_free, position_deviation, position_factor, propagate
from companion.kernels.arrays import Float1D, Float2D, Float3D, FloatArray, Scene, Threats
from companion.kernels.geometry.prism_distance import clearance
from companion.kernels.geometry.radar_shadow import is_hidden
from companion.kernels.native.kernel import kernel
from companion.kernels.native.struct import Struct
from companion.kernels.printed.reachability import dt_positions
from companion.kernels.search.costs import threats_at
from companion.kernels.search.growth import FAR
from companion.kernels.search.path_edit import air_time
from companion.kernels.threat.fuzzy_threat import membership, node_threat
from companion.kernels.workspace import PathRows, Workspace


class RowAssessment(Struct):
    """The uncertainty and the threats at each row of a path.

    ``errors``, ``estimates`` (N, 6, 6) P and Λ; ``clear``, ``levels`` (N,) p_c and TI; ``particle_levels``
    (N, M) TI of each particle; ``points`` (N, D, 4) the DTs' nearest positions when the row is passed [m],
    and 1 where one is known.
    """

    errors: Float3D
    estimates: Float3D
    clear: Float1D
    levels: Float1D
    particle_levels: Float2D
    points: Float3D


@kernel
def assess_rows(
    rows: PathRows, first: int, n: int, scene: Scene, out: RowAssessment, work: Workspace
) -> None:
    """P, Λ, p_c and TI of rows ``first`` to ``n - 1``, in place.

    P and Λ are given up to row ``first - 1``, or at row 0 where ``first`` is 0.
    """
    dimension, search, factor = scene.limits.dimension, scene.search, work.growth.factor
    states, times, rates, errors, estimates = rows.states, rows.times, rows.rates, out.errors, out.estimates
    for k in range(first, n):
        if k > 0:
            dt = air_time(rows, k, scene.limits)
            control = ((states[k, 5] - states[k - 1, 5]) / dt, rates[k, 0], rates[k, 1])
            propagate(
                states[k - 1], control, dt, scene.tables, errors[k - 1], estimates[k - 1], errors[k],
                estimates[k], work.growth.lqg,
            )  # fmt: skip
        x, y, z = states[k, 0], states[k, 1], states[k, 2]
        deviation = position_deviation(errors[k], estimates[k], dimension)
        out.clear[k] = collision_free(clearance(x, y, z, scene.obstacles, FAR), deviation, dimension)
        dt_positions(
            scene.pursuers, x, y, z, times[k], search.k_pursuer, scene.walls, out.points[k], work.growth.reach
        )
        if search.use_uncertainty == 1:
            position_factor(errors[k], estimates[k], dimension, factor)
        else:
            factor[:] = 0.0
        out.levels[k] = node_threat(
            states[k], factor, deviation / search.unit, scene.tables.normals, out.particle_levels[k],
            threats_at(scene, out.points[k], work.growth.threat),
        )  # fmt: skip


@kernel
def radar_membership(x: float, y: float, z: float, threats: Threats) -> float:
    """Sum of (1) over all radars, known or not, at a point, with masking."""
    total = 0.0
    for i in range(threats.radars.shape[0]):
        if is_hidden(x, y, z, threats.shadows[i], threats.grid):
            continue
        dx, dy, dz = x - threats.radars[i, 0], y - threats.radars[i, 1], z - threats.radars[i, 2]
        flat = math.sqrt(dx * dx + dy * dy)
        total += membership(
            math.sqrt(flat * flat + dz * dz), dz, flat, threats.radars[i, 3], threats.radars[i, 4]
        )
    return total


def radar_memberships(positions: Float2D, inner: int, threats: Threats) -> tuple[FloatArray, FloatArray]:
    """:func:`radar_membership` at ``positions`` (N, 3) [m], and at ``inner`` points between two of them.

    Shapes (N,) and (N - 1, inner).
    """
    n = len(positions)
    rows, between = np.empty(n), np.empty((max(n - 1, 0), inner))
    fill_memberships(positions, threats, rows, between)
    return rows, between


@kernel
def fill_memberships(positions: Float2D, threats: Threats, rows: Float1D, between: Float2D) -> None:
    """:func:`radar_membership` at ``positions`` (N, 3) [m] and between two of them, in place.

    ``rows`` (N,) receives the one, ``between`` (N - 1, M) the other, at M even steps.
    """
    n, inner = between.shape[0] + 1, between.shape[1]
    for k in range(positions.shape[0]):
        p = positions[k]
        rows[k] = radar_membership(p[0], p[1], p[2], threats)
        if k < n - 1:
            q = positions[k + 1]
            dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
            for j in range(inner):
                t = (j + 1.0) / (inner + 1.0)
                between[k, j] = radar_membership(p[0] + t * dx, p[1] + t * dy, p[2] + t * dz, threats)
