"""A pymavlink client on the simulator's byte stream, and missions in local metres."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import MissionConfig, load_mission, mission_from_text
from sim.simulator import Simulator

CONFIGS = Path(__file__).parents[2] / "mission_configs"
COMPANION = mavlink.MAV_COMP_ID_PATHPLANNER
WAYPOINT, LOITER, TURNS, TIME = 16, 17, 18, 19
RTL, TAKEOFF, JUMP, SPEED, LAND_START = 20, 22, 177, 178, 189
AHEAD = (600.0, 0.0)
ACCEPTED, ERROR, UNSUPPORTED, NO_SPACE = 0, 1, 3, 4
INVALID_SEQUENCE, DENIED, CANCELLED = 13, 14, 15
RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT

PLAIN = """
name: plain
dimension: 2
unit_m: 25
origin: {latitude_deg: -35.363261, longitude_deg: 149.165230, altitude_amsl_m: 584.0}
bounds: {east_m: [-6000, 6000], north_m: [-6000, 6000], up_m: [60, 160]}
start: {east_m: 0, north_m: 0, up_m: 100, course_deg: 90}
goals:
  - {east_m: 1750, north_m: 750, up_m: 100}
vehicle:
  airspeed_min_m_s: 12.5
  airspeed_max_m_s: 37.5
  airspeed_cruise_m_s: 25
  acceleration_max_m_s2: 0.5
  turn_radius_min_m: 125
  straight_length_min_m: 125
  penetration_speed_m_s: 25
planning: {sensing_horizon_m: 825, time_horizon_s: 15, total_planning_time_s: 80}
"""


def plain_mission(extra: str = "") -> MissionConfig:
    """An empty world with calm air, and what else is given as YAML."""
    return mission_from_text(PLAIN + extra, "plain.yaml")


def mission_file(name: str) -> MissionConfig:
    return load_mission(CONFIGS / name)


Item = dict[str, Any]


def item(command: int, east_m: float, north_m: float, up_m: float = 100.0, **fields: Any) -> Item:
    return {"command": command, "east": east_m, "north": north_m, "z": up_m, **fields}


def route(*places: tuple[float, float], loiter: tuple[float, float] | None = None) -> list[Item]:
    """Home slot, waypoints, and a loiter at the end."""
    items = [item(WAYPOINT, 0.0, 0.0, 0.0), *(item(WAYPOINT, east, north) for east, north in places)]
    return [*items, item(LOITER, *loiter, p3=125.0)] if loiter else items


class Client:
    def __init__(
        self, simulator: Simulator | None = None, system: int = 1, component: int = COMPANION
    ) -> None:
        self.simulator = simulator or Simulator(plain_mission(), seed=1)
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.mav.robust_parsing = True
        self.log: list[tuple[float, Any]] = []
        self._cursor = 0
        self._send = self.simulator.receive
        self._take = self.simulator.take_outgoing

    @classmethod
    def on_new_channel(cls, simulator: Simulator, system: int, component: int) -> Client:
        client = cls(simulator, system, component)
        channel = simulator.open_channel()
        client._send = lambda data: simulator.receive_on(channel, data)
        client._take = channel.take
        return client

    def depart(self) -> None:
        """Fly to item 1 of a mission of its own, 600 m ahead."""
        items = route(AHEAD, (1200.0, 300.0), (1800.0, 0.0), loiter=(2400.0, 0.0))
        assert self.upload(items) == ACCEPTED
        assert self.set_current(1) == ACCEPTED

    def send(self, message: Any) -> None:
        self._send(message.pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256

    def poll(self) -> list[Any]:
        messages = self.mav.parse_buffer(self._take()) or []
        self.log += [(self.simulator.now_s, message) for message in messages]
        return messages

    def step(self, duration_s: float = 0.02) -> None:
        end = self.simulator.now_s + duration_s
        while self.simulator.now_s < end - 1e-6:
            self.simulator.step(0.02)
            self.poll()

    def until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        end = self.simulator.now_s + timeout_s
        while self.simulator.now_s < end:
            if condition():
                return True
            self.step()
        return condition()

    def wait(self, kind: str, timeout_s: float = 1.0, **fields: Any) -> Any:
        """The next message of a type with these field values that was not waited for yet, or None."""
        end = self.simulator.now_s + timeout_s
        self.poll()
        while True:
            while self._cursor < len(self.log):
                message = self.log[self._cursor][1]
                self._cursor += 1
                if message.get_type() == kind and all(getattr(message, k) == v for k, v in fields.items()):
                    return message
            if self.simulator.now_s >= end - 1e-6:
                return None
            self.step()

    def all(self, kind: str) -> list[Any]:
        return [message for _, message in self.log if message.get_type() == kind]

    def texts(self) -> list[str]:
        return [message.text for message in self.all("STATUSTEXT")]

    def clear(self) -> None:
        self.poll()
        self.log.clear()
        self._cursor = 0

    def item_message(self, sequence: int, entry: Item, kind: int = 0) -> Any:
        projection = self.simulator.autopilot.projection
        latitude, longitude = projection.degrees(entry["east"], entry["north"])
        return mavlink.MAVLink_mission_item_int_message(
            1,
            1,
            entry.get("seq", sequence),
            entry.get("frame", RELATIVE),
            entry["command"],
            entry.get("current", 0),
            entry.get("autocontinue", 1),
            *(entry.get(name, 0.0) for name in ("p1", "p2", "p3", "p4")),
            round(latitude * 1e7),
            round(longitude * 1e7),
            entry["z"],
            kind,
        )

    def count(self, number: int, kind: int = 0) -> None:
        self.send(mavlink.MAVLink_mission_count_message(1, 1, number, kind))

    def answer(self, items: Sequence[Item], kind: int = 0, stop_at: int | None = None) -> int | None:
        """Answer requests until the acknowledgement, whose type it is; or silent from an item on."""
        end = self.simulator.now_s + 30.0
        while self.simulator.now_s < end:
            self.poll()
            while self._cursor < len(self.log):
                message = self.log[self._cursor][1]
                self._cursor += 1
                if message.get_type() == "MISSION_ACK":
                    return int(message.type)
                if message.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                    if stop_at is not None and message.seq >= stop_at:
                        return None
                    self.send(self.item_message(message.seq, items[message.seq], kind))
                    self.poll()
            self.step()
        return None

    def upload(self, items: Sequence[Item], kind: int = 0, stop_at: int | None = None) -> int | None:
        self.clear()
        self.count(len(items), kind)
        return self.answer(items, kind, stop_at)

    def download(self, kind: int = 0) -> list[Any]:
        self.send(mavlink.MAVLink_mission_request_list_message(1, 1, kind))
        number = self.wait("MISSION_COUNT").count
        items = []
        for sequence in range(number):
            self.send(mavlink.MAVLink_mission_request_int_message(1, 1, sequence, kind))
            items.append(self.wait("MISSION_ITEM_INT", seq=sequence))
        return items

    def command(self, number: int, *parameters: float) -> int | None:
        """Result of a COMMAND_LONG."""
        self.clear()
        values = [*parameters, *(0.0,) * 7][:7]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *values))
        answer = self.wait("COMMAND_ACK", command=number)
        return None if answer is None else int(answer.result)

    def set_current(self, sequence: int) -> int | None:
        return self.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, sequence)

    def stream(self, message_id: int, rate_hz: float) -> int | None:
        return self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / rate_hz)

    def target(self) -> tuple[float, float]:
        """East and north [m] that POSITION_TARGET_GLOBAL_INT says it steers to."""
        assert self.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 87) == 0
        message = self.all("POSITION_TARGET_GLOBAL_INT")[-1]
        return self.simulator.autopilot.projection.local(message.lat_int * 1e-7, message.lon_int * 1e-7)

    def steers_to(self, east_m: float, north_m: float) -> bool:
        return math.dist(self.target(), (east_m, north_m)) < 1.0


def autopilot(client: Client) -> Any:
    """The one it is connected to."""
    return client.simulator.autopilot


def nearest_m(truth):
    """Smallest slant distance of the true rows to those of the first threat, which drives at up = 0 [m]."""
    rows, threat = np.array(truth.path)[:, :4], np.array(truth.dt_path)
    return float(np.hypot(np.hypot(*(rows[:, 1:3] - threat[:, 1:]).T), rows[:, 3]).min())
