"""What it costs a service in flight to hear others: processor time, without that of the simulator."""

import asyncio
import time
from dataclasses import replace

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import load_mission
from companion.config.sections.team_section import TeamConfig
from companion.link.messages.codec import TEAM_PAYLOAD
from companion.mission.team.agreement import Agreement
from companion.mission.team.team_settings import TeamSettings
from sim.sitl import EPOCH_S, Flight
from tests.mission.team.planning_cost import ABOVE_M, NUMS, others
from tests.sim.client import CONFIGS

POSITIONS_S, HEARTBEAT_S = 0.5, 1.0  # Periods of each member's messages.
HEARTBEAT = mavlink.MAVLink_heartbeat_message(
    mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
    mavlink.MAV_MODE_FLAG_SAFETY_ARMED, 10, mavlink.MAV_STATE_ACTIVE, 3,
)  # fmt: skip
FLOWN_S, SEEDS = 90.0, 3
TURN_S = 0.1  # The members act this often.


class TimedWire:
    """The simulator, as the service's bytes reach it, and what it took of the processor [s]."""

    def __init__(self, simulator):
        self._simulator, self.took_s = simulator, 0.0

    def _timed(self, act, *given):
        began_s = time.thread_time()
        try:
            return act(*given)
        finally:
            self.took_s += time.thread_time() - began_s

    def step(self, seconds):
        return self._timed(self._simulator.step, seconds)

    def receive(self, data):
        return self._timed(self._simulator.receive, data)

    def take_outgoing(self):
        return self._timed(self._simulator.take_outgoing)


class TimedFlight(Flight):
    """A flight whose simulator is timed."""

    def __post_init__(self):
        super().__post_init__()
        self.wire = TimedWire(self.simulator)


class Others:
    """Members on straight plans that are heard over a radio of the aircraft, and hear it."""

    def __init__(self, flight, mission, num):
        team, frame = mission.team, mission.frame
        settings = TeamSettings(apart_m=team.apart_m, apart_up_m=team.apart_up_m)
        self._plans = others(mission, num, [float(mission.start.up_m) + ABOVE_M], team)
        self._flight, self._frame, self._next_s = flight, frame, 0.0
        self._radio = flight.simulator.add_radio()
        self._members = []
        for plan in self._plans:
            rows = plan.rows + np.array([EPOCH_S, 0.0, 0.0, 0.0])
            agreement = Agreement(plan.member, team.members, frame, settings, started_s=EPOCH_S)
            agreement.announce(replace(plan, rows=rows))
            self._members.append((agreement, mavlink.MAVLink(None, srcSystem=plan.member)))
        self.num_bytes = 0

    def act(self, now_s):
        """Answer what was heard, and send what is due."""
        if now_s < self._next_s:
            return
        self._next_s = now_s + TURN_S
        heard = [m for m in self._radio.parse(self._radio.take()) if m.get_type() == "TUNNEL"]
        for number, (agreement, packer) in enumerate(self._members):
            for message in heard:
                payload = bytes(message.payload[: message.payload_length])
                agreement.receive(message.get_srcSystem(), payload, EPOCH_S + now_s)
            for payload in agreement.outgoing(EPOCH_S + now_s):
                padded = payload.ljust(128, b"\0")
                self._say(packer, mavlink.MAVLink_tunnel_message(0, 0, TEAM_PAYLOAD, len(payload), padded))
            turn = round(now_s / TURN_S) + number
            if turn % round(POSITIONS_S / TURN_S) == 0:
                self._tell_position(packer, self._plans[number], now_s)
            if turn % round(HEARTBEAT_S / TURN_S) == 0:
                self._say(packer, HEARTBEAT)

    def _tell_position(self, packer, plan, now_s):
        east, north, up = (float(np.interp(now_s, plan.rows[:, 0], plan.rows[:, axis])) for axis in (1, 2, 3))
        velocity = (plan.rows[-1, 1:3] - plan.rows[0, 1:3]) / (plan.rows[-1, 0] - plan.rows[0, 0])
        latitude, longitude, altitude = self._frame.global_from_local(east, north, up)
        self._say(packer, mavlink.MAVLink_global_position_int_message(
            int(1e3 * now_s), round(1e7 * latitude), round(1e7 * longitude), round(1e3 * altitude), 0,
            round(100.0 * velocity[1]), round(100.0 * velocity[0]), 0, 0,
        ))  # fmt: skip

    def _say(self, packer, message):
        frame = message.pack(packer)
        packer.seq = (packer.seq + 1) % 256
        self.num_bytes += len(frame)
        self._flight.simulator.autopilot.receive(self._radio, frame)


async def _fly(flight, members):
    """Return what the service took of the processor [s]."""
    took_s = 0.0
    async with flight.running() as advance:
        while flight.now_s < FLOWN_S:
            if members is not None:
                members.act(flight.now_s)
            began_s, of_wire_s = time.thread_time(), flight.wire.took_s
            await advance()
            took_s += time.thread_time() - began_s - (flight.wire.took_s - of_wire_s)
    return took_s


def lines():
    """A line for each number of others: processor time with them, and over that of none."""
    alone_s = None
    for num in NUMS:
        costs = [hearing_cost(num, seed) for seed in range(1, SEEDS + 1)]
        took_s, bytes_s = np.median([took_s for took_s, _ in costs]), costs[0][1]
        alone_s = took_s if alone_s is None else alone_s
        more = 100.0 * (took_s - alone_s) / FLOWN_S
        words = f"{num} others heard, {bytes_s:.0f} bytes a second"
        yield f"{words}: {took_s:.1f} s of {FLOWN_S:.0f} s, {more:.1f} % of a core more"


def hearing_cost(num, seed):
    """Processor time of the service [s] in a flight of :data:`FLOWN_S`, and bytes heard a second."""
    mission = load_mission(CONFIGS / "paper-3d.yaml")
    if num:
        members = TeamConfig(members=tuple(range(1, num + 2)))
        mission = mission.model_copy(update={"team": members})
    flight = TimedFlight(mission, seed)
    members = Others(flight, mission, num) if num else None
    took_s = asyncio.run(_fly(flight, members))
    return took_s, 0.0 if members is None else members.num_bytes / FLOWN_S
