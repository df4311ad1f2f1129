"""``python -m sim MISSION [--listen URL] [--speed N]``: the simulator alone, for any MAVLink client."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from pathlib import Path
from typing import Annotated

import typer

from companion.config import load_mission
from companion.errors import CompanionError
from companion.types.events import Dialect
from .server import serve
from .simulator import Simulator

logger = logging.getLogger("sim")


def main(
    mission: Annotated[Path, typer.Argument(help="A mission file, as in mission_configs.")],
    listen: Annotated[
        str, typer.Option(help="udpin://host:port, udpout://host:port or tcp://host:port.")
    ] = "tcp://127.0.0.1:5760",
    speed: Annotated[float, typer.Option(min=0.01, help="Simulated seconds a second.")] = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Of turbulence, sensors and tracks.")] = 1,
    autopilot: Annotated[
        Dialect, typer.Option(help="Whose mission semantics the simulator has.")
    ] = Dialect.ARDUPILOT,
) -> None:
    """Fly the aircraft of a mission file, for any MAVLink client; Ctrl-C ends it."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    try:
        simulator = Simulator(load_mission(mission), seed=seed, dialect=autopilot)
        logger.info("flying %s; %s on %s", mission, autopilot.value, listen)
        with contextlib.suppress(KeyboardInterrupt):
            asyncio.run(serve(simulator, listen, speed))
    except CompanionError as error:
        logger.error("%s", error)
        raise SystemExit(error.exit_code) from None


if __name__ == "__main__":
    typer.run(main)
