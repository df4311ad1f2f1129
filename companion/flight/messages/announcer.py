"""Decisions are recorded, and the pilot is told what changes what he would do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from companion.clock import Clock
from companion.flight.messages.pilot_messages import PathNews
from companion.flight.messages.vehicle_link import VehicleLink
from companion.flight.state.decision import DecisionKind
from companion.frames import FloatArray
from companion.recording.recorder import Recorder
from companion.types.pilot_texts import PilotMessage, pilot_message
from companion.types.record import UploadedMission

REPEAT_S = 30.0  # A text is not sent again for so long, unless another one about its subject was.


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
    news : PathNews
        Knows what the pilot has read of the path that is flown.
    """

    def __init__(self, link: VehicleLink, recorder: Recorder, clock: Clock) -> None:
        self.decided: Counter[str] = Counter()
        self.news = PathNews()
        self._link = link
        self._recorder = recorder
        self._clock = clock
        self._sent: dict[str, tuple[str, float]] = {}

    def decide(
        self,
        kind: DecisionKind,
        text: str,
        plan_ms: float | None = None,
        latency_ms: float | None = None,
        why: Mapping[str, object] | None = None,
        *,
        tell: str = "",
        about: str = "",
        **values: object,
    ) -> None:
        """Record a decision, and tell the pilot what it means.

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
        tell : str
            Which of the pilot's texts is sent; '' where it changes nothing for the pilot.
        about : str
            The subject of the text, where one text is about several things.
        **values : object
            Replace the names in the text.
        """
        self.decided[kind.value] += 1
        now = self._clock.now_s()
        message = pilot_message(tell, about, **values) if tell else None
        if message is not None and not self._is_news(message, now):
            message = None
        told = "" if message is None else message.text
        self._recorder.decide(now, kind.value, text, plan_ms, latency_ms, why, told=told)
        if message is not None:
            self._sent[message.subject] = message.text, now
            self._link.tell(message.severity, message.text)

    def _is_news(self, message: PilotMessage, now_s: float) -> bool:
        """Whether a text was not the last one about its subject within a while."""
        text, sent_s = self._sent.get(message.subject, ("", 0.0))
        return text != message.text or now_s - sent_s >= REPEAT_S

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
