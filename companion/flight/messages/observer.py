"""Who looks on while the service works."""

from __future__ import annotations

from companion.mission.swap import SwapOutcome
from companion.types.plan import Plan


class Observer:
    """Is told of what happens; this one takes no notice. Nothing decides on it."""

    def progress(self) -> None:
        """The planning loop came round, or an exchange with the autopilot got on."""

    def planned(self, plan: Plan, plan_ms: float) -> None:
        """A plan was made, in so many milliseconds of the computer's time."""

    def exchanged(self, outcome: SwapOutcome) -> None:
        """A mission was handed over, or was not."""
