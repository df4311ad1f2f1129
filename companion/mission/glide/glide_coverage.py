"""From which seconds of a flight a field is within glide, and the stretches without any."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray, speed_made_good
from companion.mission.glide.landing_choice import (
    RESERVE_M,
    Begin,
    GlideOptions,
    LandingPlace,
    Wind,
    choice_for,
    choices,
)
from companion.types.path import Path
from companion.world.vehicle.glide import heading_of

# Least and largest time for which the aircraft flies on until missing thrust is noticed and the glide begins.
# Its excess of airspeed keeps the height meanwhile.
REACTION_S = (2, 7)
STEP_S = 1.0  # A path is looked at once a second.


@dataclass(frozen=True, slots=True)
class Coverage:
    """Fields within glide along a path, second by second.

    Parameters
    ----------
    fields : tuple of str or None
        Name of one field within glide at each second from the path's beginning; None where there is none.
    """

    fields: tuple[str | None, ...]

    @property
    def without_s(self) -> int:
        """Number of seconds without a field within glide."""
        return sum(name is None for name in self.fields)

    @property
    def stretches(self) -> tuple[tuple[int, int], ...]:
        """First second, and the second after the last, of each stretch without a field."""
        found, second = [], 0
        for is_without, run in itertools.groupby(self.fields, key=lambda name: name is None):
            length = len(list(run))
            if is_without:
                found.append((second, second + length))
            second += length
        return tuple(found)

    @property
    def words(self) -> str:
        """One sentence that names the stretches without a field."""
        if not self.fields:
            return "no path"
        if not self.stretches:
            return "a field is within glide all the way"
        spans = (f"from {clock(begin)} to {clock(end)}" for begin, end in self.stretches)
        return "no field within glide " + ", ".join(spans)

    def document(self) -> dict[str, object]:
        """Return the JSON of ``companion check`` and ``companion plan``."""
        return {
            "fields": list(self.fields),
            "without_s": self.without_s,
            "stretches_s": [list(stretch) for stretch in self.stretches],
        }


def clock(seconds: float) -> str:
    """Return a duration [s] as minutes and seconds."""
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


def coverage_of_path(options: GlideOptions, path: Path, wind_enu_m_s: Wind) -> Coverage:
    """Return the fields within glide along a path.

    Parameters
    ----------
    options : GlideOptions
        The glide, the obstacles and the fields.
    path : Path
        The path, with its times.
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north [m/s].
    """
    courses = np.unwrap(path.courses_rad)
    begin, end = float(path.times_s[0]), float(path.times_s[-1])
    at = np.minimum(np.arange(begin, end + 1e-6, STEP_S), end)
    positions = np.column_stack([np.interp(at, path.times_s, path.positions_enu_m[:, k]) for k in range(3)])
    return _coverage(options, positions, np.interp(at, path.times_s, courses), wind_enu_m_s)


def coverage_of_legs(
    options: GlideOptions, places_enu_m: Sequence[tuple[float, float, float]], airspeed_m_s: float,
    wind_enu_m_s: Wind,
) -> Coverage:  # fmt: skip
    """Return the fields within glide along straight legs.

    Parameters
    ----------
    options : GlideOptions
        The glide, the obstacles and the fields.
    places_enu_m : sequence of tuple
        East, north, up of the start and of each goal in order [m].
    airspeed_m_s : float
        Airspeed of the flight [m/s].
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north [m/s].
    """
    times, courses = [0.0], []
    for (east, north, _), (to_east, to_north, _) in itertools.pairwise(places_enu_m):
        course = math.atan2(to_east - east, to_north - north)
        speed = speed_made_good(course, airspeed_m_s, wind_enu_m_s)
        times.append(times[-1] + math.hypot(to_east - east, to_north - north) / speed)
        courses.append(course)
    at = np.arange(0.0, times[-1] + 1e-6, STEP_S)
    places = np.array(places_enu_m)
    positions = np.column_stack([np.interp(at, times, places[:, k]) for k in range(3)])
    leg = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(courses) - 1)
    return _coverage(options, positions, np.array(courses)[leg], wind_enu_m_s)


def _coverage(
    options: GlideOptions, positions_enu_m: FloatArray, courses_rad: FloatArray, wind_enu_m_s: Wind
) -> Coverage:
    """Return the fields within glide at ``positions_enu_m`` (N, 3) [m] on ``courses_rad`` (N,)."""
    names: list[str | None] = []
    last: LandingPlace | None = None
    for (east, north, up), course in zip(positions_enu_m.tolist(), courses_rad.tolist(), strict=True):
        heading = heading_of(course, options.model.airspeed_m_s, wind_enu_m_s)
        last = _field(options, Begin((east, north, up), heading, wind_enu_m_s), last)
        names.append(None if last is None else last.name)
    return Coverage(tuple(_while_reacting(names, second) for second in range(len(names))))


def _while_reacting(names: Sequence[str | None], second: int) -> str | None:
    """Return a field for an engine that stops at a second: there is one wherever the glide may begin."""
    first, last = REACTION_S
    begins = names[second + first : second + last + 1] or names[-1:]
    return None if None in begins else begins[0]


def _field(options: GlideOptions, begin: Begin, last: LandingPlace | None) -> LandingPlace | None:
    """Return a field within glide with the reserve, the last one if possible."""
    kept = None if last is None else choice_for(options, begin, last)
    if kept is not None and kept.spare_m >= RESERVE_M:
        return kept.place
    found = next(choices(options, begin), None)
    return found.place if found is not None and found.spare_m >= RESERVE_M else None
