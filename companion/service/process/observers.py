"""Distributes the app's notifications to supervision, metrics, telemetry and the page."""

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
    """Forwards the app's notifications.

    Parameters
    ----------
    supervision : Supervision
        Gets the progress of the planning loop.
    metrics : Metrics or None
        Prometheus metrics of plans and transfers; None without metrics.
    page : LivePage, optional
        Page that shows each flight; by default none.
    """

    def __init__(
        self, supervision: Supervision, metrics: Metrics | None, page: LivePage | None = None
    ) -> None:
        self.metrics = metrics
        self._page = page
        self._reporter: TelemetryReporter | None = None
        self._supervision = supervision

    def report_to(self, reporter: TelemetryReporter) -> None:
        """Use the telemetry reporter of a new flight."""
        self._reporter = reporter

    def begin_recording(self, recorder: Recorder) -> None:
        """Show a flight's recorded messages on the page, if there is one."""
        if self._page is not None:
            self._page.follow(recorder)

    def close(self) -> None:
        """Close the page."""
        if self._page is not None:
            self._page.close()

    def progress(self) -> None:
        """Forward progress to the supervision."""
        self._supervision.progress()

    def received(self) -> None:
        """Let the supervision report that the service is ready, if it is."""
        self._supervision.note_ready()

    def planned(self, plan: Plan, plan_ms: float) -> None:
        """Forward a plan to telemetry and metrics."""
        if self._reporter is not None:
            self._reporter.planned(plan, plan_ms)
        if self.metrics is not None:
            self.metrics.planned(plan, plan_ms)

    def exchanged(self, outcome: SwapOutcome) -> None:
        """Forward a transfer to the metrics."""
        if self.metrics is not None:
            self.metrics.exchanged(outcome)
