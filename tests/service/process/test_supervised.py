"""Under a service manager: the real process, a real notify socket, and the simulator over TCP."""

import signal
import urllib.error
import urllib.request

import pytest

from companion.mission.list_layout import banks_in
from companion.types.mission import Command
from tests.service.process.client import Client
from tests.service.process.processes import FIRST_FLIGHT, Manager, ended, free_port, service, simulator

HANG = """
import threading
from companion.service.process import service
from companion.flight.replanning.plan_maker import Planner
from companion.flight.replanning import replanning
service.make_ready = lambda report: None  # it plans, too
def hang(*parts, **named):
    threading.Event().wait()
"""
WEDGED = f"{HANG}Planner.plan = hang"  # in a thread of its own
STANDING = f"{HANG}replanning.Replanning._hand_over = hang"  # in the event loop


def is_healthy(port):
    direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with direct.open(f"http://127.0.0.1:{port}/healthz", timeout=10.0) as answer:
            return answer.status == 200
    except urllib.error.HTTPError as error:
        error.close()
        return False


def answers(port):
    try:
        return is_healthy(port)
    except urllib.error.URLError:
        return False


def is_flying(words):
    return "last: swap" in words.get("STATUS", "")


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A flight up to its first swap, two reloads, and the end by SIGTERM."""
    folder = tmp_path_factory.mktemp("flight")
    mission = folder / "mission.yaml"
    good = FIRST_FLIGHT.read_text(encoding="utf-8")
    mission.write_text(good, encoding="utf-8")
    port, manager = free_port(), Manager()
    with (
        simulator(port),
        service(port, folder / "flights", mission=mission, environment=manager.environment) as running,
    ):
        manager.hear_until(is_flying)
        mission.write_text(good.replace("airspeed_min_m_s: 12.5", "airspeed_min_m_s: fast"), encoding="utf-8")
        running.send_signal(signal.SIGHUP)
        manager.hear_until(lambda words: "refused" in words.get("STATUS", ""))
        mission.write_text(good.replace("threat_level_max: 0.2", "threat_level_max: 0.3"), encoding="utf-8")
        running.send_signal(signal.SIGHUP)
        manager.hear_until(lambda words: "read again" in words.get("STATUS", ""))
        code, said = ended(running)
        with Client(port) as client:
            items, current = client.mission(), client.current()
    yield manager.rest(), code, said, items, current
    manager.close()


def test_what_is_awaited_is_told_then_ready_then_alive_then_stopping(flight):
    words = flight[0]
    order = [
        next(n for n, entry in enumerate(words) if key in entry) for key in ("STATUS", "READY", "STOPPING")
    ]
    assert order == sorted(order)
    first, ready, stopping = order
    assert "compiling" in words[first]["STATUS"]
    assert all("EXTEND_TIMEOUT_USEC" in entry for entry in words[:ready])
    assert any("WATCHDOG" in entry for entry in words[ready:stopping])
    assert not any("WATCHDOG" in entry for entry in words[:ready])
    assert not any(key in entry for entry in words[stopping + 1 :] for key in ("WATCHDOG", "READY"))


def test_it_is_not_ready_before_the_kernels_and_the_autopilot_are(flight):
    words = flight[0]
    ready = next(entry for entry in words if "READY" in entry)
    assert "no autopilot" not in ready["STATUS"]
    assert "first heartbeat" not in ready["STATUS"]


def test_sigterm_ends_it_orderly(flight):
    _, code, said, _, _ = flight
    assert code == 0, said
    assert "stopped: the autopilot keeps its mission" in said
    assert "Traceback" not in said


def test_the_autopilot_is_left_with_a_whole_mission(flight):
    _, _, said, items, current = flight
    assert banks_in(items) is not None, said
    assert any(item.command == Command.NAV_LOITER_UNLIM for item in items[current:])


def test_a_bad_mission_file_is_named_with_its_key_and_the_old_one_stays(flight):
    words, _, said, _, _ = flight
    assert "vehicle.airspeed_min_m_s" in said
    reloads = [n for n, entry in enumerate(words) if "RELOADING" in entry]
    assert len(reloads) == 2
    assert all(words[n]["MONOTONIC_USEC"].isdigit() for n in reloads)
    assert all("READY" in words[n + 1] for n in reloads)


@pytest.mark.slow  # the test below is enough for every day
@pytest.mark.parametrize("stuck", [WEDGED, STANDING], ids=["planner", "loop"])
def test_whatever_hangs_is_unhealthy_and_its_stack_is_told_at_the_managers_signal(tmp_path, stuck):
    port, told, manager = free_port(), free_port(), Manager(tmp_path, watchdog_s=2.0)
    with (
        simulator(port),
        service(port, tmp_path, "--metrics", told, environment=manager.environment, before=stuck) as running,
    ):
        manager.hear_until(lambda words: "WATCHDOG" in words)
        assert is_healthy(told)
        while manager.hear(manager.watchdog_s) is not None:
            pass
        assert manager.hear(manager.watchdog_s) is None  # progress is not told each time it is made
        assert not is_healthy(told)
        code, said = ended(running, signal.SIGABRT)
        assert code == -signal.SIGABRT
        assert "in hang" in said
    manager.close()


@pytest.mark.thorough
def test_a_planner_that_does_not_return_stops_the_watchdog_and_sigterm_still_ends_it(tmp_path):
    port, manager = free_port(), Manager(watchdog_s=2.0)
    with simulator(port), service(port, tmp_path, environment=manager.environment, before=WEDGED) as running:
        manager.hear_until(lambda words: "WATCHDOG" in words)
        while manager.hear(manager.watchdog_s) is not None:
            pass
        code, said = ended(running)
        assert code == 0, said
    assert any("STOPPING" in words for words in manager.rest())
    manager.close()


def test_from_its_first_answer_on_it_ends_in_order(tmp_path):
    told = free_port()
    with service(free_port(), tmp_path, "--metrics", told) as running:
        while not answers(told):
            assert running.poll() is None
        code, said = ended(running)
    assert code == 0, said
    assert "stopped; the autopilot keeps the mission it flies" in said
