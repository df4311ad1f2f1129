"""The interface for observers of the service, such as metrics."""

from __future__ import annotations

from companion.mission.swap import SwapOutcome
from companion.types.plan import Plan


class Observer:
    """Receives notifications and ignores them; subclasses override. No decision depends on an observer."""

    def progress(self) -> None:
        """Note a round of the planning loop, or progress of an exchange with the autopilot."""

    def received(self) -> None:
        """Note the first message of an autopilot."""

    def planned(self, plan: Plan, plan_ms: float) -> None:
        """Note a finished plan and its computing time [ms]."""

    def exchanged(self, outcome: SwapOutcome) -> None:
        """Note the outcome of handing over a mission."""
