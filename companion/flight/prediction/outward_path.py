"""The path on which an aircraft flies outward, as a place that its return path keeps away from.

An ArduPlane joins the closest leg of a return path. Where the return runs close to the outward
path, that may be a leg of the way back, and the aircraft turns round at once, with or without the space.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from companion.types.path import Path
from companion.types.threat import Obstacle

AWAY_M = 60.0  # The way back keeps this far, and its clearance, from the way out, sideways or in height.
FREE_M = 150.0  # Within this distance of where the aircraft turns back it may come near to the way out.
PIECE_M = 80.0  # Longest piece of the way out that one prism surrounds.


def outward_path(path: Path, until_s: float) -> tuple[Obstacle, ...]:
    """Return prisms round a path up to the place where the aircraft turns back; none round a short one.

    Parameters
    ----------
    path : Path
        The flown path, from the aircraft on.
    until_s : float
        When the aircraft turns back, by the path's times [s].
    """
    ends = np.array([np.interp(until_s, path.times_s, path.positions_enu_m[:, axis]) for axis in range(2)])
    rows = path.positions_enu_m[path.times_s < until_s]
    rows = rows[np.linalg.norm(rows[:, :2] - ends, axis=1) > FREE_M]
    flown_m = np.concatenate([[0.0], np.linalg.norm(np.diff(rows[:, :2], axis=0), axis=1).cumsum()])
    if len(rows) < 2 or flown_m[-1] <= 0.0:
        return ()
    at = np.linspace(0.0, flown_m[-1], math.ceil(flown_m[-1] / PIECE_M) + 1)
    places = np.column_stack([np.interp(at, flown_m, rows[:, axis]) for axis in range(3)])
    found = []
    for begin, end in itertools.pairwise(places):
        along = (end - begin)[:2]
        lateral = np.array([-along[1], along[0]]) * AWAY_M / np.linalg.norm(along)
        corners = np.array([begin[:2] - lateral, end[:2] - lateral, end[:2] + lateral, begin[:2] + lateral])
        low, high = sorted((float(begin[2]), float(end[2])))
        found.append(Obstacle("flown path", corners, low - AWAY_M, high + AWAY_M))
    return tuple(found)
