"""Convert moving threats that may know the path to the kernels' form (paper 2.3)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from companion.frames import FloatArray
from companion.kernels.arrays import Game, Obstacles
from companion.kernels.threat.pursuit_game import (
    BLOCK,
    DRIVES,
    FLIES,
    PASSES_BY,
    fill_arrivals,
    fill_tops,
)
from companion.types.threat import TrackState
from companion.world.ground.cell_lookup import cells_along, has_ground
from companion.world.pursuer_trees import deviations

CELLS = 256  # The grid has this many cells along the longer side of the bounds.
CELL_MIN_M = 5.0  # Cells are not smaller than this.
DEVIATIONS = 2.0  # A vehicle is assumed nearer by this many standard deviations of its position.


def pursuit_game(
    tracks: Sequence[TrackState], walls: Obstacles, plane_up_m: float | None, bounds: Sequence[float],
    slack_s: float,
) -> Game:  # fmt: skip
    """Return the earliest arrivals of all moving threats, and the walls that block their sight.

    Parameters
    ----------
    tracks : sequence of TrackState
        Moving threats.
    walls : Obstacles
        Obstacles that block sight and that ground vehicles drive round.
    plane_up_m : float or None
        The flight level [m]; None in three dimensions.
    bounds : sequence of float
        East and north, each low and high [m]; DTs do not leave them.
    slack_s : float
        A place counts as safe if the aircraft passes it this long before a DT could threaten it [s].
    """
    west, east, south, north = bounds[:4]
    spacing = max(CELL_MIN_M, max(east - west, north - south) / CELLS)
    shape = (int((east - west) / spacing) + 2, int((north - south) / spacing) + 2) if tracks else (1, 1)
    is_flat = not has_ground(walls.ground)
    vehicles = np.array([_vehicle_row(track) for track in tracks], dtype=np.float64).reshape(-1, 8)
    num_grids = int(max(np.flatnonzero(vehicles[:, 7] == DRIVES), default=-1)) + 1
    game = Game(
        vehicles=vehicles,
        arrival=np.full((num_grids, *shape), math.inf),
        least=np.empty((len(tracks), 0, 0)),
        tops=np.full(shape, -math.inf),
        lowest=math.inf,
        grid=np.array([west, south, spacing]),
        is_plane=0 if plane_up_m is None else 1,
        slack=slack_s,
        ground=walls.ground,
    )
    if any(vehicle[7] == DRIVES for vehicle in game.vehicles):
        fill_tops(walls, math.nan if plane_up_m is None else plane_up_m, game.grid, game.tops)
        if not is_flat:
            _bar_steep_ground(game)
    for d, vehicle in enumerate(game.vehicles):
        if vehicle[7] == DRIVES:
            fill_arrivals(vehicle[0], vehicle[1], game, d)
    lowest = float(game.tops.min(where=game.tops > -math.inf, initial=math.inf)) if is_flat else -math.inf
    return game._replace(least=_least_of_blocks(game.arrival), lowest=lowest)


def _bar_steep_ground(game: Game) -> None:
    """Make cells that are too steep to drive over walls as high as their ground."""
    ground, tops = game.ground, game.tops
    rows, columns = (
        cells_along(ground, axis, game.grid[axis] + game.grid[2] * np.arange(tops.shape[axis]))
        for axis in range(2)
    )
    middle = 0.5 * (ground.high.astype(np.float64) + ground.low)
    slopes = np.hypot(*np.gradient(middle, ground.grid[2]))[np.ix_(rows, columns)]
    np.maximum(tops, ground.low[np.ix_(rows, columns)], out=tops, where=slopes > ground.drivable)


def _least_of_blocks(arrival: FloatArray) -> FloatArray:
    """Return the earliest arrival in each block of cells.

    Parameters
    ----------
    arrival : ndarray, shape (D, NX, NY)
        The earliest time at which each threat can be at each cell of the grid [s].

    Returns
    -------
    ndarray, shape (D, BX, BY)
        The earliest time at which it can be anywhere in each block [s].
    """
    across = [-(-n // BLOCK) for n in arrival.shape[1:]]
    cells = np.full((len(arrival), *(BLOCK * n for n in across)), math.inf)
    cells[:, : arrival.shape[1], : arrival.shape[2]] = arrival
    blocks = cells.reshape(len(arrival), across[0], BLOCK, across[1], BLOCK)
    return np.asarray(blocks.min(axis=(2, 4)))


def _vehicle_row(track: TrackState) -> list[float]:
    """Return a row of :class:`~companion.kernels.arrays.Game`'s vehicles."""
    kind = PASSES_BY if track.flies_on else FLIES if track.is_airborne else DRIVES
    nearer = DEVIATIONS * deviations(track)[0]
    reach = track.max_threat_radius_m
    return [*track.position_enu_m, track.stamp_s, track.speed_max_m_s, reach, nearer, kind]
