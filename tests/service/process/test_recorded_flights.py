"""Flight after flight in one run of the service: each begins anew, in a folder of its own."""

import asyncio
import os
import signal
import socket
import threading

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.clock import ManualClock
from companion.config import load_mission
from companion.config.reload import prepared_mission
from companion.errors import ConfigError, LinkError
from companion.flight.state.checkpoint import Checkpoint
from companion.flight.state.flight_phase import GROUND_MAX_S, LANDED_S
from companion.flight.state.modes import Mode, ModeEvent
from companion.link.wire.memory_transport import MemoryTransport
from companion.recording.reader import load_recording
from companion.service.doctor.doctor_command import run_checks
from companion.service.process import service as services
from companion.service.process.service import Service
from companion.service.replay.comparison import first_difference
from tests.sim.client import CONFIGS
from tests.support.recorded import replayed

MISSION = CONFIGS / "first-flight.yaml"
GOALS = [(1750.0, 750.0, 100.0)]
AUTO, FBWA = 10, 5
STEP_S = 0.5
ROUNDS_MAX = 100_000


class Bench:
    """A service whose clock and autopilot, of which there are only heartbeats, are in the test's hands."""

    def __init__(self, folder, mission=MISSION):
        self.clock = ManualClock(100.0)
        ours, self.theirs = MemoryTransport.pair()
        self.flights = folder / "flights"
        self.service = Service(mission, "tcp://nowhere:1", self.flights, {}, clock=self.clock, line=ours)
        self._packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.said, self.heard = [], []
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True

    def folders(self):
        return sorted(self.flights.glob("*Z-first-flight*"))

    async def pass_time(self, seconds, beat=None, step_s=STEP_S):
        """Let time pass; ``beat`` is the mode and whether the aircraft is armed, None is silence."""
        end_s = self.clock.now_s() + seconds
        while self.clock.now_s() < end_s:
            if beat is not None:
                mode, is_armed = beat
                base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
                base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if is_armed else 0
                message = self._packer.heartbeat_encode(1, 3, base, mode, 4)
                self.theirs.send(message.pack(self._packer))
            self.clock.advance_to(min(end_s, self.clock.now_s() + step_s))
            for _ in range(30):
                await asyncio.sleep(0)
            await self.let_mavsdk_speak()

    async def let_mavsdk_speak(self):
        """Hold time while it is MAVSDK's turn, or it would ask at another moment each time."""
        for _ in range(ROUNDS_MAX):
            if not self.service.app.link.autopilot.is_mavsdk_turn:
                return
            await asyncio.sleep(2e-4)
        raise AssertionError("MAVSDK says nothing")

    async def until(self, is_so, beat=None):
        """Let as little time pass as that takes: MAVSDK ends in threads of its own."""
        for _ in range(ROUNDS_MAX):
            if is_so():
                return
            await self.pass_time(1e-3, beat)
        raise AssertionError("it never is so")

    def is_said(self, words, times):
        return sum(words in text for text in self.said) >= times

    def receive(self, data):
        self.heard.append(data)
        self.said += [
            message.text for message in self._parser.parse_buffer(data) or []
            if message.get_type() == "STATUSTEXT"
        ]  # fmt: skip


@pytest.fixture(autouse=True)
def _needs_no_kernels(monkeypatch):
    monkeypatch.setattr(services, "make_ready", lambda report: None)


@pytest.fixture
def bench(tmp_path):
    return Bench(tmp_path)


def served(bench, script):
    """Run the service beside a script, then stop it by the signal of a service manager."""

    async def run():
        bench.theirs.set_receiver(bench.receive)
        await bench.theirs.open()
        running = asyncio.create_task(bench.service.run())
        await asyncio.sleep(0)
        try:
            await script()
        finally:
            os.kill(os.getpid(), signal.SIGTERM)
            await bench.until(running.done)
        await running

    asyncio.run(run())


def test_two_flights_are_two_recordings_and_the_second_is_planned_anew(bench):
    apps, modes = [], []

    async def script():
        await bench.pass_time(5.0, (FBWA, False))
        await bench.pass_time(20.0, (AUTO, True))
        apps.append(bench.service.app)
        modes.append(bench.service.app.mode)
        bench.service.app.change(ModeEvent.GOAL_REACHED)
        await bench.pass_time(LANDED_S + 2.0, (AUTO, False))
        await bench.until(lambda: bench.service.app is not apps[0])
        await bench.pass_time(3.0, (AUTO, False))
        apps.append(bench.service.app)
        modes.append(bench.service.app.mode)
        await bench.pass_time(20.0, (AUTO, True))
        modes.append(bench.service.app.mode)

    served(bench, script)
    first, second = apps
    assert first is not second
    assert modes == [Mode.DEPARTING, Mode.STANDBY, Mode.DEPARTING]
    recordings = [load_recording(folder / "flight.tlog") for folder in bench.folders()]
    assert len(recordings) == 2
    kinds = [[decision.kind for decision in recording.decisions] for recording in recordings]
    assert kinds[0][-1] == "landed"
    assert kinds[1][0] == "mode"
    assert kinds[1][-1] == "stopped"
    assert recordings[1].start_us >= recordings[0].frames[-1].at_us
    assert bench.said.count("Landed, flight over") == 1
    log = bench.folders()[1] / "flight.tlog"
    recording, result = replayed(log, load_mission(log.with_name("mission.yaml")))
    assert first_difference(recording, result) is None
    assert [entry.kind for entry in result.decisions] == kinds[1][:-1]
    assert not any("stopped" in text for text in bench.said[:-1])


def test_a_slip_of_the_pilots_goes_on_in_the_same_recording(bench):
    async def script():
        await bench.pass_time(20.0, (AUTO, True))
        await bench.pass_time(LANDED_S - 2.0, (AUTO, False))
        await bench.pass_time(20.0, (AUTO, True))
        await bench.pass_time(60.0)  # out of reach

    served(bench, script)
    assert len(bench.folders()) == 1


def test_hours_on_the_ground_keep_the_last_recording_before_a_flight(bench):
    seen = []

    async def script():
        for _ in range(4):
            app = bench.service.app
            await bench.pass_time(GROUND_MAX_S, (FBWA, False), step_s=4.0)
            await bench.until(lambda app=app: bench.service.app is not app)
            seen.append(len(bench.folders()))
        await bench.pass_time(20.0, (AUTO, True))

    served(bench, script)
    assert max(seen) == 2
    both = (load_recording(folder / "flight.tlog") for folder in bench.folders())
    before, flight = sorted(both, key=lambda recording: recording.frames[0].at_us)  # names are of one second
    # The switch is one instant: the last answer to MAVSDK may share it with the first heartbeat, no more.
    assert before.frames[-1].at_us <= flight.frames[0].at_us < before.frames[-1].at_us + 1_000_000
    assert [decision.kind for decision in flight.decisions][-1] == "stopped"


def test_goals_of_the_last_flight_are_forgotten_on_the_ground(tmp_path):
    Checkpoint(tmp_path / "flights" / "first-flight").note_reached(GOALS, 1)
    bench, left = Bench(tmp_path), []

    async def script():
        await bench.pass_time(LANDED_S - 1.0, (FBWA, False))
        left.append(Checkpoint(bench.flights / "first-flight").reached(GOALS))
        await bench.pass_time(6.0, (FBWA, False))  # it is known after five heartbeats alone
        left.append(Checkpoint(bench.flights / "first-flight").reached(GOALS))

    served(bench, script)
    assert left == [1, 0]


def test_a_disk_that_cannot_be_written_costs_the_recording_and_not_the_flight(tmp_path, caplog):
    (tmp_path / "flights").write_text("a file where the folder belongs")
    bench = Bench(tmp_path)
    modes = []

    async def script():
        await bench.pass_time(5.0, (AUTO, True))
        modes.append(bench.service.app.mode)

    served(bench, script)
    assert modes == [Mode.DEPARTING]  # this autopilot has no mission to read
    assert "not recorded" in caplog.text
    assert "Recording stopped, flight goes on" in bench.said


def test_names_that_are_taken_are_counted_on(bench):
    taken = bench.service._flight.folder
    again = Service(MISSION, "tcp://nowhere:1", bench.flights, {}, clock=bench.clock, line=MemoryTransport())
    names = {taken.name, again._flight.folder.name}
    assert len(names) == 2
    bench.service.close()
    again.close()


def test_an_address_that_is_taken_ends_the_service_with_one_error(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"udpin://127.0.0.1:{taken.getsockname()[1]}"
        service = Service(MISSION, url, tmp_path / "flights", {})
        with pytest.raises(LinkError, match=f"{url}: Address already in use"):
            asyncio.run(service.run())
    assert list((tmp_path / "flights").iterdir()) == []


def member_file(folder, link):
    """A mission file of a team of systems 1 and 2."""
    file = folder / "member.yaml"
    text = MISSION.read_text(encoding="utf-8")
    file.write_text(f"{text}\nteam: {{members: [1, 2]}}\n{link}\n", encoding="utf-8")
    return file


@pytest.mark.parametrize(("link", "found"), [("", "nothing"), ("link: {vehicle_system_id: 3}", "3")])
def test_a_team_whose_file_names_no_own_system_does_not_start(tmp_path, link, found):
    """Heartbeats of other members come over the radio: one of them could be taken for the own autopilot."""
    file = member_file(tmp_path, link)
    with pytest.raises(ConfigError) as of_service:
        Service(file, "udpin://127.0.0.1:0", tmp_path / "flights", {})
    with pytest.raises(ConfigError) as of_doctor:
        asyncio.run(run_checks(file, None, 0.0, tmp_path / "flights"))
    expected = (
        f"{file}: link.vehicle_system_id: got {found}; expected the own autopilot's of team.members, 1, 2"
    )
    assert str(of_service.value).startswith(expected)
    assert str(of_doctor.value).startswith(expected)


def test_a_team_whose_file_names_the_own_system_starts(tmp_path):
    file = member_file(tmp_path, "link: {vehicle_system_id: 2}")
    service = Service(file, "udpin://127.0.0.1:0", tmp_path / "flights", {})
    service.close()


def test_a_port_for_metrics_that_is_taken_leaves_nothing_behind(tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        service = Service(MISSION, "udpin://127.0.0.1:0", tmp_path / "flights", {}, metrics_port=port)
        with pytest.raises(LinkError, match=f"metrics on 127.0.0.1:{port}: Address already in use"):
            asyncio.run(service.run())
    assert list((tmp_path / "flights").iterdir()) == []


def test_hours_of_silence_leave_no_recording(bench):
    async def script():
        for _ in range(2):
            app = bench.service.app
            await bench.pass_time(GROUND_MAX_S, step_s=60.0)
            await bench.until(lambda app=app: bench.service.app is not app)

    served(bench, script)
    assert bench.folders() == []


def test_a_large_mission_is_read_beside_the_loop_and_taken_up_afterwards(bench, monkeypatch):
    """Reading one of 3.6 MB stopped the loop for 37 s."""
    begun, may_end, read = threading.Event(), threading.Event(), []

    def slow(running, file, fences):
        read.append(threading.current_thread() is threading.main_thread())
        begun.set()
        assert may_end.wait(60.0)
        return prepared_mission(running, file, fences)

    monkeypatch.setattr(services, "prepared_mission", slow)
    heard = []

    def num_reloads():
        return [entry.kind for entry in bench.service.app.recorder.decisions].count("reload")

    async def script():
        await bench.pass_time(5.0, (FBWA, False))
        bench.service.reload()
        await bench.until(begun.is_set)
        sent = len(bench.heard)
        bench.service.reload()  # twice while it is read: once more afterwards
        bench.service.reload()
        await bench.pass_time(5.0, (FBWA, False))
        heard.append(len(bench.heard) - sent)
        assert num_reloads() == 0
        may_end.set()
        await bench.until(lambda: num_reloads() == 2, (FBWA, False))

    served(bench, script)
    assert heard[0] >= 5  # heartbeats among them
    assert read == [False, False]
    [log] = [folder / "flight.tlog" for folder in bench.folders()]
    assert len(load_recording(log).reloads) == 2


def test_a_mission_file_that_became_strange_is_refused_and_the_next_is_read(tmp_path, caplog):
    file = tmp_path / "mission.yaml"
    file.write_bytes(MISSION.read_bytes())
    bench = Bench(tmp_path, file)

    async def script():
        await bench.pass_time(5.0, (FBWA, False))
        file.unlink()
        os.mkfifo(file)
        bench.service.reload()
        await bench.until(lambda: "not reloaded" in caplog.text, (FBWA, False))
        file.unlink()
        file.write_text("unit_m: 2026-13-45\n")
        bench.service.reload()
        await bench.until(lambda: caplog.text.count("not reloaded") == 2, (FBWA, False))
        file.write_bytes(MISSION.read_bytes())
        bench.service.reload()
        await bench.until(lambda: bench.is_said("read again", 1), (FBWA, False))

    served(bench, script)
    assert "not a plain file" in caplog.text
