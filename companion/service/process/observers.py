"""Who is told of what the planning loop does: the supervision, the metrics, the ground station's figures."""

from __future__ import annotations

from companion.flight.messages.observer import Observer
from companion.mission.swap import SwapOutcome
from companion.recording.recorder import Recorder
from companion.service.process.metrics import Metrics
from companion.service.process.telemetry_out import TelemetryReporter
from companion.service.process.watchdog import Supervision
from companion.types.plan import Plan
from companion.ui.page.live_page import LivePage, page_of

__all__ = ["LivePage", "Observers", "page_of"]


class Observers(Observer):
    """Passes on what the app tells its observer.

    Parameters
    ----------
    supervision : Supervision
        Learns that the planning loop came round.
    metrics : Metrics or None
        Prometheus figures of plans and exchanges; None where nobody asks for them.
    page : LivePage, optional
        Shows each flight; left out, there is none.
    """

    def __init__(
        self, supervision: Supervision, metrics: Metrics | None, page: LivePage | None = None
    ) -> None:
        self.metrics = metrics
        self._page = page
        self._reporter: TelemetryReporter | None = None
        self._supervision = supervision

    def report_to(self, reporter: TelemetryReporter) -> None:
        """Tell the figures of a flight that begins to its reporter."""
        self._reporter = reporter

    def begin_recording(self, recorder: Recorder) -> None:
        """Show on the page, if there is one, what a flight's recorder writes down."""
        if self._page is not None:
            self._page.follow(recorder)

    def close(self) -> None:
        """End the page."""
        if self._page is not None:
            self._page.close()

    def progress(self) -> None:
        """Pass it on to whoever supervises."""
        self._supervision.progress()

    def planned(self, plan: Plan, plan_ms: float) -> None:
        """Pass it on to whoever reports."""
        if self._reporter is not None:
            self._reporter.planned(plan, plan_ms)
        if self.metrics is not None:
            self.metrics.planned(plan, plan_ms)

    def exchanged(self, outcome: SwapOutcome) -> None:
        """Pass it on to whoever reports."""
        if self.metrics is not None:
            self.metrics.exchanged(outcome)
