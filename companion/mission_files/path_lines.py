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

BESIDE_M = 2.0  # The waypoints of a plan lead at most this far beside the path, on the map.


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


def lines_of_plan(mission: MissionConfig, path: Path) -> tuple[PathLine, ...]:
    """Return a plan's path as a line; it begins at no time of day."""
    return (line_of(mission, "planned path", path.positions_enu_m),)


def lines_of_flight(mission: MissionConfig, record: FlightRecord) -> tuple[PathLine, ...]:
    """Return the flown path, and the missions of the service in the order in which they were flown."""
    rows = record.flown[np.isfinite(record.flown[:, :4]).all(axis=1)]
    times = () if record.epoch_s is None else (rows[:, 0] + record.epoch_s).tolist()
    lines = [line_of(mission, "flown path", rows[:, 1:4], times)] if len(rows) > 1 else []
    for number, uploaded in enumerate(record.missions, 1):
        if len(uploaded.positions_enu_m) > 1:
            name = f"mission {number}: {uploaded.reason}"
            lines.append(line_of(mission, name, uploaded.positions_enu_m))
    return tuple(lines)


def waypoints_of_plan(path: Path) -> FloatArray:
    """Return the fewest places of a path between which straight lines stay near to it, shape (K, 3) [m].

    Parameters
    ----------
    path : Path
        The path.

    Returns
    -------
    ndarray, shape (K, 3)
        East, north, up of the origin [m].
    """
    line = shapely.LineString(path.positions_enu_m)
    return np.array(shapely.simplify(line, BESIDE_M).coords)
