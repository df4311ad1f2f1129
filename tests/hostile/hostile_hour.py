"""The whole service under hostile traffic, on simulated time, with a sound autopilot among it.

``python -m tests.hostile.hostile_hour`` runs an hour of it and prints the counts.
"""

import argparse
import asyncio
import gc
import json
import math
import os
import sys
import time
import traceback
from collections import Counter
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.clock import ManualClock
from companion.config import load_mission
from companion.flight.messages.vehicle_link import VehicleLink
from companion.flight.tasks.app import App, stop
from companion.flight.tasks.composition import composed
from companion.link.wire.memory_transport import MemoryTransport
from companion.planning.plan_runner import InlineRunner
from companion.recording.recorder import Recorder
from tests.hostile.messages import Hostile
from tests.link.pymavlink_frames import heartbeat, packed, position

MISSION = Path(__file__).parents[2] / "mission_configs" / "first-flight.yaml"
STEP_S = 0.05
SETTLE_TURNS = 10
QUIET_S = 2.0  # only the autopilot is heard: whoever is heard first is taken for it
MEBIBYTE = 2.0**20


def resident_bytes():
    """Memory of this process that is in use, as Linux counts it."""
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def autopilot_says(step):
    """What a sound ArduPlane in the air sends in a step: heartbeat at 1 Hz, the rest at 5 Hz."""
    said = b""
    if step % 20 == 0:
        said += heartbeat(base_mode=89, custom_mode=5)  # FBWA, not armed
    if step % 4 == 0:
        boot_ms = 1_000 + round(step * STEP_S * 1e3)
        north_e7 = round(2_000.0 * math.sin(step / 2_000.0))
        said += position(boot_ms, lat=-353_632_610 + north_e7)
        said += packed(mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 1.5, 0.0, 0.0, 0.0))
        said += packed(mavlink.MAVLink_vfr_hud_message(25.0, 25.0, 90, 50, 684.0, 0.0))
        said += packed(mavlink.MAVLink_mission_current_message(0))
    return said


class HostileSession:
    """A run, and what was counted in it.

    ``settled_s``: from when on the growth of the memory counts.
    """

    def __init__(self, seed=1, rate_hz=1_000, settled_s=300.0):
        self.hostile = Hostile(seed)
        self.recorder = Recorder()
        self.exceptions = Counter()
        self.first_trace = ""
        self.heartbeats_s = []
        self.sent = Counter()
        self.settled_bytes = None
        self.end_bytes = None
        self.slowest_s = 0.0
        self.duration_s = 0.0
        self.wall_s = 0.0
        self.app = None
        self._clock = ManualClock()
        self._per_step = round(rate_hz * STEP_S)
        self._settled_s = settled_s
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True

    def run(self, duration_s):
        """Lay session to a new service for so many simulated seconds."""
        asyncio.run(self._run(duration_s))
        return self

    async def _run(self, duration_s):
        asyncio.get_running_loop().set_exception_handler(
            lambda _, context: self._note(context.get("exception") or RuntimeError(context["message"]))
        )
        ours, theirs = MemoryTransport.pair()
        theirs.set_receiver(self._hear)
        await theirs.open()
        mission = load_mission(MISSION)
        link = VehicleLink(mission, ours, self._clock, self.recorder)
        parts = composed(mission, link, self._clock, self.recorder, seed=1, runner=InlineRunner())
        self.app = App(parts)
        running = asyncio.create_task(self.app.run())
        await asyncio.sleep(0)
        began = time.perf_counter()
        try:
            for step in range(round(duration_s / STEP_S)):
                await self._step(step, theirs)
                if running.done():
                    break
        finally:
            self.wall_s = time.perf_counter() - began
            self.end_bytes = self._measured()
            if running.done() and running.exception() is not None:
                self._note(running.exception())
            else:
                await stop(running)

    async def _step(self, step, theirs):
        now = step * STEP_S
        portions = [autopilot_says(step)]
        if now >= QUIET_S:
            portions += self.hostile.messages(self._per_step)
        began = time.perf_counter()
        self._clock.advance_to(now)
        for portion in portions:
            try:
                theirs.send(portion)
            except Exception as error:  # whatever leaves the decoder is what is counted
                self._note(error)
        for _ in range(SETTLE_TURNS):
            await asyncio.sleep(0)
        self.slowest_s = max(self.slowest_s, time.perf_counter() - began)
        self.duration_s = now + STEP_S
        if self.settled_bytes is None and now >= self._settled_s:
            self.settled_bytes = self._measured()

    @staticmethod
    def _measured():
        gc.collect()
        return resident_bytes()

    def _note(self, error):
        self.exceptions[type(error).__name__] += 1
        self.first_trace = self.first_trace or "".join(traceback.format_exception(error))

    def _hear(self, data):
        for message in self._parser.parse_buffer(data) or []:
            self.sent[message.get_type()] += 1
            if message.get_type() == "HEARTBEAT":
                self.heartbeats_s.append(self._clock.now_s())

    @property
    def heartbeats_missed(self):
        """Seconds, from the second after the autopilot was first heard, without a heartbeat of ours."""
        heard = {math.floor(stamp + 1e-6) for stamp in self.heartbeats_s}
        return sum(second not in heard for second in range(1, math.floor(self.duration_s + 1e-6)))

    @property
    def grown_mebibytes(self):
        """Growth of the memory since it settled."""
        if self.settled_bytes is None:
            return 0.0
        return (self.end_bytes - self.settled_bytes) / MEBIBYTE

    def document(self):
        """All counts, for JSON."""
        return {
            "simulated_s": round(self.duration_s, 2),
            "wall_s": round(self.wall_s, 1),
            "slowest_step_s": round(self.slowest_s, 4),
            "made": dict(self.hostile.counts),
            "identities": len(self.hostile.identities),
            "exceptions": dict(self.exceptions),
            "heartbeats": len(self.heartbeats_s),
            "heartbeats_missed": self.heartbeats_missed,
            "memory_grown_mebibytes": round(self.grown_mebibytes, 2),
            "link": dict(self.app.link.codec.counters),
            "tracker": dict(self.app.world_model.tracker.counters),
            "ownship": dict(self.app.world_model.ownship.counters),
            "sent": dict(self.sent),
        }


def main():
    """Run, print, and fail where the service fell short."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3_600.0)
    parser.add_argument("--settled", type=float, default=300.0, help="from when on memory counts [s]")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    session = HostileSession(arguments.seed, settled_s=arguments.settled).run(arguments.seconds)
    sys.stdout.write(json.dumps(session.document(), indent=2) + "\n" + session.first_trace)
    failed = session.exceptions or session.heartbeats_missed or session.grown_mebibytes >= 20.0
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
