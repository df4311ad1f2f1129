"""Who is told of what the planning loop does: the supervision, the metrics, the ground station's figures."""

from __future__ import annotations

from companion.flight.observer import Watch
from companion.mission.swap import SwapOutcome
from companion.service.metrics import Metrics
from companion.service.telemetry_out import TelemetryReporter
from companion.service.watchdog import Supervision
from companion.types.plan import Plan


class Observers(Watch):
    """Passes on what the app tells its observer.

    Parameters
    ----------
    supervision : Supervision
        Learns that the planning loop came round.
    metrics : Metrics or None
        Prometheus figures of plans and exchanges; None where nobody asks for them.

    Attributes
    ----------
    reporter : TelemetryReporter or None
        The present flight's; None before the first.
    """

    def __init__(self, supervision: Supervision, metrics: Metrics | None) -> None:
        self.metrics = metrics
        self.reporter: TelemetryReporter | None = None
        self._supervision = supervision

    def progress(self) -> None:
        """Pass it on to whoever supervises."""
        self._supervision.progress()

    def planned(self, plan: Plan, plan_ms: float) -> None:
        """Pass it on to whoever reports."""
        if self.reporter is not None:
            self.reporter.planned(plan, plan_ms)
        if self.metrics is not None:
            self.metrics.planned(plan, plan_ms)

    def exchanged(self, outcome: SwapOutcome) -> None:
        """Pass it on to whoever reports."""
        if self.metrics is not None:
            self.metrics.exchanged(outcome)
