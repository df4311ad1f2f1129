"""Curves between the positions of a path or a mission, and the positions' uncertainty.

Plain NumPy, like the rest of the checker; the module shares nothing with the planner.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from companion.frames import FloatArray

BoolArray = NDArray[np.bool_]

NUMBER_MAX = 1e8  # A larger number is no valid position, time or speed.
CORNER_SIDES = 8  # The arc of a corner is checked as this many segments.
SPOT_M = 0.01  # The length of a segment that stands for a point: shapely finds nothing near an empty line.
NEARER_M = 0.5  # A position inside the margin may seem nearer by this much: noise.
RECEDES = 0.1  # A track that begins inside the margin gains at least this much distance per metre flown.


def wrapped(angles: FloatArray) -> FloatArray:
    """Wrap angles to [-π, π).

    Parameters
    ----------
    angles : ndarray, shape (N,)
        Any directions [rad].

    Returns
    -------
    ndarray, shape (N,)
        The same directions [rad].
    """
    result: FloatArray = (angles + math.pi) % (2.0 * math.pi) - math.pi
    return result


def position_deviations(covariances: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the largest standard deviation of each covariance, and whether the covariance is valid.

    Parameters
    ----------
    covariances : ndarray, shape (N, 3, 3)
        Covariances of positions [m²].

    Returns
    -------
    ndarray, shape (N,)
        Largest standard deviations [m].
    ndarray, shape (N,)
        Whether each is positive semidefinite.
    """
    finite: BoolArray = np.all(np.abs(covariances) <= NUMBER_MAX, axis=(1, 2))
    safe = np.where(finite[:, None, None], covariances, 0.0)
    eigenvalues = np.linalg.eigvalsh(0.5 * (safe + np.swapaxes(safe, 1, 2)))
    scale = 1e-6 * (1.0 + eigenvalues[:, -1])
    skew = np.abs(safe - np.swapaxes(safe, 1, 2)).max(axis=(1, 2))
    well_formed = finite & (eigenvalues[:, 0] >= -scale) & (skew <= scale)
    return np.sqrt(np.maximum(eigenvalues[:, -1], 0.0)), well_formed


def fly_by(corner: FloatArray, course: float, turn: float, cut_m: float) -> tuple[FloatArray, float]:
    """Return the arc of a fly-by corner.

    Parameters
    ----------
    corner : ndarray, shape (3, 3)
        The waypoints before, at and after the corner [m].
    course : float
        Course of the leg to the corner, clockwise from north [rad].
    turn : float
        Change of course at the corner, positive to the right [rad].
    cut_m : float
        Distance from the corner at which the arc begins and ends [m].

    Returns
    -------
    ndarray, shape (S, 3)
        Points of the arc [m].
    float
        Largest distance of the arc from the lines between its points [m].
    """
    into, out = corner[1] - corner[0], corner[2] - corner[1]
    before = corner[1] - into * (cut_m / float(np.hypot(into[0], into[1])))
    behind = corner[1] + out * (cut_m / float(np.hypot(out[0], out[1])))
    radius, side = cut_m / math.tan(0.5 * abs(turn)), math.copysign(1.0, turn)
    share = np.linspace(0.0, 1.0, CORNER_SIDES + 1)
    courses = course + turn * share
    east = before[0] + side * radius * (math.cos(course) - np.cos(courses))
    north = before[1] + side * radius * (np.sin(courses) - math.sin(course))
    up = before[2] + share * (behind[2] - before[2])
    return np.column_stack([east, north, up]), radius * (1.0 - math.cos(0.5 * turn / CORNER_SIDES))


def short_segment(position_enu_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a point as a very short segment.

    Parameters
    ----------
    position_enu_m : ndarray, shape (3,)
        The point [m].

    Returns
    -------
    ndarray, shape (1, 3)
        Start of the segment [m].
    ndarray, shape (1, 3)
        End of the segment [m].
    """
    here = np.asarray(position_enu_m, dtype=np.float64)[None, :]
    return here, here + np.array([SPOT_M, 0.0, 0.0])


def margins_along(positions_enu_m: FloatArray, clear_m: float, margin_m: float) -> FloatArray:
    """Return the distance to keep on each piece of a track that may begin inside the margin and then recedes.

    Parameters
    ----------
    positions_enu_m : ndarray, shape (K, 3)
        Positions of the track [m].
    clear_m : float
        Distance from the nearest obstacle at the first position [m].
    margin_m : float
        Distance to keep elsewhere [m].

    Returns
    -------
    ndarray, shape (J,)
        Distance to keep on each of the J = K - 1 pieces [m].
    """
    lengths = np.cumsum(np.linalg.norm(np.diff(positions_enu_m, axis=0), axis=1))
    if clear_m >= margin_m:
        return np.full(len(lengths), margin_m)
    needed: FloatArray = np.clip(clear_m - NEARER_M + RECEDES * lengths, 0.0, margin_m)
    needed[0] = max(0.0, min(needed[0], clear_m - NEARER_M))
    return needed
