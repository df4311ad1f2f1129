"""Recordings that somebody made to fill the memory, or to end the program that reads them."""

import json
import os
import shutil
import struct
import subprocess
import sys
import zlib
from collections import Counter
from pathlib import Path

import lz4.frame
import pytest
import zstandard

from companion.link.wire.tlog import read_tlog
from companion.recording import mcap_reader
from companion.recording.mcap_reader import messages_of, number
from companion.recording.reader import load_recording
from companion.service.replay.flight_summary import flight_of
from tests.cli.calls import in_a_process
from tests.link.pymavlink_frames import heartbeat, position
from tests.sim.client import CONFIGS

ROOT = Path(__file__).parents[2]
MISSION = (CONFIGS / "first-flight.yaml").read_text(encoding="utf-8")
MAGIC = b"\x89MCAP0\r\n"
TOPICS = ("/mission", "/ownship", "/threat", "/plan", "/swap", "/decision", "/tracks", "/snapshot")
MEGABYTE = 2**20
ABOUT = {"name": "a", "mission_file": MISSION, "seed": 1, "epoch_s": 1e9, "clock": "wall", "stamp_s": 0.0}


def record(kind, content, length=None):
    return struct.pack("<BQ", kind, len(content) if length is None else length) + content


def text(words):
    return struct.pack("<I", len(words)) + words.encode()


def message(topic, data):
    return record(5, struct.pack("<HIQQ", TOPICS.index(topic), 0, 0, 0) + data)


def channels():
    return b"".join(
        record(4, struct.pack("<HH", number, 0) + text(topic) + text("json") + struct.pack("<I", 0))
        for number, topic in enumerate(TOPICS)
    )


def chunk(data, compression="", claimed=None, packed=None, checksum=0):
    pack = {"": bytes, "zstd": zstandard.compress, "lz4": lz4.frame.compress}[compression]
    packed = pack(data) if packed is None else packed
    claims = struct.pack("<QQQI", 0, 0, len(data) if claimed is None else claimed, checksum)
    return record(6, claims + text(compression) + struct.pack("<Q", len(packed)) + packed)


def mcap(*records):
    return MAGIC + channels() + b"".join(records) + record(2, bytes(20)) + MAGIC


def flight(folder, *records, tlog=True, mission=True):
    """A folder with a recording made by hand."""
    folder.mkdir(exist_ok=True)
    told = [message("/mission", json.dumps(ABOUT).encode())] if mission else []
    (folder / "flight.mcap").write_bytes(mcap(*told, *records))
    (folder / "mission.yaml").write_text(MISSION)
    if tlog:
        stamped = ((1e9 + n, frame) for n in range(3) for frame in (heartbeat(), position(1_000 * n)))
        (folder / "flight.tlog").write_bytes(
            b"".join(round(1e6 * stamp).to_bytes(8, "big") + frame for stamp, frame in stamped)
        )
    return folder


def ownship(**changes):
    row = {
        "stamp_s": 1.0, "position_enu_m": [150.0, 750.0, 100.0], "course_rad": 0.0,
        "flight_path_angle_rad": 0.0, "airspeed_m_s": 25.0,
    } | changes  # fmt: skip
    return json.dumps(row).encode()


MEASURED = """
import resource, sys
from pathlib import Path
from companion.errors import CompanionError
from companion.recording.reader import load_recording
from companion.service.replay.flight_summary import flight_of
taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
room = taken + int(sys.argv[2]) * 2**20
resource.setrlimit(resource.RLIMIT_AS, (room, room))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for read in (flight_of, lambda folder: load_recording(folder / "flight.tlog")):
    try:
        read(Path(sys.argv[1]))
    except CompanionError as error:
        sys.stderr.write(f"{error}\\n")
sys.stdout.write(str((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024))
"""


def megabytes_to_read(folder, room_mb):
    """Memory that reading a flight's folder takes, with so much to be had."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, str(folder), str(room_mb)],
        cwd=ROOT, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


def zeros(size):
    """A small zstd frame of that many bytes."""
    packer = zstandard.ZstdCompressor(level=1).compressobj()
    return b"".join(packer.compress(bytes(MEGABYTE)) for _ in range(size // MEGABYTE)) + packer.flush()


EMPTY = message("/ownship", b"{}")
BOMBS = {
    "chunks of empty messages": lambda: [chunk(EMPTY * 450_000, "zstd")] * 3,
    "a chunk of two gigabytes": lambda: [chunk(b"", "zstd", claimed=1_000, packed=zeros(2048 * MEGABYTE))],
    "a chunk that claims to be small": lambda: [chunk(b"", "zstd", 10, zeros(1024 * MEGABYTE))] * 3,
    "lz4": lambda: [chunk(bytes(256 * MEGABYTE), "lz4", claimed=10)] * 3,
    "lz4 of empty messages": lambda: [chunk(EMPTY * 200_000, "lz4")],
    "lists of lists": lambda: [chunk(message("/ownship", b'{"a":[' + b"[]," * 2_500_000 + b"[]]}"), "zstd")],
    "numbers": lambda: [
        chunk(message("/ownship", b'{"position_enu_m":[' + b"1," * 3_000_000 + b"1]}"), "zstd")
    ],
    "tracks": lambda: [
        chunk(message("/tracks", b'{"tracks":[' + b"{}," * 100_000 + b"{}]}") * 20, "zstd")
    ] * 2,
    "waypoints": lambda: [
        chunk(message("/swap", b'{"outcome":"flown","waypoints_enu_m":[' + b"[]," * 200_000 + b"[]]}") * 10,
              "zstd")
    ] * 2,
    "mission files": lambda: [
        chunk(message("/mission", b'{"mission_file":"' + b"#" * 7_000_000 + b'"}') * 2, "zstd")
    ] * 60,
}  # fmt: skip


# So many messages that reading ends at the limit take 10 s; of a fifth the lz4 one is in every run.
LONG = "chunks of empty messages"


@pytest.mark.parametrize(
    "bomb", [pytest.param(BOMBS[name], id=name, marks=[pytest.mark.slow] * (name == LONG)) for name in BOMBS]
)
@pytest.mark.thorough
def test_a_small_file_does_not_fill_the_memory(tmp_path, bomb):
    """A file of 197 kB took 6.3 GiB."""
    folder = flight(tmp_path / "flight", *bomb())
    assert (folder / "flight.mcap").stat().st_size < 4 * MEGABYTE
    assert megabytes_to_read(folder, 700) < 500


GOOD = message("/threat", b'{"level": 0.125}')


def test_what_is_left_out_is_counted(tmp_path, monkeypatch):
    folder = flight(
        tmp_path / "flight",
        chunk(message("/threat", b'{"level": 0.5}'), "zstd", claimed=2**62),
        chunk(message("/threat", b'{"level": 0.25}'), "lz4", claimed=0),
        chunk(bytes(17 * MEGABYTE), "zstd"),
        chunk(b"x"),
        chunk(b"", "zstd", packed=b"no frame"),
        chunk(message("/threat", b"{}"), checksum=1),
        chunk(GOOD, checksum=zlib.crc32(GOOD)),
        message("/threat", b'{"level": Infinity}'),
        message("/threat", b"[" * 100_000),
        message("/threat", b'{"level": ' + b"9" * 5_000 + b"}"),
        message("/threat", b'{"level": 1e999}'),
    )  # fmt: skip
    counters = Counter()
    found = [
        document for topic, document in messages_of(folder / "flight.mcap", counters) if topic == "/threat"
    ]
    assert [number(document["level"]) for document in found] == [0.5, 0.25, 0.125, None]
    assert counters == {"damaged_chunks": 4, "damaged_messages": 3}
    monkeypatch.setattr(mcap_reader, "MESSAGES_MAX", 5 + len(TOPICS))
    counters.clear()
    assert len(list(messages_of(folder / "flight.mcap", counters))) == 4
    assert counters["mcap_too_large"] == 1


def test_numbers_of_documents():
    assert [number(value) for value in (1, 2.5, -3)] == [1.0, 2.5, -3.0]
    wrong = (True, None, "1", float("nan"), float("inf"), 10**400, -(10**400), 1e16)
    assert [number(value) for value in wrong] == [None] * len(wrong)


DEEP = b"[" * 900 + b"]" * 900
STRANGE = [
    b"null", b"true", b"-1", b"1e308", b"-1e308", b"1e999", b"9" * 400, b'"\\ud800\\u001b[2J\\u202e"', b"[]",
    b"{}", b"[[[1]]]", b'[{"a": 1}]', b'[1, null, "x"]', DEEP, b"NaN", b"Infinity", b"\xff", b"0.0001",
]  # fmt: skip
KEYS = {
    "/mission": (
        "name", "mission_file", "seed", "epoch_s", "clock", "step_s", "versions", "remembered", "stamp_s",
    ),
    "/ownship": ("stamp_s", "position_enu_m", "course_rad", "flight_path_angle_rad", "airspeed_m_s"),
    "/threat": ("stamp_s", "level"),
    "/plan": ("stamp_s", "number", "asked", "is_stopped", "took_s", "due_s", "seen_s", "plan_ms"),
    "/swap": ("outcome", "reason", "ended_s", "waypoints_enu_m"),
    "/decision": ("stamp_s", "kind", "text", "why", "plan_ms", "track_to_mission_ms"),
    "/tracks": ("stamp_s", "tracks"),
    "/snapshot": ("number", "obstacles", "tracks"),
}  # fmt: skip


def changed(document, key, value):
    """JSON of a document with another value, which need not be JSON."""
    others = {name: told for name, told in document.items() if name != key} | {"other": 0}
    return b'{"%s": %s, %s' % (key.encode(), value, json.dumps(others)[1:].encode())


def strange_messages(topic):
    """A good message and one for each key and each strange value of it."""
    good = {
        "/mission": {"mission_file": MISSION, "stamp_s": 0.0},
        "/ownship": json.loads(ownship()),
        "/swap": {"outcome": "flown", "waypoints_enu_m": [[1.0, 2.0, 3.0]], "reason": "", "ended_s": 1.0},
        "/tracks": {"stamp_s": 1.0, "tracks": [{"identity": "a", "position_enu_m": [1.0, 2.0, 3.0]}]},
        "/decision": {"stamp_s": 1.0, "kind": "swap", "text": "x", "why": {"cost": 1.0, "notes": ["a"]}},
    }.get(topic, {"stamp_s": 1.0})
    for key in KEYS[topic]:
        for value in STRANGE:
            rest = json.dumps({name: told for name, told in good.items() if name != key})[1:].encode()
            yield message(
                topic, b'{"%s": %s%s%s' % (key.encode(), value, b", " if rest != b"}" else b"", rest)
            )


@pytest.mark.parametrize("topic", KEYS)
def test_strange_values_neither_end_a_report_nor_a_replay(tmp_path, topic):
    records = [message("/ownship", ownship(stamp_s=stamp)) for stamp in (0.0, 1.0, 2.0)]
    folder = flight(tmp_path / "flight", *records, *strange_messages(topic), mission=topic != "/mission")
    mission, _, flown = flight_of(folder)
    assert mission.name == "first-flight"
    assert len(flown.flown) >= 3
    recording = load_recording(folder / "flight.tlog")
    assert len(recording.frames) == 6
    assert recording.counters["damaged_messages"] >= 3


@pytest.mark.parametrize("key", KEYS["/mission"])
def test_a_recording_that_says_strange_things_of_itself(tmp_path, key):
    for index, value in enumerate(STRANGE):
        about = {
            "name": "a",
            "mission_file": MISSION,
            "seed": 1,
            "epoch_s": 1e9,
            "clock": "wall",
            "stamp_s": 0.0,
        }
        about.pop(key, None)
        told = b'{"%s": %s, %s' % (key.encode(), value, json.dumps(about)[1:].encode())
        folder = flight(tmp_path / str(index), message("/mission", told), mission=False)
        assert len(load_recording(folder / "flight.tlog").frames) == 6


@pytest.mark.thorough
def test_report_and_replay_of_what_is_strange_end_with_an_exit_code_and_no_trace(tmp_path):
    records = [message("/ownship", ownship(stamp_s=stamp)) for stamp in (0.0, 1.0, 2.0)]
    strange = [entry for topic in KEYS for entry in strange_messages(topic)]
    folder = flight(tmp_path / "flight", *records, *strange)
    done = in_a_process("report", folder)
    assert (done.code, "Traceback" in done.err) == (0, False), done.err[-3_000:]
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "damaged messages" in page
    assert not {"\x1b", "\u202e"} & set(page)
    mission = folder / "mission.yaml"
    done = in_a_process("replay", folder / "flight.tlog", mission, "--json", tmp_path / "told.json")
    assert (done.code, "Traceback" in done.err) == (0, False), done.err[-3_000:]
    assert "\x1b" not in done.out + done.err


def test_a_recording_without_a_mission_that_can_be_read_is_named(tmp_path, companion_command):
    folder = flight(tmp_path / "flight", message("/mission", b'{"mission_file": "a: *b"}'), mission=False)
    done = companion_command("report", folder)
    assert done.code == 2
    assert "flight.mcap" in done.err


@pytest.mark.parametrize("name", ["flight.mcap", "flight.tlog"])
@pytest.mark.thorough
def test_a_pipe_in_the_place_of_a_recording_is_refused(tmp_path, name):
    folder = flight(tmp_path / "flight")
    (folder / name).unlink()
    os.mkfifo(folder / name)
    done = in_a_process("report" if name == "flight.mcap" else "replay", *(
        [folder] if name == "flight.mcap" else [folder / name, folder / "mission.yaml"]
    ), timeout_s=60)  # fmt: skip
    assert done.code == 2
    assert "ot a plain file" in done.err


# --- telemetry logs


def stamped(frame, number):
    return (1_000_000_000_000_000 + number).to_bytes(8, "big") + frame


NOISE = {
    "nothing but beginnings": lambda size: (bytes(8) + b"\xfd\xff\x00") * (size // 11),
    "nothing but old beginnings": lambda size: b"\xfe" * size,
    "zeros": bytes,
    "the shortest frames": lambda size: (bytes(8) + b"\xfe\x00\x00\x01\x01\xff\x00\x00") * (size // 16),
}


@pytest.mark.parametrize("noise", NOISE.values(), ids=NOISE)
@pytest.mark.thorough
def test_a_telemetry_log_of_any_content_is_read_once_and_in_little_memory(tmp_path, noise):
    """Counted in places looked at, since a test asks for no time."""
    file = tmp_path / "a.tlog"
    file.write_bytes(noise(MEGABYTE))
    counters, num_entries = Counter(), 0
    for _ in read_tlog(file, counters):
        num_entries += 1
    assert 16 * num_entries + counters["skipped_bytes"] <= MEGABYTE
    folder = flight(tmp_path / "flight", mission=False, tlog=False)
    shutil.copy(file, folder / "flight.tlog")
    assert megabytes_to_read(folder, 700) < 60


def test_frames_beyond_the_longest_flight_are_left_out_and_told(tmp_path, monkeypatch):
    monkeypatch.setattr("companion.recording.reader.FRAMES_MAX", 100)
    file = tmp_path / "a.tlog"
    file.write_bytes(b"".join(stamped(heartbeat(), 1_000 * n) for n in range(101)))
    recording = load_recording(file)
    assert len(recording.frames) == 100
    assert recording.counters["tlog_too_large"] == 1
