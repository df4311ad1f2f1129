"""The figures of ``companion bench``: the measured cases, and their summaries."""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Iterable, Sequence
from pathlib import Path

from companion.config import load_mission
from companion.research.campaign.runs import plan_runs
from companion.types.events import Dialect
from .arrival import fly_in_wind
from .reaction import CHANGES, reaction_s

WINDS_M_S, WINDS_FROM_DEG = (0, 5, 10, 14), (0, 135, 270)
PLANS = 20

Values = dict[str, float]
Reaction = tuple[str, Dialect, int]  # The kind of change, the autopilot, the seed.
Wind = tuple[
    Path, Dialect, int, int
]  # Mission file, autopilot, wind [m/s], direction that it comes from [deg].


def quantiles(values: Iterable[float], unit: str = "") -> Values:
    """Median, 95th percentile (of the nearest rank) and number; the first two names end in the unit."""
    ordered = sorted(values)
    if not ordered:
        return {f"median{unit}": math.nan, f"p95{unit}": math.nan, "n": 0}
    rank = max(math.ceil(0.95 * len(ordered)) - 1, 0)
    return {f"median{unit}": statistics.median(ordered), f"p95{unit}": ordered[rank], "n": len(ordered)}


def reactions(flights: int) -> list[Reaction]:
    """Return a number of flights of each kind."""
    return list(itertools.product(CHANGES, Dialect, range(1, flights + 1)))


def react(case: Reaction) -> float:
    """Time until the answer [s]; see :func:`sim.bench.reaction.reaction_s`."""
    return reaction_s(*case)


def by_change(cases: Sequence[Reaction], took_s: Sequence[float]) -> dict[str, dict[str, Values]]:
    """Reactions by autopilot and by what changes [s]."""
    found: dict[str, dict[str, list[float]]] = {
        dialect.value: {change: [] for change in CHANGES} for dialect in Dialect
    }
    for (change, dialect, _), took in zip(cases, took_s, strict=True):
        found[dialect.value][change].append(took)
    return {
        kind: {change: quantiles(some, "_s") for change, some in changes.items()}
        for kind, changes in found.items()
    }


def planned(file: Path) -> Values:
    """Return the durations of offline plans of a mission, without the first, which loads kernels [ms]."""
    _, plans = plan_runs(load_mission(file), method=None, first_seed=1, runs=PLANS + 1, time_limit_s=None)
    return quantiles((1e3 * plan.measures.path_search_time_s for plan in plans[1:]), "_ms")


def winds(files: Sequence[Path]) -> list[Wind]:
    """Every mission in every wind; in still air it comes from one side only."""
    every = itertools.product(files, Dialect, WINDS_M_S, WINDS_FROM_DEG)
    return [case for case in every if case[2] or case[3] == WINDS_FROM_DEG[0]]


def arrive(case: Wind) -> list[float]:
    """Errors of arrival predicted 30 s ahead in a flight [s]."""
    file, dialect, speed, direction = case
    return fly_in_wind(load_mission(file), dialect, speed, direction, 1).errors_s


def by_wind(cases: Sequence[Wind], errors_s: Sequence[Sequence[float]]) -> dict[str, Values]:
    """Errors of arrival by the wind [s]."""
    found: dict[str, list[float]] = {}
    for (_, _, speed, _), some in zip(cases, errors_s, strict=True):
        found.setdefault(str(speed), []).extend(map(abs, some))
    return {speed: quantiles(some) for speed, some in found.items()}


def finite(document: object) -> object:
    """Return the document with None in place of infinite numbers and NaN."""
    if isinstance(document, dict):
        return {key: finite(value) for key, value in document.items()}
    return None if isinstance(document, float) and not math.isfinite(document) else document
