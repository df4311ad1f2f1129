"""Flights as runs of a campaign, and the moving threats that are driven against a campaign's plans."""

from __future__ import annotations

import asyncio
from typing import cast

import numpy as np

from companion.config import MissionConfig
from companion.frames import FloatArray
from companion.kernels.native.ready import make_ready
from companion.planning.comparators import FLOWN_METHODS
from companion.research.campaign.campaign_spec import Campaign, Run, Scalar
from companion.research.campaign.engines.runners import Outcome
from companion.types.events import Dialect
from companion.types.path import Path
from ..threats.pursuer import TargetEstimate
from ..threats.pursuers import pursuers_of

STEP_US = 100_000
TIMED = ("plan_ms", "track_to_mission_ms", "wall_s")
PATHS = ("true_path", "dt_path", "dt_paths")


class FlightRunner:
    """Flies a campaign's flights, each with its method instead of the mission's.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    known : dict
        Places of code; a flight needs none.
    """

    def __init__(self, campaign: Campaign, known: dict[str, str]) -> None:
        del known
        # The simulator is an extra; driving threats against plans works without it.
        from .flown_runs import flight_of  # noqa: PLC0415

        self._campaign, self._flight_of = campaign, flight_of
        self._dialect = Dialect(campaign.config.autopilot)

    def warm_up(self) -> None:
        """Have the planner's kernels ready."""
        make_ready()

    def outcome(self, run: Run) -> Outcome:
        """Fly, and measure the flight."""
        faults = self._campaign.faults(run.setting)
        flight = self._flight_of(mission_of(self._campaign, run), run, self._dialect, faults)
        asyncio.run(flight.fly())
        measures: dict[str, Scalar | None] = {}
        timings: dict[str, Scalar | None] = {}
        paths: dict[str, object] = {}
        for key, value in flight.document().items():
            if key in PATHS:
                paths[key] = value
            else:
                (timings if key in TIMED else measures).update(_flat(key, value))
        return Outcome(measures, timings, paths)


def mission_of(campaign: Campaign, run: Run) -> MissionConfig:
    """Return a run's mission, which plans by the run's method."""
    mission = campaign.mission(run.mission, run.setting)
    if run.method in FLOWN_METHODS:
        return mission
    planning = mission.planning.model_copy(update={"method": run.method})
    return mission.model_copy(update={"planning": planning})


def _flat(key: str, value: object) -> dict[str, Scalar | None]:
    """A measure of a flight under its name, those of an inner table under both names with a dot between."""
    if not isinstance(value, dict):
        return {key: cast("Scalar | None", value)}
    return {name: of for inner, entry in value.items() for name, of in _flat(f"{key}.{inner}", entry).items()}


def driven(mission: MissionConfig, path: Path) -> list[FloatArray]:
    """Drive the mission's moving threats against a path that they know in full.

    Parameters
    ----------
    mission : MissionConfig
        The mission, whose threats begin at their starts as the path begins.
    path : Path
        The path, flown as planned.

    Returns
    -------
    list of ndarray, shape (M, 3)
        Of each threat: time [s], east, north [m].
    """
    begins_s, steps = float(path.times_s[0]), int(np.ceil(path.duration_s / (STEP_US * 1e-6)))
    times = begins_s + np.arange(steps + 1) * STEP_US * 1e-6
    at = np.column_stack([np.interp(times, path.times_s, path.positions_enu_m[:, n]) for n in range(2)])
    places = [(float(east), float(north)) for east, north in path.positions_enu_m[:, :2]]
    ahead = np.searchsorted(path.times_s, times, side="right")
    speed_m_s = path.length_m / max(path.duration_s, 1.0)
    tracks = []
    for _, pursuer in pursuers_of(mission):
        rows = [(begins_s, *pursuer.position)]
        for step in range(1, steps + 1):
            before = step - 1
            target = TargetEstimate(
                (float(at[before, 0]), float(at[before, 1])), speed_m_s, tuple(places[ahead[before] :]), 0
            )
            pursuer.step(before * STEP_US, STEP_US * 1e-6, target)
            rows.append((float(times[step]), *pursuer.position))
        tracks.append(np.array(rows))
    return tracks
