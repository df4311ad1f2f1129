"""The way round obstacles to a sub goal, and samples that follow it.

GoalZoom (paper 4.4.1) samples the ball about the sub goal that the tree has not entered yet. Behind a
wall that ball is the wrong place: what counts there is the way round. Here the way is a wave on a grid,
and a share of the samples lies a little ahead, along it, of nodes that are far on.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from companion.kernels.arrays import FloatArray, Guide, Limits, Obstacles, Tree
from companion.kernels.geometry.prism_distance import clearance, clearance_bound

BoolArray = NDArray[np.bool_]
FIRST_PICK = 8  # column of the draws from which nodes are picked
PICKS = 8  # nodes compared: the one farthest on is followed
SPREAD = 0.5  # radius of the disc a sample is drawn from, of the way it lies ahead


@nb.njit(cache=True, nogil=True)
def spread_wave(
    x: float, y: float, z: float, radius: float, margin: float, bounds: FloatArray, obstacles: Obstacles,
    origin: FloatArray, cell: float, wave: FloatArray,
) -> None:  # fmt: skip
    """Way from (x, y) round obstacles at height z to every cell of a grid, in place [m].

    ``wave`` (N, M) has its first cell's centre at ``origin`` (2,). Cells beyond ``radius`` from the point
    or outside ``bounds``, or nearer than ``margin`` to an obstacle, stay infinite; the point's own cell
    is free in any case. Sweeps there and back until nothing changes (Zhao, "A fast sweeping method for
    Eikonal equations", 2005, on the 8-neighbour graph).
    """
    free = np.zeros(wave.shape, dtype=np.bool_)
    for i in range(wave.shape[0]):
        for j in range(wave.shape[1]):
            cx, cy = origin[0] + i * cell, origin[1] + j * cell
            inside = (cx - x) ** 2 + (cy - y) ** 2 <= (radius + cell) ** 2
            if inside and bounds[0] <= cx <= bounds[1] and bounds[2] <= cy <= bounds[3]:
                free[i, j] = (
                    clearance_bound(cx, cy, z, obstacles) >= margin
                    or clearance(cx, cy, z, obstacles, margin + 1.0) >= margin
                )
    wave[:] = np.inf
    i, j = int(round((x - origin[0]) / cell)), int(round((y - origin[1]) / cell))
    if i < 0 or j < 0 or i >= wave.shape[0] or j >= wave.shape[1]:
        return
    wave[i, j], free[i, j] = 0.0, True
    while _sweep(wave, free, cell, 1) | _sweep(wave, free, cell, -1):
        pass


@nb.njit(cache=True, nogil=True)
def _sweep(wave: FloatArray, free: BoolArray, cell: float, step: int) -> bool:
    """One sweep over all rows, each crossed both ways; whether anything changed."""
    rows, n = wave.shape
    aslant = cell * math.sqrt(2.0)
    changed = False
    for a in range(rows):
        i = a if step > 0 else rows - 1 - a
        behind = i - step
        for turn in range(2):
            for b in range(n):
                j = b if turn == 0 else n - 1 - b
                if not free[i, j]:
                    continue
                best = wave[i, j]
                if 0 <= behind < rows:
                    best = min(best, wave[behind, j] + cell)
                    if j > 0:
                        best = min(best, wave[behind, j - 1] + aslant)
                    if j < n - 1:
                        best = min(best, wave[behind, j + 1] + aslant)
                beside = j - 1 if turn == 0 else j + 1
                if 0 <= beside < n:
                    best = min(best, wave[i, beside] + cell)
                if best < wave[i, j] - 1e-9:
                    wave[i, j] = best
                    changed = True
    return changed


@nb.njit(cache=True, nogil=True)
def way_at(guide: Guide, x: float, y: float) -> float:
    """Way from a point round obstacles to the sub goal [m]; infinite outside the grid."""
    i = int(round((x - guide.origin[0]) / guide.cell))
    j = int(round((y - guide.origin[1]) / guide.cell))
    if i < 0 or j < 0 or i >= guide.wave.shape[0] or j >= guide.wave.shape[1]:
        return math.inf
    return float(guide.wave[i, j])


@nb.njit(cache=True, nogil=True)
def draw_on_the_way(
    draws: FloatArray, tree: Tree, guide: Guide, sub_goal: FloatArray, limits: Limits, q_s: FloatArray
) -> bool:
    """A sample ahead of a node that is far on, into ``q_s`` (3,); False where no node has a way.

    Of ``PICKS`` nodes drawn from the tree, the one with the shortest way is followed, up to
    ``guide.ahead`` metres along its way, and the sample is uniform in a disc there. Its height lies
    between the node's and the sub goal's, within what can be climbed.
    """
    best, node = math.inf, -1
    for t in range(PICKS):
        i = int(draws[FIRST_PICK + t] * tree.count[0])
        if tree.active[i] == 1 and tree.way[i] < best:
            best, node = tree.way[i], i
    if node < 0:
        return False
    x, y, z = tree.state[node, 0], tree.state[node, 1], tree.state[node, 2]
    wave = guide.wave
    i, j = int(round((x - guide.origin[0]) / guide.cell)), int(round((y - guide.origin[1]) / guide.cell))
    wanted = best - min(best, draws[1] * guide.ahead)
    while wave[i, j] > wanted:
        u, w = i, j
        for a in range(max(0, i - 1), min(wave.shape[0], i + 2)):
            for b in range(max(0, j - 1), min(wave.shape[1], j + 2)):
                if wave[a, b] < wave[u, w]:
                    u, w = a, b
        i, j = u, w
    gone = best - wave[i, j]
    spread, angle = SPREAD * gone * math.sqrt(draws[2]), 2.0 * math.pi * draws[3]
    box = limits.bounds
    q_s[0] = min(box[1], max(box[0], guide.origin[0] + i * guide.cell + spread * math.cos(angle)))
    q_s[1] = min(box[3], max(box[2], guide.origin[1] + j * guide.cell + spread * math.sin(angle)))
    q_s[2] = sub_goal[2]
    if limits.dimension == 3:
        aside = (2.0 * draws[7] - 1.0) * SPREAD * gone * math.tan(limits.climb_max)
        level = z + (sub_goal[2] - z) * gone / max(best, 1.0)
        q_s[2] = min(box[5], max(box[4], level + aside))
    return True
