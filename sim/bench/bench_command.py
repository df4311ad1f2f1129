"""``companion bench``: the speed figures, as a table or as JSON."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from companion.cli import EXIT_FAILED
from companion.cli_options import JsonFile, write_json

GOALS_S = {"ardupilot": 2.5, "px4": 1.5}  # Promised median reaction times [s].


def register(app: typer.Typer) -> None:
    """Add the command to ``companion``."""
    app.command("bench")(bench)


def bench(
    missions: Annotated[
        list[Path] | None,
        typer.Argument(help="Mission files to plan and to fly in the wind; else mission_configs/paper-*."),
    ] = None,
    json_file: JsonFile = None,
    flights: Annotated[int, typer.Option(min=1, help="In real time, of each kind.")] = 5,
    jobs: Annotated[int, typer.Option(min=1, help="Flights at once.")] = 1,
) -> None:
    """Measure reactions in real time, plans, and the prediction of arrival in wind.

    Exits with 1 if a median reaction takes longer than promised, or a reaction never comes.
    """
    from . import bench_figures

    files = missions or sorted(Path("mission_configs").glob("paper-*.yaml"))
    logging.disable(logging.CRITICAL)  # Of these flights only the figures matter.
    console = Console(stderr=json_file is not None and str(json_file) == "-")
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with (
        Progress(*columns, console=console, transient=True) as progress,
        ProcessPoolExecutor(jobs, initializer=logging.disable, initargs=(logging.CRITICAL,)) as pool,
    ):
        reacted = bench_figures.reactions(flights)
        shown = progress.track(
            pool.map(bench_figures.react, reacted), total=len(reacted), description="reaction"
        )
        reaction = bench_figures.by_change(reacted, list(shown))
        flown = bench_figures.winds(files)
        shown_too = progress.track(
            pool.map(bench_figures.arrive, flown), total=len(flown), description="wind"
        )
        arrival = bench_figures.by_wind(flown, list(shown_too))
        plans = {file.stem: bench_figures.planned(file) for file in files}
    figures = {"reaction": reaction, "plan": plans, "arrival_error_s": arrival}
    if json_file is not None:
        write_json(json_file, bench_figures.finite(figures))
    if json_file is None or str(json_file) != "-":
        for table in _tables(reaction, plans, arrival):
            console.print(table)
    if any(of["median_s"] > GOALS_S[kind] for kind, kinds in reaction.items() for of in kinds.values()):
        raise typer.Exit(EXIT_FAILED)


def _tables(
    reaction: dict[str, dict[str, dict[str, float]]], plans: dict[str, dict[str, float]],
    arrival: dict[str, dict[str, float]],
) -> Iterator[Table]:  # fmt: skip
    """One table of each kind of figure that was measured."""
    table = Table(title="from what changes the picture to the new mission flown, real time [s]")
    for head in ("autopilot", "change", "median", "95 %", "flights"):
        table.add_column(head, justify="left" if head in ("autopilot", "change") else "right")
    for kind, changes in reaction.items():
        for change, of in changes.items():
            table.add_row(kind, change, f"{of['median_s']:.2f}", f"{of['p95_s']:.2f}", str(of["n"]))
    yield table
    if plans:
        table = Table("mission", "median", "95 %", "n", title="plans [ms]")
        for name, of in plans.items():
            table.add_row(name, f"{of['median_ms']:.0f}", f"{of['p95_ms']:.0f}", str(of["n"]))
        yield table
    if arrival:
        table = Table("wind [m/s]", "median", "95 %", "n", title="arrival 30 s ahead off by [s]")
        for name, of in arrival.items():
            table.add_row(name, f"{of['median']:.2f}", f"{of['p95']:.2f}", str(of["n"]))
        yield table
