"""Planned and flown paths for ground stations and maps: lines beside the places of their mission."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
import shapely

from companion.config import MissionConfig
from companion.frames import FloatArray
from companion.types.path import Path
from companion.types.record import FlightRecord

BESIDE_M = 2.0  # The waypoints of a plan lead at most this far beside the path, and above or below it.


@dataclass(frozen=True, slots=True)
class PathLine:
    """A line with a name.

    Parameters
    ----------
    name : str
        What the line is.
    latitudes_deg, longitudes_deg, heights_amsl_m : ndarray, shape (N,)
        Places of the line [°, °, m above mean sea level].
    times : tuple of str
        UTC at each place, in ISO 8601; none where no time of day is known.
    """

    name: str
    latitudes_deg: FloatArray
    longitudes_deg: FloatArray
    heights_amsl_m: FloatArray
    times: tuple[str, ...] = ()

    def coordinates(self) -> Iterator[tuple[float, float, float]]:
        """Yield longitude, latitude [°] and height above mean sea level [m] of each place."""
        rows = zip(self.longitudes_deg, self.latitudes_deg, self.heights_amsl_m, strict=True)
        for longitude, latitude, height in rows:
            yield round(float(longitude), 9), round(float(latitude), 9), round(float(height), 3)


def line_of(
    mission: MissionConfig, name: str, positions_enu_m: FloatArray, times_utc_s: Sequence[float] = ()
) -> PathLine:
    """Return a line in degrees.

    Parameters
    ----------
    mission : MissionConfig
        The mission file, for its origin.
    name : str
        What the line is.
    positions_enu_m : ndarray, shape (N, 3)
        East, north, up of the origin [m].
    times_utc_s : sequence of float
        Seconds since 1970 in UTC at each place, or none.
    """
    east, north, up = positions_enu_m.T
    latitudes, longitudes = mission.frame.places_from_local(east, north)
    times = tuple(
        datetime.fromtimestamp(float(stamp), UTC).isoformat(timespec="milliseconds") for stamp in times_utc_s
    )
    return PathLine(name, latitudes, longitudes, up + mission.frame.altitude_amsl_m, times)


def flown_lines(mission: MissionConfig, record: FlightRecord) -> tuple[PathLine, ...]:
    """Return the flown path as a line; no line where fewer than two places are known."""
    rows = record.flown[np.isfinite(record.flown[:, :4]).all(axis=1)]
    times = () if record.epoch_s is None else (rows[:, 0] + record.epoch_s).tolist()
    return (line_of(mission, "flown path", rows[:, 1:4], times),) if len(rows) > 1 else ()


def mission_lines(mission: MissionConfig, record: FlightRecord) -> tuple[PathLine, ...]:
    """Return the missions of the service as lines, in the order in which they were flown."""
    return tuple(
        line_of(mission, f"mission {number}: {uploaded.reason}", uploaded.positions_enu_m)
        for number, uploaded in enumerate(record.missions, 1)
        if len(uploaded.positions_enu_m) > 1
    )


def waypoints_of_plan(path: Path) -> FloatArray:
    """Return the fewest places of a path between which straight lines stay near to it.

    Parameters
    ----------
    path : Path
        The path.

    Returns
    -------
    ndarray, shape (K, 3)
        East, north, up of the origin [m].
    """
    east, north, up = path.positions_enu_m.T
    along = np.append(0.0, np.cumsum(np.hypot(np.diff(east), np.diff(north))))
    number = np.arange(len(path))
    kept = {0, len(path) - 1}
    for line in (
        (east, north),
        (along, up),
    ):  # From above and from the side; the third column is carried along.
        simple = shapely.simplify(shapely.LineString(np.column_stack([*line, number])), 0.5 * BESIDE_M)
        kept.update(int(row) for row in shapely.get_coordinates(simple, include_z=True)[:, 2])
    return np.asarray(path.positions_enu_m[sorted(kept)])
