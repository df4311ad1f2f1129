"""What follows from the rows of a path alone, edge by edge.

Plain NumPy, as all of the checker; shares nothing with the planner.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.assurance import curves
from companion.assurance.prisms import LENGTH_TOLERANCE_M
from companion.assurance.violation import Violation, listed
from companion.frames import FloatArray
from companion.types.path import Path

BoolArray = NDArray[np.bool_]

GOAL_TOLERANCE_M = 0.01
SPEED_JOIN_M_S = 0.15  # by which rows of one path that were planned apart may differ
SLOWING_M_S2 = 1.0  # or the limit, if that is more: the throttle is closed sooner than speed is gained
STRAIGHT_COURSE_RAD = 1e-3  # course change below which an edge is straight


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


def acceleration_violations(
    path: Path, edges: Edges, ahead: BoolArray, most_m_s2: float
) -> Iterator[Violation]:
    """Airspeeds that rise or fall faster along the path than they can.

    By the way: ``v² = u² + 2·a·s``, so as in still air, however soon the wind takes the aircraft there.

    Parameters
    ----------
    path : Path
        As planned, of N rows.
    edges : Edges
        What its rows say of its edges.
    ahead : ndarray, shape (N - 1,)
        Which edges are judged.
    most_m_s2 : float
        Acceleration [m/s²].
    """
    before, after = path.speeds_m_s[:-1], path.speeds_m_s[1:]
    ways = np.hypot(edges.lengths_m, edges.rises_m)
    fastest = np.sqrt(before**2 + 2.0 * most_m_s2 * ways) + SPEED_JOIN_M_S
    slowest = np.sqrt(np.maximum(before**2 - 2.0 * max(most_m_s2, SLOWING_M_S2) * ways, 0.0)) - SPEED_JOIN_M_S
    detail = "airspeed over one edge [m/s]"
    yield from listed("acceleration", edges.rows, ahead & ~(after <= fastest), after, fastest, detail)
    yield from listed("acceleration", edges.rows, ahead & ~(after >= slowest), after, slowest, detail)


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


def straight_violations(
    edges: Edges, turn_radius_m: float, straight_min_m: float, first: int
) -> Iterator[Violation]:
    """Find turns begun before enough straight flight since the last; see :mod:`companion.assurance.checker`.

    Parameters
    ----------
    edges : Edges
        What a path's rows say of its edges.
    turn_radius_m, straight_min_m : float
        Radius of the tightest turn, and the least straight flight between two [m].
    first : int
        Turns at rows up to this one are not judged.
    """
    lengths = np.where(edges.usable, np.hypot(edges.lengths_m, edges.rises_m), 0.0)
    turns = np.where(edges.usable, edges.turns_rad, 0.0)
    signs = np.where(np.abs(turns) > STRAIGHT_COURSE_RAD, np.sign(turns), 0.0).astype(int)
    spare = np.maximum(0.0, lengths - turn_radius_m * np.abs(turns))
    last_sign, straight, last_edge = 0, 0.0, 0
    for k in np.flatnonzero(signs):
        straight = float(lengths[last_edge + 1 : k].sum())
        goes_on = signs[k] == last_sign and k == last_edge + 1
        if last_sign != 0 and not goes_on:
            straight += min(float(max(lengths[k], lengths[last_edge])), float(spare[k] + spare[last_edge]))
            if straight < straight_min_m - LENGTH_TOLERANCE_M and edges.rows[k] > first:
                yield Violation(
                    "straight", int(edges.rows[k]), straight, straight_min_m,
                    "straight flight since the last turn [m]",
                )  # fmt: skip
        last_sign, last_edge = signs[k], int(k)


def goal_violations(path: Path, goal_enu_m: Sequence[float], radius_m: float) -> Iterator[Violation]:
    """Whether the last row is at the goal.

    Parameters
    ----------
    path : Path
        As planned.
    goal_enu_m : sequence of float
        East, north, up [m].
    radius_m : float
        How near counts as there [m].
    """
    away = float(np.linalg.norm(path.positions_enu_m[-1] - np.asarray(goal_enu_m, dtype=np.float64)))
    if not away <= radius_m + GOAL_TOLERANCE_M:
        yield Violation(
            "goal", len(path.times_s) - 1, away, radius_m, "distance of the end from the goal [m]"
        )
