"""A whole flight in one process: simulator, link and service on simulated time.

The two talk MAVLink bytes, as over a wire, in the steps of :mod:`companion.service.replay.lockstep`: the same
seed gives the same flight.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from companion.clock import ManualClock
from companion.config import MissionConfig
from companion.errors import NoAutopilotError
from companion.flight.messages.vehicle_link import VehicleLink
from companion.flight.state.modes import Mode
from companion.flight.tasks.app import App, stop
from companion.flight.tasks.composition import composed
from companion.link.wire.memory_transport import MemoryTransport
from companion.planning.plan_runner import InlineRunner
from companion.recording.recorder import About, Recorder
from companion.service.replay.lockstep import STEP_S, TURN_TIMEOUT_S, step
from companion.types.events import Dialect
from .faults import FaultyLink
from .flight_measures import FlightMeasures, Measures, measured
from .simulator import Aircraft, Place, Simulator

SILENT_S = 10.0
LINGER_S = 2.0  # The flight goes on for this time after the goal.
STATION = (255, 190)  # System and component of the ground station that switches replanning off.
EPOCH_S = 1_767_225_600.0  # 2026-01-01T00:00:00Z, the day of simulated flights.


@dataclass
class Flight:
    """A flight and its measures.

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    seed : int
        Seed of everything random.
    folder : Path or None
        Folder of the recording.
    dialect : Dialect
        Which autopilot flies.
    speed : float
        Simulated seconds a second.
    turn_timeout_s : float
        Longest wait for MAVSDK, by the computer's clock.
    mission_text : str
        The mission file, for the recording.
    on_ground : bool
        Whether it begins on the ground, disarmed and without a mission.
    route_enu_m : tuple of (float, float, float)
        Waypoints of the operator's mission [m]; with them replanning is switched off. Without any, the
        service decides what is flown.
    battery_drain : float
        Factor by which the battery falls faster than the flight takes.
    aircraft : sequence of (str, PassingAircraft)
        Aircraft that pass, by their names.
    system_id : int
        The autopilot's MAVLink system id.

    Attributes
    ----------
    wire : Simulator or FaultyLink
        Receiver of the service's bytes; a faulty link may replace the simulator.
    """

    mission: MissionConfig
    seed: int
    folder: Path | None = None
    dialect: Dialect = Dialect.ARDUPILOT
    speed: float = math.inf
    wall_s: float = 0.0
    turn_timeout_s: float = TURN_TIMEOUT_S
    mission_text: str = ""
    on_ground: bool = False
    route_enu_m: tuple[Place, ...] = ()
    battery_drain: float = 1.0
    aircraft: Aircraft = ()
    system_id: int = 1
    wire: Simulator | FaultyLink = field(init=False)
    recorder: Recorder = field(init=False)
    simulator: Simulator = field(init=False)
    app: App = field(init=False)

    def __post_init__(self) -> None:
        about = About(self.mission, self.seed, self.mission_text, STEP_S)
        self.recorder = Recorder(self.folder, EPOCH_S, about)
        self.simulator = Simulator(
            self.mission, seed=self.seed, dialect=self.dialect, on_ground=self.on_ground,
            route_enu_m=self.route_enu_m, battery_drain=self.battery_drain, aircraft=self.aircraft,
            system_id=self.system_id,
        )  # fmt: skip
        self.wire = self.simulator

    @property
    def now_s(self) -> float:
        """Simulated seconds."""
        return self.simulator.now_s

    @property
    def limit_s(self) -> float:
        """Time limit of the flight: three times that of the straight line, and two minutes."""
        points = [(self.mission.start.east_m, self.mission.start.north_m)]
        points += [(goal.east_m, goal.north_m) for goal in self.mission.goals]
        way = sum(math.dist(a, b) for a, b in itertools.pairwise(points))
        return 120.0 + 3.0 * way / float(self.mission.vehicle.airspeed_cruise_m_s)

    @property
    def goal_reached(self) -> bool:
        """Return whether the true path passed the last goal within its radius."""
        return self.simulator.truth.min_goal_distance_m <= self.mission.goals[-1].acceptance_radius_m

    async def fly(self, on_step: Callable[[Flight], None] | None = None) -> None:
        """Fly until the goal is reached, something is hit, or the time limit has passed.

        Raises
        ------
        NoAutopilotError
            If no heartbeat comes within 10 s of simulated time.
        """
        arrived_s = math.inf
        async with self.running() as advance:
            while self.now_s < self.limit_s and self.now_s < arrived_s + LINGER_S:
                await advance()
                if self.has_arrived() and arrived_s == math.inf:
                    arrived_s = self.now_s
                if self.simulator.truth.collision:
                    break
                if self.now_s > SILENT_S and not self.app.link.has_received:
                    raise NoAutopilotError("no heartbeat of an autopilot within 10 s")
                if on_step is not None:
                    on_step(self)

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[Callable[[], Awaitable[None]]]:
        """Run the service; what is returned advances simulated time once, and lets the service act on it."""
        clock = ManualClock()
        ours, theirs = MemoryTransport.pair()
        link = VehicleLink(self.mission, ours, clock, self.recorder)
        parts = composed(self.mission, link, clock, self.recorder, seed=self.seed, runner=InlineRunner())
        self.app = App(parts)
        if self.route_enu_m:
            parts.parameters.switch_off(STATION)
        theirs.set_receiver(self.wire.receive)
        await theirs.open()
        running = asyncio.create_task(self.app.run(), name="service")
        began = time.perf_counter()

        async def advance() -> None:
            await self._step(clock, theirs, running)
            if math.isfinite(self.speed):
                await asyncio.sleep(max(0.0, began + self.now_s / self.speed - time.perf_counter()))

        try:
            yield advance
        finally:
            self.wall_s = time.perf_counter() - began
            await stop(running)
            self.recorder.close()

    def has_arrived(self) -> bool:
        """Return whether the goal is reached, by the service or, if that does not plan, by the truth."""
        return self.goal_reached if self.route_enu_m else self.app.mode is Mode.ARRIVED

    async def _step(self, clock: ManualClock, theirs: MemoryTransport, running: asyncio.Task[None]) -> None:
        """Advance simulated time once, and let the service act on it."""
        self.wire.step(STEP_S)
        data = self.wire.take_outgoing()
        await step(self.app, clock, theirs, data, self.simulator.now_s, self.turn_timeout_s)
        if running.done():
            await running

    def measures(self) -> FlightMeasures:
        """Return the encounters with the threats, by the true paths."""
        mission = self.mission
        return measured(self.simulator.truth, mission.dynamic_threat_list, mission.radar_list)

    def summary(self) -> dict[str, float | int | bool | str]:
        """Measures of ``sitl --json`` without paths and single threats; infinite if never happened."""
        truth, recorder, measures = self.simulator.truth, self.recorder, self.measures()
        plan_ms = np.array(recorder.plan_ms or [math.nan])
        latency = np.array(recorder.track_to_mission_ms or [math.nan])
        reached, hit, threatened = self.goal_reached, truth.collision, measures.num_threatening
        return {
            "mission": self.mission.name,
            "seed": self.seed,
            "success": reached and not hit,
            "goal_reached": reached,
            "collision": hit,
            "is_safe": reached and not hit and threatened == 0,
            "threatened": threatened,
            **_rounded(measures.over_all()),
            "min_obstacle_clearance_m": round(truth.min_obstacle_clearance_m, 3),
            "min_ground_height_m": round(truth.min_ground_height_m, 3),
            "missions_uploaded": self.app.num_swaps,
            "missions_rejected": recorder.num_rejected,
            "replans": len(recorder.plan_ms),
            "plan_ms_median": round(float(np.median(plan_ms)), 3),
            "plan_ms_p95": round(float(np.percentile(plan_ms, 95)), 3),
            "plan_ms_max": round(float(plan_ms.max()), 3),
            "track_to_mission_ms_median": round(float(np.median(latency)), 3),
            "track_to_mission_ms_p95": round(float(np.percentile(latency, 95)), 3),
            "flight_s": round(self.now_s, 3),
            "wall_s": round(self.wall_s, 3),
        }

    def document(self) -> dict[str, object]:
        """The JSON of ``companion sitl``: measures by name, and the true paths; null if never happened."""
        flat = _finite(self.summary())
        del flat["mission"], flat["seed"]
        flat["min_dt_distance_m"] = flat["miss_distance_m"]  # The older name of the measure.
        for name, keys in (("plan_ms", ("median", "p95", "max")), ("track_to_mission_ms", ("median", "p95"))):
            flat[name] = {key: flat.pop(f"{name}_{key}") for key in keys}
        by_name = self.measures().by_name()
        flat["dynamic_threats"] = {name: _finite(_rounded(of_one)) for name, of_one in by_name.items()}
        truth = self.simulator.truth
        flat["true_path"] = _table(truth.path, 4)
        flat["dt_path"] = _table(truth.dt_path, 3)
        flat["dt_paths"] = {name: _table(rows, 3) for name, rows in truth.threat_paths.items()}
        return flat


def _rounded(measures: Measures) -> Measures:
    return {key: round(value, 3) for key, value in measures.items()}


def _finite(measures: Mapping[str, object]) -> dict[str, object]:
    """Measures fit for JSON, which has no infinity."""
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in measures.items()
    }


def _table(rows: list[list[float]], digits: int) -> list[list[float]]:
    return [[round(value, digits) for value in row] for row in rows]
