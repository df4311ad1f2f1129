"""What follows from the rows of a path alone, edge by edge.

Plain NumPy, as all of the checker; shares nothing with the planner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.assurance import curves
from companion.frames import FloatArray
from companion.types.path import Path

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Edges:
    """What follows from the N rows alone: one number an edge, edge k from row k to row k + 1.

    Time ``steps_s`` (N - 1,), lengths ``chords_m``, ``flat_chords_m``, ``lengths_m``, ``rises_m`` (N - 1,)
    and angles ``turns_rad``, ``offsets_rad`` (N - 1,); ``rows``, ``usable`` (N - 1,) tell which they are.
    """

    rows: NDArray[np.int64]  # row at the end of each
    usable: BoolArray  # both ends have numbers
    steps_s: FloatArray
    chords_m: FloatArray
    flat_chords_m: FloatArray
    turns_rad: FloatArray  # course change, positive to the right
    offsets_rad: FloatArray  # chord's course against the mean course
    lengths_m: FloatArray  # along the arc, level
    rises_m: FloatArray


def edges_of(path: Path, usable_rows: BoolArray) -> Edges:
    """Differences between rows.

    Parameters
    ----------
    path : Path
        As planned, of N rows.
    usable_rows : ndarray, shape (N,)
        Which rows have numbers; those of the others are taken as 0.
    """
    positions = np.where(usable_rows[:, None], path.positions_enu_m, 0.0)
    courses = np.where(usable_rows, path.courses_rad, 0.0)
    times = np.where(usable_rows, path.times_s, 0.0)
    away = np.diff(positions, axis=0)
    flat = np.hypot(away[:, 0], away[:, 1])
    turns = curves.wrapped(np.diff(courses))
    half = 0.5 * np.abs(turns)
    offsets = curves.wrapped(np.arctan2(away[:, 0], away[:, 1]) - (courses[:-1] + 0.5 * turns))
    return Edges(
        rows=np.arange(1, len(courses)),
        usable=usable_rows[:-1] & usable_rows[1:],
        steps_s=np.diff(times),
        chords_m=np.linalg.norm(away, axis=1),
        flat_chords_m=flat,
        turns_rad=turns,
        offsets_rad=offsets,
        lengths_m=flat / np.sinc(half / math.pi),
        rises_m=away[:, 2],
    )


def bulges(edges: Edges, radius_m: float) -> FloatArray:
    """How far the curves may leave their chords; see :mod:`companion.assurance.checker`.

    Parameters
    ----------
    edges : Edges
        Those of a path of N rows.
    radius_m : float
        Radius of the tightest turn [m].

    Returns
    -------
    ndarray, shape (E,)
        For each of the E = N - 1 edges [m].
    """
    turns = np.abs(edges.turns_rad)
    spread: FloatArray = 0.25 * edges.lengths_m * turns - 0.125 * radius_m * turns**2
    sagitta: FloatArray = 0.5 * edges.flat_chords_m * np.tan(0.25 * turns)
    return np.maximum(spread, sagitta)
