"""A timed path of the aircraft."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from companion.frames import FloatArray, speed_made_good

SLOWS_M_S2 = 1.0  # Deceleration with the throttle closed; the simulated aircraft has 1.3.
RUN_ON_STEP_M = 25.0
FASTER_M_S = 0.5  # A smaller excess of airspeed decays by itself.


@dataclass(frozen=True, slots=True)
class Path:
    """Waypoints with times, as the planner's tree holds them.

    Parameters
    ----------
    times_s : ndarray, shape (N,)
        Clock reading of arrival at each waypoint [s].
    positions_enu_m : ndarray, shape (N, 3)
        East, north, up [m].
    courses_rad : ndarray, shape (N,)
        Course clockwise from north, in [0, 2π) [rad].
    climb_angles_rad : ndarray, shape (N,)
        Flight-path angle, positive up [rad].
    speeds_m_s : ndarray, shape (N,)
        Airspeed [m/s].
    position_covariances_m2 : ndarray, shape (N, 3, 3)
        Covariance of the true position about the waypoint, by LQG-MP [m²].
    collision_free : ndarray, shape (N,)
        Lower bound of p_c at each waypoint.
    threat_levels : ndarray, shape (N,)
        TI at each waypoint, in [0, 1].
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north, for which the times are computed [m/s].
    """

    times_s: FloatArray
    positions_enu_m: FloatArray
    courses_rad: FloatArray
    climb_angles_rad: FloatArray
    speeds_m_s: FloatArray
    position_covariances_m2: FloatArray
    collision_free: FloatArray
    threat_levels: FloatArray
    wind_enu_m_s: tuple[float, float] = (0.0, 0.0)

    def __len__(self) -> int:
        return len(self.times_s)

    @property
    def duration_s(self) -> float:
        """Time from the first waypoint to the last [s]."""
        return float(self.times_s[-1] - self.times_s[0])

    @property
    def length_m(self) -> float:
        """Sum of the straight distances between waypoints [m]."""
        return float(np.linalg.norm(np.diff(self.positions_enu_m, axis=0), axis=1).sum())

    @property
    def travelled_m(self) -> FloatArray:
        """Level length of the path up to each row, shape (N,) [m]."""
        steps = np.linalg.norm(np.diff(self.positions_enu_m[:, :2], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def until(self, row: int) -> Path:
        """Return the path up to a row, including that row."""
        return replace(self, **{name: getattr(self, name)[: row + 1] for name in _ROWS})

    def since(self, row: int) -> Path:
        """Return the path from a row on."""
        return replace(self, **{name: getattr(self, name)[row:] for name in _ROWS})

    def followed_by(self, path: Path, *, shares_row: bool = True) -> Path:
        """Return this path and another; with ``shares_row`` its first row is the last row of this path."""
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(path, name)[shares_row:]]) for name in _ROWS
        }
        return replace(path, **joined)

    def rows(self) -> list[list[float]]:
        """Return rows ``[t_s, east_m, north_m, up_m, course_rad, climb_rad, speed_m_s]`` for JSON."""
        table = np.column_stack(
            [self.times_s, self.positions_enu_m, self.courses_rad, self.climb_angles_rad, self.speeds_m_s]
        )
        return [[round(float(value), 6) for value in row] for row in table]


_ROWS = tuple(entry.name for entry in fields(Path) if entry.name != "wind_enu_m_s")


def slowed_path(path: Path, airspeed_m_s: float) -> Path:
    """Return the path flown no faster than an airspeed commanded at its beginning.

    Parameters
    ----------
    path : Path
        Planned path. Its threat levels are kept, although the aircraft arrives later everywhere.
    airspeed_m_s : float
        True airspeed to which the aircraft slows down [m/s].
    """
    if float(path.speeds_m_s.max()) <= airspeed_m_s + FASTER_M_S:
        return path
    speeds, times = path.speeds_m_s.copy(), path.times_s.copy()
    for k in range(1, len(path)):
        length = float(np.linalg.norm(path.positions_enu_m[k] - path.positions_enu_m[k - 1]))
        still = math.sqrt(max(speeds[k - 1] ** 2 - 2.0 * SLOWS_M_S2 * length, 0.0))
        speeds[k] = min(speeds[k], max(airspeed_m_s, still))
        turned = math.remainder(path.courses_rad[k] - path.courses_rad[k - 1], 2.0 * math.pi)
        course, climb = path.courses_rad[k - 1] + 0.5 * turned, path.climb_angles_rad[k - 1 : k + 1].mean()
        was, now = (
            speed_made_good(course, rows[k - 1 : k + 1].mean() * math.cos(climb), path.wind_enu_m_s)
            for rows in (path.speeds_m_s, speeds)
        )
        times[k] = times[k - 1] + (path.times_s[k] - path.times_s[k - 1]) * was / now
    return replace(path, times_s=times, speeds_m_s=speeds)


def straight_path(
    after_s: FloatArray, begin_s: float, begin_enu_m: FloatArray, course_rad: float, airspeed_m_s: float, *,
    covariance_m2: FloatArray, threat_level: float, wind_enu_m_s: tuple[float, float],
) -> Path:  # fmt: skip
    """Return straight and level flight at an airspeed in wind.

    Parameters
    ----------
    after_s : ndarray, shape (N,)
        Time of each row after the beginning [s].
    begin_s : float
        Clock reading at the beginning [s].
    begin_enu_m : ndarray, shape (3,)
        Position at the beginning [m].
    course_rad : float
        Course clockwise from north [rad].
    airspeed_m_s : float
        Airspeed of all rows [m/s].
    covariance_m2 : ndarray, shape (3, 3)
        Covariance of the position of all rows [m²].
    threat_level : float
        Threat level of all rows.
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north [m/s].
    """
    count, along = len(after_s), np.array([math.sin(course_rad), math.cos(course_rad), 0.0])
    lengths_m = after_s * speed_made_good(course_rad, airspeed_m_s, wind_enu_m_s)
    return Path(
        times_s=begin_s + after_s,
        positions_enu_m=begin_enu_m + lengths_m[:, None] * along,
        courses_rad=np.full(count, course_rad),
        climb_angles_rad=np.zeros(count),
        speeds_m_s=np.full(count, airspeed_m_s),
        position_covariances_m2=np.repeat(covariance_m2[None], count, axis=0),
        collision_free=np.ones(count),
        threat_levels=np.full(count, threat_level),
        wind_enu_m_s=wind_enu_m_s,
    )


def run_on(path: Path, metres: float) -> Path:
    """Return the path followed by straight and level flight.

    Parameters
    ----------
    path : Path
        Planned path.
    metres : float
        Length of the straight flight, rounded up to a multiple of 25 m [m].
    """
    course, airspeed = float(path.courses_rad[-1]), float(path.speeds_m_s[-1])
    made_good = speed_made_good(course, airspeed, path.wind_enu_m_s)
    ahead = straight_path(
        np.arange(1.0 + math.ceil(metres / RUN_ON_STEP_M)) * RUN_ON_STEP_M / made_good,
        float(path.times_s[-1]), path.positions_enu_m[-1], course, airspeed,
        covariance_m2=path.position_covariances_m2[-1], threat_level=float(path.threat_levels[-1]),
        wind_enu_m_s=path.wind_enu_m_s,
    )  # fmt: skip
    return path.followed_by(ahead)
