"""A radio between the aircraft of a team, with a range, losses and a delay."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Sequence

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.wire.framing import frames_in
from ..simulator import Simulator

CARRIED = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_TUNNEL,
    }
)  # What a member's radio sends to the other members.


class Radio:
    """Carries messages from each aircraft to all others.

    Parameters
    ----------
    simulators : sequence of Simulator
        The aircraft, each with a system id of its own.
    range_m : float
        Nobody farther away receives anything [m].
    loss : float
        Share of the messages that are lost, for each receiver by itself.
    delay_s : float
        Largest delay; each message has one from half of it on [s].
    seed : int
        Seed of losses and delays.

    Attributes
    ----------
    bytes_sent : list of int
        Bytes of team messages that each aircraft has sent.
    """

    def __init__(
        self, simulators: Sequence[Simulator], *, range_m: float = math.inf, loss: float = 0.0,
        delay_s: float = 0.2, seed: int = 0,
    ) -> None:  # fmt: skip
        self._simulators = simulators
        self._channels = [simulator.add_radio() for simulator in simulators]
        self._range_m, self._loss, self._delay_s = range_m, loss, delay_s
        self._generator = np.random.default_rng(seed)
        self._under_way: list[tuple[float, int, int, bytes]] = []
        self._counter = itertools.count()
        self.bytes_sent = [0] * len(simulators)

    def step(self, now_s: float) -> None:
        """Take what was sent, and deliver what is due.

        Parameters
        ----------
        now_s : float
            Simulated time [s].
        """
        places = [simulator.truth.path[-1][1:4] for simulator in self._simulators]
        for sender, channel in enumerate(self._channels):
            for frame in frames_in(channel.take()):
                self._send(sender, frame, places, now_s)
        while self._under_way and self._under_way[0][0] <= now_s:
            _, _, receiver, frame = heapq.heappop(self._under_way)
            simulator = self._simulators[receiver]
            simulator.autopilot.receive(self._channels[receiver], frame)

    def _send(self, sender: int, frame: bytes, places: Sequence[Sequence[float]], now_s: float) -> None:
        number = int.from_bytes(frame[7:10], "little")
        is_own = frame[5] == self._simulators[sender].autopilot.system_id
        if not is_own or number not in CARRIED:
            return
        if number == mavlink.MAVLINK_MSG_ID_TUNNEL:
            self.bytes_sent[sender] += len(frame)
        for receiver, place in enumerate(places):
            if receiver == sender or math.dist(place, places[sender]) > self._range_m:
                continue
            lost, late = self._generator.random(2)
            if lost >= self._loss:
                due_s = now_s + self._delay_s * (0.5 + 0.5 * late)
                heapq.heappush(self._under_way, (due_s, next(self._counter), receiver, frame))
