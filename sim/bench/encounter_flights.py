"""Encounters flown closed loop: the same flight without and with aircraft that the service hears of."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Mapping

import numpy as np

from companion.config import MissionConfig
from companion.flight.state.decision import DecisionKind
from companion.frames import FloatArray
from companion.kernels.native.ready import make_ready
from companion.research.campaign.campaign_spec import Campaign, Run
from companion.research.campaign.engines.runners import Outcome
from companion.research.encounters.passing import Passing, passing_from_text, passing_tracks
from companion.research.encounters.well_clear import SMALL_AIRCRAFT
from companion.types.events import Dialect
from ..sitl import Flight
from ..threats.passing_aircraft import PassingAircraft
from ..threats.reports import ADSB, SOURCES, ReportSource
from .campaign_runs import mission_of
from .encounter_measures import Row, encounter_measures, inside, way_m

MEETS = 0.6  # The two are to meet after this share of the unmitigated flight.

DIGITS = 6


class EncounterRunner:
    """Flies a campaign's encounters.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    known : dict
        Places of code; an encounter needs none.
    """

    def __init__(self, campaign: Campaign, known: dict[str, str]) -> None:
        del known
        self._campaign = campaign
        self._model = functools.cache(lambda setting: passing_from_text(*campaign.models[setting]))
        self._alone: tuple[MissionConfig, int, FloatArray] | None = None  # Runs of a seed follow each other.

    def warm_up(self) -> None:
        """Have the planner's kernels ready."""
        make_ready()

    def outcome(self, run: Run) -> Outcome:
        """Fly, and measure."""
        campaign, wanted = self._campaign, self._campaign.encounter(run.setting)
        mission, dialect = mission_of(campaign, run), Dialect(campaign.config.autopilot)
        if self._alone is None or self._alone[:2] != (mission, run.seed):
            self._alone = mission, run.seed, flown_alone(mission, run.seed, dialect)
        return flown_encounter(
            mission, self._model(run.setting), run.seed, spread=wanted.spread, dialect=dialect,
            source=SOURCES[wanted.source], alone=self._alone[2],
        )  # fmt: skip


def flown_alone(mission: MissionConfig, seed: int, dialect: Dialect) -> FloatArray:
    """Fly a mission without other aircraft, and return the path.

    Parameters
    ----------
    mission : MissionConfig
        The mission, without moving threats.
    seed : int
        Seed of everything random.
    dialect : Dialect
        The autopilot whose semantics the simulator has.

    Returns
    -------
    ndarray, shape (N, 4)
        Time [s], east, north, up [m].
    """
    return _flown(Flight(mission, seed, dialect=dialect))


def flown_encounter(
    mission: MissionConfig, passing: Passing, seed: int, *,
    spread: float, dialect: Dialect, source: ReportSource = ADSB, alone: FloatArray | None = None,
) -> Outcome:  # fmt: skip
    """Fly an encounter, and return its measures and the paths.

    The mission is flown twice with the same seed: alone, and with aircraft placed about the first of these
    flights by :func:`companion.research.encounters.passing.passing_tracks`.
    Measures of the first flight against these aircraft, which it does not hear, begin with ``without.``.

    Parameters
    ----------
    mission : MissionConfig
        The mission, without moving threats.
    passing : EncounterModel or Scenario
        What the aircraft do.
    seed : int
        Seed of everything random.
    spread : float
        Largest miss distances of the first flight over those of well clear; of a model only.
    dialect : Dialect
        The autopilot whose semantics the simulator has.
    source : ReportSource
        How the aircraft are reported.
    alone : ndarray, shape (N, 4), optional
        The path of :func:`flown_alone`, if it is known.
    """
    path = flown_alone(mission, seed, dialect) if alone is None else alone
    meets_s = round(MEETS * float(path[-1, 0]))
    generator = np.random.default_rng(seed)
    tracks, drawn = passing_tracks(passing, path, generator, meets_s=meets_s, spread=spread)
    aircraft = [(name, PassingAircraft(rows, source)) for name, rows in tracks.items()]
    flight = Flight(mission, seed, dialect=dialect, aircraft=aircraft)
    flown = _flown(flight)
    measures: Row = {
        **{f"without.{name}": value for name, value in encounter_measures(path, tracks).items()},
        **encounter_measures(flown, tracks),
        **drawn,
        "alert_before_s": _alert_before_s(flight, path, tracks),
        "alerts": sum(entry.kind == DecisionKind.TRAFFIC.value for entry in flight.recorder.decisions),
        "success": flight.goal_reached and not flight.simulator.truth.collision,
        "detour_m": way_m(flown) - way_m(path),
        "detour_s": float(flown[-1, 0] - path[-1, 0]),
    }
    seconds = np.searchsorted(flown[:, 0], np.arange(flown[-1, 0]))
    paths = {"true_path": flown[seconds].round(2).tolist()}
    paths |= {name: rows[:, :4].round(2).tolist() for name, rows in tracks.items()}
    rounded = {
        name: round(value, DIGITS) if isinstance(value, float) else value for name, value in measures.items()
    }
    return Outcome(rounded, {}, paths)


def _alert_before_s(flight: Flight, alone: FloatArray, tracks: Mapping[str, FloatArray]) -> float | None:
    """Return how long before the flight ``alone`` (N, 4) loses well clear the pilot was warned [s].

    ``tracks`` are those of the other aircraft, (M, 7) each.

    It is None where the flight alone stays well clear, or where the pilot was not warned.
    """
    lost_s = [
        float(rows[lost][0, 0])
        for rows, lost in (inside(alone, other, SMALL_AIRCRAFT) for other in tracks.values())
        if lost.any()
    ]
    announced_s = [
        entry.stamp_s for entry in flight.recorder.decisions if entry.kind == DecisionKind.TRAFFIC.value
    ]
    return min(lost_s) - min(announced_s) if lost_s and announced_s else None


def _flown(flight: Flight) -> FloatArray:
    """Fly, and return the path (N, 4): time [s], east, north, up [m]."""
    asyncio.run(flight.fly())
    return np.array(flight.simulator.truth.path)[:, :4]
