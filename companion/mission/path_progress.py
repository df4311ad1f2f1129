"""The aircraft's progress on a path, and the rest of the path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.types.path import Path

MIN_ROWS = 3  # A rest of a path with fewer rows is too short to fly.


@dataclass(frozen=True, slots=True)
class Progress:
    """A point of a path.

    Parameters
    ----------
    row : int
        The path's row before the point.
    share : float
        Position between that row and the next, in [0, 1].
    off_track_m : float
        Distance of the aircraft from the point [m].
    """

    row: int
    share: float
    off_track_m: float


def progress_on(
    path: Path, position_enu_m: tuple[float, float, float], from_row: int = 0, num_rows: int | None = None
) -> Progress:
    """Return the point of a path nearest to a position, at or after a row.

    ``num_rows`` limits the search: a path may pass the same place again, and the nearest point of the whole
    path may be minutes ahead.
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
    """Return the path's horizontal length up to a point [m]."""
    steps = np.hypot(*np.diff(path.positions_enu_m[: progress.row + 2, :2], axis=0).T)
    return float(steps[:-1].sum() + progress.share * steps[-1])


def time_at(path: Path, progress: Progress) -> float:
    """Return the path's time at a point [s]."""
    t0, t1 = path.times_s[progress.row], path.times_s[progress.row + 1]
    return float(t0 + progress.share * (t1 - t0))


def rest_of_path(path: Path, path_time_s: float, now_s: float) -> Path | None:
    """Return the rest of a path, from its first row at or after one of its times.

    The rest is restamped so that the path's time ``path_time_s`` becomes the clock's ``now_s``. It begins at
    a row, because only rows lie exactly on turns. The result is None if fewer than three rows are left.
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
