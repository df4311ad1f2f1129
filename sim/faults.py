"""Faults of the link: frames that are lost, delayed, doubled, overtaken, damaged or refused, and more.

Faults act on whole frames, independently, and the same in both directions; a seed chooses them. A
:class:`Schedule` makes a flight's worth of them, with the autopilot's reboots and other uploaders.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.wire.framing import MAGIC_V2, checksum, frames_in
from companion.types.mission import MissionItem
from .simulator import Simulator

_HEADER = 10
_RESULT = 2  # Place of the verdict in the payload of MISSION_ACK and COMMAND_ACK.
_ACKS = {47: "mission", 77: "command"}
_MISSION_NACKS = (1, 2, 3, 4, 5, 6, 9, 13, 14, 15)
_COMMAND_NACKS = (1, 2, 3, 4, 6)


@dataclass(frozen=True, slots=True)
class LinkFaults:
    """Faults of the link, the same in both directions.

    Parameters
    ----------
    loss, duplication, corruption : float
        Probability for each frame; a corrupted frame has a few bits inverted.
    delay_s, jitter_s : float
        Fixed delay, and the largest random addition to it; with jitter frames overtake each other.
    mission_nack, command_nack : int
        Verdict put in the place of ACCEPTED in MISSION_ACK and COMMAND_ACK; 0 leaves them alone.
    bytes_per_s : float
        Rate of a serial line, on which each frame waits for those before it: a tenth of its baud rate.
    """

    loss: float = 0.0
    duplication: float = 0.0
    corruption: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    mission_nack: int = 0
    command_nack: int = 0
    bytes_per_s: float = math.inf


class FaultKind(Enum):
    """Further kinds of faults."""

    DISCONNECT = "the link is cut"
    REBOOT = "the autopilot reboots"
    UPLOADER = "somebody else uploads"
    DISK_FULL = "the disk is full"
    CLOCK_JUMP = "the service's clock jumps ahead"
    KILL = "the service is killed and restarted"


@dataclass(frozen=True, slots=True)
class Event:
    """A fault, its begin and end [s], and its amount."""

    begin_s: float
    end_s: float
    kind: FaultKind
    amount: float = 0.0


@dataclass(frozen=True, slots=True)
class Schedule:
    """The faults of a flight.

    Parameters
    ----------
    spells : tuple
        Begin and end [s] of each spell of a bad link, and its faults; spells do not overlap.
    events : tuple of Event
        Faults in the order in which they begin.
    """

    spells: tuple[tuple[float, float, LinkFaults], ...] = ()
    events: tuple[Event, ...] = ()

    def faults_at(self, now_s: float) -> LinkFaults:
        """Faults of the link at an instant."""
        return next((faults for begin, end, faults in self.spells if begin <= now_s < end), LinkFaults())

    def is_cut(self, now_s: float) -> bool:
        """Return whether the link is cut at an instant."""
        return any(
            event.kind is FaultKind.DISCONNECT and event.begin_s <= now_s < event.end_s
            for event in self.events
        )


def random_schedule(
    seed: int, duration_s: float, kinds: tuple[FaultKind, ...] = tuple(FaultKind)
) -> Schedule:
    """Make a schedule of faults; the same seed makes the same one.

    Parameters
    ----------
    seed : int
        Seed of everything in the schedule.
    duration_s : float
        Duration of the flight [s].
    kinds : tuple of FaultKind
        Which may occur besides a bad link.
    """
    random = np.random.default_rng(seed)
    spells, begin = [], float(random.uniform(0.0, 0.3 * duration_s))
    while begin < duration_s:
        end = begin + float(random.uniform(1.0, 0.5 * duration_s))
        spells.append((begin, end, _bad_link(random)))
        begin = end + float(random.uniform(0.0, 0.3 * duration_s))
    events = []
    for _ in range(int(random.integers(0, 3))):
        if not kinds:
            break
        at = float(random.uniform(2.0, duration_s))
        kind = kinds[int(random.integers(len(kinds)))]
        events.append(Event(at, at + float(random.uniform(0.5, 12.0)), kind, float(random.uniform(0.1, 5.0))))
    return Schedule(tuple(spells), tuple(sorted(events, key=lambda event: event.begin_s)))


def _bad_link(random: np.random.Generator) -> LinkFaults:
    """One kind of fault, or several."""
    faults = LinkFaults()
    if random.random() < 0.6:
        faults = replace(faults, loss=float(random.uniform(0.0, 0.5)))
    if random.random() < 0.4:
        faults = replace(faults, delay_s=float(random.uniform(0.0, 2.0)))
    if random.random() < 0.3:
        faults = replace(faults, jitter_s=float(random.uniform(0.0, 1.0)))
    if random.random() < 0.3:
        faults = replace(faults, duplication=float(random.uniform(0.0, 0.5)))
    if random.random() < 0.3:
        faults = replace(faults, corruption=float(random.uniform(0.0, 0.3)))
    if random.random() < 0.2:
        faults = replace(faults, mission_nack=int(random.choice(_MISSION_NACKS)))
    if random.random() < 0.2:
        faults = replace(faults, command_nack=int(random.choice(_COMMAND_NACKS)))
    return faults


def refused(frame: bytes, faults: LinkFaults) -> bytes:
    """Return a frame, with an acceptance turned into a refusal if the faults say so."""
    if frame[0] != MAGIC_V2:
        return frame
    number = int.from_bytes(frame[7:10], "little")
    kind = _ACKS.get(number)
    verdict = {"mission": faults.mission_nack, "command": faults.command_nack}.get(kind or "", 0)
    if not verdict:
        return frame
    payload = bytearray(frame[_HEADER : _HEADER + frame[1]].ljust(_RESULT + 1, b"\0"))
    if payload[_RESULT] != 0:
        return frame
    payload[_RESULT] = verdict
    body = bytes([frame[0], len(payload)]) + frame[2:_HEADER] + bytes(payload)
    extra = mavlink.mavlink_map[number].crc_extra
    return body + checksum(body[1:], extra).to_bytes(2, "little")


class _Pipe:
    """One direction of the link."""

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator
        self._waiting: list[tuple[float, int, bytes]] = []
        self._order = itertools.count()
        self._free_s = -math.inf

    def put(self, now_s: float, data: bytes, faults: LinkFaults) -> None:
        for frame in frames_in(data):
            self._put_frame(now_s, refused(frame, faults), faults)

    def _put_frame(self, now_s: float, data: bytes, faults: LinkFaults) -> None:
        loss, double, corrupt, jitter, place = self._generator.random(5)
        if loss < faults.loss:
            return
        if corrupt < faults.corruption:
            index = int(place * len(data))
            data = data[:index] + bytes([data[index] ^ 0x55]) + data[index + 1 :]
        self._free_s = max(self._free_s, now_s) + len(data) / faults.bytes_per_s
        due_s = self._free_s + faults.delay_s + jitter * faults.jitter_s
        for _ in range(2 if double < faults.duplication else 1):
            heapq.heappush(self._waiting, (due_s, next(self._order), data))

    def take(self, now_s: float) -> list[bytes]:
        frames = []
        while self._waiting and self._waiting[0][0] <= now_s + 1e-9:
            frames.append(heapq.heappop(self._waiting)[2])
        return frames

    def clear(self) -> None:
        self._waiting.clear()


class FaultyLink:
    """The simulator's byte stream as it arrives over a bad link; used in the simulator's place.

    Parameters
    ----------
    simulator : Simulator
        The simulator at the other end.
    faults : LinkFaults
        The present faults; may be replaced at any time.
    seed : int
        Seed of all random choices.
    schedule : Schedule, optional
        Replaces the faults as time goes on, and cuts the link.

    Attributes
    ----------
    is_up : bool
        If ``False``, nothing passes and frames in transit are lost.
    watch : callable or None
        Called with each frame that enters the link, and whether it comes from the client; it returns whether
        the frame goes on.
    """

    def __init__(
        self, simulator: Simulator, faults: LinkFaults, *, seed: int, schedule: Schedule | None = None
    ) -> None:
        self.simulator = simulator
        self.faults = faults
        self.is_up = True
        self.watch: Callable[[bytes, bool], bool] | None = None
        self._schedule = schedule
        up, down = (np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(2))
        self._up, self._down = _Pipe(up), _Pipe(down)

    @property
    def now_s(self) -> float:
        """Simulated seconds since the start."""
        return self.simulator.now_s

    def step(self, duration_s: float = 0.02) -> None:
        """Advance the simulator, after giving it the frames that have arrived."""
        if self._schedule is not None:
            self.faults = self._schedule.faults_at(self.now_s)
            self.is_up = not self._schedule.is_cut(self.now_s)
        self._deliver()
        self.simulator.step(duration_s)
        data = self._watched(self.simulator.take_outgoing(), False)
        if data and self.is_up:
            self._down.put(self.now_s, data, self.faults)

    def receive(self, data: bytes) -> None:
        """Take bytes from the client; they arrive later, if at all."""
        data = self._watched(data, True)
        if data and self.is_up:
            self._up.put(self.now_s, data, self.faults)
            self._deliver()

    def take_outgoing(self) -> bytes:
        """Hand out what has arrived for the client since the last call."""
        if not self.is_up:
            self._up.clear()
            self._down.clear()
        return b"".join(self._down.take(self.now_s))

    def _watched(self, data: bytes, is_from_client: bool) -> bytes:
        if self.watch is None:
            return data
        return b"".join(frame for frame in frames_in(data) if self.watch(frame, is_from_client))

    def _deliver(self) -> None:
        if not self.is_up:
            self._up.clear()
        for frame in self._up.take(self.now_s):
            self.simulator.receive(frame)


class OtherUploader:
    """A ground station on a link of its own that uploads a mission, message by message.

    Parameters
    ----------
    simulator : Simulator
        Autopilot that it uploads to.
    items : tuple of MissionItem
        The list, numbered from 0.
    """

    SYSTEM, COMPONENT = 255, 190

    def __init__(self, simulator: Simulator, items: tuple[MissionItem, ...]) -> None:
        self._simulator = simulator
        self._items = items
        self._channel = simulator.open_channel()
        self._mav = mavlink.MAVLink(None, srcSystem=self.SYSTEM, srcComponent=self.COMPONENT)
        self._mav.robust_parsing = True
        self.verdict: int | None = None
        self._send(mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))

    def step(self) -> None:
        """Answer the autopilot's requests since the last call."""
        for message in self._mav.parse_buffer(self._channel.take()) or []:
            kind = message.get_type()
            if kind == "MISSION_ACK" and message.target_system == self.SYSTEM:
                self.verdict = message.type
            elif kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT") and message.seq < len(self._items):
                self._send(_message_of(self._items[message.seq]))

    def _send(self, message: object) -> None:
        self._simulator.receive_on(self._channel, message.pack(self._mav))  # type: ignore[attr-defined]


def _message_of(item: MissionItem) -> object:
    values = (float("nan") if value is None else value for value in item.parameters)
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, item.sequence, item.frame, item.command, int(item.is_current), int(item.autocontinue), *values,
        item.latitude_e7, item.longitude_e7, item.altitude_m, 0,
    )  # fmt: skip
