"""The watchdog is fed by progress and by nothing else."""

import socket

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.clock import ManualClock
from companion.config import mission_from_text
from companion.service.process.sd_notify import Notifier, watchdog_of
from companion.service.process.watchdog import EXTENSION_S, WARM_UP_MAX_S, Report, Supervision
from companion.types.events import Dialect
from tests.support.sitl_harness import FIRST_FLIGHT, SitlHarness

COLD = Report(False, False, "")
DEAF = Report(True, False, "")
READY = Report(True, True, "planning (AUTO)", "keep: cost 2")


class Told:
    def __init__(self):
        self.words = []

    def tell(self, **words):
        self.words.append(words)

    def keys(self):
        return [key for words in self.words for key in words if key != "STATUS"]


def supervised(watchdog_s=60.0):
    told, clock, now = Told(), ManualClock(100.0), [COLD]
    return told, clock, now, Supervision(told, clock, lambda: now[0], watchdog_s)


def rounds(clock, supervision, until_s):
    while clock.now_s() < until_s:
        supervision.progress()
        clock.advance_to(clock.now_s() + 0.2)


def test_it_asks_for_time_while_it_compiles_and_while_the_autopilot_has_no_power():
    told, clock, now, supervision = supervised()
    rounds(clock, supervision, 110.0)
    now[0] = DEAF
    rounds(clock, supervision, 100_000.0)
    assert set(told.keys()) == {"EXTEND_TIMEOUT_USEC"}
    assert [words["STATUS"] for words in told.words if "STATUS" in words] == [str(COLD), str(DEAF)]
    now[0] = READY
    rounds(clock, supervision, 100_002.0)
    assert told.words[-2] == {"READY": 1, "WATCHDOG": 1, "STATUS": str(READY)}


def test_ready_is_told_when_it_is_true_and_once_and_feeds_no_watchdog():
    told, clock, now, supervision = supervised()
    rounds(clock, supervision, 100.5)
    supervision.note_ready()
    assert not any("READY" in words for words in told.words)
    now[0] = READY
    clock.advance_to(clock.now_s() + 0.01)
    supervision.note_ready()
    assert told.words[-1] == {"READY": 1, "WATCHDOG": 1, "STATUS": str(READY)}
    before, progress_s = len(told.words), supervision.progress_s
    for _ in range(100):
        clock.advance_to(clock.now_s() + 1.0)
        supervision.note_ready()
    assert len(told.words) == before
    assert supervision.progress_s == progress_s
    assert supervision.is_stalled


def test_a_service_that_stops_is_not_ready_any_more():
    told, _, now, supervision = supervised()
    supervision.leave()
    now[0] = READY
    supervision.note_ready()
    supervision.progress()
    assert told.keys() == ["STOPPING"]


@pytest.mark.parametrize("dialect", list(Dialect))
def test_the_autopilot_is_noted_when_it_is_received_first(dialect):
    noted = []

    def on_step(harness):
        link = harness.app.link
        link._observer.received = lambda: noted.append((link.knows_autopilot, link.has_received))

    SitlHarness(mission_from_text(FIRST_FLIGHT, "first-flight.yaml"), dialect=dialect).fly(5.0, on_step)
    assert noted == [(True, False)]  # it is confirmed by the next heartbeat


def test_compiling_for_ever_is_no_progress():
    told, clock, _, supervision = supervised()
    rounds(clock, supervision, 100.0 + WARM_UP_MAX_S + 100.0)
    assert len(told.keys()) <= WARM_UP_MAX_S + 1


def test_there_are_several_words_in_each_extension_and_in_each_watchdog_period():
    for watchdog_s in (2.0, 60.0):
        told, clock, now, supervision = supervised(watchdog_s)
        rounds(clock, supervision, 100.0 + EXTENSION_S)
        assert len(told.words) >= 10
        now[0] = READY
        before = len(told.words)
        rounds(clock, supervision, clock.now_s() + watchdog_s)
        assert len(told.words) - before >= 3


@given(wedged_after=st.floats(0.0, 50.0), period=st.floats(2.0, 90.0))
def test_without_rounds_the_watchdog_is_not_fed_within_its_time(wedged_after, period):
    told, clock, now, supervision = supervised(period)
    now[0] = READY
    rounds(clock, supervision, 100.0 + wedged_after)
    before = len(told.words)
    assert not supervision.is_stalled
    clock.advance_to(clock.now_s() + period + 1.0)
    assert len(told.words) == before
    assert supervision.is_stalled


def test_the_words_change_when_what_is_done_does():
    told, clock, now, supervision = supervised()
    now[0] = READY
    rounds(clock, supervision, 105.0)
    now[0] = Report(True, True, "suspended: another mode is flown (FBWA)")
    rounds(clock, supervision, 110.0)
    assert [words["STATUS"] for words in told.words if "STATUS" in words] == [
        "planning (AUTO); last: keep: cost 2", "suspended: another mode is flown (FBWA)",
    ]  # fmt: skip


@pytest.mark.parametrize("dialect", list(Dialect))
def test_in_flight_there_is_progress_far_more_often_than_the_watchdog_asks_for_it(dialect):
    stamps = []

    def on_step(harness):
        harness.app._observer.progress = lambda: stamps.append(harness.now_s)

    SitlHarness(mission_from_text(FIRST_FLIGHT, "first-flight.yaml"), dialect=dialect).fly(25.0, on_step)
    assert max(np.diff([0.0, *stamps, 25.0])) < 10.0


@pytest.mark.parametrize("kind", ["path", "abstract"])
def test_words_arrive_at_both_kinds_of_socket(tmp_path, kind):
    name = f"companion-test-{tmp_path.name}"
    address = f"@{name}" if kind == "abstract" else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind("\0" + name if kind == "abstract" else address)
        manager.settimeout(5.0)
        notifier = Notifier(address)
        assert notifier._socket is not None
        notifier.tell(READY=1, STATUS="one\ntwo")
        assert manager.recv(1000) == b"READY=1\nSTATUS=one two"
        notifier.close()
        notifier.tell(READY=1)  # nobody, and no error


def test_a_manager_that_is_not_there_or_does_not_read_holds_nothing_up(tmp_path, caplog):
    assert Notifier("")._socket is None
    assert Notifier(str(tmp_path / "none"))._socket is None
    assert "not told anything" in caplog.text
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "full"))
        notifier = Notifier(str(tmp_path / "full"))
        for _ in range(10_000):  # far more than its queue holds
            notifier.tell(STATUS="x" * 100)
        notifier.close()


@pytest.mark.parametrize(
    ("environment", "seconds"),
    [({}, None), ({"WATCHDOG_USEC": "0"}, None), ({"WATCHDOG_USEC": "often"}, None),
     ({"WATCHDOG_USEC": "30000000"}, 30.0), ({"WATCHDOG_USEC": "30000000", "WATCHDOG_PID": "1"}, None)],
)  # fmt: skip
def test_the_watchdogs_period_is_the_environments(environment, seconds):
    assert watchdog_of(environment) == seconds
