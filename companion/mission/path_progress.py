"""Where the aircraft is along a path, and where it will be on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.types.path import Path

MIN_ROWS = 3


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
        wind_enu_m_s=path.wind_enu_m_s,
    )
