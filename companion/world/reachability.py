"""The RS estimator's trees: one a DT, carried from plan to plan (SPEC 5)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from companion.kernels.layout import Obstacles, Pursuers, empty_pursuers
from companion.kernels.reachability import re_root
from companion.types.threat import TrackState

STEP_S = 2.0  # driving time of one TTree edge
CAPACITY = 1500


def threat_trees(
    tracks: Sequence[TrackState], stamp_s: float, obstacles: Obstacles, plane_up_m: float | None,
    bounds: tuple[float, ...],
) -> Pursuers:  # fmt: skip
    """Fresh TTrees: rooted at each DT's estimate, one child along its predicted motion.

    Parameters
    ----------
    tracks : sequence of TrackState
        Moving threats.
    stamp_s : float
        The clock reading the estimates are taken to (they are moved on by their velocity).
    plane_up_m : float or None
        In the plane: the flight level, at which the DTs are taken to be [m].
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
    trees = empty_pursuers(CAPACITY, models, np.array(bounds, dtype=np.float64))
    for d, track in enumerate(tracks):
        observe(trees, d, track, stamp_s, obstacles, plane_up_m)
    return trees


def observe(
    trees: Pursuers, d: int, track: TrackState, stamp_s: float, obstacles: Obstacles, plane_up_m: float | None
) -> None:
    """Re-root tree ``d`` at a new estimate (paper Fig. 1), in place."""
    age = max(0.0, stamp_s - track.stamp_s)
    east = track.position_enu_m[0] + age * track.velocity_enu_m_s[0]
    north = track.position_enu_m[1] + age * track.velocity_enu_m_s[1]
    up = track.position_enu_m[2] if plane_up_m is None else plane_up_m
    speed = math.hypot(track.velocity_enu_m_s[0], track.velocity_enu_m_s[1])
    heading = math.atan2(track.velocity_enu_m_s[1], track.velocity_enu_m_s[0])
    re_root(trees, d, east, north, up, heading, stamp_s, min(speed, track.speed_max_m_s) * STEP_S, obstacles)
