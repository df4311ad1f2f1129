"""Telemetry logs that were cut off, damaged, or could not be written."""

import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.errors import RecordError
from companion.link.wire.tlog import Entry, TlogWriter, read_tlog
from tests.link.pymavlink_frames import adsb, heartbeat, position

FRAMES = [heartbeat(), position(), adsb(), position(2_000)]
START_S = 1_795_228_291.25


def write(path, frames=FRAMES):
    writer = TlogWriter(path)
    for index, frame in enumerate(frames):
        writer.write(START_S + index, frame)
    writer.close()


def test_what_is_written_is_read(tmp_path):
    write(tmp_path / "a.tlog")
    assert list(read_tlog(tmp_path / "a.tlog")) == [
        Entry(START_S + index, frame) for index, frame in enumerate(FRAMES)
    ]


def test_the_layout(tmp_path):
    write(tmp_path / "a.tlog", FRAMES[:1])
    assert (tmp_path / "a.tlog").read_bytes() == round(START_S * 1e6).to_bytes(8, "big") + FRAMES[0]


def test_a_log_is_continued(tmp_path):
    write(tmp_path / "a.tlog")
    write(tmp_path / "a.tlog")
    assert len(list(read_tlog(tmp_path / "a.tlog"))) == 8


def test_a_killed_process_loses_less_than_a_second(tmp_path):
    path = tmp_path / "a.tlog"
    code = (
        "import os, signal, sys\n"
        "from companion.link.wire.tlog import TlogWriter\n"
        "writer = TlogWriter(sys.argv[1])\n"
        "for tick in range(100):\n"
        "    writer.write(1e9 + 0.1 * tick, bytes.fromhex(sys.argv[2]))\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    root = Path(__file__).parents[3]
    killed = subprocess.run(
        [sys.executable, "-c", code, str(path), FRAMES[0].hex()], cwd=root, check=False, timeout=60
    )
    assert killed.returncode == -9
    assert list(read_tlog(path))[-1].time_s > 1e9 + 9.9 - 1.0


def test_a_clock_that_is_set_back_does_not_stop_the_flushing(tmp_path):
    writer = TlogWriter(tmp_path / "a.tlog")
    writer.write(START_S, FRAMES[0])
    writer.write(START_S - 3_600.0, FRAMES[1])
    assert len(list(read_tlog(tmp_path / "a.tlog"))) == 2
    writer.close()


def test_what_comes_after_the_end_is_left_out(tmp_path):
    writer = TlogWriter(tmp_path / "a.tlog")
    writer.write(START_S, FRAMES[0])
    writer.write(START_S + 0.1, FRAMES[1])
    writer.close()
    assert len(list(read_tlog(tmp_path / "a.tlog"))) == 2
    writer.close()
    writer.write(START_S, FRAMES[0])
    assert len(list(read_tlog(tmp_path / "a.tlog"))) == 2


def test_a_cut_log_is_read_to_the_cut(tmp_path):
    path = tmp_path / "a.tlog"
    write(path)
    whole = path.read_bytes()
    last = len(whole) - len(FRAMES[3]) - 8
    for length in range(last, len(whole)):
        path.write_bytes(whole[:length])
        tally = Counter()
        assert [entry.raw for entry in read_tlog(path, tally)] == FRAMES[:3]
        assert tally["skipped_bytes"] == length - last


def test_damage_costs_no_more_than_the_entries_it_hits(tmp_path):
    path = tmp_path / "a.tlog"
    write(path)
    whole = bytearray(path.read_bytes())
    start = 8 + len(FRAMES[0])
    whole[start : start + 20] = b"\xff" * 20
    path.write_bytes(whole)
    assert [entry.raw for entry in read_tlog(path)] == [FRAMES[0], *FRAMES[2:]]


@settings(deadline=None)
@given(st.binary(max_size=2_000))
def test_noise_is_no_log(tmp_path_factory, noise):
    path = tmp_path_factory.getbasetemp() / "noise.tlog"
    path.write_bytes(noise)
    list(read_tlog(path))


def test_large_logs_are_read_in_portions(tmp_path):
    path = tmp_path / "a.tlog"
    write(path, FRAMES * 1_000)
    assert path.stat().st_size > 2 * 65_536
    assert [entry.raw for entry in read_tlog(path)] == FRAMES * 1_000


def test_no_log():
    with pytest.raises(RecordError, match="No such file"):
        list(read_tlog("/nowhere/a.tlog"))
    with pytest.raises(RecordError, match="No such file"):
        TlogWriter("/nowhere/a.tlog")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_full_disk_is_told_once():
    writer = TlogWriter("/dev/full")
    with pytest.raises(RecordError, match="No space left"):
        writer.write(START_S, FRAMES[0])
    writer.write(START_S, FRAMES[0])
    writer.close()
    writer = TlogWriter("/dev/full")
    writer._flushed_s = START_S
    writer.write(START_S, FRAMES[0])
    with pytest.raises(RecordError, match="No space left"):
        writer.close()
