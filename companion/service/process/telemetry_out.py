"""Sends values to the ground station, and updates the metrics, every second."""

from __future__ import annotations

import math
from pathlib import Path

from companion.clock import Clock
from companion.flight.messages.observer import Observer
from companion.flight.tasks.app import App
from companion.service.process.host_status import host_status
from companion.service.process.metrics import Metrics
from companion.types.plan import Plan

PERIOD_S = 1.0
COMPUTER_PERIODS = 5  # The computer's state changes slowly, and a telemetry radio is slow.


class TelemetryReporter(Observer):
    """Reports values while the service runs.

    Parameters
    ----------
    app : App
        App whose values are reported.
    clock : Clock
        Clock of the app.
    folder : Path
        Folder on the disk whose use is reported.
    metrics : Metrics or None
        Prometheus metrics to update at the same time; None without metrics.
    begun_s : float
        Clock reading at which the service started [s].
    """

    def __init__(self, app: App, clock: Clock, folder: Path, metrics: Metrics | None, begun_s: float) -> None:
        self._app = app
        self._clock = clock
        self._folder = folder
        self._metrics = metrics
        self._begun_s = begun_s
        self._plan_quality = math.nan

    def planned(self, plan: Plan, plan_ms: float) -> None:  # noqa: ARG002 - The signature is the base class's.
        """Store the quality Q of the last plan."""
        if plan.path is not None:
            self._plan_quality = plan.measures.quality

    async def run(self) -> None:
        """Run until cancelled."""
        turn = 0
        while True:
            now = self._clock.now_s()
            self.tell(now, with_computer=turn % COMPUTER_PERIODS == 0)
            turn += 1
            await self._clock.sleep_until(now + PERIOD_S)

    def tell(self, now_s: float, *, with_computer: bool) -> None:
        """Report all values once."""
        app = self._app
        if self._metrics is not None:
            self._metrics.renew(app, now_s)
        if not app.link.has_received:
            return
        boot_s = now_s - self._begun_s
        state = app.world_model.ownship.state(now_s)
        if state is not None:
            level = app.world_model.threat_at(state, app.world_model.tracks(now_s))
            app.link.send(app.link.codec.named_value(boot_s, "threat", level))
        if math.isfinite(self._plan_quality):
            app.link.send(app.link.codec.named_value(boot_s, "plan_q", self._plan_quality))
        if with_computer:
            computer = host_status(self._folder)
            app.link.send(
                app.link.codec.computer_status(
                    computer.uptime_s,
                    computer.cores_percent,
                    computer.temperature_c,
                    (computer.memory_used_mb, computer.memory_total_mb),
                    (computer.disk_used_mb, computer.disk_total_mb),
                )
            )
