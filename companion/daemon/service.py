"""``companion run``: the service on the computer's own clock."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from datetime import UTC, datetime
from pathlib import Path

from companion.clock import WallClock
from companion.config import MissionConfig
from companion.config.compose import goals_of, planner_settings_of, vehicle_of, world_of
from companion.daemon.app import App
from companion.daemon.memory import Memory
from companion.daemon.record import Recorder
from companion.link.codec import signer_of
from companion.link.signing import Signer, Timestamps, read_key
from companion.link.transport import transport_from_url
from companion.planning.problem import GoalRegion, Problem, StartState, initial_covariances
from companion.planning.solver import solve

REPORT_SILENCE_S = 5.0

_log = logging.getLogger(__name__)


async def serve(mission: MissionConfig, url: str, flights: Path) -> None:
    """Run until cancelled; says within seconds when no autopilot is heard, and keeps trying."""
    clock = WallClock()
    transport = transport_from_url(url, clock)
    timestamps, signer = _signing(mission)
    name = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{mission.name}"
    recorder = Recorder(flights / name, time.time() - clock.now_s())
    app = App(
        mission,
        transport,
        clock,
        recorder,
        seed=int(mission.planning.seed),
        plans_inline=False,
        memory=Memory(flights / mission.name),
        signer=signer,
    )
    _log.info("listening on %s; recording to %s", url, flights / name)
    try:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(app.run())
            tasks.create_task(_report_silence(app, clock, url))
            tasks.create_task(_warm(app, mission))
    finally:
        recorder.close()
        if timestamps is not None:
            timestamps.close()


def _signing(mission: MissionConfig) -> tuple[Timestamps | None, Signer | None]:
    """What signs and verifies, as the mission file says; nothing without a key."""
    signing = mission.link.signing
    if signing is None:
        return None, None
    key_file = Path(signing.key_file)
    times = signing.timestamp_file or f"{signing.key_file}.times"
    timestamps = Timestamps(Path(times), time.time)
    signer = signer_of(read_key(key_file), signing.link_id, timestamps, signing.allow_unsigned)
    return timestamps, signer


async def _warm(app: App, mission: MissionConfig) -> None:
    """Compile beside everything else; the first plan waits for it."""
    app.may_plan = False
    _log.info("compiling the planner's kernels")
    await asyncio.to_thread(warm_up, mission)
    app.may_plan = True
    _log.info("ready to plan")


async def _report_silence(app: App, clock: WallClock, url: str) -> None:
    """Say every few seconds that no autopilot is heard, while that is so."""
    while True:
        await clock.sleep_until(clock.now_s() + REPORT_SILENCE_S)
        if not app.hears_autopilot:
            _log.warning("no autopilot heard on %s for %.0f s; still trying", url, REPORT_SILENCE_S)


def _some_goal(mission: MissionConfig) -> GoalRegion:
    """A place ahead of the start, for a mission whose goals the autopilot holds."""
    start, ahead = mission.start, 4.0 * float(mission.vehicle.turn_radius_min_m)
    course = math.radians(start.course_deg)
    east, north = start.east_m + ahead * math.sin(course), start.north_m + ahead * math.cos(course)
    return GoalRegion((float(east), float(north), float(start.up_m)), 60.0)


def warm_up(mission: MissionConfig) -> None:
    """Compile every kernel, so that the first plan in flight is as fast as the others."""
    vehicle = vehicle_of(mission)
    start = mission.start
    problem = Problem(
        start=StartState(
            0.0, (float(start.east_m), float(start.north_m), float(start.up_m)), 0.0, 0.0,
            vehicle.airspeed_cruise_m_s, initial_covariances(vehicle, 2.0, 2.0),
            initial_covariances(vehicle, 0.0, 0.0),
        ),
        goals=goals_of(mission) or (_some_goal(mission),),
        snapshot=world_of(mission),
        vehicle=vehicle,
        settings=planner_settings_of(mission),
        seed=0,
    )  # fmt: skip
    solve(problem)
