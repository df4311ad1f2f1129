"""Whole flights for those who call from Python."""

from __future__ import annotations

import asyncio

from companion.config import MissionConfig
from companion.kernels.native.ready import make_ready
from companion.offline import Flown
from companion.types.events import Dialect
from sim.flight_record import record_of
from sim.sitl import Flight


def flown(mission: MissionConfig, seed: int, autopilot: str) -> Flown:
    """Fly a mission; kernels are read or compiled before.

    Parameters
    ----------
    mission : MissionConfig
        The mission.
    seed : int
        Seed of everything random.
    autopilot : str
        The value of a :class:`Dialect`.
    """
    make_ready()
    flight = Flight(mission, seed, dialect=Dialect(autopilot))
    asyncio.run(flight.fly())
    document = flight.document()
    for name in ("true_path", "dt_path", "dt_paths"):
        del document[name]  # The record has these.
    return Flown(mission, document, record_of(flight))
