"""Metrics, health, logs, and what the ground station is told every second."""

import json
import logging
import sys
import urllib.error
import urllib.request

import pytest
from prometheus_client.parser import text_string_to_metric_families
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.clock import ManualClock
from companion.config import mission_from_text
from companion.errors import ConfigError, LinkError
from companion.link.wire.link_quality import LinkQuality
from companion.mission.swap import SwapOutcome
from companion.service.process import log_format as logs
from companion.service.process import metrics
from companion.service.process.host_status import host_status
from companion.service.process.metrics import Endpoint, Metrics
from companion.service.process.sd_notify import Notifier
from companion.service.process.telemetry_out import COMPUTER_PERIODS, TelemetryReporter
from companion.service.process.watchdog import Report, Supervision
from companion.types.plan import Measures, Plan, PlanStatus
from tests.support.sitl_harness import FIRST_FLIGHT, SitlHarness


def get(url):
    with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(url, timeout=10.0) as answer:
        return answer.read().decode()


def refused(url):
    """The code that a request is refused with."""
    with pytest.raises(urllib.error.HTTPError) as error:
        get(url)
    error.value.close()
    return error.value.code


@pytest.fixture
def endpoint():
    clock = ManualClock()
    supervision = Supervision(Notifier(), clock, lambda: Report(True, True, "planning (AUTO)"), 30.0)
    figures = Metrics()
    served = Endpoint(0, figures, supervision)
    yield served, figures, supervision, clock
    served.close()


@pytest.fixture(scope="module")
def flight():
    """Ten seconds with figures told every second."""
    figures, told = Metrics(), []

    def on_step(harness):
        if not told:
            told.append(
                TelemetryReporter(harness.app, harness.app._clock, harness.flight.folder or "/", figures, 0.0)
            )
            told[0].planned(plan(PlanStatus.EXACT), 1.0)
        if round(harness.now_s * 50) % 50 == 0:
            told[0].tell(harness.now_s, with_computer=harness.now_s % COMPUTER_PERIODS < 0.5)

    harness = SitlHarness(mission_from_text(FIRST_FLIGHT, "first-flight.yaml")).fly(10.0, on_step)
    return harness, figures, told[0]


def plan(status, path=None, quality=0.0):
    return Plan(status, path, Measures(quality=quality), 1, "safe-rrt", 0)


def samples(text):
    return {
        (sample.name, *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_a_flight_is_seen_in_the_figures(flight, endpoint):
    figures = flight[1]
    served = Endpoint(0, figures, endpoint[2])
    try:
        seen = samples(get(f"http://127.0.0.1:{served.port}/metrics"))
    finally:
        served.close()
    assert seen["companion_mode", "active"] == 1.0
    assert sum(value for key, value in seen.items() if key[0] == "companion_mode") == 1.0
    assert seen["companion_autopilot_heard",] == 1.0
    assert seen["companion_tracks",] == 1.0
    assert seen["companion_track_reports_total", "ADSB_VEHICLE"] > 3.0
    assert seen["companion_track_results_total", "initiated"] == 1.0
    assert seen["companion_autopilot_frames_total", "lost"] == 0.0
    assert seen["companion_autopilot_frames_total", "received"] > 100.0
    assert seen["companion_decisions_total", "swap"] >= 1.0
    assert seen["companion_recording",] == 0.0
    assert 0.0 <= seen["companion_threat_level",] <= 1.0
    assert seen["companion_queue_bytes", "link"] == 0.0


def test_plans_and_exchanges_are_counted_by_how_they_ended(endpoint):
    served, figures, _, _ = endpoint
    figures.planned(plan(PlanStatus.EXACT), 300.0)
    figures.planned(plan(PlanStatus.APPROXIMATE), 1200.0)
    figures.exchanged(SwapOutcome.FLOWN)
    figures.exchanged(SwapOutcome.STALE)
    seen = samples(get(f"http://127.0.0.1:{served.port}/metrics"))
    assert seen["companion_plan_seconds_bucket", "0.35", "exact"] == 1.0
    assert seen["companion_plan_seconds_bucket", "1.0", "approximate"] == 0.0
    assert seen["companion_plan_seconds_sum", "approximate"] == pytest.approx(1.2)
    assert seen["companion_swaps_total", "flown"] == seen["companion_swaps_total", "stale"] == 1.0
    assert seen["companion_swaps_total", "refused"] == 0.0


def test_health_follows_the_planning_loop(endpoint):
    served, _, supervision, clock = endpoint
    url = f"http://127.0.0.1:{served.port}/healthz"
    supervision.progress()
    assert json.loads(get(url)) == {"ready": True, "status": "planning (AUTO)"}
    clock.advance_to(31.0)
    assert refused(url) == 503
    supervision.progress()
    assert json.loads(get(url))["ready"] is True
    assert refused(f"http://127.0.0.1:{served.port}/else") == 404


def test_the_endpoint_is_for_this_computer_alone_and_says_when_its_port_is_taken(endpoint):
    served = endpoint[0]
    assert served._server.address[0] == "127.0.0.1"
    with pytest.raises(LinkError, match=f"127.0.0.1:{served.port}"):
        Endpoint(served.port, endpoint[1], endpoint[2])


def test_without_the_library_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr(metrics, "HAS_LIBRARY", False)
    with pytest.raises(ConfigError, match=r"safe-rrt-companion\[metrics\]"):
        Metrics()


def test_the_ground_station_sees_threat_quality_and_computer(flight):
    harness = flight[0]
    values = harness.said("NAMED_VALUE_FLOAT")
    assert {message.name for _, message in values} == {"threat"}
    assert 8 <= len(values) <= 11
    computers = [message for _, message in harness.said("ONBOARD_COMPUTER_STATUS")]
    assert 1 <= len(computers) <= 3
    assert computers[0].ram_total > computers[0].ram_usage > 0
    assert computers[0].storage_total[0] > 0
    assert computers[0].cpu_cores[0] <= 100
    assert (computers[0].get_srcSystem(), computers[0].get_srcComponent()) == (1, 195)


def test_the_quality_of_the_last_plan_with_a_path_is_told(flight):
    harness, _, reporting = flight
    path = harness.app.state.flown.path
    reporting.planned(plan(PlanStatus.EXACT, path, 0.75), 1.0)
    reporting.planned(plan(PlanStatus.APPROXIMATE, None, 0.1), 1.0)
    sent = []
    harness.app.link.send = sent.append
    reporting.tell(20.0, with_computer=False)
    messages = mavlink.MAVLink(None).parse_buffer(b"".join(sent))
    assert {message.name: message.value for message in messages}["plan_q"] == pytest.approx(0.75)


def test_a_folder_that_is_gone_costs_the_disks_figures_only(tmp_path):
    computer = host_status(tmp_path / "gone" / "away")
    assert computer.disk_total_mb == 0.0
    assert computer.memory_total_mb > 0.0


@pytest.mark.parametrize(
    ("numbers", "received", "lost"),
    [([], 0, 0), ([7, 8, 9], 3, 0), ([7, 9], 2, 1), ([254, 255, 0, 1], 4, 0), ([250, 2], 2, 7),
     ([5, 5, 6], 3, 0), ([10, 9, 10], 3, 0), ([200, 0, 1], 3, 55)],
)  # fmt: skip
def test_gaps_in_the_sequence_are_losses_and_late_frames_are_not(numbers, received, lost):
    quality = LinkQuality()
    for number in numbers:
        quality.note(bytes((0xFD, 0, 0, 0, number, 1, 1, 0, 0, 0, 0, 0)))
    assert (quality.received, quality.lost) == (received, lost)
    assert quality.loss == (lost / (lost + received) if received else 0.0)


def record_of(level=logging.WARNING, **extra):
    record = logging.LogRecord("companion.x", level, "x.py", 1, "%s went", ("it",), None)
    vars(record).update(extra)
    return record


def test_a_line_of_json_has_what_was_said_and_what_is_known_of_it():
    line = json.loads(logs.JsonFormatter().format(record_of(decision="swap")))
    assert line["message"] == "it went"
    assert (line["level"], line["logger"], line["decision"]) == ("warning", "companion.x", "swap")
    assert line["time"].endswith("+00:00")


def test_a_trace_stays_on_one_line_of_json():
    try:
        raise ValueError("no")
    except ValueError:
        record = record_of(exc_info=sys.exc_info())
    text = logs.JsonFormatter().format(record)
    assert "\n" not in text
    assert "ValueError: no" in json.loads(text)["trace"]


@pytest.mark.parametrize(("level", "priority"), [(10, 7), (20, 6), (30, 4), (40, 3), (50, 3)])
def test_journald_gets_the_priority_of_each_line(level, priority):
    formatter = logs.PriorityFormatter(logging.Formatter("%(message)s\nagain"))
    assert formatter.format(record_of(level)) == f"<{priority}>it went\n<{priority}>again"


def test_only_journalds_own_stream_counts_as_a_journal(monkeypatch, tmp_path):
    with (tmp_path / "stderr").open("w") as stream:
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setenv("JOURNAL_STREAM", "1:2")
        assert not logs.is_journal()
        status = (tmp_path / "stderr").stat()
        monkeypatch.setenv("JOURNAL_STREAM", f"{status.st_dev}:{status.st_ino}")
        assert logs.is_journal()
