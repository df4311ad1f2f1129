"""The RS estimator's trees: one a DT, carried from plan to plan (paper 3.2.2, Fig. 1)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from companion.kernels.arrays import Obstacles, Pursuers, empty_pursuers
from companion.kernels.threat.threat_tree import re_root
from companion.types.threat import ThreatTree, TrackState

STEP_S = 2.0  # driving time of one TTree edge
CAPACITY = 1500
CARRIED_MAX = CAPACITY // 2  # so that every plan has room to grow its own
PATH_CAPACITY = 8192  # of PathTrees whose near nodes are found by cells; of larger ones by looking at all


def threat_trees(
    tracks: Sequence[TrackState], obstacles: Obstacles, plane_up_m: float | None, bounds: tuple[float, ...],
    carried: Sequence[ThreatTree] = (), with_corners: bool = True,
) -> Pursuers:  # fmt: skip
    """TTrees rooted at each DT's estimate, with one child along its predicted motion.

    The estimate's own time is the root's time stamp, not the plan's start: meanwhile the DT may turn
    off its predicted path.

    Parameters
    ----------
    tracks : sequence of TrackState
        Moving threats.
    plane_up_m : float or None
        In the plane: the flight level, at which the DTs are taken to be [m].
    bounds : tuple of float
        East and north, each low and high [m], which DTs do not leave.
    carried : sequence of ThreatTree
        Trees of the plan before: updated by the new estimate where they belong to one of the tracks.
    with_corners : bool
        Whether the shortest ways round the obstacles' corners are part of the trees from the start.
    """
    models = np.array(
        [
            [
                t.speed_max_m_s,
                t.max_threat_radius_m,
                t.turn_radius_m,
                float(t.is_airborne),
                STEP_S * t.speed_max_m_s,
            ]
            for t in tracks
        ],
        dtype=np.float64,
    ).reshape(-1, 5)
    trees = empty_pursuers(CAPACITY, models, np.array(bounds, dtype=np.float64), PATH_CAPACITY)
    before = {(tree.identity, tree.is_airborne): tree for tree in carried}
    for d, track in enumerate(tracks):
        tree = before.get((track.identity, track.is_airborne))
        if tree is not None:
            put_back(trees, d, tree)
        observe(trees, d, track, obstacles, plane_up_m, with_corners)
    return trees


def put_back(trees: Pursuers, d: int, tree: ThreatTree) -> None:
    """Fill tree ``d`` with the earliest nodes of a carried one, at most :data:`CARRIED_MAX`.

    Time stamps grow along every branch, so no node comes without its parent.
    """
    chosen = np.sort(np.argsort(tree.time_s, kind="stable")[:CARRIED_MAX])
    n = len(chosen)
    row = np.full(len(tree.time_s) + 1, -1, dtype=np.int64)  # the last entry stands for the root's parent
    row[chosen] = np.arange(n)
    trees.position[d, :n], trees.heading[d, :n] = tree.position_enu_m[chosen], tree.heading_rad[chosen]
    trees.time[d, :n], trees.parent[d, :n] = tree.time_s[chosen], row[tree.parent[chosen]]
    trees.count[d] = n


def observe(
    trees: Pursuers, d: int, track: TrackState, obstacles: Obstacles, plane_up_m: float | None,
    with_corners: bool = True,
) -> None:  # fmt: skip
    """Re-root tree ``d`` at a new estimate (paper Fig. 1), in place."""
    east, north, up = track.position_enu_m
    east_m_s, north_m_s, _ = track.velocity_enu_m_s
    ahead = min(math.hypot(east_m_s, north_m_s), track.speed_max_m_s) * STEP_S
    root = (float(east), float(north), float(up if plane_up_m is None else plane_up_m))
    heading = math.atan2(north_m_s, east_m_s)
    re_root(trees, d, root, heading, track.stamp_s, ahead, with_corners, obstacles)


def grown_trees(trees: Pursuers, tracks: Sequence[TrackState]) -> tuple[ThreatTree, ...]:
    """Copies of what a plan has grown, for the next one; ``tracks`` are those the trees were made for."""
    return tuple(_grown_tree(trees, d, track) for d, track in enumerate(tracks))


def _grown_tree(trees: Pursuers, d: int, track: TrackState) -> ThreatTree:
    n = int(trees.count[d])
    return ThreatTree(
        identity=track.identity,
        is_airborne=track.is_airborne,
        position_enu_m=trees.position[d, :n].copy(),
        heading_rad=trees.heading[d, :n].copy(),
        parent=trees.parent[d, :n].copy(),
        time_s=trees.time[d, :n].copy(),
    )
