"""A broadcast radio with range, loss and delay."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from companion.frames import FloatArray
from .scenes import Scene

Reception = tuple[list[int], int, bytes]  # receivers, sender, payload


class TeamRadio:
    """The messages on the air.

    Parameters
    ----------
    scene : Scene
        The team, and how its radio is.
    step_s : float
        Messages arrive at multiples of this [s].
    rng : Generator
        Source of chance.
    """

    def __init__(self, scene: Scene, step_s: float, rng: np.random.Generator) -> None:
        self.sent_bytes = np.zeros(scene.num_aircraft)
        self._scene, self._step_s, self._rng = scene, step_s, rng
        self._arriving: dict[int, list[Reception]] = defaultdict(list)

    def send(self, sender: int, payload: bytes, step: int, places_m: FloatArray) -> None:
        """Broadcast a payload.

        Parameters
        ----------
        sender : int
            Number of the aircraft, from 0.
        payload : bytes
            Payload of the message.
        step : int
            Number of the time step.
        places_m : ndarray, shape (N, 2)
            East and north of all aircraft [m].
        """
        scene = self._scene
        self.sent_bytes[sender] += len(payload) + scene.settings.frame_bytes
        hears = self._rng.random(scene.num_aircraft) >= scene.loss
        hears &= np.hypot(*(places_m - places_m[sender]).T) <= scene.range_m
        hears[sender] = False
        late = self._rng.uniform(0.5, 1.5, scene.num_aircraft) * scene.delay_s / self._step_s
        receivers: dict[int, list[int]] = defaultdict(list)
        steps = (step + 1 + late.astype(int)).tolist()
        for receiver in np.flatnonzero(hears).tolist():
            receivers[steps[receiver]].append(receiver)
        for due, together in receivers.items():
            self._arriving[due].append((together, sender, payload))

    def arrived(self, step: int) -> list[Reception]:
        """Return what arrives in a time step."""
        return self._arriving.pop(step, [])
