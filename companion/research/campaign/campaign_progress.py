"""A campaign from its file to its rows, and what the terminal shows meanwhile."""

from __future__ import annotations

import itertools
import json
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column, Table

from companion.errors import ConfigError
from companion.research.campaign.campaign_spec import Campaign, Run
from companion.research.campaign.engines.finished import Finished
from companion.research.campaign.engines.process_engine import ProcessEngine
from companion.research.campaign.engines.runners import runner_at
from companion.research.campaign.provenance import provenance
from companion.research.campaign.run_store import RunStore
from companion.run_places import places


class _Shown(NamedTuple):
    """A measure whose running median is shown: its name, heading and factor."""

    name: str
    heading: str
    factor: float = 1.0


_SHOWN = {
    "anytime": (
        _Shown("first_s", "first, ms", 1e3),
        _Shown("cost_1_s", "PC, 1 s"),
        _Shown("cost_10_s", "PC, 10 s"),
    ),
    "plans": (_Shown("PST", "PST, ms", 1e3), _Shown("PC", "PC"), _Shown("Q", "Q"), _Shown("TTA", "TTA")),
    "encounters": (
        _Shown("miss_m", "miss distance, m"),
        _Shown("severity", "severity"),
        _Shown("detour_s", "later, s"),
    ),
    "flights": (
        _Shown("flight_s", "flight, s"),
        _Shown("seconds_in_reach_and_sight", "threatened, s"),
        _Shown("min_obstacle_clearance_m", "clearance, m"),
    ),
}


@dataclass(slots=True)
class _Tally:
    """The running results of a method on a mission, under all settings together."""

    num_runs: int = 0
    num_errors: int = 0
    num_successes: int = 0
    values: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    def add(self, over: Finished) -> None:
        """Count a run."""
        self.num_runs += 1
        if over.outcome.error is not None:
            self.num_errors += 1
            return
        measured = json.loads(over.outcome.measures) | json.loads(over.outcome.timings)
        if measured.get("success") is not True:
            return
        self.num_successes += 1
        for name, value in measured.items():
            if isinstance(value, int | float) and not isinstance(value, bool):
                self.values[name].append(float(value))


class _Display:
    """The progress bar, and below it one line for each method on each mission."""

    def __init__(self, campaign: Campaign, done: int) -> None:
        self._shown = _SHOWN[campaign.config.kind]
        named = itertools.product(campaign.texts, campaign.config.methods)
        self._tallies = {name: _Tally() for name in named}
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
        )
        self._task = self._bar.add_task(campaign.config.name, total=len(campaign.runs), completed=done)

    def add(self, over: Finished) -> None:
        """Count a run."""
        self._tallies[over.run.mission, over.run.method].add(over)
        self._bar.advance(self._task)

    def __rich__(self) -> Group:
        return Group(self._bar, self.table())

    def table(self) -> Table:
        """The results so far: runs, successes, errors, and medians of the runs that reached the goal."""
        names = Column("mission", no_wrap=True), Column("method", no_wrap=True)
        table = Table(*names, "runs", "success", "errors", *(entry.heading for entry in self._shown))
        for (mission, method), tally in self._tallies.items():
            share = f"{tally.num_successes / tally.num_runs:.0%}" if tally.num_runs else "–"
            medians = (_median(tally.values[entry.name], entry.factor) for entry in self._shown)
            table.add_row(mission, method, str(tally.num_runs), share, str(tally.num_errors), *medians)
        return table


def _median(values: Sequence[float], factor: float) -> str:
    return f"{factor * float(np.median(values)):.4g}" if values else "–"


@dataclass(frozen=True, slots=True)
class CampaignResult:
    """The result of a campaign: the number of rows, of new ones, and of errors."""

    num_rows: int
    num_made: int
    num_errors: int


def run_campaign(
    campaign: Campaign,
    folder: Path,
    *,
    jobs: int,
    resumes: bool,
    console: Console,
    scheduler: str | None = None,
) -> CampaignResult:
    """Make a campaign's runs, and store each when it is finished.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    folder : Path
        Where the rows are stored.
    jobs : int
        How many processes make runs.
    resumes : bool
        Whether to continue an earlier campaign; if not, a folder with rows is refused.
    console : Console
        Where progress is shown.
    scheduler : str, optional
        Address of a Dask scheduler whose workers make the runs instead of processes of this computer.

    Raises
    ------
    ConfigError
        If the folder is of another campaign, or what makes such runs is not installed.
    RecordError
        If a row cannot be stored.
    """
    known = places()
    kind = campaign.config.kind
    if kind not in known:
        found, expected = "no simulator installed", "pip install 'safe-rrt-companion[sim]'"
        raise ConfigError("companion", None, f"campaign of {kind}", found, expected)
    runner_at(known[kind], campaign, known)  # A missing part fails here, once, instead of in every process.
    store = RunStore.to_write(folder, campaign, resumes=resumes)
    try:
        there = store.numbers()
        runs = [run for run in campaign.runs if run.number not in there]
        num_errors = _make(campaign, store, runs, _engine(campaign, known, jobs, scheduler), console)
    finally:
        store.close()
    return CampaignResult(len(campaign.runs), len(runs), num_errors)


class Engine(Protocol):
    """The maker of runs."""

    def finished(self, runs: Sequence[Run]) -> Iterator[Finished]:
        """Make the runs, and yield each when it is finished."""
        ...


def _engine(campaign: Campaign, known: dict[str, str], jobs: int, scheduler: str | None) -> Engine:
    if scheduler is None:
        return ProcessEngine(campaign, known, jobs)
    from companion.research.campaign.engines.dask_engine import DaskEngine  # an extra  # noqa: PLC0415

    return DaskEngine(campaign, known, scheduler)


def _make(campaign: Campaign, store: RunStore, runs: Sequence[Run], engine: Engine, console: Console) -> int:
    """Make runs and store them; return how many were errors."""
    if not runs:
        return 0
    made_by, num_errors = provenance(), 0
    digests = {name: campaign.digest(name) for name in campaign.texts}
    display = _Display(campaign, len(campaign.runs) - len(runs))
    with Live(display, console=console, refresh_per_second=4, transient=True):
        for over in engine.finished(runs):
            store.add(over, digests[over.run.mission], over.made_by or made_by)
            display.add(over)
            num_errors += over.outcome.error is not None
    console.print(display.table())
    return num_errors
