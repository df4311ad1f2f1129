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
    along = wind.east_m_s * np.sin(courses) + wind.north_m_s * np.cos(courses)
    across = wind.east_m_s * np.cos(courses) - wind.north_m_s * np.sin(courses)
    speeds = along + np.sqrt(np.maximum(level**2 - across**2, 0.0))
    return GroundSpeeds(
        most=(speeds.max(axis=0) + wind.std_m_s) / level,
        least=np.maximum(speeds.min(axis=0) - wind.std_m_s, 0.0) / level,
        fastest_m_s=speeds.max(axis=0),
        level_m_s=level,
        is_windy=wind.east_m_s != 0.0 or wind.north_m_s != 0.0,
    )
