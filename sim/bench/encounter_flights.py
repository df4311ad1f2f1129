"""Encounters flown closed loop: the same flight without and with aircraft that the service hears of."""

from __future__ import annotations

import asyncio
import functools
import math
from collections.abc import Mapping

import numpy as np

from companion.config import MissionConfig
from companion.flight.state.decision import DecisionKind
from companion.frames import FloatArray
from companion.kernels.native.ready import make_ready
from companion.research.campaign.campaign_spec import Campaign, Run
from companion.research.campaign.engines.runners import Outcome
from companion.research.encounters.daa_scenario import Scenario
from companion.research.encounters.encounter_model import EncounterModel
from companion.research.encounters.passing import passing_from_text
from companion.research.encounters.placement import placed_track
from companion.research.encounters.well_clear import (
    EN_ROUTE,
    NEAR_MID_AIR_COLLISION,
    NON_COOPERATIVE,
    SMALL_AIRCRAFT,
    BoolArray,
    Volume,
)
from companion.types.events import Dialect
from ..sitl import Flight
from ..threats.passing_aircraft import PassingAircraft
from .campaign_runs import mission_of

VOLUMES = {
    "nmac": NEAR_MID_AIR_COLLISION,
    "lowc": SMALL_AIRCRAFT,
    "lowc_en_route": EN_ROUTE,
    "lowc_non_cooperative": NON_COOPERATIVE,
}
MEETS = 0.6  # The two are to meet after this share of the unmitigated flight.
DELAY_S = 0.6  # From the measurement to the report: 14 CFR 91.227(e), uncompensated latency.
LOSS = 0.1  # Share of the reports that are lost.

DIGITS = 6

Row = dict[str, bool | int | float | str | None]


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

    def warm_up(self) -> None:
        """Have the planner's kernels ready."""
        make_ready()

    def outcome(self, run: Run) -> Outcome:
        """Fly, and measure."""
        campaign = self._campaign
        return flown_encounter(
            mission_of(campaign, run), self._model(run.setting), run.seed,
            spread=campaign.encounter(run.setting).spread, dialect=Dialect(campaign.config.autopilot),
        )  # fmt: skip


def flown_encounter(
    mission: MissionConfig, model: EncounterModel | Scenario, seed: int, *, spread: float, dialect: Dialect
) -> Outcome:
    """Fly an encounter, and return its measures and the paths.

    The mission is flown twice with the same seed: alone, and with aircraft placed about the first of these
    flights: one by :func:`companion.research.encounters.placement.placed_track`, or all of a scenario.
    Measures of the first flight against these aircraft, which it does not hear, begin with ``without.``.

    Parameters
    ----------
    mission : MissionConfig
        The mission, without moving threats.
    model : EncounterModel or Scenario
        What the aircraft do.
    seed : int
        Seed of everything random.
    spread : float
        Largest miss distances of the first flight over those of well clear; of a model only.
    dialect : Dialect
        The autopilot whose semantics the simulator has.
    """
    path = _flown(Flight(mission, seed, dialect=dialect))
    meets_s = round(MEETS * float(path[-1, 0]))
    drawn: Row = {}
    if isinstance(model, Scenario):
        tracks = model.tracks(path, meets_s)
    else:
        track = placed_track(path, model, np.random.default_rng(seed), meets_s=meets_s, spread=spread)
        tracks = {"passing": track.rows}
        drawn = {
            "drawn_miss_m": track.miss_m,
            "drawn_above_m": track.above_m,
            "closing_m_s": track.closing_m_s,
            "aircraft_m_s": float(np.hypot(*track.rows[meets_s, 4:6])),
            "aircraft_up_m": float(track.rows[meets_s, 3]),
        }
    aircraft = [(name, PassingAircraft(rows, delay_s=DELAY_S, loss=LOSS)) for name, rows in tracks.items()]
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
        float(rows[inside][0, 0])
        for rows, inside in (_inside(alone, other, SMALL_AIRCRAFT) for other in tracks.values())
        if inside.any()
    ]
    announced_s = [
        entry.stamp_s for entry in flight.recorder.decisions if entry.kind == DecisionKind.TRAFFIC.value
    ]
    return min(lost_s) - min(announced_s) if lost_s and announced_s else None


def _flown(flight: Flight) -> FloatArray:
    """Fly, and return the path (N, 4): time [s], east, north, up [m]."""
    asyncio.run(flight.fly())
    return np.array(flight.simulator.truth.path)[:, :4]


def encounter_measures(own: FloatArray, others: Mapping[str, FloatArray]) -> Row:
    """Return what happened between a flight and aircraft while both are known, at the flight's rows.

    An event counts if it happens with any of them; distances are those to the nearest.

    Parameters
    ----------
    own : ndarray, shape (N, 4)
        The flight: time [s], east, north, up [m].
    others : mapping of str to ndarray, shape (M, 7)
        Each aircraft: time [s], east, north, up [m], and the velocity in these [m/s].
    """
    found: Row = dict.fromkeys(VOLUMES, False) | {"severity": 0.0, "miss_m": math.inf, "above_m": math.inf}
    for other in others.values():
        _, away, velocity = _relative(own, other)
        flat = np.hypot(away[:, 0], away[:, 1])
        nearest = int(flat.argmin())
        for name, volume in VOLUMES.items():
            found[name] = bool(found[name]) or bool(volume.is_inside(away, velocity).any())
        severity = float(SMALL_AIRCRAFT.severity(away, velocity).max())
        found["severity"] = max(float(found["severity"] or 0.0), severity)
        if flat[nearest] < float(found["miss_m"] or 0.0):
            found |= {"miss_m": float(flat[nearest]), "above_m": float(away[nearest, 2])}
    return found


def _relative(own: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the rows of ``own`` (N, 4) at which ``other`` (M, 7) is known, (K, 4).

    Besides, its position and velocity less those of the own aircraft then, each (K, 3).
    """
    rows = own[(own[:, 0] >= other[0, 0]) & (own[:, 0] <= other[-1, 0])]
    there = np.column_stack([np.interp(rows[:, 0], other[:, 0], other[:, n]) for n in range(1, 7)])
    return rows, there[:, :3] - rows[:, 1:], there[:, 3:] - np.gradient(rows[:, 1:], rows[:, 0], axis=0)


def _inside(own: FloatArray, other: FloatArray, volume: Volume) -> tuple[FloatArray, BoolArray]:
    """Return the rows of ``own`` at which ``other`` is known (K, 4), and whether it is in the volume (K,)."""
    rows, away, velocity = _relative(own, other)
    return rows, volume.is_inside(away, velocity)


def way_m(path: FloatArray) -> float:
    """Return the length of a path [m].

    Parameters
    ----------
    path : ndarray, shape (N, 4)
        Time [s], east, north, up [m].
    """
    return float(np.linalg.norm(np.diff(path[:, 1:], axis=0), axis=1).sum())
