"""While the pilot flies: inform the pilot whenever it changes whether a handback is safe."""

from __future__ import annotations

import math

from companion.flight.state.decision import DecisionKind
from companion.flight.state.modes import Mode
from companion.flight.takeover.resume_path import ResumePath, resume_path
from companion.flight.tasks.replanning_parts import ReplanningParts

REPEAT_MIN_S = 5.0  # Time between two texts, because the result changes often in a circle.


class Handback:
    """Watches the resume path.

    Parameters
    ----------
    parts : ReplanningParts
        The parts of replanning.

    Attributes
    ----------
    found : ResumePath or None
        The last resume path; None while the pilot does not fly.
    """

    def __init__(self, parts: ReplanningParts) -> None:
        self._flight, self._world_model, self._clock = parts.flight, parts.world_model, parts.clock
        self._announcer, self._reader = parts.announcer, parts.handover.reader
        self._link = parts.handover.protocols.parts.link
        self.found: ResumePath | None = None
        self._announced: ResumePath | None = None
        self._announced_s = -math.inf

    def look(self) -> None:
        """Check the resume path, and inform the pilot if the result has changed; about once a second."""
        state, now = self._flight.state, self._clock.now_s()
        ownship = self._world_model.ownship.state(now)
        if state.mode is not Mode.SUSPENDED or not state.phase.is_airborne or ownship is None:
            self.found, self._announced, self._announced_s = None, None, -math.inf
            return
        if now - self._announced_s < REPEAT_MIN_S:
            return
        self.found = found = resume_path(state, self._reader.current, ownship)
        if self._announced is None or found.is_safe is not self._announced.is_safe:
            self._announced, self._announced_s = found, now
            tell = "handback safe" if found.is_safe else "handback unsafe"
            self._announcer.decide(
                DecisionKind.HANDBACK, found.text, tell=tell, mode=self._link.mission_mode, what=found.wrong
            )
