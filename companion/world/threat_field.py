"""The static threats' membership over the map, as the planner's kernels compute it."""

from __future__ import annotations

import math

import numpy as np

from companion.frames import FloatArray
from companion.kernels.geometry.radar_shadow import NO_SHADOW
from companion.world.snapshot import Snapshot

NODES_LONG_SIDE = 180  # A picture has this many cells along the longer side of the bounds.
FLOOR_CELLS = 2  # A radar's floor is the lowest of a square of this many of its shadow's cells.


def threat_field(
    snapshot: Snapshot, height_m: float, num_nodes: int = NODES_LONG_SIDE
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the radars' joint membership over the bounds at one height.

    Every radar counts, sensed or not, because the picture shows what is there. Membership is (1) of the
    paper, and 0 where an obstacle masks the radar. Several radars combine as ``1 - Π(1 - μ)``.

    Parameters
    ----------
    snapshot : Snapshot
        The world.
    height_m : float
        Up coordinate of the section [m].
    num_nodes : int
        Number of cells along the longer side of the bounds.

    Returns
    -------
    east_m, north_m : ndarray, shape (NX,) and (NY,)
        Cell centres [m].
    level : ndarray, shape (NY, NX)
        Threat level of each cell, in [0, 1].
    """
    east_low, east_high, north_low, north_high = snapshot.bounds[:4]
    spacing = max(east_high - east_low, north_high - north_low) / num_nodes
    east = np.arange(east_low + 0.5 * spacing, east_high, spacing)
    north = np.arange(north_low + 0.5 * spacing, north_high, spacing)
    threats, free = snapshot.threats, np.ones((len(north), len(east)))
    for radar, shadow in zip(threats.radars, threats.shadows, strict=True):
        above, reach, coefficient = height_m - float(radar[2]), float(radar[3]), float(radar[4])
        level = np.hypot(east - radar[0], (north - radar[1])[:, None])
        slant = np.hypot(level, above)
        seen = (level <= reach) & (slant <= reach) & (above >= coefficient * level**2)
        seen &= ~_hidden(east, north, height_m, shadow, threats.grid)
        free[seen] *= 1.0 - np.exp(-((slant[seen] / reach) ** 4))
    return east, north, 1.0 - free


def _hidden(
    east_m: FloatArray, north_m: FloatArray, height_m: float, shadow: FloatArray, grid: FloatArray
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return which cells of a section lie in a radar's shadow, by the planner's own rule.

    Parameters
    ----------
    east_m, north_m : ndarray, shape (NX,) and (NY,)
        Cell centres [m].
    height_m : float
        Up coordinate of the section [m].
    shadow : ndarray, shape (SX, SY)
        Heights at the grid's nodes; a point below all four nodes around it is hidden [m].
    grid : ndarray, shape (3,)
        East and north of the first node, and the spacing [m].

    Returns
    -------
    ndarray, shape (NY, NX)
        True for a hidden cell.
    """
    below = height_m < shadow
    cells = below[:-1, :-1] & below[1:, :-1] & below[:-1, 1:] & below[1:, 1:]
    column = np.floor((east_m - grid[0]) / grid[2]).astype(np.int64)
    row = np.floor((north_m - grid[1]) / grid[2]).astype(np.int64)
    is_in = ((row >= 0) & (row < cells.shape[1]))[:, None] & (column >= 0) & (column < cells.shape[0])
    found = cells[
        np.clip(column, 0, cells.shape[0] - 1)[None, :], np.clip(row, 0, cells.shape[1] - 1)[:, None]
    ]
    return np.asarray(is_in & found)


def sight_floor(snapshot: Snapshot, number: int) -> tuple[FloatArray, tuple[float, float, float]]:
    """Return the height above which a radar sees, cell by cell: what is lower is hidden, or below h_B.

    Ground and obstacles hide what lies below all nodes of the shadow about a cell, by the planner's rule.

    Parameters
    ----------
    snapshot : Snapshot
        The world.
    number : int
        Number of the radar.

    Returns
    -------
    floor_m : ndarray, shape (NY, NX)
        The height [m]. It is minus infinity where nothing hides, plus infinity where everything is hidden,
        and not a number farther away than the radar's range.
    grid : tuple of float
        West and south edge of the first cell, and the spacing [m].
    """
    threats = snapshot.threats
    east_m, north_m, up_m, reach_m, coefficient = (float(value) for value in threats.radars[number])
    lowest = np.where(threats.shadows[number] <= NO_SHADOW, -np.inf, threats.shadows[number])
    for axis in range(2):
        pairs = np.minimum(*(np.delete(lowest, end, axis=axis) for end in (-1, 0)))
        lowest = np.minimum.reduceat(pairs, np.arange(0, pairs.shape[axis], FLOOR_CELLS), axis=axis)
    west, south, side = float(threats.grid[0]), float(threats.grid[1]), FLOOR_CELLS * float(threats.grid[2])
    east, north = (
        first + side * (0.5 + np.arange(count))
        for first, count in zip((west, south), lowest.shape, strict=True)
    )
    level = np.hypot(east - east_m, (north - north_m)[:, None])
    level = np.maximum(level - side / math.sqrt(2.0), 0.0)  # No place in the cell is nearer.
    boundary = up_m + coefficient * level**2 if coefficient > 0.0 else -np.inf
    return np.where(level <= reach_m, np.maximum(lowest.T, boundary), np.nan), (west, south, side)


def flight_height(snapshot: Snapshot, ups_m: FloatArray, fallback_m: float) -> float:
    """Return the height of the section through the world, inside the bounds [m].

    Parameters
    ----------
    snapshot : Snapshot
        The world, with its bounds.
    ups_m : ndarray, shape (N,)
        Up coordinates of a path [m]. Their median is the height; values that are not finite are ignored.
    fallback_m : float
        The height if no coordinate is finite [m].
    """
    finite = ups_m[np.isfinite(ups_m)]
    height = float(np.median(finite)) if finite.size else fallback_m
    return min(max(height, snapshot.bounds[4]), snapshot.bounds[5])
