"""Ground speeds on the edges of a path, in a wind of known uncertainty.

Plain NumPy, like the rest of the checker; the module shares nothing with the planner.
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
    """Ground speeds on the edges of a path of N rows, (N - 1,) each.

    ``most`` and ``least`` (N - 1,) are the largest and the least ratio to the airspeed. ``fastest_m_s``
    (N - 1,) is the ground speed for turns and climbs, ``level_m_s`` (N - 1,) the horizontal part of the
    airspeed.

    They hold in the wind, within one standard deviation of the estimate, in which the path is easiest to fly:
    an estimate that changes by that much does not make a path impossible.
    """

    most: FloatArray
    least: FloatArray
    fastest_m_s: FloatArray
    level_m_s: FloatArray
    is_windy: bool


def ground_speeds(path: Path, edges: Edges, wind: Wind) -> GroundSpeeds:
    """Return the ground speeds at start, middle and end of each edge, by the wind triangle.

    Parameters
    ----------
    path : Path
        The path.
    edges : Edges
        The edges of the path.
    wind : Wind
        The wind as stated.
    """
    climbs = np.arctan2(edges.rises_m, edges.lengths_m)
    level = 0.5 * (path.speeds_m_s[:-1] + path.speeds_m_s[1:]) * np.cos(climbs)
    courses = path.courses_rad[:-1] + edges.turns_rad * np.array([[0.0], [0.5], [1.0]])
    speeds = _speed_made_good(courses, level, wind.east_m_s, wind.north_m_s)
    return GroundSpeeds(
        most=(speeds.max(axis=0) + wind.std_m_s) / level,
        least=np.maximum(speeds.min(axis=0) - wind.std_m_s, 0.0) / level,
        fastest_m_s=speeds.max(axis=0) - wind.std_m_s,
        level_m_s=level,
        is_windy=wind.east_m_s != 0.0 or wind.north_m_s != 0.0,
    )


def tailwinds(legs_enu_m: FloatArray, airspeed_m_s: float, wind_enu_m_s: tuple[float, float]) -> FloatArray:
    """Return what the wind adds to the ground speed along straight legs.

    Parameters
    ----------
    legs_enu_m : ndarray, shape (K, 3)
        Vectors from the start to the end of each leg [m].
    airspeed_m_s : float
        Airspeed on the legs [m/s].
    wind_enu_m_s : tuple of float
        Velocity of the air over the ground, east and north [m/s].

    Returns
    -------
    ndarray, shape (K,)
        Added ground speed, negative against the wind [m/s].
    """
    courses = np.arctan2(legs_enu_m[:, 0], legs_enu_m[:, 1])
    level = airspeed_m_s * np.cos(np.arctan2(legs_enu_m[:, 2], np.hypot(legs_enu_m[:, 0], legs_enu_m[:, 1])))
    return _speed_made_good(courses, level, *wind_enu_m_s) - level


def slope_over_ground(
    angle_rad: float, airspeeds_m_s: FloatArray | float, gained_m_s: FloatArray
) -> FloatArray:
    """Return the steepest slope over the ground for the steepest climb angle in still air.

    Against the wind the slope stays the angle in still air: the steeper slope that is possible is not used.

    Parameters
    ----------
    angle_rad : float
        Largest angle of a climb or a descent in still air, positive [rad].
    airspeeds_m_s : ndarray, shape (K,)
        Airspeeds, or one number for all [m/s].
    gained_m_s : ndarray, shape (K,)
        Horizontal ground speed less horizontal airspeed [m/s].

    Returns
    -------
    ndarray, shape (K,)
        Slopes, positive [rad].
    """
    level = airspeeds_m_s * np.cos(angle_rad) + np.maximum(gained_m_s, 0.0)
    slopes: FloatArray = np.arctan2(airspeeds_m_s * np.sin(angle_rad), level)
    return slopes


def _speed_made_good(
    courses: FloatArray, level_m_s: FloatArray, east_m_s: float, north_m_s: float
) -> FloatArray:
    """Return ground speeds by the wind triangle, with the shape of ``courses``: (M, K) or (K,).

    ``courses`` (M, K) [rad], ``level_m_s`` (K,) horizontal airspeeds [m/s].
    """
    along = east_m_s * np.sin(courses) + north_m_s * np.cos(courses)
    across = east_m_s * np.cos(courses) - north_m_s * np.sin(courses)
    speeds: FloatArray = along + np.sqrt(np.maximum(level_m_s**2 - across**2, 0.0))
    return speeds
