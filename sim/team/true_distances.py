"""True positions of a team's aircraft, and the pairs that lost their separation.

It shares no code with the plans' comparison: it looks at places, four times a second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from companion.frames import FloatArray
from .candidates import Circling
from .scenes import Scene

STEP_S = 0.25
TOGETHER = 8  # Instants at once for which pairs that are near each other are sought.


@dataclass(frozen=True, slots=True)
class Flown:
    """The flight of one aircraft: a circle, and perhaps a way into another.

    Parameters
    ----------
    circling : Circling
        The first circle.
    way : ndarray, shape (M, 4), or None
        Time [s], east, north, up [m] from where it left the circle to the centre of the last one.
    """

    circling: Circling
    way: FloatArray | None


def true_places(scene: Scene, flown: Flown, times_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return where an aircraft was, off its plan by up to nine tenths of its tolerance.

    Parameters
    ----------
    scene : Scene
        The team.
    flown : Flown
        What it flew.
    times_s : ndarray, shape (T,)
        Times [s].
    rng : Generator
        Source of chance.

    Returns
    -------
    ndarray, shape (T, 3)
        East, north, up [m].
    """
    places = _circle(
        flown.circling.centre, flown.circling.angle_rad, flown.circling.rate_rad_s * times_s, scene
    )
    if flown.way is not None:
        way, centre = flown.way[:-1], flown.way[-1, 1:]
        on_way, after = times_s >= way[0, 0], times_s >= way[-1, 0]
        for column in range(3):
            places[on_way, column] = np.interp(times_s[on_way], way[:, 0], way[:, 1 + column])
        entry = way[-1, 1:3] - centre[:2]
        turned = flown.circling.rate_rad_s * (times_s[after] - way[-1, 0])
        places[after] = _circle(centre, math.atan2(entry[1], entry[0]), turned, scene)
    phases, rates = rng.uniform(0.0, 2.0 * np.pi, 3), rng.uniform(0.05, 0.3, 3)
    across, heading, height = np.sin(rates * times_s[:, None] + phases).T
    off = 0.9 * scene.tolerance_m * across
    turn = 2.0 * np.pi * heading
    wander = [off * np.cos(turn), off * np.sin(turn), 0.9 * scene.tolerance_up_m * height]
    return np.asarray(places + np.column_stack(wander))


def _circle(centre: FloatArray, angle_rad: float, turned_rad: FloatArray, scene: Scene) -> FloatArray:
    """Return places on a circle about ``centre`` (3,) after turns of ``turned_rad`` (T,), (T, 3) [m]."""
    angles = angle_rad + turned_rad
    flat = scene.radius_m * np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    return np.asarray(centre + flat)


def pairs_lost(scene: Scene, places: FloatArray) -> set[tuple[int, int]]:
    """Return the pairs that were too near each other both horizontally and vertically at some instant.

    Parameters
    ----------
    scene : Scene
        The team.
    places : ndarray, shape (N, T, 3)
        East, north, up of each aircraft at each instant [m].
    """
    found: set[tuple[int, int]] = set()
    apart_m, up_m = scene.settings.apart_m, scene.settings.apart_up_m
    for first in range(0, places.shape[1], TOGETHER):
        part = places[:, first : first + TOGETHER]
        # Nobody moves farther in these instants than the reach, so that all other pairs stay apart.
        reach_m = 2.0 * float(np.hypot(*(part - part[:, :1])[:, :, :2].T).max())
        near = cKDTree(part[:, 0, :2]).query_pairs(apart_m + reach_m, output_type="ndarray")
        between = part[near[:, 0]] - part[near[:, 1]]
        is_lost = (np.hypot(between[..., 0], between[..., 1]) < apart_m) & (abs(between[..., 2]) < up_m)
        found |= {(int(one), int(other)) for one, other in near[is_lost.any(axis=1)]}
    return found
