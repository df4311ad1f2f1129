"""Quantities that follow from the rows of a path alone, per edge, and the rules on them.

Plain NumPy, like the rest of the checker; the module shares nothing with the planner.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.assurance import curves
from companion.assurance.surroundings.prisms import LENGTH_TOLERANCE_M
from companion.assurance.violation import Violation, violated
from companion.frames import FloatArray
from companion.types.path import Path

BoolArray = NDArray[np.bool_]

GOAL_TOLERANCE_M = 0.01  # Rounding of positions.
SPEED_JOIN_M_S = 0.15  # Rows of one path that were planned separately may differ by this airspeed.
SLOWING_M_S2 = 1.0  # The aircraft may slow down this fast: closing the throttle acts sooner than opening it.
COURSE_TOLERANCE_RAD = 0.02  # An edge's chord and its courses may differ by this much.
STRAIGHT_COURSE_RAD = 1e-3  # An edge with a smaller course change is straight.


@dataclass(frozen=True, slots=True)
class Edges:
    """The edges of a path of N rows; edge k leads from row k to row k + 1.

    Time ``steps_s`` (N - 1,), lengths ``chords_m``, ``flat_chords_m``, ``lengths_m``, ``rises_m`` (N - 1,),
    angles ``turns_rad``, ``offsets_rad`` (N - 1,), and ``rows``, ``usable`` (N - 1,).
    """

    rows: NDArray[np.int64]  # row at the end of the edge
    usable: BoolArray  # whether both ends have finite numbers
    steps_s: FloatArray
    chords_m: FloatArray
    flat_chords_m: FloatArray
    turns_rad: FloatArray  # course change, positive to the right
    offsets_rad: FloatArray  # course of the chord less the mean course
    lengths_m: FloatArray  # horizontal length along the arc
    rises_m: FloatArray


def edges_of(path: Path, usable_rows: BoolArray) -> Edges:
    """Return the differences between rows.

    Parameters
    ----------
    path : Path
        A path of N rows.
    usable_rows : ndarray, shape (N,)
        Whether the numbers of each row are finite; the others are replaced by 0.
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
    """Check that the airspeed rises and falls no faster along the path than the aircraft can.

    The rule is ``v² = u² + 2·a·s`` over the path's length, as in still air: it does not depend on how soon
    the wind takes the aircraft there.

    Parameters
    ----------
    path : Path
        A path of N rows.
    edges : Edges
        The edges of the path.
    ahead : ndarray, shape (N - 1,)
        Which edges are judged.
    most_m_s2 : float
        Largest acceleration [m/s²].
    """
    before, after = path.speeds_m_s[:-1], path.speeds_m_s[1:]
    lengths = np.hypot(edges.lengths_m, edges.rises_m)
    fastest = np.sqrt(before**2 + 2.0 * most_m_s2 * lengths) + SPEED_JOIN_M_S
    slowing = max(most_m_s2, SLOWING_M_S2)
    slowest = np.sqrt(np.maximum(before**2 - 2.0 * slowing * lengths, 0.0)) - SPEED_JOIN_M_S
    detail = "airspeed over one edge [m/s]"
    yield from violated("acceleration", edges.rows, ahead & ~(after <= fastest), after, fastest, detail)
    yield from violated("acceleration", edges.rows, ahead & ~(after >= slowest), after, slowest, detail)


def turn_violations(
    edges: Edges, ahead: BoolArray, radii_min_m: FloatArray, tolerance: float
) -> Iterator[Violation]:
    """Check that each edge is a curve of one turn, nowhere tighter than allowed, between its two courses.

    With an arc of the smallest radius at one end and a straight piece behind it, the chord lies farthest from
    the mean course. With the arc from end to end it has that course.

    Parameters
    ----------
    edges : Edges
        The edges of a path of N rows.
    ahead : ndarray, shape (N - 1,)
        Which edges are judged.
    radii_min_m : ndarray, shape (N - 1,)
        Radius of the tightest turn on each edge [m].
    tolerance : float
        Radii may be smaller by this share.
    """
    turns = np.abs(edges.turns_rad)
    half = 0.5 * turns
    tightest = radii_min_m * (1.0 - tolerance)
    straights = np.maximum(edges.lengths_m - tightest * turns, 0.0)
    arc_chords = 2.0 * tightest * np.sin(half)
    farthest = np.arctan2(straights * np.sin(half), arc_chords + straights * np.cos(half))
    allowed = farthest + COURSE_TOLERANCE_RAD + 0.05 / np.maximum(edges.flat_chords_m, 0.05)
    disagrees = ahead & (np.abs(edges.offsets_rad) > allowed)
    yield from violated("course", edges.rows, disagrees, np.abs(edges.offsets_rad), allowed,
                        "courses do not agree with positions [rad]")  # fmt: skip
    radii = edges.lengths_m / np.maximum(turns, 1e-12)
    tight = ahead & (turns > 1e-6) & ~(radii >= tightest)
    yield from violated("turn_radius", edges.rows, tight, radii, radii_min_m, "turn radius [m]")


def bulges(edges: Edges, radius_m: float) -> FloatArray:
    """Return how far the curves may leave their chords; see :mod:`companion.assurance.checker`.

    Parameters
    ----------
    edges : Edges
        The edges of a path of N rows.
    radius_m : float
        Radius of the tightest turn [m].

    Returns
    -------
    ndarray, shape (E,)
        One distance for each of the E = N - 1 edges [m].
    """
    turns = np.abs(edges.turns_rad)
    spread: FloatArray = 0.25 * edges.lengths_m * turns - 0.125 * radius_m * turns**2
    sagitta: FloatArray = 0.5 * edges.flat_chords_m * np.tan(0.25 * turns)
    return np.maximum(spread, sagitta)


def straight_violations(
    edges: Edges, turn_radius_m: float, straight_min_m: float, first: int
) -> Iterator[Violation]:
    """Check that enough straight flight lies between two turns; see :mod:`companion.assurance.checker`.

    Parameters
    ----------
    edges : Edges
        The edges of a path.
    turn_radius_m : float
        Radius of the tightest turn [m].
    straight_min_m : float
        Shortest straight flight between two turns [m].
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
    """Check that the last row is at the goal.

    Parameters
    ----------
    path : Path
        The planned path.
    goal_enu_m : sequence of float
        East, north, up of the goal [m].
    radius_m : float
        Allowed distance from the goal [m].
    """
    away = float(np.linalg.norm(path.positions_enu_m[-1] - np.asarray(goal_enu_m, dtype=np.float64)))
    if not away <= radius_m + GOAL_TOLERANCE_M:
        yield Violation(
            "goal", len(path.times_s) - 1, away, radius_m, "distance of the end from the goal [m]"
        )
