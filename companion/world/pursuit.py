"""What moving threats could do if they knew the path, in kernel form (paper 2.3)."""

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
from companion.world.pursuer_trees import deviations

CELLS = 256  # along the longer side of the bounds
CELL_MIN_M = 5.0
DEVIATIONS = 2.0  # of a track's place, by which it is taken to be nearer


def pursuit_game(
    tracks: Sequence[TrackState], walls: Obstacles, plane_up_m: float | None, bounds: Sequence[float],
    slack_s: float,
) -> Game:  # fmt: skip
    """Earliest arrivals of all moving threats, and the walls that hide from them.

    Parameters
    ----------
    tracks : sequence of TrackState
        Moving threats.
    walls : Obstacles
        What hides, and what they drive round.
    plane_up_m : float or None
        In the plane: the flight level [m].
    bounds : sequence of float
        East and north, each low and high [m], which DTs do not leave.
    slack_s : float
        By which a place has to be passed before it is under threat [s].
    """
    west, east, south, north = bounds[:4]
    spacing = max(CELL_MIN_M, max(east - west, north - south) / CELLS)
    shape = (int((east - west) / spacing) + 2, int((north - south) / spacing) + 2) if tracks else (1, 1)
    game = Game(
        vehicles=np.array([_vehicle_row(track) for track in tracks], dtype=np.float64).reshape(-1, 8),
        arrival=np.full((len(tracks), *shape), math.inf),
        least=np.empty((len(tracks), 0, 0)),
        tops=np.full(shape, -math.inf),
        lowest=math.inf,
        grid=np.array([west, south, spacing]),
        is_plane=0 if plane_up_m is None else 1,
        slack=slack_s,
    )
    if any(vehicle[7] == DRIVES for vehicle in game.vehicles):
        fill_tops(walls, math.nan if plane_up_m is None else plane_up_m, game.grid, game.tops)
    for d, vehicle in enumerate(game.vehicles):
        if vehicle[7] == DRIVES:
            fill_arrivals(vehicle[0], vehicle[1], game, d)
    lowest = game.tops.min(where=game.tops > -math.inf, initial=math.inf)
    return game._replace(least=_least_of_blocks(game.arrival), lowest=float(lowest))


def _least_of_blocks(arrival: FloatArray) -> FloatArray:
    """The earliest in each block of cells.

    Parameters
    ----------
    arrival : ndarray, shape (D, NX, NY)
        When a threat can be at each cell of the grid [s].

    Returns
    -------
    ndarray, shape (D, BX, BY)
        When it can be in any of the block's [s].
    """
    across = [-(-n // BLOCK) for n in arrival.shape[1:]]
    cells = np.full((len(arrival), *(BLOCK * n for n in across)), math.inf)
    cells[:, : arrival.shape[1], : arrival.shape[2]] = arrival
    blocks = cells.reshape(len(arrival), across[0], BLOCK, across[1], BLOCK)
    return np.asarray(blocks.min(axis=(2, 4)))


def _vehicle_row(track: TrackState) -> list[float]:
    """Row of :class:`~companion.kernels.arrays.Game`'s vehicles."""
    kind = PASSES_BY if track.flies_on else FLIES if track.is_airborne else DRIVES
    nearer = DEVIATIONS * deviations(track)[0]
    reach = track.max_threat_radius_m
    return [*track.position_enu_m, track.stamp_s, track.speed_max_m_s, reach, nearer, kind]
