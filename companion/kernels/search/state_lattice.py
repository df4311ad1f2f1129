"""A race against the DTs on a lattice of poses: the earliest way to a goal that they cannot bar.

Where the game of paper 2.3 leaves one narrow way in time, a tree of random samples seldom comes through: its
branches meander, and whoever comes late is caught. Here the aircraft's own steps are searched by A*, one
pose a cell of place, direction and turn; since every place is safe until a moment, the earliest arrival in a
cell is the best. In the plane only.

References
----------
Dolgov, Thrun, Montemerlo, Diebel, "Path planning for autonomous vehicles in unknown semi-structured
environments", IJRR 29(5), 2010 (hybrid A*).
"""

from __future__ import annotations

import math

import numpy as np

from companion.kernels.aircraft.motion import OK, advance, slowness, state_status, straight_after, turn_radius
from companion.kernels.arrays import Float1D, Float2D, Guide, Int1D, Limits, Scene, Tree
from companion.kernels.geometry.distance_field import distance_to_go
from companion.kernels.native.kernel import inlined, kernel
from companion.kernels.native.struct import Struct
from companion.kernels.search.costs import threats_at
from companion.kernels.search.growth import AVOID, is_edge_clear, room_cost
from companion.kernels.threat.fuzzy_threat import point_threat
from companion.kernels.threat.pursuit_game import is_caught, pop_least, push
from companion.kernels.threat.reachability import passes_by
from companion.kernels.threat.threat_tree import FLIES_ON
from companion.kernels.workspace import PathRows, Workspace

CELLS = 300  # along the longer side of the bounds, of at least a step each
DIRECTIONS, TURN_STATES = 16, 3
STRAIGHT_STEPS = 2  # of a piece between which a turn may begin
CAPACITY = 200_000  # poses looked at
UNFINISHED = -1


class Poses(Struct):
    """What the search has come to, a row each.

    ``state`` (P, 6); ``parent`` (P,); ``time`` (P,) [s]; ``due`` (P,) by how much later a way as dear by (9)
    without threats would be here [s]; ``turn``, ``straight`` and ``rate`` (P,) as in
    :class:`~companion.kernels.arrays.Tree`; ``caught`` (P,) 1 where a DT could threaten it, as one that the
    aircraft begins in.
    """

    state: Float2D
    parent: Int1D
    time: Float1D
    due: Float1D
    turn: Int1D
    straight: Float1D
    rate: Float1D
    caught: Int1D


class Race(Struct):
    """A race as far as it has come.

    ``poses`` looked at; ``keys`` and ``waiting`` (P,) the heap of those that may be gone on from; ``best``
    (C,) the earliest that a cell was come to, ``due`` counted [s], minus infinity once it was gone on from, 0
    where it was not come to; ``sizes`` (2,) of the poses and of the heap.
    """

    poses: Poses
    keys: Float1D
    waiting: Int1D
    best: Float1D
    sizes: Int1D


@kernel
def num_cells(limits: Limits) -> int:
    """How many cells of place, direction and turn there are within the bounds."""
    b, (cell, across) = limits.bounds, _grid(limits)
    return (int((b[1] - b[0]) / cell) + 1) * across * DIRECTIONS * TURN_STATES


def race_from(tree: Tree, i: int, best: Float1D) -> Race:
    """A race that begins at node ``i``; ``best`` (C,) zeros, one of each of :func:`num_cells`.

    NumPy's zeros cost nothing where they are not looked at: a race that is soon won looks at few of millions.
    """
    poses = Poses(
        np.empty((CAPACITY, 6)),
        np.empty(CAPACITY, dtype=np.int64),
        np.empty(CAPACITY),
        np.empty(CAPACITY),
        np.empty(CAPACITY, dtype=np.int64),
        np.empty(CAPACITY),
        np.empty(CAPACITY),
        np.empty(CAPACITY, dtype=np.int64),
    )
    poses.state[0], poses.time[0], poses.caught[0] = tree.state[i], tree.time[i], tree.caught[i]
    poses.turn[0], poses.straight[0] = tree.turn[i], tree.straight[i]
    poses.parent[0], poses.due[0], poses.rate[0] = -1, 0.0, 0.0
    keys, waiting = np.empty(CAPACITY + 1), np.empty(CAPACITY + 1, dtype=np.int64)
    keys[0], waiting[0] = poses.time[0], 0
    sizes = np.ones(2, dtype=np.int64)
    return Race(poses, keys, waiting, best, sizes)


@kernel
def race(
    field: Race, goal: Float1D, radius: float, home: Guide, scene: Scene, rows: PathRows, most: int,
    work: Workspace,
) -> int:  # fmt: skip
    """Steps to within ``radius`` of a goal, none of which a DT could threaten by then.

    ``goal`` (3,) [m], ``home`` its distance field. After ``most`` poses :data:`UNFINISHED`; else ``rows``
    receives the steps, where the race begins first, and it returns how many there are, 0 where no way was
    found.
    """
    limits, poses, best, sizes = scene.limits, field.poses, field.best, field.sizes
    work.points[:] = 0.0
    cell, across = _grid(limits)
    for _ in range(most):
        if sizes[1] == 0:
            return 0
        at = field.waiting[0]
        sizes[1] = pop_least(field.keys, field.waiting, sizes[1])
        place = _cell_of(poses.state[at], poses.turn[at], limits.bounds, cell, across)
        if poses.time[at] + poses.due[at] > _earliest(best, place):
            continue
        best[place] = -math.inf
        if sizes[0] + int(limits.straight_min) >= CAPACITY:
            return 0
        for way in range(-1, 2):
            first = sizes[0]
            last = _fly_on(poses, first, at, way, goal, radius, home, limits)
            if last < first:
                continue
            there = _cell_of(poses.state[last], poses.turn[last], limits.bounds, cell, across)
            is_goal = math.hypot(poses.state[last, 0] - goal[0], poses.state[last, 1] - goal[1]) <= radius
            if not is_goal and best[there] == -math.inf:
                continue
            if not _is_judged_fit(poses, first, last, scene, work):
                continue
            if is_goal:
                return _steps_to(last, poses, rows)
            gone = poses.time[last] + poses.due[last]
            if gone >= _earliest(best, there):
                continue
            best[there] = gone
            left = distance_to_go(home, poses.state[last, 0], poses.state[last, 1]) / limits.v_cruise
            sizes[0] = last + 1
            sizes[1] = push(field.keys, field.waiting, sizes[1], gone + left, last)
    return UNFINISHED


@inlined
def _earliest(best: Float1D, place: int) -> float:
    """When cell ``place`` was come to at the earliest; infinite where it was not. ``best`` (C,) [s]."""
    return math.inf if best[place] == 0.0 else best[place]


@kernel
def _grid(limits: Limits) -> tuple[float, int]:
    """Size of a cell of place [m], and how many there are from south to north."""
    b = limits.bounds
    cell = max(limits.v_cruise * limits.tau, max(b[1] - b[0], b[3] - b[2]) / CELLS)
    return cell, int((b[3] - b[2]) / cell) + 1


@kernel
def _fly_on(
    poses: Poses, first: int, at: int, way: int, goal: Float1D, radius: float, home: Guide, limits: Limits
) -> int:
    """Steps from pose ``at``: a turn's to the left (1) or right (-1), or as many straight ones as have to be.

    They become poses from ``first`` on, of which only where and how they are flown is known. The last of
    them; less than ``first`` where they cannot be flown to their end. They end at once within ``radius`` of
    ``goal`` (3,) [m].
    """
    tau = limits.tau
    is_straight = poses.straight[at] >= limits.straight_min - 1e-6
    if way != 0 and poses.turn[at] != way and (poses.turn[at] != 0 or not is_straight):
        return -1
    before = at
    for n in range(first, first + _steps(poses, at, way, limits)):
        here, out = poses.state[before], poses.state[n]
        a = min(limits.a_max, max(-limits.a_max, (limits.v_cruise - here[5]) / tau))
        slow, fast = min(here[5], here[5] + a * tau), max(here[5], here[5] + a * tau)
        w = way * slow / turn_radius(fast, limits)
        advance(here, a, w, 0.0, tau, out)
        if state_status(out, limits) != OK or distance_to_go(home, out[0], out[1]) == math.inf:
            return -1
        poses.parent[n], poses.rate[n] = before, w
        poses.turn[n], poses.straight[n] = straight_after(
            poses.turn[before], poses.straight[before], w, tau * 0.5 * (out[5] + here[5])
        )
        before = n
        if math.hypot(out[0] - goal[0], out[1] - goal[1]) <= radius:
            break
    return before


@kernel
def _is_judged_fit(poses: Poses, first: int, last: int, scene: Scene, work: Workspace) -> bool:
    """Whether poses ``first`` to ``last`` keep clear of all; when they are passed, and what they cost."""
    limits, tau, is_avoided = scene.limits, scene.limits.tau, scene.search.pursuit == AVOID
    per_second = scene.search.cost_distance * limits.v_cruise / scene.search.unit
    for n in range(first, last + 1):
        before = poses.parent[n]
        here, out = poses.state[before], poses.state[n]
        work.stats[0] += 1
        if not is_edge_clear(here, out, poses.rate[n], scene.obstacles, limits):
            return False
        taken = tau * slowness(here, out, limits)
        time = poses.time[before] + taken
        caught = 1 if is_caught(scene.game, out[0], out[1], out[2], time) else 0
        if is_avoided and caught > poses.caught[before]:
            return False
        level = level_at(out, time, scene, work)
        if level > scene.search.level_max:
            return False
        dear = scene.search.cost_threat * level
        if not is_avoided:
            dear += scene.search.cost_caught * caught * taken + room_cost(scene, out)
        poses.due[n] = poses.due[before] + dear / per_second
        poses.time[n], poses.caught[n] = time, caught
    return True


@kernel
def level_at(out: Float1D, time: float, scene: Scene, work: Workspace) -> float:
    """Threat level of radars, and of aircraft that fly on, to the state ``out`` (6,).

    Those that hunt are kept away from anyhow.
    """
    trees = scene.pursuers
    for d in range(scene.pursuers.count.shape[0]):
        if scene.pursuers.model[d, 3] == FLIES_ON:
            passes_by(trees, d, out[0], out[1], out[2], time, work.points)
    threats = threats_at(scene, work.points, work.growth.threat)
    mu, nu = point_threat(out[0], out[1], out[2], out[3], out[4], out[5], 0.0, threats)
    return max(mu - nu, 0.0)


@kernel
def _steps(poses: Poses, at: int, way: int, limits: Limits) -> int:
    """How many steps are flown at once: no turn begins sooner than ``straight_min`` after another."""
    if way != 0:
        return 1
    flown = 0.0 if poses.turn[at] != 0 else poses.straight[at]
    left = limits.straight_min - flown
    return max(STRAIGHT_STEPS, int(math.ceil(left / (poses.state[at, 5] * limits.tau) - 1e-6)))


@kernel
def _cell_of(state: Float1D, turn: int, b: Float1D, cell: float, across: int) -> int:
    """Number of the cell of place, direction and turn in which ``state`` (6,) lies; ``b`` (6,) bounds [m]."""
    i, j = int((state[0] - b[0]) / cell), int((state[1] - b[2]) / cell)
    k = int(math.floor((state[3] / (2.0 * math.pi) + 1.0) * DIRECTIONS)) % DIRECTIONS
    return ((i * across + j) * DIRECTIONS + k) * TURN_STATES + turn + 1


@kernel
def _steps_to(last: int, poses: Poses, rows: PathRows) -> int:
    """Copy the steps to a pose, the first one first; how many rows, 0 where there is no room for them."""
    n, at = 0, last
    while at >= 0:
        n += 1
        at = poses.parent[at]
    if n > rows.times.shape[0]:
        return 0
    at = last
    for k in range(n - 1, -1, -1):
        rows.states[k], rows.times[k] = poses.state[at], poses.time[at]
        rows.rates[k, 0], rows.rates[k, 1] = poses.rate[at], 0.0
        at = poses.parent[at]
    return n
