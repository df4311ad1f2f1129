"""Curves between the places that a path or a mission names, and how well those places are known.

Plain NumPy, as all of the checker; shares nothing with the planner.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from companion.frames import FloatArray

BoolArray = NDArray[np.bool_]

NUMBER_MAX = 1e8  # anything larger is no position, time or speed
CORNER_SIDES = 8
SPOT_M = 0.01  # a line without any length is near to nothing
NEARER_M = 0.5  # noise of a position that is within the margin already
COMES_AWAY = 0.1  # of the way flown from there


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
    """Largest deviation of each covariance, and whether it is one.

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
    """Arc that rounds a corner.

    Parameters
    ----------
    corner : ndarray, shape (3, 3)
        Waypoint before it, itself, and the one after it [m].
    course : float
        Course of the leg to it, clockwise from north.
    turn : float
        Change of course at it, positive to the right.
    cut_m : float
        Distance from it at which the arc begins and ends [m].

    Returns
    -------
    ndarray, shape (S, 3)
        Points of the arc [m].
    float
        By how much it leaves the lines between them [m].
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


def spot(position_enu_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Place as a line that is next to nothing long.

    Parameters
    ----------
    position_enu_m : ndarray, shape (3,)
        The place [m].

    Returns
    -------
    ndarray, shape (1, 3)
        Its beginning [m].
    ndarray, shape (1, 3)
        Its end [m].
    """
    here = np.asarray(position_enu_m, dtype=np.float64)[None, :]
    return here, here + np.array([SPOT_M, 0.0, 0.0])


def margins_along(positions_enu_m: FloatArray, clear_m: float, margin_m: float) -> FloatArray:
    """Distance to keep on each piece of a track that may begin within its margin, and comes away then.

    Parameters
    ----------
    positions_enu_m : ndarray, shape (K, 3)
        Places of the track [m].
    clear_m : float
        Distance to the nearest obstacle at the first of them [m].
    margin_m : float
        Distance to keep [m].

    Returns
    -------
    ndarray, shape (J,)
        Distance to keep on each of the J = K - 1 pieces between them [m].
    """
    lengths = np.cumsum(np.linalg.norm(np.diff(positions_enu_m, axis=0), axis=1))
    if clear_m >= margin_m:
        return np.full(len(lengths), margin_m)
    needed: FloatArray = np.clip(clear_m - NEARER_M + COMES_AWAY * lengths, 0.0, margin_m)
    needed[0] = max(0.0, min(needed[0], clear_m - NEARER_M))
    return needed
