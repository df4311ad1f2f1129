"""The check that a glide, and the circle before a field, stay above the ground.

A glide ends on the ground, so that no fixed distance can be kept from it. Far from its end it keeps a margin,
and more for the height that it has lost, because the ratio is not known exactly. Near its end it keeps half
of the height that it still has over the field: the ground before the field may lie half as high.
"""

from __future__ import annotations

import math

import numpy as np

from companion.assurance.surroundings.ground_heights import GroundHeights
from companion.frames import FloatArray
from companion.world.vehicle.glide import Glide

END_SHARE = 0.5  # Share of the glide's own height over its end that is kept over the ground before it.
FINAL_POINTS = 12  # Places at which a final is checked.
LEVEL_M = 12.0  # The ground of a place to come down on may differ by this much in height.
LEVEL_SIDES = 8  # Points about a place at which level ground is sought.


def is_glide_over_ground(
    ground: GroundHeights, glide: Glide, place_up_m: float, radius_m: float, margin_m: float,
    low_share: float = 0.0,
) -> bool:  # fmt: skip
    """Return whether a glide keeps its height over the ground as far as it is flown.

    Parameters
    ----------
    ground : GroundHeights
        The ground.
    glide : Glide
        The glide. Where it is lower than the place, it is not flown: the final has begun before.
    place_up_m : float
        Height of the place to come down on [m].
    radius_m : float
        The ground this near to the end of the glide is the place itself [m].
    margin_m : float
        Height over ground to keep far from the end; less if the glide begins lower [m].
    low_share : float
        Share of the lost height that is kept as well.
    """
    track = glide.track()
    along, up, below = ground.profile(track).T
    over, wanted = up - below, np.maximum(margin_m, low_share * (track[0, 2] - up))
    needed = np.minimum(np.minimum(wanted, END_SHARE * (up - place_up_m)), max(float(over[0]), 0.0))
    is_flown = (up > place_up_m) & (along[-1] - along > radius_m)
    return bool((over >= needed)[is_flown].all())


def is_circle_over_ground(
    ground: GroundHeights, ring_enu_m: FloatArray, place_enu_m: tuple[float, float, float], radius_m: float
) -> bool:
    """Return whether a circle before a place, and the finals from it, keep above the ground.

    Parameters
    ----------
    ground : GroundHeights
        The ground.
    ring_enu_m : ndarray, shape (K, 3)
        Points of the circle [m].
    place_enu_m : tuple of float
        Middle of the place to come down on [m].
    radius_m : float
        The ground this near to the middle is the place itself [m].
    """
    end = np.array(place_enu_m)
    share = np.linspace(0.0, 1.0, FINAL_POINTS, endpoint=False)[None, :, None]
    lines = ring_enu_m[:, None, :] + share * (end - ring_enu_m[:, None, :])
    points = lines.reshape(-1, 3)
    needed = END_SHARE * (points[:, 2] - end[2])
    is_before = np.hypot(*(points - end)[:, :2].T) > radius_m
    return bool((points[:, 2] - ground.up_m(points) >= needed)[is_before].all())


def is_level(ground: GroundHeights, place_enu_m: tuple[float, float, float], radius_m: float) -> bool:
    """Return whether the ground about a place is level enough to come down on.

    Parameters
    ----------
    ground : GroundHeights
        The ground.
    place_enu_m : tuple of float
        Middle of the place [m].
    radius_m : float
        Radius of the place [m].
    """
    angles = np.linspace(0.0, 2.0 * math.pi, LEVEL_SIDES, endpoint=False)
    around = np.array(place_enu_m[:2]) + radius_m * np.column_stack([np.sin(angles), np.cos(angles)])
    heights = np.append(ground.up_m(around), place_enu_m[2])
    return bool(heights.max() - heights.min() <= LEVEL_M)
