"""The aircraft that pass a flight, read from an encounter model or a scenario."""

from __future__ import annotations

import numpy as np

from companion.frames import FloatArray
from companion.research.encounters.daa_scenario import SUFFIX, Scenario, scenario_from_text
from companion.research.encounters.encounter_model import EncounterModel, model_from_text
from companion.research.encounters.placement import placed_track

Passing = EncounterModel | Scenario


def passing_from_text(text: str, name: str) -> Passing:
    """Read what passes from the text of its file.

    Parameters
    ----------
    text : str
        The file's text.
    name : str
        The file's name: one that ends in ``.daa`` is a scenario, any other an encounter model.

    Raises
    ------
    ConfigError
        For the first thing wrong with it: the file, the place, and what was expected.
    """
    read = scenario_from_text if name.endswith(SUFFIX) else model_from_text
    return read(text, name)


def passing_tracks(
    passing: Passing, own: FloatArray, generator: np.random.Generator, *, meets_s: int, spread: float
) -> tuple[dict[str, FloatArray], dict[str, float]]:
    """Place the aircraft about an unmitigated flight: one drawn from a model, or all of a scenario.

    Parameters
    ----------
    passing : EncounterModel or Scenario
        What the aircraft do.
    own : ndarray, shape (N, 4)
        The flight: time from 0 on [s], east, north, up [m].
    generator : numpy.random.Generator
        Source of everything random.
    meets_s : int
        When they are to meet [s].
    spread : float
        Largest miss distances over those of well clear; of a model only.

    Returns
    -------
    tracks : dict of str to ndarray, shape (M, 7)
        By name: time [s], east, north, up [m], and the velocity in these [m/s].
    drawn : dict of str to float
        What was drawn of a model: miss distances [m], closing speed, and speed and height then.
    """
    if isinstance(passing, Scenario):
        return passing.tracks(own, meets_s), {}
    track = placed_track(own, passing, generator, meets_s=meets_s, spread=spread)
    drawn = {
        "drawn_miss_m": track.miss_m,
        "drawn_above_m": track.above_m,
        "closing_m_s": track.closing_m_s,
        "aircraft_m_s": float(np.hypot(*track.rows[meets_s, 4:6])),
        "aircraft_up_m": float(track.rows[meets_s, 3]),
    }
    return {"passing": track.rows}, drawn
