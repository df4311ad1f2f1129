"""Errors of predicted arrival times in wind.

Every five seconds the place where the flown path has the aircraft in 30 s is noted. When the true path passes
that place, its delay is measured.
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
from ..sitl import Flight

AHEAD_S, EVERY_S = 30.0, 5.0
PASSED_M = 20.0  # The aircraft passes its place within this distance.
SETTLED_S = 20.0


class WindyFlight(NamedTuple):
    """The end of a flight (``goal``, ``collision`` or ``flying``), and the delays at places [s]."""

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
        Wind speed and the direction that the wind comes from.
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
    """Predicted places and times of a flight."""

    def __init__(self) -> None:
        self._expected: list[tuple[float, FloatArray]] = []
        self._next_s = SETTLED_S

    def note(self, flight: Flight) -> None:
        """Note the prediction, after a step of the flight."""
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
        """Delay of each place that was passed, against its prediction [s]."""
        rows, found = np.array(truth), []
        for due_s, place in self._expected:
            window = rows[np.abs(rows[:, 0] - due_s) < AHEAD_S]
            away = np.hypot(*(window[:, 1:3] - place[:2]).T)
            if len(away) and away.min() < PASSED_M:
                found.append(float(window[int(np.argmin(away)), 0] - due_s))
        return found
