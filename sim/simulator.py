"""The aircraft, its autopilot and the threats, stepped through simulated time.

Nothing here reads a clock or opens a socket: bytes go in and come out, and the same mission, seed
and input at the same simulated times give the same output bytes.
"""

from __future__ import annotations

from collections.abc import Sequence

from companion.config import MissionConfig
from companion.types.events import Dialect
from companion.types.mission import Command
from .autopilot.base import SYSTEM_ID, Autopilot
from .autopilot.channel import Channel
from .mission_types import is_navigation
from .scenario import build
from .threats.passing_aircraft import PassingAircraft
from .threats.pursuer import TargetEstimate
from .truth import PERIOD_US, Truth
from .vehicle.control import TICK_S

Place = tuple[float, float, float]
Aircraft = Sequence[tuple[str, PassingAircraft]]

GROUND_STATION = 255  # System id of a ground station.
_TURN_US = 20_000
_TICKS_A_SECOND = round(1.0 / TICK_S)
_ENDLESS = frozenset({Command.NAV_LOITER_UNLIM, Command.NAV_RETURN_TO_LAUNCH, Command.NAV_LAND})


class Simulator:
    """A simulated flight.

    Parameters
    ----------
    mission : MissionConfig
        Mission with the start, the weather, the obstacles and the threats.
    seed : int
        Seed of all randomness: turbulence, sensors, tracks.
    dialect : Dialect
        The autopilot.
    on_ground : bool
        Whether the flight begins on the ground, disarmed and without a mission.
    route_enu_m : tuple of (float, float, float)
        Waypoints of the operator's mission [m]; empty for a circle near the start.
    battery_drain : float
        Factor by which the battery of a mission with a section ``energy`` falls faster than the flight takes.
    aircraft : sequence of (str, PassingAircraft)
        Aircraft that pass, by their names.
    system_id : int
        The autopilot's MAVLink system id.

    Attributes
    ----------
    autopilot : Autopilot
        The simulated autopilot, with ``mode``, ``mission_items`` and ``current_sequence``.
    truth : Truth
        What really happened.
    """

    def __init__(
        self,
        mission: MissionConfig,
        *,
        seed: int,
        dialect: Dialect = Dialect.ARDUPILOT,
        on_ground: bool = False,
        route_enu_m: tuple[Place, ...] = (),
        battery_drain: float = 1.0,
        aircraft: Aircraft = (),
        system_id: int = SYSTEM_ID,
    ) -> None:
        scenario = build(
            mission, seed, dialect, on_ground=on_ground, route_enu_m=route_enu_m,
            battery_drain=battery_drain, aircraft=aircraft,
        )  # fmt: skip
        self._scenario = scenario
        self.autopilot: Autopilot = scenario.autopilot
        self.truth: Truth = scenario.truth
        self._now_us = 0
        self._ticks = 0
        self._next_record_us = 0
        self._route_key: tuple[int, int, str] | None = None
        self._route: tuple[tuple[float, float], ...] = ()
        self.autopilot.system_id = system_id
        self._channel = self.autopilot.add_channel()
        self._record()

    @property
    def energy_used_wh(self) -> float:
        """Energy that the battery has supplied [Wh]; 0 without a battery."""
        battery = self._scenario.flight.battery
        return 0.0 if battery is None else battery.used_wh

    @property
    def now_s(self) -> float:
        """Simulated seconds since the start."""
        return self._now_us * 1e-6

    def step(self, duration_s: float = 0.02) -> None:
        """Advance in turns of at most 20 ms; the autopilot acts once in each."""
        end_us = self._now_us + round(duration_s * 1e6)
        while self._now_us < end_us:
            self._now_us = min(end_us, self._now_us + _TURN_US)
            self._turn()

    def add_radio(self) -> Channel:
        """Open a channel to a radio, over which the autopilot forwards what is for everybody."""
        channel = self.autopilot.add_channel()
        channel.systems_seen.add(GROUND_STATION)
        return channel

    def receive(self, data: bytes) -> None:
        """Take bytes from the client; any split of frames, acted on at once."""
        self.autopilot.receive(self._channel, data)

    def take_outgoing(self) -> bytes:
        """Everything sent to the client since the last call."""
        return self._channel.take()

    def set_mode(self, name: str) -> None:
        """Move the pilot's switch.

        Raises
        ------
        ValueError
            If the autopilot has no such mode.
        """
        if not self.autopilot.set_mode(name):
            raise ValueError(f"no such mode: {name}")

    def reboot(self) -> None:
        """Restart the autopilot in flight."""
        self.autopilot.reboot()

    def open_channel(self) -> Channel:
        """Open a further client's link."""
        return self.autopilot.add_channel()

    def close_channel(self, channel: Channel) -> None:
        """End a further client's link."""
        self.autopilot.remove_channel(channel)

    def receive_on(self, channel: Channel, data: bytes) -> None:
        """Take bytes from a further client."""
        self.autopilot.receive(channel, data)

    def _turn(self) -> None:
        scenario = self._scenario
        due = self._now_us * _TICKS_A_SECOND // 1_000_000
        while self._ticks < due:
            self._ticks += 1
            scenario.flight.tick()
        if self._now_us >= self._next_record_us:
            self._record()
        self.autopilot.update(self._now_us)
        scenario.tracks.update(self._now_us)

    def _record(self) -> None:
        """Move the threats, and record all positions."""
        scenario = self._scenario
        self._next_record_us += PERIOD_US
        state = scenario.dynamics.state
        self.truth.record(self.now_s, state)
        if not scenario.pursuers:
            return
        speed = max(scenario.flight.estimate.ground_speed_m_s, 10.0)
        target = TargetEstimate(
            (state.east_m, state.north_m), speed, self._mission_ahead(), self.autopilot.mission_revision
        )
        for name, pursuer in scenario.pursuers:
            if self._now_us > 0:
                pursuer.step(self._now_us, PERIOD_US * 1e-6, target)
            self.truth.record_threat(self.now_s, name, pursuer.position)

    def _mission_ahead(self) -> tuple[tuple[float, float], ...]:
        """East and north of the autopilot's remaining waypoints, up to where it stays."""
        autopilot = self.autopilot
        key = (autopilot.mission_revision, autopilot.current_sequence, autopilot.mode)
        target = autopilot.telemetry.target
        if key != self._route_key:
            self._route_key = key
            items = autopilot.mission_items if autopilot.mode in ("AUTO", "MISSION") else ()
            current = autopilot.current_sequence
            points = []
            if not (current < len(items) and items[current].command in _ENDLESS):
                for item in items[current + 1 :]:
                    if is_navigation(item.command) and (item.latitude_e7 or item.longitude_e7):
                        points.append(
                            autopilot.projection.local(item.latitude_e7 * 1e-7, item.longitude_e7 * 1e-7)
                        )
                    if item.command in _ENDLESS:
                        break
            self._route = tuple(points)
        return self._route if target is None else (target[:2], *self._route)
