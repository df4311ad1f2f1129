"""Encounter scenarios in the format of DAIDALUS (``.daa``), placed about a flight of our own.

A scenario is a table: the columns' names, their units, and then a row for each aircraft at each instant. The
aircraft that comes first is the own one. Only what the others do relative to it is used: their places are
turned so that its course is that of our flight, and moved in time so that the nearest approach is where it is
wanted. The own aircraft of a scenario may be faster than ours; the encounter, as it sees it, is the same.

References
----------
.. [1] NASA, DAIDALUS, https://github.com/nasa/daidalus: the scenarios of its examples.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from companion.errors import ConfigError
from companion.frames import FloatArray, LocalFrame
from companion.research.encounters.encounter_model import KNOT_M_S
from companion.research.encounters.well_clear import FOOT_M

SUFFIX = ".daa"
NAUTICAL_MILE_M = 1852.0
UNITS = {
    "deg": 1.0,
    "rad": 180.0 / math.pi,
    "ft": FOOT_M,
    "m": 1.0,
    "nmi": NAUTICAL_MILE_M,
    "km": 1e3,
    "knot": KNOT_M_S,
    "kn": KNOT_M_S,
    "m/s": 1.0,
    "fpm": FOOT_M / 60.0,
    "s": 1.0,
    "ms": 1e-3,
}  # In degrees, metres and seconds.
COLUMNS = ("lat", "lon", "alt", "time")
LOWEST_M = 30.0  # No aircraft of an encounter comes lower.


@dataclass(frozen=True, slots=True)
class Scenario:
    """The motion of other aircraft relative to the own one.

    Parameters
    ----------
    name : str
        Name of the file.
    away : mapping of str to ndarray, shape (N, 4)
        By name: time from the nearest approach of any [s], and how far the aircraft is ahead, to the
        left and above [m].
    """

    name: str
    away: Mapping[str, FloatArray]

    def tracks(self, own: FloatArray, meets_s: float) -> dict[str, FloatArray]:
        """Return where the other aircraft are about a flight, which meets them at ``meets_s``.

        Parameters
        ----------
        own : ndarray, shape (N, 4)
            The unmitigated flight: time from 0 on [s], east, north, up [m].
        meets_s : float
            When it meets them [s].

        Returns
        -------
        dict of str to ndarray, shape (M, 7)
            By each aircraft's name, each second: time [s], east, north, up [m], and the velocity in these
            [m/s]. Before and after the scenario each moves on relative to the own one as it does then.
        """
        seconds = np.arange(math.floor(own[-1, 0]) + 1.0)
        here = np.column_stack([np.interp(seconds, own[:, 0], own[:, axis]) for axis in (1, 2, 3)])
        meets = round(meets_s)
        course = here[meets + 1, :2] - here[meets - 1, :2]
        ahead = course / np.hypot(*course)
        found = {}
        for name, away in self.away.items():
            relative = _extrapolated(away, seconds - meets_s)
            east = relative[:, 0] * ahead[0] - relative[:, 1] * ahead[1]
            north = relative[:, 0] * ahead[1] + relative[:, 1] * ahead[0]
            places = here + np.column_stack([east, north, relative[:, 2]])
            places[:, 2] = np.maximum(places[:, 2], LOWEST_M)
            found[name] = np.column_stack([seconds, places, np.gradient(places, seconds, axis=0)])
        return found


def _extrapolated(away: FloatArray, times_s: FloatArray) -> FloatArray:
    """Return the places (M, 3) in ``away`` (N, 4) at ``times_s`` (M,), on straight lines beyond its ends."""
    row = np.clip(np.searchsorted(away[:, 0], times_s) - 1, 0, len(away) - 2)
    share = (times_s - away[row, 0]) / (away[row + 1, 0] - away[row, 0])
    return np.asarray(away[row, 1:] + share[:, None] * (away[row + 1, 1:] - away[row, 1:]))


def scenario_from_text(text: str, name: str) -> Scenario:
    """Read a scenario from the text of its file, which is called ``name`` in errors.

    Raises
    ------
    ConfigError
        For the first thing wrong with it: the file, the line, and what was expected.
    """
    lines = _lines_of(text, name)
    names = _names_of(*lines[0], name)
    factors = _factors(name, lines[1], names)
    rows: dict[str, list[list[float]]] = {}
    for number, fields in lines[2:]:
        rows.setdefault(fields[0], []).append(_numbers(name, number, fields, names, factors))
    if len(rows) < 2:
        raise ConfigError(name, None, "aircraft", ", ".join(rows), "at least two aircraft")
    return _relative(name, {aircraft: np.array(each) for aircraft, each in rows.items()})


def _lines_of(text: str, name: str) -> list[tuple[int, list[str]]]:
    """Return number and fields of each line that is no comment."""
    lines = [
        (number, re.split(r"[,;\s]+", line.strip().rstrip(",")))
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if len(lines) < 3:
        raise ConfigError(name, None, "file", f"{len(lines)} lines", "names, units, and a row per aircraft")
    return lines


def _names_of(number: int, fields: list[str], name: str) -> list[str]:
    """Return the names of the columns, which are in line ``number``."""
    names = [column.lower() for column in fields]
    if names[0] != "name" or not all(column in names for column in COLUMNS):
        expected = "first name, and lat, lon, alt and time"
        raise ConfigError(name, number, "columns", ", ".join(names), expected)
    return names


def _factors(name: str, line: tuple[int, list[str]], names: list[str]) -> list[float]:
    """Return by what each column is multiplied."""
    number, units = line
    if len(units) < len(names):
        expected = f"{len(names)} units, one a column"
        raise ConfigError(name, number, "units", str(len(units)), expected)
    factors = []
    for column, unit in zip(names, units, strict=False):
        factor = UNITS.get(unit.strip("[]").lower())
        if factor is None and column in COLUMNS:
            raise ConfigError(name, number, column, unit, "one of " + ", ".join(UNITS))
        factors.append(factor or 1.0)
    return factors


def _numbers(
    name: str, number: int, fields: list[str], names: list[str], factors: list[float]
) -> list[float]:
    """Return latitude, longitude [deg], altitude [m] and time [s] of a row."""
    found = []
    for column in COLUMNS:
        at = names.index(column)
        try:
            value = float(fields[at]) * factors[at]
        except (ValueError, IndexError):
            value = math.nan
        if not math.isfinite(value):
            given = fields[at] if at < len(fields) else "nothing"
            raise ConfigError(name, number, column, given, "a number")
        found.append(value)
    return found


def _relative(name: str, rows: dict[str, FloatArray]) -> Scenario:
    """Return what others do relative to the first of ``rows``, (N, 4): latitude, longitude, up, time."""
    own = next(iter(rows.values()))
    if len(own) < 2 or not (np.diff(own[:, 3]) > 0.0).all():
        raise ConfigError(name, None, "time", "not rising", "two instants or more of each aircraft")
    frame = LocalFrame(float(own[0, 0]), float(own[0, 1]), 0.0)
    places = {
        aircraft: np.column_stack([each[:, 3], [frame.local_from_global(*row[:3]) for row in each]])
        for aircraft, each in rows.items()
    }
    (_, here), *others = places.items()
    velocity = np.gradient(here[:, 1:3], here[:, 0], axis=0)
    course = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    away, nearest = {}, (math.inf, 0.0)
    for aircraft, there in others:
        if not (np.diff(there[:, 0]) > 0.0).all():
            raise ConfigError(name, None, "time", f"not rising for {aircraft}", "rising times")
        rows_of = there[(there[:, 0] >= here[0, 0]) & (there[:, 0] <= here[-1, 0])]
        if len(rows_of) < 2:
            raise ConfigError(name, None, "time", f"{aircraft} alone", "instants at which the own flies, too")
        mine = np.column_stack([np.interp(rows_of[:, 0], here[:, 0], here[:, n]) for n in (1, 2, 3)])
        apart, turned = rows_of[:, 1:] - mine, np.interp(rows_of[:, 0], here[:, 0], course)
        ahead = apart[:, 0] * np.cos(turned) + apart[:, 1] * np.sin(turned)
        left = apart[:, 1] * np.cos(turned) - apart[:, 0] * np.sin(turned)
        away[aircraft] = np.column_stack([rows_of[:, 0], ahead, left, apart[:, 2]])
        flat = np.hypot(ahead, left)
        nearest = min(nearest, (float(flat.min()), float(rows_of[flat.argmin(), 0])))
    for each in away.values():
        each[:, 0] -= nearest[1]
    return Scenario(name, away)
