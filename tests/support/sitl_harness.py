"""The service and the simulator on simulated time, and everything the service says on the wire."""

import asyncio

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.clock import ManualClock
from companion.flight.messages.vehicle_link import VehicleLink
from companion.flight.tasks.app import App, stop
from companion.flight.tasks.composition import composed
from companion.link.missions.autopilot_link import AutopilotLink
from companion.link.wire.memory_transport import MemoryTransport
from companion.planning.plan_runner import InlineRunner
from companion.types.events import Dialect
from sim.sitl import Flight
from tests.sim.client import CONFIGS

FIRST_FLIGHT = (CONFIGS / "first-flight.yaml").read_text(encoding="utf-8")
ASKING = {mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_CMD_REQUEST_MESSAGE}
CHANGING = {
    *("MISSION_COUNT", "MISSION_ITEM", "MISSION_ITEM_INT", "MISSION_WRITE_PARTIAL_LIST"),
    *("MISSION_CLEAR_ALL", "MISSION_SET_CURRENT", "SET_MODE", "PARAM_SET", "COMMAND_INT"),
    *("MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE", "SET_POSITION_TARGET_GLOBAL_INT"),
}


def is_changing(message):
    """Whether a message changes the mission, the mode or anything else of the autopilot."""
    kind = message.get_type()
    return kind in CHANGING or (kind == "COMMAND_LONG" and message.command not in ASKING)


class SitlHarness:
    """A short flight, with the bridge between service and simulator in the test's hands."""

    def __init__(
        self, mission, seed=1, folder=None, dialect=Dialect.ARDUPILOT, *, on_ground=False, battery_drain=1.0
    ):
        self.flight = Flight(mission, seed, folder, dialect, on_ground=on_ground, battery_drain=battery_drain)
        self.simulator = self.flight.simulator
        self.recorder = self.flight.recorder
        self.heard = []
        self.is_cut = False
        self.is_over = False
        self.is_killed = False
        self.is_warm = True
        self.apps = []
        self.checkpoint = None
        self.signer = None
        self.link_kind = AutopilotLink
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True

    @property
    def now_s(self):
        return self.simulator.now_s

    @property
    def app(self):
        return self.flight.app

    def fly(self, until_s, on_step=lambda harness: None):
        """Fly to an instant of simulated time, or until it is over; ``on_step`` acts after each 20 ms."""
        asyncio.run(self._fly(until_s, on_step))
        return self

    async def _fly(self, until_s, on_step):
        clock = ManualClock()
        ours, theirs = MemoryTransport.pair()
        theirs.set_receiver(self._receive)
        await theirs.open()
        running = self._started(ours, clock)
        try:
            while self.now_s < until_s and not self.is_over:
                await self.flight._step(clock, theirs, running)
                on_step(self)
                if self.is_killed:
                    self.is_killed = False
                    await stop(running)
                    running = self._started(ours, clock)
                if theirs.is_open is self.is_cut:
                    await (theirs.close() if self.is_cut else theirs.open())
        finally:
            await stop(running)
            self.recorder.close()

    def _started(self, ours, clock):
        """A service from nothing, as after a restart."""
        mission = self.flight.mission
        link = VehicleLink(mission, ours, clock, self.recorder, signer=self.signer, link_kind=self.link_kind)
        parts = composed(
            mission, link, clock, self.recorder, seed=self.flight.seed, runner=InlineRunner(),
            checkpoint=self.checkpoint,
        )  # fmt: skip
        self.flight.app = App(parts, is_warm=self.is_warm)
        self.apps.append(self.flight.app)
        return asyncio.create_task(self.app.run())

    def _receive(self, data):
        for message in self._parser.parse_buffer(data) or []:
            self.heard.append((self.now_s, message))
        self.flight.wire.receive(data)

    def said(self, kind):
        return [(stamp, message) for stamp, message in self.heard if message.get_type() == kind]

    def changes(self, after_s=0.0, before_s=float("inf")):
        """Messages that change something, by time."""
        return [
            (stamp, message.get_type())
            for stamp, message in self.heard
            if after_s < stamp < before_s and is_changing(message)
        ]

    def texts(self, kind):
        return [decision.text for decision in self.recorder.decisions if decision.kind == kind]

    def kinds(self):
        return [decision.kind for decision in self.recorder.decisions]
