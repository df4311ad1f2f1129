"""What a flight leaves behind, and what becomes of it when the process or the disk does not hold."""

import json
import math
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from companion.config import load_mission
from companion.errors import RecordError
from companion.recording import mcap_schema as channels
from companion.recording.mcap_writer import CHUNK_S, FlightLog, encoded, plain
from companion.recording.reader import load_recording
from companion.recording.recorder import About, Recorder
from companion.types.events import Dialect
from tests.link.pymavlink_frames import heartbeat
from tests.sim.client import CONFIGS
from tests.support.messages import read_messages
from tests.support.recorded import recorded

pytestmark = pytest.mark.xdist_group("recorded flights")  # they share flights that are made once a process

ROOT = Path(__file__).parents[2]
WRITER = """
import sys
from pathlib import Path
from companion.config import load_mission
from companion.recording.recorder import About, Recorder
mission = load_mission(sys.argv[2])
recorder = Recorder(Path(sys.argv[1]), 1e9, About(mission, 7, step_s=0.1))
recorder.begin(0.0)
"""
KILLED = (
    WRITER
    + """
import os, signal
for tick in range(200):
    recorder.frame(0.1 * tick, bytes.fromhex(sys.argv[3]))
    recorder.decide(0.1 * tick, "keep", f"tick {tick}")
os.kill(os.getpid(), signal.SIGKILL)
"""
)
FILLED = (
    WRITER
    + """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[4]), int(sys.argv[4])))
for tick in range(3000):
    recorder.frame(0.1 * tick, bytes.fromhex(sys.argv[3]))
    recorder.decide(0.1 * tick, "keep", f"tick {tick}")
recorder.close()
sys.stdout.write(f"{len(recorder.decisions)} {recorder.failure}")
"""
)


def run(code, folder, *more):
    arguments = [sys.executable, "-c", code, folder, CONFIGS / "first-flight.yaml", heartbeat().hex(), *more]
    return subprocess.run(
        [str(value) for value in arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


KINDS = {
    "number": (int, float), "integer": int, "string": str, "boolean": bool, "array": list, "object": dict,
    "null": type(None),
}  # fmt: skip


@pytest.fixture(scope="module")
def flown():
    return recorded("first-flight", 3, Dialect.PX4)


def topics_in(folder):
    """Number of messages by topic, each of which keeps to its schema."""
    seen = Counter()
    with (folder / "flight.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            seen[channel.topic] += 1
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            properties, document = json.loads(schema.data)["properties"], json.loads(message.data)
            assert document.keys() <= properties.keys()
            for key, value in document.items():
                wanted = properties[key]["type"]
                names = [wanted] if isinstance(wanted, str) else wanted
                assert any(isinstance(value, KINDS[name]) for name in names), (channel.topic, key, value)
    return seen


def test_the_file_opens_with_its_own_reader_and_every_message_keeps_to_its_schema(flown):
    folder, _ = flown
    # The mission file has no section `energy`.
    assert topics_in(folder).keys() == {channel.topic for channel in channels.CHANNELS} - {channels.ENERGY}


def test_what_is_left_on_board_keeps_to_its_schema(tmp_path):
    mission = load_mission(CONFIGS / "first-flight.yaml")
    recorder = Recorder(tmp_path, 1e9, About(mission, 7, step_s=0.1))
    recorder.begin(0.0)
    known = {"left_wh": 40.0, "ratio": 1.5, "home_wh": 9.0, "margin_wh": 21.0, "turn_back_in_s": math.inf}
    recorder.energy(1.0, known)
    recorder.energy(2.0, {**known, "left_wh": 39.0, "home_wh": None, "margin_wh": None})
    recorder.energy(3.0, {**known, "left_wh": 38.0, "turn_back_in_s": 71.5})
    recorder.close()
    assert topics_in(tmp_path)[channels.ENERGY] == 3
    rows = [[1.0, 40.0, 19.0], [2.0, 39.0, math.nan], [3.0, 38.0, 17.0]]
    np.testing.assert_array_equal(recorder.record({}).energy, rows)


def test_the_folder_says_what_was_flown_with_what(flown):
    folder, flight = flown
    assert (folder / "mission.yaml").read_text() == (CONFIGS / "first-flight.yaml").read_text()
    [about] = read_messages(folder / "flight.mcap", Counter())[channels.MISSION]
    assert about["seed"] == 3
    assert about["clock"] == "simulated"
    assert about["step_s"] == 0.02
    assert about["epoch_s"] == flight.recorder.epoch_s
    assert {"companion", "numpy", "numba", "pymavlink", "mavsdk"} <= about["versions"].keys()


def test_why_it_replanned_is_answered(flown):
    folder, _ = flown
    told = read_messages(folder / "flight.mcap", Counter())
    swap = [entry for entry in told[channels.DECISION] if entry["text"].startswith("extend")][-1]
    assert swap["why"]["occasion"] == "15 s since the last plan"
    assert swap["why"]["carried_s"] < swap["why"]["carried_min_s"] == 22.5
    plan = [entry for entry in told[channels.PLAN] if entry["begun_s"] < swap["stamp_s"]][-1]
    assert plan["occasion"] == swap["why"]["occasion"]
    assert plan["cost"] == swap["why"]["cost"]
    assert len(plan["path"]) == len(plan["threat_levels"]) > 10
    [world] = [entry for entry in told[channels.SNAPSHOT] if entry["number"] == plan["snapshot"]]
    assert world["known_threats"] == ["radar_1"]
    assert [track["identity"] for track in world["tracks"]] == ["icao:D70001"]
    handed = [entry for entry in told[channels.SWAP] if entry["ended_s"] == swap["stamp_s"]]
    assert [entry["outcome"] for entry in handed] == ["flown"]
    assert len(handed[0]["items"]) > 5


def test_a_killed_process_loses_less_than_a_second_of_both_files(tmp_path):
    done = run(KILLED, tmp_path)
    assert done.returncode == -signal.SIGKILL, done.stderr
    counters = Counter()
    decisions = read_messages(tmp_path / "flight.mcap", counters)[channels.DECISION]
    assert 19.9 - decisions[-1]["stamp_s"] <= 1.0
    assert [entry["text"] for entry in decisions] == [f"tick {n}" for n in range(len(decisions))]
    assert counters["mcap_ends_early"] == 1
    recording = load_recording(tmp_path / "flight.tlog")
    assert 19.9 - recording.duration_s <= 1.0
    assert recording.until_s <= min(recording.duration_s, decisions[-1]["stamp_s"])


def test_a_full_disk_ends_the_recording_and_not_the_flight_and_is_told_once(tmp_path):
    done = run(FILLED, tmp_path, 30_000)
    assert done.returncode == 0, done.stderr
    number, failure = done.stdout.split(" ", 1)
    assert number == "3000"
    assert "File too large" in failure
    assert done.stderr.count("recording stopped") <= 1
    assert len(read_messages(tmp_path / "flight.mcap", Counter())[channels.DECISION]) > 100
    assert len(load_recording(tmp_path / "flight.tlog").frames) > 100


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_disk_that_was_full_from_the_beginning():
    log = FlightLog(Path("/dev/full"), 0.0)
    with pytest.raises(RecordError, match="No space left"):
        log.write(channels.THREAT, 0.0, encoded(0.0, {"level": 0.5}))
    log.write(channels.THREAT, 1.0, encoded(1.0, {"level": 0.5}))
    log.close()


def test_wherever_the_file_is_cut_what_stands_before_is_read(flown, tmp_path):
    folder, _ = flown
    whole = (folder / "flight.mcap").read_bytes()
    stamps = []
    for length in range(0, len(whole), 2503):
        (tmp_path / "cut.mcap").write_bytes(whole[:length])
        found = read_messages(tmp_path / "cut.mcap", Counter())
        stamps.append(max((entry["stamp_s"] for entry in found.get(channels.OWNSHIP, ())), default=0.0))
    assert stamps == sorted(stamps)
    assert stamps[-1] > 55.0


@settings(max_examples=150)
@given(st.data())
def test_whatever_became_of_its_bytes_a_file_is_read(flown, tmp_path_factory, data):
    folder, _ = flown
    damaged = bytearray((folder / "flight.mcap").read_bytes())
    for _ in range(data.draw(st.integers(1, 40))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    file = tmp_path_factory.getbasetemp() / "damaged.mcap"
    file.write_bytes(damaged)
    read_messages(file, Counter())


def test_a_clock_that_is_set_back_does_not_stop_the_writing(tmp_path):
    log = FlightLog(tmp_path / "a.mcap", 1e9)
    log.write(channels.THREAT, 100.0, encoded(100.0, {"level": 0.1}))
    log.write(channels.THREAT, 10.0, encoded(10.0, {"level": 0.2}))
    found = read_messages(tmp_path / "a.mcap", Counter())[channels.THREAT]
    assert [entry["level"] for entry in found] == [0.1, 0.2]
    log.close()
    assert CHUNK_S <= 1.0


def test_what_waits_is_written_every_half_second_of_the_clock_and_not_at_each_message(tmp_path):
    # From 100 s to 102 s, eight messages a second: the first alone, then four times four.
    log = FlightLog(tmp_path / "a.mcap", 1e9)
    for eighth in range(17):
        log.write(channels.THREAT, 100.0 + eighth / 8, encoded(100.0 + eighth / 8, {"level": 0.1}))
    log.close()
    with (tmp_path / "a.mcap").open("rb") as file:
        statistics = make_reader(file).get_summary().statistics
    assert (statistics.message_count, statistics.chunk_count) == (17, 5)


def test_what_is_not_finite_is_null():
    assert plain({"a": math.inf, "b": [math.nan, 1.0], "c": Dialect.PX4, 3: (True, None)}) == {
        "a": None, "b": [None, 1.0], "c": "px4", "3": [True, None],
    }  # fmt: skip


def test_arrays_are_told_as_their_rows_one_by_one_would_be():
    values = np.array([[0.1 + 0.2, -1.0 / 3.0, 4706.892379012345], [1e-12, 123456.7890123456, -0.0]])
    assert (
        plain(values)
        == plain(values.tolist())
        == [[0.3, -0.333333333, 4706.892379012], [0.0, 123456.789012346, 0.0]]
    )
    assert plain(np.array([1.0, math.nan, -math.inf])) == [1.0, None, None]
    assert plain(np.array([3, -1])) == [3, -1]
    assert plain(np.array([[True], [False]])) == [[True], [False]]
    assert plain(np.empty((0, 3))) == []


def test_no_file():
    with pytest.raises(RecordError, match="No such file"):
        FlightLog(Path("/nowhere/a.mcap"), 0.0)
    with pytest.raises(RecordError, match="No such file"):
        read_messages(Path("/nowhere/a.mcap"), Counter())


def test_a_mission_without_a_file_is_written_anew(tmp_path):
    mission = load_mission(CONFIGS / "paper-2d.yaml")
    Recorder(tmp_path, 0.0, About(mission, 1)).close()
    assert load_mission(tmp_path / "mission.yaml") == mission
