"""``python -m sim.team``: flights of a team in fast time, one row of JSON each."""

from __future__ import annotations

import dataclasses
import json
import logging
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from .fast_time import RunRow, fly, fly_straight
from .scenes import Scene

logger = logging.getLogger(__package__)


def main(
    runs: Annotated[int, typer.Option(min=1, help="Flights.")] = 10,
    aircraft: Annotated[int, typer.Option(min=2, help="Aircraft in each.")] = 128,
    first_seed: Annotated[int, typer.Option(min=0, help="Seed of the first flight.")] = 1,
    loss: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Share of messages that are not heard.")
    ] = 0.3,
    delay: Annotated[float, typer.Option(min=0.0, help="Mean delay of a message [s].")] = 1.0,
    jobs: Annotated[int, typer.Option(min=1, help="Flights at once.")] = 1,
    straight: Annotated[bool, typer.Option(help="Without sharing: everybody flies straight.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="File to which rows are added; else they are shown.")
    ] = None,
) -> None:
    """Fly teams that share their plans over a lossy radio, and count lost separations."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    scene = Scene(num_aircraft=aircraft, loss=loss, delay_s=delay)
    flight = partial(fly_straight if straight else fly, scene=scene)
    seeds, rows = range(first_seed, first_seed + runs), []
    with ProcessPoolExecutor(jobs) as pool:
        for row in pool.map(flight, seeds):
            rows.append(row)
            text = json.dumps(dataclasses.asdict(row)) + "\n"
            if out is None:
                sys.stdout.write(text)
            else:
                with out.open("a", encoding="utf-8") as file:
                    file.write(text)
    logger.info("%s", summary(rows))


def summary(rows: list[RunRow]) -> str:
    """Return the counts of flights in one line."""
    flown, aircraft = len(rows), sum(row.aircraft for row in rows)
    return (
        f"{flown} flights: {sum(row.pairs_lost for row in rows)} pairs lost separation; "
        f"{sum(row.blocked for row in rows)} of {aircraft} aircraft blocked; "
        f"{sum(row.bytes_s for row in rows) / flown:.1f} B/s each; "
        f"{sum(row.wall_s for row in rows) / flown:.1f} s a flight"
    )


if __name__ == "__main__":
    typer.run(main)
