"""What is decided, told to the pilot and written down."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

from companion.clock import Clock
from companion.comms.vehicle_link import VehicleLink
from companion.flight.decision import DecisionKind
from companion.frames import FloatArray
from companion.recording.recorder import Recorder
from companion.types.record import UploadedMission

REPEAT_S = 30.0  # the same words again within it are recorded, and not told


class Announcer:
    """Records decisions and tells the pilot.

    Parameters
    ----------
    link : VehicleLink
        To the pilot's ground station.
    recorder : Recorder
        Keeps the decisions.
    clock : Clock
        The service's.

    Attributes
    ----------
    decided : Counter of str
        How many decisions of each kind there were.
    """

    def __init__(self, link: VehicleLink, recorder: Recorder, clock: Clock) -> None:
        self.decided: Counter[str] = Counter()
        self._link = link
        self._recorder = recorder
        self._clock = clock
        self._told: dict[str, float] = {}

    def decide(
        self,
        kind: DecisionKind,
        text: str,
        plan_ms: float | None = None,
        latency_ms: float | None = None,
        why: Mapping[str, object] | None = None,
    ) -> None:
        """Record a decision and tell the pilot, unless the same words were told a moment ago.

        Parameters
        ----------
        kind : DecisionKind
            What it is about.
        text : str
            In words.
        plan_ms : float, optional
            The computer's time for the plan behind it [ms].
        latency_ms : float, optional
            From the newest track to the mission that answers it [ms].
        why : mapping, optional
            The numbers that led to it.
        """
        self.decided[kind.value] += 1
        now = self._clock.now_s()
        decision = self._recorder.decide(now, kind.value, text, plan_ms, latency_ms, why)
        spoken = decision.spoken
        if now - self._told.get(spoken, -math.inf) >= REPEAT_S:
            self._told = {text: at for text, at in self._told.items() if now - at < REPEAT_S}
            self._told[spoken] = now
            self._link.tell(kind.severity, spoken)

    def flown(self, positions_enu_m: FloatArray, reason: str, latency_ms: float | None = None) -> None:
        """Note for the report that a mission is flown.

        Parameters
        ----------
        positions_enu_m : ndarray, shape (K, 3)
            Waypoints of the mission [m].
        reason : str
            Why it was wanted.
        latency_ms : float, optional
            How old the newest track was by then [ms].
        """
        mission = UploadedMission(self._clock.now_s(), positions_enu_m, reason)
        self._recorder.mission_flown(mission, latency_ms)

    def count_rejected(self) -> None:
        """Count a plan or mission that was refused."""
        self._recorder.plan_rejected()
