"""How fast the edges of a path are flown over the ground, in a wind that is known so well.

Plain NumPy, as all of the checker; shares nothing with the planner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.assurance.edges import Edges
from companion.frames import FloatArray
from companion.types.path import Path


@dataclass(frozen=True, slots=True)
class Wind:
    """Velocity of the air over the ground and its standard deviation [m/s]."""

    east_m_s: float
    north_m_s: float
    std_m_s: float


@dataclass(frozen=True, slots=True)
class GroundSpeeds:
    """How fast edges are flown over the ground, (N - 1,) each.

    ``most``, ``least`` (N - 1,) in airspeeds, as far as the wind is known; ``fastest_m_s`` (N - 1,) in the
    wind as it is told; ``level_m_s`` (N - 1,) the level part of the airspeed.
    """

    most: FloatArray
    least: FloatArray
    fastest_m_s: FloatArray
    level_m_s: FloatArray
    is_windy: bool


def ground_speeds(path: Path, edges: Edges, wind: Wind) -> GroundSpeeds:
    """Speeds over the ground at beginning, middle and end of each edge, by the triangle of velocities.

    Parameters
    ----------
    path : Path
        As planned.
    edges : Edges
        What its rows say of its edges.
    wind : Wind
        As it is told.
    """
    climbs = np.arctan2(edges.rises_m, edges.lengths_m)
    level = 0.5 * (path.speeds_m_s[:-1] + path.speeds_m_s[1:]) * np.cos(climbs)
    courses = path.courses_rad[:-1] + edges.turns_rad * np.array([[0.0], [0.5], [1.0]])
    speeds = _made_good(courses, level, wind.east_m_s, wind.north_m_s)
    return GroundSpeeds(
        most=(speeds.max(axis=0) + wind.std_m_s) / level,
        least=np.maximum(speeds.min(axis=0) - wind.std_m_s, 0.0) / level,
        fastest_m_s=speeds.max(axis=0),
        level_m_s=level,
        is_windy=wind.east_m_s != 0.0 or wind.north_m_s != 0.0,
    )


def tailwinds(legs_enu_m: FloatArray, airspeed_m_s: float, wind_enu_m_s: tuple[float, float]) -> FloatArray:
    """What the wind adds to the speed over the ground along straight legs.

    Parameters
    ----------
    legs_enu_m : ndarray, shape (K, 3)
        From the beginning to the end of each [m].
    airspeed_m_s : float
        At which they are flown [m/s].
    wind_enu_m_s : tuple of float
        Velocity of the air over the ground, east and north [m/s].

    Returns
    -------
    ndarray, shape (K,)
        Negative against the wind [m/s].
    """
    courses = np.arctan2(legs_enu_m[:, 0], legs_enu_m[:, 1])
    level = airspeed_m_s * np.cos(np.arctan2(legs_enu_m[:, 2], np.hypot(legs_enu_m[:, 0], legs_enu_m[:, 1])))
    return _made_good(courses, level, *wind_enu_m_s) - level


def slope_over_ground(
    angle_rad: float, airspeeds_m_s: FloatArray | float, gained_m_s: FloatArray
) -> FloatArray:
    """Steepest flight over the ground, of an angle that is the steepest in still air.

    Against the wind it stays that angle: how much steeper could be flown is not made use of.

    Parameters
    ----------
    angle_rad : float
        Positive, of a climb or a descent in still air [rad].
    airspeeds_m_s : ndarray, shape (K,)
        At which it is flown; one number for all [m/s].
    gained_m_s : ndarray, shape (K,)
        By how much the level speed over the ground exceeds that in the air [m/s].

    Returns
    -------
    ndarray, shape (K,)
        Positive [rad].
    """
    level = airspeeds_m_s * np.cos(angle_rad) + np.maximum(gained_m_s, 0.0)
    slopes: FloatArray = np.arctan2(airspeeds_m_s * np.sin(angle_rad), level)
    return slopes


def _made_good(courses: FloatArray, level_m_s: FloatArray, east_m_s: float, north_m_s: float) -> FloatArray:
    """Speeds over the ground by the triangle of velocities, shape (M, K), or (K,) as courses are.

    ``courses`` (M, K), ``level_m_s`` (K,), level airspeeds; [rad], [m/s].
    """
    along = east_m_s * np.sin(courses) + north_m_s * np.cos(courses)
    across = east_m_s * np.cos(courses) - north_m_s * np.sin(courses)
    speeds: FloatArray = along + np.sqrt(np.maximum(level_m_s**2 - across**2, 0.0))
    return speeds
