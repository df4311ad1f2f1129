"""Flights in the simulator with their recordings, each made once."""

import asyncio
import functools
import tempfile
from pathlib import Path

from companion.config import load_mission
from companion.recording.reader import load_recording
from companion.service.replay.engine import Replay
from companion.types.events import Dialect
from sim.sitl import Flight
from tests.sim.client import CONFIGS


@functools.cache
def recorded(name, seed, dialect=Dialect.ARDUPILOT):
    """Folder of a flight's recording, and the flight."""
    file = CONFIGS / f"{name}.yaml"
    folder = Path(tempfile.mkdtemp(prefix="flight-"))
    flight = Flight(load_mission(file), seed, folder, dialect, mission_text=file.read_text(encoding="utf-8"))
    asyncio.run(flight.fly())
    return folder, flight


def replayed(log, mission, seed=None):
    """A recording and what a replay of it gives."""
    recording = load_recording(Path(log))
    return recording, asyncio.run(Replay(recording, mission, seed).run())
