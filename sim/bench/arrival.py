"""How well flights in the wind know when they will be where.

Every five seconds it is noted where the flown path says that the aircraft will be in 30 s; once the true
path passes there, by how much it came too late.
"""

from __future__ import annotations

import asyncio
from typing import NamedTuple

import numpy as np

from companion.config import MissionConfig
from companion.flight.state.flight_state import SEARCH_ROWS
from companion.flight.state.modes import Mode
from companion.frames import FloatArray
from companion.mission.path_progress import progress_on, time_at
from companion.types.events import Dialect
from sim.sitl import Flight

AHEAD_S, EVERY_S = 30.0, 5.0
PASSED_M = 20.0  # by which the aircraft passes a place that it was to pass, and not another's
SETTLED_S = 20.0


class WindyFlight(NamedTuple):
    """How it ended, ``goal``, ``collision`` or ``flying``, and by how much places were passed late [s]."""

    ending: str
    errors_s: list[float]


def fly_in_wind(
    mission: MissionConfig, dialect: Dialect, speed_m_s: float, from_deg: float, seed: int
) -> WindyFlight:
    """Fly a mission in a wind with light turbulence.

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    dialect : Dialect
        Which autopilot flies.
    speed_m_s, from_deg : float
        The wind, and where it comes from.
    seed : int
        Seed of everything random.
    """
    air = {"wind_speed_m_s": speed_m_s, "wind_from_deg": from_deg, "turbulence": "light"}
    blown = mission.model_copy(update={"simulation": mission.simulation.model_copy(update=air)})
    flight, start_prediction = Flight(blown, seed, dialect=dialect), _StartPrediction()
    asyncio.run(flight.fly(start_prediction.note))
    truth = flight.simulator.truth
    has_arrived = flight.app.mode is Mode.ARRIVED and flight.goal_reached
    ending = "collision" if truth.collision else "goal" if has_arrived else "flying"
    return WindyFlight(ending, start_prediction.errors_s(truth.path))


class _StartPrediction:
    """Where a flight says it will be, and when it is."""

    def __init__(self) -> None:
        self._expected: list[tuple[float, FloatArray]] = []
        self._next_s = SETTLED_S

    def note(self, flight: Flight) -> None:
        """Note it, after a step of the flight."""
        state = flight.app.state
        if flight.now_s < self._next_s or state.flown is None:
            return
        self._next_s = flight.now_s + EVERY_S
        path, row = state.flown.path, state.flown.row
        east, north, up = flight.simulator.truth.path[-1][1:4]
        due_s = time_at(path, progress_on(path, (east, north, up), row, SEARCH_ROWS)) + AHEAD_S
        if due_s < path.times_s[-1]:
            place = [np.interp(due_s, path.times_s, column) for column in path.positions_enu_m.T]
            self._expected.append((flight.now_s + AHEAD_S, np.array(place)))

    def errors_s(self, truth: list[list[float]]) -> list[float]:
        """By how much later than foreseen each place was passed, of those that were [s]."""
        rows, found = np.array(truth), []
        for due_s, place in self._expected:
            window = rows[np.abs(rows[:, 0] - due_s) < AHEAD_S]
            away = np.hypot(*(window[:, 1:3] - place[:2]).T)
            if len(away) and away.min() < PASSED_M:
                found.append(float(window[int(np.argmin(away)), 0] - due_s))
        return found
