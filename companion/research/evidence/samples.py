"""Measures as columns: which there are, of which runs, and their values by seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from companion.config.load import mission_from_text
from companion.errors import ConfigError
from companion.frames import FloatArray
from companion.research.campaign.run_store import Row, RunStore


class Measure(NamedTuple):
    """A measure: its name in the rows, its meaning, and whether only runs that reach the goal have it."""

    name: str
    words: str
    of_success: bool = False


class Group(NamedTuple):
    """Measures of one table."""

    title: str
    measures: tuple[Measure, ...]


FAILURE = Measure("FR", "failure rate: no path to the goal, or a fault")
GROUPS: dict[str, tuple[Group, ...]] = {
    "plans": (
        Group(
            "Search",
            (
                Measure("PST", "path search [s]"),
                Measure("NCDC", "collision checks"),
                Measure("NTN", "tree nodes"),
                Measure("ESR", "NTN/NCDC"),
                Measure("TSI", "PST/NCDC [s]"),
            ),
        ),
        Group(
            "Path",
            (
                Measure("PC", "path cost by (9)", of_success=True),
                Measure("Q", "path quality by (8)", of_success=True),
                Measure("length_m", "length [m]", of_success=True),
                Measure("duration_s", "duration [s]", of_success=True),
            ),
        ),
        Group(
            "Radars",
            (
                Measure("TTA", "sum of radar membership over the path", of_success=True),
                Measure("ATP", "radar threat at waypoints by IFWA", of_success=True),
                Measure("NHTW", "waypoints above level 0.5", of_success=True),
                Measure("PSR", "success by (3)", of_success=True),
            ),
        ),
        Group(
            "Moving threats, driven against the path",
            (
                Measure("ADTP", "actual threat at waypoints by IFWA", of_success=True),
                Measure("TDTA", "sum of the actual threat over the path", of_success=True),
                Measure("ETDTA", "the same sum as estimated", of_success=True),
                Measure("ETDTA/TDTA", "how much of it was foreseen", of_success=True),
                Measure("TFP/PD", "first pursued, share of the path's duration", of_success=True),
                Measure("RRS", "nodes called reachable", of_success=True),
            ),
        ),
    ),
    "flights": (
        Group(
            "Moving threats, by the true paths",
            (
                Measure("threatened", "how many had the aircraft in reach and sight"),
                Measure("seconds_in_reach_and_sight", "for how long [s]"),
                Measure("miss_distance_m", "nearest approach [m]"),
                Measure("TDTA", "sum of the threat over the path"),
                Measure("ADTP", "threat at waypoints by IFWA"),
            ),
        ),
        Group(
            "Radars and obstacles",
            (
                Measure("seconds_in_radar", "in a radar's reach and sight [s]"),
                Measure("TTA", "sum of radar membership"),
                Measure("ATP", "radar threat by IFWA"),
                Measure("min_obstacle_clearance_m", "nearest obstacle [m]"),
            ),
        ),
        Group(
            "Flight",
            (
                Measure("flight_s", "until the goal was reached [s]", of_success=True),
                Measure("missions_uploaded", "missions"),
                Measure("replans", "plans"),
                Measure("plan_ms.median", "a plan, median [ms]"),
                Measure("plan_ms.max", "a plan, longest [ms]"),
            ),
        ),
    ),
    "encounters": (
        Group(
            "Passing aircraft, by the true paths",
            (
                Measure("miss_m", "nearest approach in the plane [m]"),
                Measure("severity", "how deep in the well clear volume, 0 to 1"),
                Measure("without.miss_m", "nearest approach of the flight alone [m]"),
                Measure("without.severity", "how deep the flight alone is"),
                Measure("detour_m", "longer than the flight alone [m]"),
                Measure("detour_s", "later than the flight alone [s]"),
            ),
        ),
    ),
    "anytime": (
        Group(
            "Paths",
            (
                Measure("first_s", "until the first path [s]", of_success=True),
                Measure("cost_0.1_s", "cost by (9) after 0.1 s"),
                Measure("cost_1_s", "after 1 s"),
                Measure("cost_10_s", "after 10 s"),
                Measure("asked", "edges that Python was asked"),
                Measure("asked_s", "in which it spent [s]"),
            ),
        ),
    ),
}


@dataclass(frozen=True)
class Sample:
    """All runs of one method on one mission under one set of settings, by their seeds."""

    rows: Mapping[int, Row]

    @property
    def num_errors(self) -> int:
        """Number of runs that ended in an error."""
        return sum(row.error is not None for row in self.rows.values())

    def share(self, name: str) -> FloatArray:
        """1 or 0 for each seed in order, shape (N,): whether a measure is true; 0 for runs with an error."""
        return np.array([float(row.measures.get(name) is True) for _, row in sorted(self.rows.items())])

    def values(self, measure: Measure) -> dict[int, float]:
        """Values by their seeds, of the runs that have one."""
        if measure == FAILURE:
            return {seed: float(row.measures.get("success") is not True) for seed, row in self.rows.items()}
        found = {}
        for seed, row in sorted(self.rows.items()):
            value = row.measures.get(measure.name)
            reached = row.measures.get("success") is True or not measure.of_success
            if reached and isinstance(value, int | float) and not isinstance(value, bool):
                found[seed] = float(value)
        return found


@dataclass(frozen=True)
class Case:
    """One mission under one set of settings: the sample of each method, in the campaign's order."""

    mission: str
    setting: str
    dimension: int
    samples: Mapping[str, Sample]

    @property
    def title(self) -> str:
        """Mission and settings."""
        return f"{self.mission}, {self.setting}"


@dataclass(frozen=True)
class Evidence:
    """A campaign's rows in order.

    Parameters
    ----------
    name, kind : str
        The campaign's.
    cases : tuple of Case
        Missions by settings.
    num_rows, num_wanted : int
        Number of runs so far, and number of the campaign's runs.
    commits, machines : tuple of str
        Commits and computers that made them.
    """

    name: str
    kind: str
    cases: tuple[Case, ...]
    num_rows: int
    num_wanted: int
    commits: tuple[str, ...]
    machines: tuple[str, ...]


def paired(first: Mapping[int, float], second: Mapping[int, float]) -> tuple[FloatArray, FloatArray]:
    """Values of two methods on the seeds that both have.

    Parameters
    ----------
    first, second : mapping
        Values by seeds.

    Returns
    -------
    first, second : ndarray, shape (N,)
        Values in the seeds' order.
    """
    seeds = sorted(first.keys() & second.keys())
    return np.array([first[seed] for seed in seeds]), np.array([second[seed] for seed in seeds])


def evidence_of(store: RunStore) -> Evidence:
    """Return all measures of a campaign so far.

    Raises
    ------
    ConfigError
        If there is no row yet.
    """
    return evidence_from(*stored(store))


def stored(store: RunStore) -> tuple[list[Row], Mapping[str, object], Mapping[str, int]]:
    """Return a campaign's rows, its identity, and the dimension of each mission.

    Raises
    ------
    ConfigError
        If there is no row yet.
    """
    rows = list(store.rows())
    if not rows:
        raise ConfigError("results", None, "FOLDER", "a campaign without a row", "one that has been run")
    dimensions = {name: mission_from_text(text, name).dimension for name, text in store.texts().items()}
    return rows, store.identity(), dimensions


def evidence_from(
    rows: Sequence[Row], identity: Mapping[str, object], dimensions: Mapping[str, int]
) -> Evidence:
    """Arrange rows by mission, setting, method and seed; those of encounters also without their setting.

    Parameters
    ----------
    rows : sequence of Row
        The rows, in any order.
    identity : mapping
        The campaign's identity, see :meth:`companion.research.campaign.campaign_spec.Campaign.identity`.
    dimensions : mapping
        Number of dimensions of each mission.
    """
    missions, settings, methods, seeds = (
        _names(identity[key]) for key in ("missions", "settings", "methods", "seeds")
    )
    by_case: dict[tuple[str, str, str], dict[int, Row]] = {}
    for row in rows:
        by_case.setdefault((row.mission, row.setting, row.method), {})[row.seed] = row
    cases = [
        Case(
            mission,
            setting,
            dimensions[mission],
            {method: Sample(by_case.get((mission, setting, method), {})) for method in methods},
        )
        for mission in missions
        for setting in settings
    ]
    kind = str(identity["kind"])
    if kind == "encounters" and len(settings) > 1:
        cases += _pooled(cases)
    return Evidence(
        str(identity["name"]),
        kind,
        tuple(cases),
        len(rows),
        len(missions) * len(settings) * len(methods) * len(seeds),
        tuple(dict.fromkeys(row.commit for row in rows)),
        tuple(dict.fromkeys(row.machine for row in rows)),
    )


def _pooled(cases: Sequence[Case]) -> list[Case]:
    """Return the runs of each mission under all settings as one case, numbered anew."""
    found = []
    for mission in dict.fromkeys(case.mission for case in cases):
        of_mission = [case for case in cases if case.mission == mission]
        samples = {
            method: Sample(
                dict(enumerate(row for case in of_mission for row in case.samples[method].rows.values()))
            )
            for method in of_mission[0].samples
        }
        found.append(Case(mission, "all", of_mission[0].dimension, samples))
    return found


def _names(entries: object) -> list[str]:
    """Names in a list whose entries may be pairs."""
    known = entries if isinstance(entries, list) else []
    return [str(entry[0] if isinstance(entry, list) else entry) for entry in known]
