"""The RS estimator's trees: one a DT, carried from plan to plan (paper 3.2.2, Fig. 1)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from companion.kernels.arrays import Obstacles, Pursuers, empty_pursuers
from companion.kernels.printed.threat_tree import FLIES_ON, re_root
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
    models = np.array([_model_of(track) for track in tracks], dtype=np.float64).reshape(-1, 5)
    trees = empty_pursuers(CAPACITY, models, np.array(bounds, dtype=np.float64), PATH_CAPACITY)
    before = {(tree.identity, tree.is_airborne): tree for tree in carried}
    for d, track in enumerate(tracks):
        if track.flies_on:
            fly_on(trees, d, track)
            continue
        tree = before.get((track.identity, track.is_airborne))
        if tree is not None:
            put_back(trees, d, tree)
        observe(trees, d, track, obstacles, plane_up_m, with_corners)
    return trees


def _model_of(track: TrackState) -> list[float]:
    """Row of :class:`~companion.kernels.arrays.Pursuers`' models."""
    speed, reach = track.speed_max_m_s, track.max_threat_radius_m
    if track.flies_on:
        place, velocity = deviations(track)
        return [speed, reach, place, FLIES_ON, velocity]
    return [speed, reach, track.turn_radius_m, float(track.is_airborne), STEP_S * speed]


def deviations(track: TrackState) -> tuple[float, float]:
    """Largest standard deviations of a track's place [m] and of its velocity [m/s], level."""
    covariance = np.asarray(track.covariance)
    parts = (covariance[np.ix_(rows, rows)] for rows in ((0, 2), (1, 3)))
    place, velocity = (math.sqrt(max(float(np.linalg.eigvalsh(part)[-1]), 0.0)) for part in parts)
    return place, velocity


def fly_on(trees: Pursuers, d: int, track: TrackState) -> None:
    """Tree ``d`` of an aircraft that flies on as it does: where it is, and where in a second, in place."""
    here, moving = np.asarray(track.position_enu_m), np.asarray(track.velocity_enu_m_s)
    trees.position[d, 0], trees.position[d, 1] = here, here + moving
    trees.parent[d, 0], trees.parent[d, 1] = -1, 0
    trees.time[d, 0], trees.time[d, 1] = track.stamp_s, track.stamp_s + 1.0
    trees.heading[d, :2] = math.atan2(moving[1], moving[0])
    trees.count[d] = 2


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
