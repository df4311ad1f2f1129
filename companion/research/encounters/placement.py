"""Places an aircraft's track so that it passes an unmitigated flight as near as was drawn.

The miss distances are uniform: horizontally from 0 to a multiple of the well clear distance of ASTM F3442,
as those of straight flights that cross a cylinder are, and vertically up to the same multiple of its height
to both sides. They are drawn once, and tracks until one fits them, so that what does not fit leaves their
distribution as it is. The aircraft comes from any direction; what closes faster is met more often, in
proportion [1]_.

References
----------
.. [1] Kochenderfer, Espindle, Kuchar, Griffith, "A Comprehensive Aircraft Encounter Model of the National
   Airspace System", Lincoln Laboratory Journal 17 (2), 2008.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.errors import ConfigError
from companion.frames import FloatArray
from companion.research.encounters.encounter_model import KNOT_M_S, SPEED, EncounterModel
from companion.research.encounters.well_clear import SMALL_AIRCRAFT

TRIES_MAX = 10_000
LOWEST_M = 30.0  # No aircraft of an encounter comes lower.
APART_S = 3.0  # The nearest approach is within this time of the one at which the two are to meet.


@dataclass(frozen=True, slots=True)
class PlacedTrack:
    """An aircraft's track, and how near it is to pass.

    Parameters
    ----------
    rows : ndarray, shape (N, 7)
        Each second: time [s], east, north, up [m], and the velocity in these [m/s].
    meets_s : float
        When it is to pass [s].
    miss_m, above_m : float
        Horizontal distance then, and how much higher it is then [m].
    closing_m_s : float
        Horizontal speed of one relative to the other then [m/s].
    """

    rows: FloatArray
    meets_s: float
    miss_m: float
    above_m: float
    closing_m_s: float


def placed_track(
    own: FloatArray, model: EncounterModel, generator: np.random.Generator, *, meets_s: int, spread: float
) -> PlacedTrack:
    """Draw tracks until one fits the own flight, and place it.

    A track fits if it begins in that layer of the model in which the own flight meets it, if it stays above
    30 m, and if it comes nowhere nearer than where the two are to meet, to 3 s and 5 m.

    Parameters
    ----------
    own : ndarray, shape (N, 4)
        The unmitigated flight: time from 0 on [s], east, north, up [m].
    model : EncounterModel
        What the other aircraft does.
    generator : numpy.random.Generator
        Source of everything random.
    meets_s : int
        When the two are to meet, at least a second from the flight's ends [s].
    spread : float
        Largest miss distances over those of well clear.

    Raises
    ------
    ConfigError
        If none of 10,000 tracks fits.
    """
    seconds = np.arange(math.floor(own[-1, 0]) + 1.0)
    here = np.column_stack([np.interp(seconds, own[:, 0], own[:, axis]) for axis in (1, 2, 3)])
    own_velocity = 0.5 * (here[meets_s + 1] - here[meets_s - 1])[:2]
    fastest = math.hypot(*own_velocity) + KNOT_M_S * float(model.edges[model.number_of(SPEED)][-1])
    miss_m = float(generator.uniform(0.0, spread * SMALL_AIRCRAFT.distance_m))
    above_m = float(generator.uniform(-1.0, 1.0)) * spread * SMALL_AIRCRAFT.height_m
    for _ in range(TRIES_MAX):
        track = model.track(len(seconds) - 1, generator, float(here[meets_s, 2]))
        if track is None:
            continue
        rows = _turned(track, float(generator.uniform(-math.pi, math.pi)))
        relative = rows[meets_s, 4:6] - own_velocity
        closing = math.hypot(*relative)
        if generator.random() * fastest > closing:
            continue
        across = generator.choice((-1.0, 1.0)) * miss_m / closing * np.array([relative[1], -relative[0]])
        wanted = here[meets_s] + (*across, above_m)
        rows[:, 1:4] += wanted - rows[meets_s, 1:4]
        away = np.hypot(*(rows[:, 1:3] - here[:, :2]).T)
        is_nearest = away.min() >= miss_m - 5.0 and abs(int(away.argmin()) - meets_s) <= APART_S
        if is_nearest and rows[:, 3].min() >= LOWEST_M:
            return PlacedTrack(rows, float(meets_s), miss_m, above_m, closing)
    expected = f"a model of aircraft {here[meets_s, 2]:.0f} m above ground"
    raise ConfigError(model.name, None, "boundaries", f"no fitting track in {TRIES_MAX}", expected)


def _turned(track: FloatArray, turn_rad: float) -> FloatArray:
    """Return ``track`` (N, 7) turned clockwise about the vertical, (N, 7)."""
    sine, cosine = math.sin(turn_rad), math.cos(turn_rad)
    rows = track.copy()
    for east, north in ((1, 2), (4, 5)):
        rows[:, east] = cosine * track[:, east] + sine * track[:, north]
        rows[:, north] = cosine * track[:, north] - sine * track[:, east]
    return rows
