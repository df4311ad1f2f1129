"""Scratch arrays that a plan makes once, so that nothing is allocated where a tree grows.

A kernel writes intermediate results into them. Nothing is kept from one call to the next, apart from
``stats``, which counts, and results that a docstring mentions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from companion.kernels.arrays import Float1D, Float2D, FloatArray, Int1D, ThreatModel, Threats
from companion.kernels.native.struct import Struct

MAX_THREATS = 32  # Most threats that can act on one point.
MAX_NEAR = 16  # A query of the reachability estimator returns at most this many nodes.
MAX_K = 64  # A query of the search returns at most this many nodes.
PATH_PICKS = 4  # RRT* joins each new node with its k nearest, and with this many waypoints of the path.
MAX_STRAIGHT = 64  # A greedy connection to the sub goal has at most this many steps.
MAX_ROWS = 128  # One Dubins edge has at most this many rows.
MAX_PATH = 4096  # A path has at most this many nodes.


class KNearest(Struct):
    """The answer to a query for near nodes, nearest first.

    ``squares`` (K,) squared distances [m²]; ``rows`` (≥ K,) the nodes.
    """

    squares: Float1D
    rows: Int1D


class PathRows(Struct):
    """A path as rows: ``states`` (N, 6) x y z theta phi v, ``times`` (N,) of arrival [s], and for each row
    but the first ``rates`` (N, 2), the turn rate w and climb rate wp of the edge that ends there [rad/s].
    """  # noqa: D205

    states: Float2D
    times: Float1D
    rates: Float2D


class ThreatScratch(Struct):
    """``pairs`` (MAX_THREATS, 2) μ and ν of each threat felt; ``course`` (3,) the velocity's unit vector."""

    pairs: Float2D
    course: Float1D


class ThreatScene(NamedTuple):
    """The threats at one time, in the threat model's form.

    ``threats`` the static ones; ``points`` (D, 4) where each DT is taken to be [m] and 1 where that
    counts; ``reach`` (D,) the DTs' RD_max [m]; ``model`` the A-IFS parameters; ``scratch`` for both.
    """

    threats: Threats
    points: Float2D
    reach: Float1D
    model: ThreatModel
    scratch: ThreatScratch


class FilterScratch(Struct):
    """Matrices of one LQG-MP step.

    ``motion`` (6, 6) A, then A + B·L; ``control`` (6, 3) B; ``gain`` (3, 6) L; ``product`` (6, 6);
    ``taken`` (6, 5) what a measurement takes out of P; ``factor`` (5, 5) of the innovation's covariance.
    """

    motion: Float2D
    control: Float2D
    gain: Float2D
    product: Float2D
    taken: Float2D
    factor: Float2D


class ReachScratch(Struct):
    """Scratch of the reachability estimator.

    ``near``, ``targets`` nodes found; ``spot`` (6,) q_B and the DT's nearest position [m]; ``sample`` (3,)
    [m]; ``changed`` (4·MAX_NEAR,) nodes whose DT position is news; ``everything`` (0,) stands for "all
    nodes are searched".
    """

    near: KNearest
    targets: KNearest
    spot: Float1D
    sample: Float1D
    changed: Int1D
    everything: Int1D


class Step(Struct):
    """One step of the aircraft: ``control`` (3,) a, w, wp and ``state`` (6,) at its end."""

    control: Float1D
    state: Float1D


class Straight(Struct):
    """Steps of a greedy connection: ``states`` (MAX_STRAIGHT, 6) and ``controls`` (MAX_STRAIGHT, 3)."""

    states: Float2D
    controls: Float2D
    threat: ThreatScratch


class GrowthScratch(Struct):
    """Scratch of a new node.

    ``factor`` (3, 3) Cholesky factor of its position covariance [m]; ``levels`` (M,) TI of each particle;
    ``threat``, ``lqg`` and ``reach`` of those kernels.
    """

    factor: Float2D
    levels: Float1D
    threat: ThreatScratch
    lqg: FilterScratch
    reach: ReachScratch


class EdgeScratch(Struct):
    """A Dubins edge between two nodes: its ``rows``, and ``segments`` (3,) of a Dubins word."""

    rows: PathRows
    segments: Float1D
    threat: ThreatScratch


class Walk(Struct):
    """A walk down the tree: ``stack``, ``felt``, ``turns`` (N,) and ``lengths`` (N,) [m]."""

    stack: Int1D
    felt: Int1D
    turns: Int1D
    lengths: Float1D


class Workspace(Struct):
    """Scratch of one plan's search.

    In parts, each for the kernels that need it: numba hands over a tuple array by array, so that a kernel
    which is called for every near node takes its part alone.

    ``sample`` (3,) q_s [m]; ``near`` of the search; ``points`` (D, 4) DTs' positions [m]; ``path``
    (MAX_PATH,) nodes from the goal back. ``stats`` (4,) counts collision checks, samples dropped by TUDD,
    failed extensions and iterations.
    """

    sample: Float1D
    step: Step
    near: KNearest
    straight: Straight
    growth: GrowthScratch
    edge: EdgeScratch
    walk: Walk
    points: Float2D
    path: Int1D
    stats: Int1D


def empty_nearest(capacity: int) -> KNearest:
    """Return room for the answer of a query for up to ``capacity`` nodes."""
    return KNearest(np.empty(capacity), np.empty(capacity, dtype=np.int64))


def empty_rows(capacity: int) -> PathRows:
    """Return room for a path of ``capacity`` rows."""
    return PathRows(np.empty((capacity, 6)), np.empty(capacity), np.empty((capacity, 2)))


def threat_scene(threats: Threats, points: FloatArray, reach: FloatArray, model: ThreatModel) -> ThreatScene:
    """Return the threats; ``points`` (D, 4) and ``reach`` (D,) are those of :class:`ThreatScene` [m]."""
    return ThreatScene(threats, points, reach, model, threat_scratch())


def threat_scratch() -> ThreatScratch:
    """Return the scratch of the threat model."""
    return ThreatScratch(np.empty((MAX_THREATS, 2)), np.empty(3))


def filter_scratch() -> FilterScratch:
    """Return the matrices of one LQG-MP step."""
    empty = np.empty
    return FilterScratch(
        motion=empty((6, 6)),
        control=empty((6, 3)),
        gain=empty((3, 6)),
        product=empty((6, 6)),
        taken=empty((6, 5)),
        factor=empty((5, 5)),
    )


def reach_scratch() -> ReachScratch:
    """Return the scratch of the reachability estimator."""
    return ReachScratch(
        near=empty_nearest(MAX_NEAR),
        targets=empty_nearest(MAX_NEAR),
        spot=np.empty(6),
        sample=np.empty(3),
        changed=np.empty(4 * MAX_NEAR, dtype=np.int64),
        everything=np.empty(0, dtype=np.int64),
    )


def workspace(capacity: int, num_threats: int, num_particles: int) -> Workspace:
    """Return the scratch for a tree of ``capacity`` nodes, a number of DTs, and particles about a node."""
    empty, threat = np.empty, threat_scratch()
    return Workspace(
        sample=empty(3),
        step=Step(empty(3), empty(6)),
        near=KNearest(empty(MAX_K), empty(MAX_K + 2 * PATH_PICKS, dtype=np.int64)),
        straight=Straight(empty((MAX_STRAIGHT, 6)), empty((MAX_STRAIGHT, 3)), threat),
        growth=GrowthScratch(empty((3, 3)), empty(num_particles), threat, filter_scratch(), reach_scratch()),
        edge=EdgeScratch(empty_rows(MAX_ROWS), empty(3), threat),
        walk=Walk(
            stack=empty(capacity, dtype=np.int64),
            felt=empty(capacity, dtype=np.int64),
            turns=empty(capacity, dtype=np.int64),
            lengths=empty(capacity),
        ),
        points=np.zeros((max(num_threats, 1), 4)),
        path=empty(MAX_PATH, dtype=np.int64),
        stats=np.zeros(4, dtype=np.int64),
    )
