"""The ground as an ArduPilot stores it: whole metres at posts of its own grid, bilinear in between.

Its grid begins anew at each whole degree, and its posts come in blocks of 28 by 32, of which neighbours share
the last four. It asks for a block's heights by TERRAIN_REQUEST. Posts may lie farther apart than those of the
map, so that the autopilot's ground misses the tops of narrow ridges.

References
----------
ArduPilot ``AP_Terrain::calculate_grid_info``, ``AP_Terrain::height_amsl``, ``Location::offset_latlng``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from typing import NamedTuple

import numpy as np

from companion.frames import M_PER_E7, FloatArray, LocalFrame, longitude_scale, offset_places
from companion.kernels.arrays import FollowedGround, IntArray
from companion.world.ground.bilinear import bilinear

BLOCK_POSTS, BLOCK_STEPS = (28, 32), (24, 28)  # Posts of a block, and from block to block; north and east.
KEY_PLACES = np.array([10**11, 10**8, 10**4, 1])  # They make one number of a block's degrees and numbers.
NODES_A_POST = 4  # Nodes of the local frame's grid from post to post.
BEYOND_M = 1_000.0  # The ground is known up to this distance beyond the bounds.
Heights = Callable[[FloatArray, FloatArray], FloatArray]


class ClimbAhead(NamedTuple):
    """The way in which an ArduPilot climbs ahead of rising ground.

    Parameters
    ----------
    distance_m : float
        Distance along the leg that it looks ahead, TERRAIN_LOOKAHD [m].
    climb_rate_m_s : float
        Rate of rise of the ground from which it climbs ahead, half of TECS_CLMB_MAX [m/s].
    """

    distance_m: float
    climb_rate_m_s: float


class AutopilotGround:
    """The ground over which an ArduPilot keeps heights.

    Parameters
    ----------
    heights : callable
        Takes latitudes and longitudes (N,) [deg]; returns heights above mean sea level (N,) [m], not a number
        where they are unknown.
    frame : LocalFrame
        The local frame.
    bounds : sequence of float
        East and north, each low and high [m].
    spacing_m : float
        From post to post: TERRAIN_SPACING [m].

    Attributes
    ----------
    followed : FollowedGround
        The same for kernels, on a grid of the local frame; without looking ahead.
    """

    def __init__(
        self, heights: Heights, frame: LocalFrame, bounds: Sequence[float], spacing_m: float
    ) -> None:
        side = spacing_m / NODES_A_POST
        west, south = bounds[0] - BEYOND_M, bounds[2] - BEYOND_M
        east = np.arange(west, bounds[1] + BEYOND_M + side, side)
        north = np.arange(south, bounds[3] + BEYOND_M + side, side)
        places = frame.places_from_local(*(at.ravel() for at in np.meshgrid(east, north, indexing="ij")))
        up = stored_heights(heights, *places, spacing_m).reshape(len(east), len(north))
        known = up[np.isfinite(up)]
        up = np.nan_to_num(up, nan=float(known.min()) if len(known) else frame.altitude_amsl_m)
        self.followed = FollowedGround(
            up - frame.altitude_amsl_m, np.array([west, south, side]), float(spacing_m), 0.0, 0.0
        )

    def looking(self, look_ahead: ClimbAhead) -> AutopilotGround:
        """Return the same ground for an autopilot that climbs ahead of rising ground."""
        other = copy(self)
        distance_m, climb_rate_m_s = look_ahead
        other.followed = self.followed._replace(look_ahead=distance_m, climb_rate=climb_rate_m_s)
        return other

    def up_m(self, places_enu_m: FloatArray) -> FloatArray:
        """Return the height of the ground below places, (N,) [m].

        Parameters
        ----------
        places_enu_m : ndarray, shape (N, 2) or (N, 3)
            Places; beyond the grid the ground of its edge counts [m].
        """
        west, south, side = self.followed.grid
        return bilinear(
            self.followed.up, (places_enu_m[:, 0] - west) / side, (places_enu_m[:, 1] - south) / side
        )


def stored_heights(
    heights: Heights, latitude_deg: FloatArray, longitude_deg: FloatArray, spacing_m: float
) -> FloatArray:
    """Return the heights that an ArduPilot computes from its posts.

    Parameters
    ----------
    heights : callable
        As in :class:`AutopilotGround`.
    latitude_deg, longitude_deg : ndarray, shape (N,)
        Places, WGS84 [deg].
    spacing_m : float
        From post to post [m].

    Returns
    -------
    ndarray, shape (N,)
        Heights above mean sea level [m]; not a number where one of the four posts is unknown.
    """
    lat, lon = np.round(latitude_deg, 7), np.round(longitude_deg, 7)
    ref_lat, ref_lon = np.floor(lat), np.floor(lon)
    north = 1e7 * (lat - ref_lat) * M_PER_E7 / spacing_m
    east = 1e7 * (lon - ref_lon) * M_PER_E7 * longitude_scale(0.5 * (lat + ref_lat)) / spacing_m
    rows, columns = north.astype(np.int64), east.astype(np.int64)
    keys = np.stack([ref_lat, ref_lon, rows // BLOCK_STEPS[0], columns // BLOCK_STEPS[1]]).astype(np.int64)
    found = np.empty(len(lat))
    _, firsts, which = np.unique(KEY_PLACES @ keys, return_index=True, return_inverse=True)
    members = np.split(np.argsort(which, kind="stable"), np.cumsum(np.bincount(which))[:-1])
    for block, inside in zip(keys[:, firsts].T, members, strict=True):
        posts = _block(heights, block, spacing_m)
        within = north[inside] - BLOCK_STEPS[0] * block[2], east[inside] - BLOCK_STEPS[1] * block[3]
        found[inside] = bilinear(posts, *within)
    return found


def _block(heights: Heights, block: IntArray, spacing_m: float) -> FloatArray:
    """Return heights (28, 32) of a block's posts, rows to the north and columns to the east.

    ``block`` (4,) holds its whole degrees and its number in them.
    """
    ref_lat, ref_lon, row, column = (int(number) for number in block)
    away = np.array([[row * BLOCK_STEPS[0] * spacing_m], [column * BLOCK_STEPS[1] * spacing_m]])
    corner = offset_places(ref_lat, ref_lon, *away)
    lat, lon = (float(np.round(degrees[0], 7)) for degrees in corner)
    rows, columns = np.meshgrid(*map(np.arange, BLOCK_POSTS), indexing="ij")
    up = heights(*offset_places(lat, lon, spacing_m * rows.ravel(), spacing_m * columns.ravel()))
    return np.asarray(np.round(up).reshape(BLOCK_POSTS))
