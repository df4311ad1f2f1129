"""Measures of a flight and the aircraft that pass it, by their true paths."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from companion.frames import FloatArray
from companion.research.encounters.well_clear import (
    EN_ROUTE,
    NEAR_MID_AIR_COLLISION,
    NON_COOPERATIVE,
    SMALL_AIRCRAFT,
    BoolArray,
    Volume,
)

VOLUMES = {
    "nmac": NEAR_MID_AIR_COLLISION,
    "lowc": SMALL_AIRCRAFT,
    "lowc_en_route": EN_ROUTE,
    "lowc_non_cooperative": NON_COOPERATIVE,
}

Row = dict[str, bool | int | float | str | None]


def encounter_measures(own: FloatArray, others: Mapping[str, FloatArray]) -> Row:
    """Return what happened between a flight and aircraft while both are known, at the flight's rows.

    An event counts if it happens with any of them; distances are those to the nearest.

    Parameters
    ----------
    own : ndarray, shape (N, 4)
        The flight: time [s], east, north, up [m].
    others : mapping of str to ndarray, shape (M, 7)
        Each aircraft: time [s], east, north, up [m], and the velocity in these [m/s].
    """
    found: Row = dict.fromkeys(VOLUMES, False) | {"severity": 0.0, "miss_m": math.inf, "above_m": math.inf}
    for other in others.values():
        _, away, velocity = _relative(own, other)
        flat = np.hypot(away[:, 0], away[:, 1])
        nearest = int(flat.argmin())
        for name, volume in VOLUMES.items():
            found[name] = bool(found[name]) or bool(volume.is_inside(away, velocity).any())
        severity = float(SMALL_AIRCRAFT.severity(away, velocity).max())
        found["severity"] = max(float(found["severity"] or 0.0), severity)
        if flat[nearest] < float(found["miss_m"] or 0.0):
            found |= {"miss_m": float(flat[nearest]), "above_m": float(away[nearest, 2])}
    return found


def _relative(own: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rows of ``own`` (N, 4) at which ``other`` (M, 7) is known, (K, 4).

    Besides, its position and velocity less those of the own aircraft then, each (K, 3).
    """
    rows = own[(own[:, 0] >= other[0, 0]) & (own[:, 0] <= other[-1, 0])]
    there = np.column_stack([np.interp(rows[:, 0], other[:, 0], other[:, n]) for n in range(1, 7)])
    return rows, there[:, :3] - rows[:, 1:], there[:, 3:] - np.gradient(rows[:, 1:], rows[:, 0], axis=0)


def inside(own: FloatArray, other: FloatArray, volume: Volume) -> tuple[FloatArray, BoolArray]:
    """Return the rows of a flight at which another aircraft is known, and whether it is in a volume then.

    Parameters
    ----------
    own : ndarray, shape (N, 4)
        The flight: time [s], east, north, up [m].
    other : ndarray, shape (M, 7)
        The aircraft: time [s], east, north, up [m], and the velocity in these [m/s].
    volume : Volume
        About the flight.

    Returns
    -------
    rows : ndarray, shape (K, 4)
        The flight's rows.
    is_inside : ndarray, shape (K,)
        Whether the aircraft is in the volume.
    """
    rows, away, velocity = _relative(own, other)
    return rows, volume.is_inside(away, velocity)


def way_m(path: FloatArray) -> float:
    """Return the length of a path [m].

    Parameters
    ----------
    path : ndarray, shape (N, 4)
        Time [s], east, north, up [m].
    """
    return float(np.linalg.norm(np.diff(path[:, 1:], axis=0), axis=1).sum())
