"""Reaction time: from a change of the world to the flight of a new mission, in real time.

The service is a process of its own, as on board, and flies the simulator over TCP. In flight, at a moment
that is independent of its plans, a vehicle on the ground appears 600 m ahead, an aircraft that flew
beside ours turns towards it, or a fence is put across the path. A known vehicle on the ground that turns is
no surprise: each plan assumes that it may. The clock stops when the autopilot steers for a place that was in
none of its items before, nor in an upload that was under way.
"""

from __future__ import annotations

import asyncio
import math
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import mission_from_text
from companion.types.events import Dialect
from companion.types.mission import Command, MavFrame, MissionItem
from ..autopilot.arduplane.arduplane import ArduPlane
from ..autopilot.px4.px4 import Px4
from ..autopilot.px4.px4_store import stored
from ..mission_types import MissionKind
from ..server import serve
from ..simulator import Simulator

CHANGES = ("pop_up", "turn", "fence")
AHEAD_M, FENCE_RADIUS_M = 600.0, 150.0
KNOWN_AHEAD_M, KNOWN_LATERAL_M, KNOWN_SPEED_M_S = 900.0, 700.0, 15.0
PERIOD_S = 0.5  # Time between two sightings.
SETTLED_S = 12.0  # The surprise comes this long after the first mission is flown.
PATIENCE_S = 20.0  # A later answer does not count.
LIMIT_S = 120.0
GROUND_MM, AIRBORNE_MM = 584_000, 684_000  # above mean sea level: home's height, and 100 m above it
SOURCE = (200, mavlink.MAV_COMP_ID_ADSB)
MISSION = """
name: reaction
dimension: 2
unit_m: 25
origin: {latitude_deg: -35.363261, longitude_deg: 149.165230, altitude_amsl_m: 584.0}
bounds: {east_m: [-6000, 6000], north_m: [-6000, 6000], up_m: [60, 160]}
start: {east_m: 0, north_m: 0, up_m: 100, course_deg: 90}
goals:
  - {east_m: 4000, north_m: 0, up_m: 100}
vehicle:
  airspeed_min_m_s: 12.5
  airspeed_max_m_s: 37.5
  airspeed_cruise_m_s: 25
  acceleration_max_m_s2: 0.5
  turn_radius_min_m: 125
  straight_length_min_m: 125
  penetration_speed_m_s: 25
planning: {sensing_horizon_m: 825, time_horizon_s: 15, total_planning_time_s: 250, threat_level_max: 0.3}
"""

Place = tuple[float, float]


@dataclass
class _Reaction:
    """One flight: it changes the world, and measures the time.

    The change comes ``wait_s`` after the first mission is flown; ``took_s`` is infinite until the answer.
    """

    simulator: Simulator
    change: str
    wait_s: float
    took_s: float = math.inf
    begun_s: float = math.inf
    changed_s: float = math.inf
    _known: set[tuple[int, int]] = field(default_factory=set)
    _is_of_before: bool = False
    _vehicle: Place | None = None
    _drives_m_s: Place = (0.0, 0.0)
    _sighted_s: float = -math.inf
    _due_s: float = -math.inf

    def __post_init__(self) -> None:
        self._known = self._places()

    def is_over(self) -> bool:
        """Return whether it is answered, or will not be; asked after every step."""
        now = self.simulator.now_s
        if self.begun_s == math.inf:
            if self._flies_anew():
                self.begun_s = now
        elif self.changed_s == math.inf:
            if now >= self.begun_s + self.wait_s:
                self.changed_s, self._known = now, self._places()
                self._is_of_before = self.simulator.autopilot.is_uploading
                self._change()
        elif self._is_of_before:
            self._known |= self._places()
            self._is_of_before = self.simulator.autopilot.is_uploading
        elif self._flies_anew():
            self.took_s = now - self.changed_s
        self._report(now)
        return self.took_s < math.inf or now > min(self.changed_s + PATIENCE_S, LIMIT_S)

    def _places(self) -> set[tuple[int, int]]:
        return {(item.latitude_e7, item.longitude_e7) for item in self.simulator.autopilot.mission_items}

    def _flies_anew(self) -> bool:
        """Return whether the autopilot flies an item that was in no list before."""
        items, current = self.simulator.autopilot.mission_items, self.simulator.autopilot.current_sequence
        if current >= len(items):
            return False
        return (items[current].latitude_e7, items[current].longitude_e7) not in self._known

    def _here(self) -> tuple[Place, float]:
        """Return the aircraft's position, and its course [rad]."""
        _, east, north, *_ = self.simulator.truth.path[-1]
        return (east, north), float(self.simulator.truth.path[-1][4])

    def _relative(self, ahead_m: float, lateral_m: float) -> Place:
        (east, north), course = self._here()
        along, across = (math.sin(course), math.cos(course)), (math.cos(course), -math.sin(course))
        return (
            east + ahead_m * along[0] + lateral_m * across[0],
            north + ahead_m * along[1] + lateral_m * across[1],
        )

    def _change(self) -> None:
        if self.change == "fence":
            self._fence(self._relative(AHEAD_M, 0.0))
        elif self.change == "pop_up":
            self._vehicle = self._relative(AHEAD_M, 0.0)
        self._due_s = -math.inf  # The vehicle is reported at once.

    def _report(self, now_s: float) -> None:
        """A surveillance source reports the vehicle, if there is one."""
        if self.change == "turn" and self._vehicle is None and self.begun_s < math.inf:
            self._vehicle = self._relative(KNOWN_AHEAD_M + 25.0 * self.wait_s, -KNOWN_LATERAL_M)
        if self._vehicle is None or now_s < self._due_s:
            return
        driven_s = now_s - self._sighted_s if math.isfinite(self._sighted_s) else 0.0
        east, north = self._vehicle
        self._vehicle = east + driven_s * self._drives_m_s[0], north + driven_s * self._drives_m_s[1]
        east_m_s, north_m_s = self._drives_m_s = self._velocity()
        self._sighted_s, self._due_s = now_s, now_s + PERIOD_S
        autopilot = self.simulator.autopilot
        latitude, longitude = autopilot.projection.degrees(*self._vehicle)
        course = math.degrees(math.atan2(east_m_s, north_m_s)) % 360.0
        flies = self.change == "turn"
        report = mavlink.MAVLink_adsb_vehicle_message(
            0xABC, round(latitude * 1e7), round(longitude * 1e7), 0, AIRBORNE_MM if flies else GROUND_MM,
            round(100.0 * course), round(100.0 * math.hypot(east_m_s, north_m_s)), 0, b"OTHER",
            mavlink.ADSB_EMITTER_TYPE_LIGHT if flies else mavlink.ADSB_EMITTER_TYPE_SERVICE_SURFACE, 0, 63, 0,
        )  # fmt: skip
        autopilot.relay_traffic(report, SOURCE)

    def _velocity(self) -> Place:
        """Return its velocity: first along our course until it is known, then towards a place ahead of us."""
        if self.change != "turn" or self._vehicle is None:
            return 0.0, 0.0
        _, course = self._here()
        if self.changed_s == math.inf:
            return KNOWN_SPEED_M_S * math.sin(course), KNOWN_SPEED_M_S * math.cos(course)
        ahead = self._relative(AHEAD_M, 0.0)
        toward = ahead[0] - self._vehicle[0], ahead[1] - self._vehicle[1]
        share = 25.0 / max(math.hypot(*toward), 1.0)
        return share * toward[0], share * toward[1]

    def _fence(self, place: Place) -> None:
        """Put a circle to stay out of into the autopilot."""
        autopilot = self.simulator.autopilot
        latitude, longitude = autopilot.projection.degrees(*place)
        circle = MissionItem(
            0, Command.NAV_FENCE_CIRCLE_EXCLUSION, MavFrame.GLOBAL_RELATIVE_ALT,
            (FENCE_RADIUS_M, 0.0, 0.0, 0.0), round(latitude * 1e7), round(longitude * 1e7), 0.0,
        )  # fmt: skip
        if isinstance(autopilot, Px4):
            autopilot.switch(MissionKind.FENCE, stored([circle]), None)
        if isinstance(autopilot, ArduPlane):
            autopilot.store.truncate(MissionKind.FENCE, 0)
            autopilot.store.put(MissionKind.FENCE, circle)


def reaction_in(simulator: Simulator, change: str, seed: int) -> _Reaction:
    """Return the change in a flight, at a moment that is independent of the service's plans."""
    return _Reaction(simulator, change, SETTLED_S + 15.0 * (0.618034 * seed % 1.0))


def reaction_s(change: str, dialect: Dialect, seed: int) -> float:
    """Fly once, in real time; return the time until the answer [s], infinite if there is none.

    Parameters
    ----------
    change : str
        One of :data:`CHANGES`.
    dialect : Dialect
        Which autopilot flies.
    seed : int
        Seed of everything random, and of when it happens.
    """
    simulator = Simulator(mission_from_text(MISSION, "reaction.yaml"), seed=seed, dialect=dialect)
    reaction = reaction_in(simulator, change, seed)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "reaction.yaml"
        file.write_text(MISSION, encoding="utf-8")
        command = [sys.executable, "-m", "companion", "run", str(file), "--link", url, "--record", folder]
        service = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            _serve(simulator, url, reaction.is_over)
        finally:
            service.terminate()
            service.wait()
    return reaction.took_s


def _serve(simulator: Simulator, url: str, until: Callable[[], bool]) -> None:
    asyncio.run(serve(simulator, url, 1.0, until))
