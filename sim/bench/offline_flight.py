"""Whole flights for those who call from Python."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Mapping

from companion.config import MissionConfig
from companion.kernels.native.ready import make_ready
from companion.offline import Flown
from companion.recording.recorder import Listener
from companion.types.events import Dialect
from ..flight_record import record_of
from ..sitl import Flight


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
    return Flown(mission, measures_of(flight), record_of(flight))


def watched(
    mission: MissionConfig, seed: int, pace: float, listen: Listener, is_wanted: Callable[[], bool]
) -> Mapping[str, object]:
    """Fly a mission while somebody looks on, and return its measures; none if it was not wanted to its end.

    Parameters
    ----------
    mission : MissionConfig
        The mission.
    seed : int
        Seed of everything random.
    pace : float
        Simulated seconds a second; infinite for as fast as it goes.
    listen : callable
        Gets each message that a recording would have.
    is_wanted : callable
        Asked in each step; the flight ends if it returns False.
    """
    make_ready()
    flight = Flight(mission, seed, speed=pace)
    flight.recorder.listen(listen)

    async def fly() -> bool:
        def look(_: Flight) -> None:
            if not is_wanted():
                flying.cancel()

        flying = asyncio.ensure_future(flight.fly(look))
        with contextlib.suppress(asyncio.CancelledError):
            await flying
        return not flying.cancelled()

    return measures_of(flight) if asyncio.run(fly()) else {}


def measures_of(flight: Flight) -> dict[str, object]:
    """Return what was measured of a flight, without its paths: the record and whoever looks on have these."""
    paths = ("true_path", "dt_path", "dt_paths")
    return {key: value for key, value in flight.document().items() if key not in paths}
