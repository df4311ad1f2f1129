"""Convert static threats to the kernels' form, with their shadow fields (paper 3.1)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from companion.kernels.arrays import IntArray, Obstacles, Threats
from companion.kernels.geometry.ground_surface import fill_ground_shadows
from companion.kernels.geometry.radar_shadow import fill_shadows
from companion.types.threat import Radar
from companion.world.ground.cell_lookup import has_ground

SHADOW_NODES = 321  # A shadow field has this many nodes along the longer side of the bounds.


def packed_threats(
    radars: Sequence[Radar], obstacles: Obstacles, bounds: tuple[float, float, float, float, float, float]
) -> Threats:
    """Return the flat arrays of all radars, marked as known, with the shadow field of each."""
    rows = np.array(
        [[*r.position_enu_m, r.max_threat_radius_m, r.boundary_coefficient_per_m] for r in radars],
        dtype=np.float64,
    ).reshape(-1, 5)
    width, height = bounds[1] - bounds[0], bounds[3] - bounds[2]
    spacing = max(width, height) / (SHADOW_NODES - 1)
    shape = (math.ceil(width / spacing) + 1, math.ceil(height / spacing) + 1)
    grid = np.array([bounds[0], bounds[2], spacing])
    shadows = np.zeros((len(rows), *shape))
    for radar, row, shadow in zip(radars, rows, shadows, strict=True):
        fill_shadows(shadow, grid, row, obstacles)
        if has_ground(obstacles.ground):
            fill_ground_shadows(shadow, grid, row, obstacles.ground)
        if radar.lowest_seen_m is not None:
            nodes = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 2)
            floor = radar.lowest_seen_m(grid[:2] + spacing * nodes)
            np.maximum(shadow, floor.reshape(shape), out=shadow)
    return Threats(radars=rows, known=np.ones(len(rows), dtype=np.int64), shadows=shadows, grid=grid)


def known_within(threats: Threats, east_m: float, north_m: float, sensing_horizon_m: float) -> IntArray:
    """Return which radars' areas reach into the sensing horizon about a point (paper 4.2).

    Parameters
    ----------
    threats : Threats
        R radars.
    east_m, north_m : float
        The point [m].
    sensing_horizon_m : float
        The range of the sensors [m].

    Returns
    -------
    ndarray, shape (R,)
        1 for each radar whose area does, 0 for the others.
    """
    away = np.hypot(threats.radars[:, 0] - east_m, threats.radars[:, 1] - north_m)
    return (away <= sensing_horizon_m + threats.radars[:, 3]).astype(np.int64)
