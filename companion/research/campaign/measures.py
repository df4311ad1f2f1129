"""Measures of a moving threat against one path: the actual threat, and the estimated one (paper Table 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray
from companion.kernels.arrays import Obstacles
from companion.kernels.geometry.line_of_sight import sight_blocked
from companion.kernels.printed.intercept import EYE_M
from companion.kernels.printed.reachability import dt_positions
from companion.kernels.threat.fuzzy_threat import membership
from companion.kernels.workspace import reach_scratch
from companion.types.path import Path
from companion.types.plan import Plan
from companion.world.pursuer_trees import threat_trees
from companion.world.snapshot import Snapshot

NUM_SECONDARY = 10  # Points between two waypoints that are evaluated.
NUM_NEAR = 3  # TTree nodes that are tested at a point, in addition to the root and the corners.


@dataclass(frozen=True, slots=True)
class PursuitMeasures:
    """The paper's measures of a reachability estimator, for one flight.

    Parameters
    ----------
    aggregated_threat : float
        ADTP: actual threat at the waypoints by IFWA, in [0, 1].
    total_threat : float
        TDTA: sum of the actual threat at the waypoints and at ten points between each two.
    estimated_total_threat : float
        ETDTA: the same sum with the DT where the estimator put it nearest.
    first_pursued_share : float
        TFP/PD: when the first waypoint is called reachable, as a share of the path's duration; 1 if none.
    num_reachable : int
        RRS: nodes of the search tree that were called reachable.
    """

    aggregated_threat: float
    total_threat: float
    estimated_total_threat: float
    first_pursued_share: float
    num_reachable: int


def pursuit_measures(
    plan: Plan, path: Path, snapshot: Snapshot, which: int, track: FloatArray
) -> PursuitMeasures:
    """Measures of one DT over a path.

    Parameters
    ----------
    plan : Plan
        The plan whose search is measured, with its DTs' trees.
    path : Path
        The path flown, usually the plan's.
    snapshot : Snapshot
        The world the plan was made in.
    which : int
        Number of the snapshot's track.
    track : ndarray, shape (M, 3)
        True positions of the DT: clock reading [s], east, north [m], by rising time. It stands still
        before and after.
    """
    dt = snapshot.tracks[which]
    up = float(path.positions_enu_m[0, 2]) if snapshot.dimension == 2 else dt.position_enu_m[2]
    times, points = _with_points_between(path)
    actual = np.column_stack(
        [np.interp(times, track[:, 0], track[:, 1]), np.interp(times, track[:, 0], track[:, 2])]
    )
    places = np.column_stack([actual, np.full(len(times), up)])
    reach = dt.max_threat_radius_m
    felt = np.array([_threat(p, q, reach, snapshot.obstacles) for p, q in zip(places, points, strict=True)])
    trees = threat_trees(
        snapshot.tracks, snapshot.obstacles, up if snapshot.dimension == 2 else None, snapshot.bounds,
        plan.threat_trees,
    )  # fmt: skip
    scratch = reach_scratch()
    nearest = np.zeros((len(times), len(snapshot.tracks), 4))
    for row, point, time in zip(nearest, points, times, strict=True):
        dt_positions(trees, point[0], point[1], point[2], time, NUM_NEAR, snapshot.obstacles, row, scratch)
    known = nearest[:, which, 3] > 0.0
    away = np.linalg.norm(nearest[:, which, :3] - points, axis=1)
    expected = np.array([membership(r, 0.0, 0.0, reach, 0.0) for r in away]) * known
    waypoints = slice(None, None, NUM_SECONDARY + 1)
    pursued = np.flatnonzero(known[waypoints])
    first = path.times_s[pursued[0]] if len(pursued) else path.times_s[-1]
    kept = np.prod((1.0 - felt[waypoints]) ** (1.0 / len(path)))
    return PursuitMeasures(
        aggregated_threat=float(1.0 - kept),
        total_threat=float(felt.sum()),
        estimated_total_threat=float(expected.sum()),
        first_pursued_share=float((first - path.times_s[0]) / path.duration_s),
        num_reachable=len(plan.trace.reach_circles_enu_m),
    )


def _with_points_between(path: Path) -> tuple[FloatArray, FloatArray]:
    """Times, shape (K,), and positions, shape (K, 3), of the waypoints with the points between them."""
    steps = np.arange((len(path) - 1) * (NUM_SECONDARY + 1) + 1) / (NUM_SECONDARY + 1.0)
    rows = np.arange(len(path))
    times = np.interp(steps, rows, path.times_s)
    points = np.column_stack([np.interp(steps, rows, path.positions_enu_m[:, axis]) for axis in range(3)])
    return times, points


def _threat(dt: FloatArray, aircraft: FloatArray, reach_m: float, obstacles: Obstacles) -> float:
    """Membership, paper (1), of a DT at ``dt`` to an ``aircraft``, shape (3,) each [m]; 0 where unseen."""
    slant = float(np.linalg.norm(aircraft - dt))
    if slant > reach_m or sight_blocked(
        dt[0], dt[1], dt[2] + EYE_M, aircraft[0], aircraft[1], aircraft[2], obstacles
    ):
        return 0.0
    return float(membership(slant, 0.0, 0.0, reach_m, 0.0))
