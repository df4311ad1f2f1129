"""A bad link: bytes between client and simulator lost, delayed, doubled, corrupted or cut off."""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass

import numpy as np

from sim.simulator import Simulator


@dataclass(frozen=True, slots=True)
class LinkFaults:
    """How bad the link is, the same in both directions.

    Parameters
    ----------
    loss, duplication, corruption : float
        Probability for each chunk of bytes.
    delay_s, jitter_s : float
        Fixed delay, and the most that is added to it; with jitter chunks overtake each other.
    """

    loss: float = 0.0
    duplication: float = 0.0
    corruption: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0


class _Pipe:
    """One direction."""

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator
        self._waiting: list[tuple[float, int, bytes]] = []
        self._order = itertools.count()

    def put(self, now_s: float, data: bytes, faults: LinkFaults) -> None:
        loss, double, corrupt, jitter, place = self._generator.random(5)
        if loss < faults.loss:
            return
        if corrupt < faults.corruption:
            index = int(place * len(data))
            data = data[:index] + bytes([data[index] ^ 0x55]) + data[index + 1 :]
        due_s = now_s + faults.delay_s + jitter * faults.jitter_s
        for _ in range(2 if double < faults.duplication else 1):
            heapq.heappush(self._waiting, (due_s, next(self._order), data))

    def take(self, now_s: float) -> list[bytes]:
        chunks = []
        while self._waiting and self._waiting[0][0] <= now_s + 1e-9:
            chunks.append(heapq.heappop(self._waiting)[2])
        return chunks

    def clear(self) -> None:
        self._waiting.clear()


class FaultyLink:
    """The simulator's byte stream as it arrives over a bad link; used in the simulator's place.

    Parameters
    ----------
    simulator : Simulator
        What is at the other end.
    faults : LinkFaults
        How bad it is; may be replaced at any time.
    seed : int
        Of what is lost and when.

    Attributes
    ----------
    is_up : bool
        While ``False`` nothing passes and what was on its way is lost.
    """

    def __init__(self, simulator: Simulator, faults: LinkFaults, *, seed: int) -> None:
        self.simulator = simulator
        self.faults = faults
        self.is_up = True
        up, down = (np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(2))
        self._up, self._down = _Pipe(up), _Pipe(down)

    @property
    def now_s(self) -> float:
        """Simulated seconds since the start."""
        return self.simulator.now_s

    def step(self, duration_s: float = 0.02) -> None:
        """Advance the simulator, after giving it what has arrived by now."""
        self._deliver()
        self.simulator.step(duration_s)
        data = self.simulator.take_outgoing()
        if data and self.is_up:
            self._down.put(self.now_s, data, self.faults)

    def receive(self, data: bytes) -> None:
        """Take bytes from the client; they arrive when and if they do."""
        if data and self.is_up:
            self._up.put(self.now_s, data, self.faults)
            self._deliver()

    def take_outgoing(self) -> bytes:
        """Hand out what has arrived for the client since the last call."""
        if not self.is_up:
            self._up.clear()
            self._down.clear()
        return b"".join(self._down.take(self.now_s))

    def _deliver(self) -> None:
        if not self.is_up:
            self._up.clear()
        for chunk in self._up.take(self.now_s):
            self.simulator.receive(chunk)
