"""Record decisions, and inform the pilot of those that change what the pilot would do."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

from companion.clock import Clock
from companion.flight.messages.pilot_messages import PathNews
from companion.flight.messages.vehicle_link import VehicleLink
from companion.flight.state.decision import DecisionKind
from companion.frames import FloatArray
from companion.recording.recorder import Recorder
from companion.types.pilot_text import PilotMessage
from companion.types.pilot_texts import pilot_message
from companion.types.record import UploadedMission

SAME_STRETCH_S = 10.0  # A stretch without a field that changes by less is not announced again.
REPEAT_S = 30.0  # A text is not repeated within this time, unless another about its subject was sent.


class Announcer:
    """Records decisions and informs the pilot.

    Parameters
    ----------
    link : VehicleLink
        The link to the pilot's ground station.
    recorder : Recorder
        Records the decisions.
    clock : Clock
        The service's clock.

    Attributes
    ----------
    decided : Counter of str
        Number of decisions of each kind.
    news : PathNews
        Text about the flown path, if it is new to the pilot.
    """

    def __init__(self, link: VehicleLink, recorder: Recorder, clock: Clock) -> None:
        self.decided: Counter[str] = Counter()
        self.news = PathNews()
        self._link = link
        self._recorder = recorder
        self._clock = clock
        self._sent: dict[str, tuple[str, float]] = {}
        self._stretch = -math.inf, 0

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
        """Record a decision, and send the pilot its meaning.

        Parameters
        ----------
        kind : DecisionKind
            Kind of the decision.
        text : str
            The decision in words.
        plan_ms : float, optional
            Computing time of the plan behind the decision [ms].
        latency_ms : float, optional
            Time from the newest track to the mission that answers it [ms].
        why : mapping, optional
            The numbers behind the decision.
        tell : str
            Key of the pilot's text; '' if the decision changes nothing for the pilot.
        about : str
            Subject of the text, if one text is used for several subjects.
        **values : object
            Values of the placeholders in the text.
        """
        self.decided[kind.value] += 1
        now = self._clock.now_s()
        message = pilot_message(tell, about, **values) if tell else None
        if message is not None and not self._is_news(message, now):
            message = None
        sent_text = "" if message is None else message.text
        self._recorder.decide(now, kind.value, text, plan_ms, latency_ms, why, told=sent_text)
        if message is not None:
            self._sent[message.subject] = message.text, now
            self._link.tell(message.severity, message.text)

    def _is_news(self, message: PilotMessage, now_s: float) -> bool:
        """Return whether a text differs from the last one about its subject, or that one is old."""
        text, sent_s = self._sent.get(message.subject, ("", 0.0))
        return text != message.text or now_s - sent_s >= REPEAT_S

    def tell_of_fields(self, why: Mapping[str, object]) -> None:
        """Inform the pilot of a stretch of a new path without a field, unless the last text named it.

        Parameters
        ----------
        why : mapping
            The numbers behind the path.
        """
        seconds, stretches = why.get("no_field_s"), why.get("no_field_stretches_s")
        if not isinstance(seconds, int) or not isinstance(stretches, tuple) or not stretches:
            return
        after_s = int(stretches[0][0])
        begin_s, (last_s, last_seconds) = self._clock.now_s() + after_s, self._stretch
        if abs(begin_s - last_s) <= SAME_STRETCH_S and abs(seconds - last_seconds) <= SAME_STRETCH_S:
            return
        self._stretch = begin_s, seconds
        words = f"{after_s // 60}:{after_s % 60:02d}"
        text = f"no field within glide for {seconds} s, first from {words}"
        self.decide(DecisionKind.ENGINE, text, tell="no field ahead", seconds=seconds, time=words)

    def flown(self, positions_enu_m: FloatArray, reason: str, latency_ms: float | None = None) -> None:
        """Note for the report that a mission is flown.

        Parameters
        ----------
        positions_enu_m : ndarray, shape (K, 3)
            Waypoints of the mission [m].
        reason : str
            Why the mission was wanted.
        latency_ms : float, optional
            Age of the newest track at the entry [ms].
        """
        mission = UploadedMission(self._clock.now_s(), positions_enu_m, reason)
        self._recorder.mission_flown(mission, latency_ms)

    def count_rejected(self) -> None:
        """Count a plan or mission that was rejected."""
        self._recorder.plan_rejected()
