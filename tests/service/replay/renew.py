"""Flies and records the flights of the references anew: ``python -m tests.service.replay.renew``."""

import asyncio
import shutil
import sys
import tempfile
from pathlib import Path

from companion.config import load_mission
from companion.types.events import Dialect
from sim.sitl import Flight
from tests.sim.client import CONFIGS

FOLDER = Path(__file__).parent / "recordings"
FLIGHTS = {
    "first-flight-ardupilot": ("first-flight", 1, Dialect.ARDUPILOT),
    "first-flight-px4": ("first-flight", 3, Dialect.PX4),
}


def renew():
    """Write a tlog, an mcap and the mission file for each."""
    for name, (mission, seed, dialect) in FLIGHTS.items():
        file = CONFIGS / f"{mission}.yaml"
        with tempfile.TemporaryDirectory() as folder:
            text = file.read_text(encoding="utf-8")
            flight = Flight(load_mission(file), seed, Path(folder), dialect, mission_text=text)
            asyncio.run(flight.fly())
            for kind, target in (("flight.tlog", "tlog"), ("flight.mcap", "mcap"), ("mission.yaml", "yaml")):
                shutil.copy(Path(folder) / kind, FOLDER / f"{name}.{target}")


if __name__ == "__main__":
    if sys.argv[1:]:
        sys.exit(__doc__)
    renew()
