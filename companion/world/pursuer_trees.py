"""Build the trees of the RS estimator: one per DT, kept from plan to plan (paper 3.2.2, Fig. 1)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from companion.kernels.arrays import Obstacles, Pursuers, empty_pursuers
from companion.kernels.printed.threat_tree import FLIES_ON, re_root
from companion.kernels.threat.near_aircraft import near_aircraft
from companion.types.threat import TURNS_S, ThreatTree, TrackState

NOT_PASSING = (0.0, 0.0, 0.0, math.inf, 0.0)  # In a model's columns for aircraft that fly on.
STEP_S = 2.0  # One edge of a TTree takes this driving time.
CAPACITY = 1500  # A TTree has at most this many nodes.
# A plan starts with at most this many nodes of the last one, so that it can grow its own.
KEPT_MAX = CAPACITY // 2
PATH_CAPACITY = 8192  # PathTrees up to this size find near nodes by cells; larger ones search all nodes.


def threat_trees(
    tracks: Sequence[TrackState], obstacles: Obstacles, plane_up_m: float | None, bounds: tuple[float, ...],
    kept: Sequence[ThreatTree] = (), with_corners: bool = True,
) -> Pursuers:  # fmt: skip
    """Return TTrees rooted at each DT's estimate, with one child along its predicted motion.

    The root's time stamp is the time of the estimate, not the start of the plan: the DT may have turned off
    its predicted path since.

    Parameters
    ----------
    tracks : sequence of TrackState
        Moving threats.
    obstacles : Obstacles
        The prisms that the DTs drive round.
    plane_up_m : float or None
        The flight level, which is also taken as the DTs' height [m]; None in three dimensions.
    bounds : tuple of float
        East and north, each low and high [m]; DTs do not leave them.
    kept : sequence of ThreatTree
        Trees of the last plan. Each is updated by the new estimate if it belongs to one of the tracks.
    with_corners : bool
        Whether the trees contain the shortest paths round the obstacles' corners from the start.
    """
    models = np.array([_model_of(track) for track in tracks], dtype=np.float64).reshape(-1, 10)
    trees = empty_pursuers(CAPACITY, models, np.array(bounds, dtype=np.float64), PATH_CAPACITY)
    before = {(tree.identity, tree.is_airborne): tree for tree in kept}
    for d, track in enumerate(tracks):
        if track.flies_on:
            extend_ahead(trees, d, track)
            continue
        tree = before.get((track.identity, track.is_airborne))
        if tree is not None:
            restore_tree(trees, d, tree)
        observe(trees, d, track, obstacles, plane_up_m, with_corners)
    return near_aircraft(trees)


def _model_of(track: TrackState) -> list[float]:
    """Return a row of :class:`~companion.kernels.arrays.Pursuers`' models."""
    speed, reach = track.speed_max_m_s, track.max_threat_radius_m
    if track.flies_on:
        place, velocity = deviations(track)
        passing = [track.clear_up_m, track.height_std_m, float(track.keeps_route)]
        circle = [track.circles_from_s, track.circle_m]
        return [speed, reach, place, FLIES_ON, velocity, *passing, *circle]
    return [speed, reach, track.turn_radius_m, float(track.is_airborne), STEP_S * speed, *NOT_PASSING]


def deviations(track: TrackState) -> tuple[float, float]:
    """Return the largest horizontal standard deviations of a track's position [m] and velocity [m/s]."""
    of = np.asarray(track.covariance)
    return _largest(of[0, 0], of[0, 2], of[2, 2]), _largest(of[1, 1], of[1, 3], of[3, 3])


def _largest(east: float, both: float, north: float) -> float:
    """Return the square root of the larger eigenvalue of a symmetric matrix of two rows."""
    middle, half = 0.5 * (east + north), 0.5 * (east - north)
    return math.sqrt(max(float(middle + math.hypot(half, both)), 0.0))


def extend_ahead(trees: Pursuers, d: int, track: TrackState) -> None:
    """Fill tree ``d`` in place for an aircraft that flies on: where it is, and will be every second.

    The last two rows are on the straight line that it goes on along. One row more is where it would be in a
    second if it flew straight from now.
    """
    turns_s = 0.0 if track.turn_rate_rad_s == 0.0 and track.velocity_enu_m_s[2] == 0.0 else TURNS_S
    if track.route is not None:
        turns_s = min(max(0.0, math.ceil(track.route[-2, 0] - track.stamp_s)), CAPACITY - 3.0)
    seconds = np.arange(turns_s + 2.0)
    places, n = track.places_enu_m(track.stamp_s + seconds), len(seconds)
    trees.position[d, :n], trees.time[d, :n] = places, track.stamp_s + seconds
    trees.position[d, n] = np.asarray(track.position_enu_m) + track.velocity_enu_m_s
    trees.count[d] = n


def restore_tree(trees: Pursuers, d: int, tree: ThreatTree) -> None:
    """Fill tree ``d`` with the earliest nodes of a kept tree, at most :data:`KEPT_MAX`.

    Time stamps grow along every branch, so every node comes with its parent.
    """
    chosen = np.sort(np.argsort(tree.time_s, kind="stable")[:KEPT_MAX])
    n = len(chosen)
    row = np.full(len(tree.time_s) + 1, -1, dtype=np.int64)  # The last entry is the parent of the root.
    row[chosen] = np.arange(n)
    trees.position[d, :n], trees.heading[d, :n] = tree.position_enu_m[chosen], tree.heading_rad[chosen]
    trees.time[d, :n], trees.parent[d, :n] = tree.time_s[chosen], row[tree.parent[chosen]]
    trees.count[d] = n


def observe(
    trees: Pursuers, d: int, track: TrackState, obstacles: Obstacles, plane_up_m: float | None,
    with_corners: bool = True,
) -> None:  # fmt: skip
    """Re-root tree ``d`` in place at a new estimate (paper Fig. 1)."""
    east, north, up = track.position_enu_m
    east_m_s, north_m_s, _ = track.velocity_enu_m_s
    ahead = min(math.hypot(east_m_s, north_m_s), track.speed_max_m_s) * STEP_S
    root = (float(east), float(north), float(up if plane_up_m is None else plane_up_m))
    heading = math.atan2(north_m_s, east_m_s)
    re_root(trees, d, root, heading, track.stamp_s, ahead, with_corners, obstacles)


def grown_trees(trees: Pursuers, tracks: Sequence[TrackState]) -> tuple[ThreatTree, ...]:
    """Return copies of the trees that a plan has grown, for the next plan: those of pursuers.

    Parameters
    ----------
    trees : Pursuers
        The trees after the plan.
    tracks : sequence of TrackState
        The tracks that the trees were made for, in the same order.
    """
    return tuple(_grown_tree(trees, d, track) for d, track in enumerate(tracks) if not track.flies_on)


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
