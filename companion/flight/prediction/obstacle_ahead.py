"""Obstacles on the predicted track, when the aircraft meets them, and the escapes that are clear."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from companion.assurance.violation import Violation
from companion.flight.construction.mission_simulation import guidance_of
from companion.flight.prediction.mode_tracks import AHEAD_S, ModeTracks
from companion.flight.prediction.return_path import STEP_S
from companion.flight.state.flight_state import FlightState
from companion.frames import FloatArray
from companion.tracking.ownship import predicted
from companion.types.state import Ownship

ESCAPE_BANK_SHARE = 0.7  # A pilot turns with this share of the largest bank.
ESCAPE_DELAY_S = 1.0  # The aircraft flies on for this time until a pilot has reacted.


@dataclass(frozen=True, slots=True)
class ObstacleAhead:
    """Something that the aircraft meets if nobody acts.

    Parameters
    ----------
    name : str
        Name of the obstacle or fence.
    after_s : float
        Time until the aircraft comes too near to it [s].
    escapes : tuple of str
        What the pilot can do: ``climb``, ``turn left``, ``turn right``, those that keep clear.
    """

    name: str
    after_s: float
    escapes: tuple[str, ...]

    @property
    def advice(self) -> str:
        """The escapes in words."""
        words = " or ".join(self.escapes).replace("turn left or turn right", "turn")
        return words or "no way out is clear"


def obstacle_ahead(state: FlightState, ownship: Ownship, tracks: ModeTracks) -> ObstacleAhead | None:
    """Return what is met first on the tracks; None if they keep clear.

    On tracks between which small differences decide, the first meeting on any of them counts. A pilot who
    steers is informed only of what is met on each of the tracks.

    Parameters
    ----------
    state : FlightState
        Obstacles and fences.
    ownship : Ownship
        The aircraft now.
    tracks : ModeTracks
        What it flies next.
    """
    met = [first_met(state, track) for track in tracks.positions_enu_m]
    found = [entry for entry in met if entry is not None]
    if not found or (tracks.is_steered and len(found) < len(met)):
        return None
    first = min(found, key=lambda entry: entry.row)
    name = first.detail.removeprefix("distance to ").partition(" [")[0]
    return ObstacleAhead(name, STEP_S * first.row, _escapes(state, ownship))


def is_clear(state: FlightState, positions_enu_m: FloatArray) -> bool:
    """Return whether a track keeps clear of obstacles and fences.

    Parameters
    ----------
    state : FlightState
        Obstacles and fences.
    positions_enu_m : ndarray, shape (K, 3)
        Positions on the track [m].
    """
    return first_met(state, positions_enu_m) is None


def first_met(state: FlightState, places: FloatArray) -> Violation | None:
    """Return what a track comes too near to first; None if it keeps clear.

    Parameters
    ----------
    state : FlightState
        Obstacles and fences.
    places : ndarray, shape (K, 3)
        Positions on the track [m].
    """
    margin = state.rules.checker.limits.margin_m
    wrong = state.rules.checker.check_track(places, margin)
    near = [entry for entry in wrong if entry.rule == "clearance"]
    return min(near, key=lambda entry: entry.row, default=None)


def _escapes(state: FlightState, ownship: Ownship) -> tuple[str, ...]:
    """Return which of climbing straight on and turning to either side keep clear."""
    guidance = guidance_of(state)
    begun = predicted(ownship, ESCAPE_DELAY_S)
    bank = ESCAPE_BANK_SHARE * guidance.bank_max_rad
    climb = math.atan2(guidance.climb_rate_max_m_s, max(begun.ground_speed_m_s, 1.0))
    manoeuvres = {
        "climb": replace(begun, bank_rad=0.0, flight_path_angle_rad=climb),
        "turn left": replace(begun, bank_rad=-bank, flight_path_angle_rad=0.0),
        "turn right": replace(begun, bank_rad=bank, flight_path_angle_rad=0.0),
    }
    times = np.arange(0.0, AHEAD_S, STEP_S)
    return tuple(
        words
        for words, state_then in manoeuvres.items()
        if is_clear(state, np.array([predicted(state_then, float(time)).position_enu_m for time in times]))
    )
