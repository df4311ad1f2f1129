"""Prometheus metrics and a health check, over HTTP and for this computer only.

The event loop updates the metrics once a second. A separate thread serves them, so that the health check is
answered even if the event loop hangs.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from http import HTTPStatus
from typing import Any

from companion import __version__
from companion.errors import ConfigError, LinkError
from companion.flight.messages.observer import Observer
from companion.flight.state.modes import Mode
from companion.flight.tasks.app import App
from companion.loopback_server import LOOPBACK, Answer, LoopbackServer
from companion.mission.swap import SwapOutcome
from companion.service.process.watchdog import Supervision
from companion.types.plan import Plan

try:
    from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, Counter, Histogram, generate_latest
    from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
except ImportError:  # The library is an extra; `Metrics` reports that it is missing.
    HAS_LIBRARY = False
else:
    HAS_LIBRARY = True

PLAN_BUCKETS_S = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)


class Metrics(Observer):
    """Collects the metrics.

    Raises
    ------
    ConfigError
        If the library is not installed.
    """

    def __init__(self) -> None:
        if not HAS_LIBRARY:
            raise ConfigError(
                "command line", None, "--metrics", "no prometheus-client installed",
                "pip install 'safe-rrt-companion[metrics]'",
            )  # fmt: skip
        self.registry = CollectorRegistry()
        self._plan_s = Histogram(
            "companion_plan_seconds", "Time a plan took", ["status"],
            buckets=PLAN_BUCKETS_S, registry=self.registry,
        )  # fmt: skip
        self._swaps = Counter(
            "companion_swaps", "Missions handed over, or not", ["outcome"], registry=self.registry
        )
        for outcome in SwapOutcome:
            self._swaps.labels(outcome.value)
        self._figures: list[Metric] = []
        self.registry.register(self)

    def planned(self, plan: Plan, plan_ms: float) -> None:
        """Count a plan by its status."""
        self._plan_s.labels(plan.status.value).observe(1e-3 * plan_ms)

    def exchanged(self, outcome: SwapOutcome) -> None:
        """Count a transfer by its outcome."""
        self._swaps.labels(outcome.value).inc()

    def collect(self) -> Iterable[Metric]:
        """Return the values of the last :meth:`renew`, for the registry."""
        return self._figures

    def renew(self, app: App, now_s: float) -> None:
        """Update the values; called in the event loop."""
        recorder, link, world_model = app.recorder, app.link, app.world_model
        quality = link.quality
        state, tracks = world_model.ownship.state(now_s), world_model.tracks(now_s)
        is_received, missing = app.receives_autopilot, len(link.streams.missing)
        frames: Values = {("received",): quality.received, ("lost",): quality.lost}
        modes: Values = {(mode.name.lower(),): mode is app.mode for mode in Mode}
        self._figures = [
            _gauge("companion_info", "Version", {(__version__,): 1}, "version"),
            _gauge("companion_mode", "What the service may do", modes, "mode"),
            _gauge("companion_autopilot_heard", "Whether a heartbeat came lately", {(): is_received}),
            _gauge("companion_link_open", "Whether the link is open", {(): link.transport.is_open}),
            _gauge("companion_link_loss_ratio", "Share of the autopilot's frames lost", {(): quality.loss}),
            _gauge("companion_streams_missing", "Vital streams that do not come", {(): missing}),
            _gauge("companion_tracks", "Vehicles that are followed", {(): len(tracks)}),
            _gauge("companion_queue_bytes", "Waiting", {("link",): link.transport.pending_bytes}, "queue"),
            _gauge("companion_recording", "Whether the flight is recorded", {(): recorder.is_recording}),
            _counter("companion_autopilot_frames", "Frames of the autopilot's", frames, "what"),
            _reasons("companion_frames", "Received frames by what became of them", link.codec.counters),
            _reasons("companion_track_reports", "Sightings by message", world_model.reports),
            _reasons(
                "companion_track_results", "Sightings by what became of them", world_model.tracker.counters
            ),
            _reasons("companion_decisions", "Decisions by kind", app.announcer.decided),
        ]
        if state is not None:
            level = world_model.threat_at(state, tracks)
            self._figures.append(_gauge("companion_threat_level", "The aircraft is under", {(): level}))


Values = dict[tuple[str, ...], float | int | bool]


def _filled(family: Any, values: Values) -> Metric:  # noqa: ANN401
    for labels, value in values.items():
        family.add_metric(labels, float(value))
    return family  # type: ignore[no-any-return]


def _gauge(name: str, text: str, values: Values, *labels: str) -> Metric:
    return _filled(GaugeMetricFamily(name, text, labels=labels), values)


def _counter(name: str, text: str, values: Values, *labels: str) -> Metric:
    return _filled(CounterMetricFamily(name, text, labels=labels), values)


def _reasons(name: str, text: str, counters: dict[str, int]) -> Metric:
    return _counter(name, text, {(reason,): number for reason, number in counters.items()}, "what")


class Endpoint:
    """Serves ``/metrics`` and ``/healthz`` on the loopback interface, in a thread.

    Parameters
    ----------
    port : int
        TCP port to listen on; 0 for any free port.
    metrics : Metrics
        Metrics to serve.
    supervision : Supervision
        State of the service: 200 while the planning loop makes progress, 503 otherwise.

    Raises
    ------
    LinkError
        If the port is in use.
    """

    def __init__(self, port: int, metrics: Metrics, supervision: Supervision) -> None:
        self._registry = metrics.registry
        self._supervision = supervision
        try:
            self._server = LoopbackServer(port, self._page)
        except OSError as error:
            raise LinkError(f"metrics on {LOOPBACK}:{port}: {error.strerror}") from error

    @property
    def port(self) -> int:
        """TCP port that it listens on."""
        return self._server.address[1]

    def _page(self, path: str) -> Answer:
        match path:
            case "/metrics":
                return Answer(HTTPStatus.OK, CONTENT_TYPE_LATEST, generate_latest(self._registry))
            case "/healthz":
                state = self._supervision
                status = HTTPStatus.SERVICE_UNAVAILABLE if state.is_stalled else HTTPStatus.OK
                body = json.dumps({"ready": state.is_ready, "status": state.status}).encode() + b"\n"
                return Answer(status, "application/json", body)
            case _:
                return Answer(HTTPStatus.NOT_FOUND, "text/plain", b"/metrics or /healthz\n")

    def close(self) -> None:
        """Stop the server."""
        self._server.close()
