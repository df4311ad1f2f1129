"""Where the aircraft is along a path, and where it will be on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray, wrapped_angle
from companion.types.path import Path

MIN_ROWS = 3
TURN_STEP_RAD = math.radians(15.0)
TURN_MAX_RAD = math.radians(110.0)
SLIGHT_TURN_RAD = math.radians(45.0)


@dataclass(frozen=True, slots=True)
class Progress:
    """A point of a path.

    Parameters
    ----------
    row : int
        The path's row before it.
    share : float
        How far towards the next row, in [0, 1].
    off_track_m : float
        Distance of the aircraft from it [m].
    """

    row: int
    share: float
    off_track_m: float


def progress_on(
    path: Path, position_enu_m: tuple[float, float, float], from_row: int = 0, num_rows: int | None = None
) -> Progress:
    """Nearest point of a path at or after a row.

    ``num_rows`` bounds the search: a path may come by the same place again, and the nearest point of
    all of it may be minutes ahead.
    """
    from_row = min(from_row, len(path) - 2)
    last = len(path) - 1 if num_rows is None else min(len(path) - 1, from_row + num_rows)
    points = path.positions_enu_m[from_row : last + 1]
    start, along = points[:-1], np.diff(points, axis=0)
    square = np.maximum((along**2).sum(axis=1), 1e-9)
    offset = np.asarray(position_enu_m) - start
    share = np.clip((offset * along).sum(axis=1) / square, 0.0, 1.0)
    away = np.linalg.norm(offset - share[:, None] * along, axis=1)
    best = int(np.argmin(away))
    return Progress(from_row + best, float(share[best]), float(away[best]))


def distance_along(path: Path, progress: Progress) -> float:
    """Length of the path flown at a point of it, over the ground [m]."""
    steps = np.hypot(*np.diff(path.positions_enu_m[: progress.row + 2, :2], axis=0).T)
    return float(steps[:-1].sum() + progress.share * steps[-1])


def time_at(path: Path, progress: Progress) -> float:
    """The path's own time at a point of it [s]."""
    t0, t1 = path.times_s[progress.row], path.times_s[progress.row + 1]
    return float(t0 + progress.share * (t1 - t0))


def rest_of_path(path: Path, path_time_s: float, now_s: float) -> Path | None:
    """What is left of a path from its first row at or after one of its times on.

    Restamped so that the path's time ``path_time_s`` falls on the clock's ``now_s``. It begins at a row,
    since only rows lie exactly on turns. None where fewer than three rows are left.
    """
    first = int(np.searchsorted(path.times_s, path_time_s, side="left"))
    if len(path) - first < MIN_ROWS:
        return None
    return Path(
        times_s=path.times_s[first:] - path_time_s + now_s,
        positions_enu_m=path.positions_enu_m[first:],
        courses_rad=path.courses_rad[first:],
        climb_angles_rad=path.climb_angles_rad[first:],
        speeds_m_s=path.speeds_m_s[first:],
        position_covariances_m2=path.position_covariances_m2[first:],
        collision_free=path.collision_free[first:],
        threat_levels=path.threat_levels[first:],
    )


def way_to(
    position_enu_m: tuple[float, float, float], course_rad: float, target_enu_m: FloatArray, radius_m: float
) -> FloatArray | None:
    """How an aircraft sent to a point flies there: a turn towards it, and then straight.

    Parameters
    ----------
    position_enu_m : tuple of float
        Where it is [m].
    course_rad : float
        Where it is heading, clockwise from north.
    target_enu_m : ndarray, shape (3,)
        Where it is sent [m].
    radius_m : float
        Radius of the aircraft's turns [m].

    Returns
    -------
    ndarray, shape (K, 3), or None
        Corners of the way, both ends among them; None where the point lies inside the turn, or so far
        round that it is not told to which side the aircraft would turn.
    """
    here, points, turned = np.asarray(position_enu_m, dtype=np.float64), [], 0.0
    points.append(here)
    away = np.asarray(target_enu_m) - here
    turn = wrapped_angle(math.atan2(away[0], away[1]) - course_rad)
    if abs(turn) > TURN_MAX_RAD:
        return None
    if abs(turn) <= SLIGHT_TURN_RAD and float(np.hypot(away[0], away[1])) < radius_m:
        return np.vstack([here, target_enu_m])  # it counts as reached beside it
    side = math.copysign(1.0, turn)
    while True:
        away = np.asarray(target_enu_m) - here
        left = side * wrapped_angle(math.atan2(away[0], away[1]) - course_rad)
        if abs(left) <= TURN_STEP_RAD or float(np.hypot(away[0], away[1])) < 1.0:
            return np.vstack([*points, target_enu_m])
        if turned > 2.0 * math.pi:
            return None
        middle = course_rad + side * 0.5 * TURN_STEP_RAD
        chord = 2.0 * radius_m * math.sin(0.5 * TURN_STEP_RAD)
        here = here + chord * np.array([math.sin(middle), math.cos(middle), 0.0])
        course_rad += side * TURN_STEP_RAD
        turned += TURN_STEP_RAD
        points.append(here)
