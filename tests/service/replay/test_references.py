"""Small recordings, and what a replay of each gives, as text to be read in a diff.

A change of the planner, the checker or the link shows here as another decision or mission. Where it is
meant, ``pytest tests/service/replay --update-refs`` renews the texts; where not, the first line that
differs names the decision it changed. ``python -m tests.service.replay.renew`` flies and records the
simulated ones anew, for changes after which nothing of the old flights fits.
"""

import asyncio
import difflib
import threading

import pytest

from companion.config import load_mission
from companion.link.missions import mavsdk_reader
from companion.link.wire.tlog import read_tlog
from companion.recording.reader import load_recording
from companion.service.replay.comparison import item_line
from companion.service.replay.engine import Replay
from tests.service.replay.corruptions import DATA, RECORDINGS
from tests.service.replay.renew import FLIGHTS, FOLDER

# Of the recordings of others a part, as of a service that is started in mid-flight: with the upload that
# is broken off, its repair and the replacement; and with the two replacements on PX4.
PARTS_S = {"arduplane-4.7dev-replace": (64.0, 92.0), "px4-1.17dev-replace": (88.0, 110.0)}


def part_of(name, file):
    """The part of a recording between two instants, as a log of its own."""
    entries = list(read_tlog(DATA / f"{name}.tlog"))
    first, last = (entries[0].time_s + edge for edge in PARTS_S[name])
    file.write_bytes(
        b"".join(
            round(1e6 * entry.time_s).to_bytes(8, "big") + entry.raw
            for entry in entries
            if first <= entry.time_s <= last
        )
    )
    return file


def lines_of(decisions, uploads):
    """Decisions and missions as text, for people and for references."""
    lines = [f"{entry.stamp_s:9.2f} s  {entry.kind}: {entry.text}" for entry in decisions]
    for number, upload in enumerate(uploads, 1):
        lines += ["", f"mission {number}, sent by {upload.stamp_s:.2f} s, {len(upload.items)} items"]
        lines += [f"  {item_line(item)}" for item in upload.items]
    return lines


# Of the service beside real autopilots, from power-on to landing: see tests/data/README.md.
REAL = ("real-arduplane", "real-px4")


@pytest.mark.parametrize("name", [*FLIGHTS, *REAL, *PARTS_S])
def test_replays_as_before(name, request, tmp_path):
    is_ours = name not in PARTS_S
    log = FOLDER / f"{name}.tlog" if is_ours else part_of(name, tmp_path / "part.tlog")
    mission = load_mission(FOLDER / f"{name}.yaml" if is_ours else DATA / RECORDINGS[f"{name}.tlog"])
    result = asyncio.run(Replay(load_recording(log), mission).run())
    lines = [f"said as in flight until {result.diverged_s:.2f} s" if result.apart else "said as in flight"]
    lines += lines_of(result.decisions, result.uploads)
    reference = FOLDER / f"{name}.txt"
    if request.config.getoption("--update-refs", default=False):
        reference.write_text("\n".join(lines) + "\n", encoding="utf-8")
    expected = reference.read_text(encoding="utf-8").splitlines()
    told = "\n".join(difflib.unified_diff(expected, lines, "reference", "now", lineterm="", n=2))
    assert lines == expected, f"\n{told}"


@pytest.mark.thorough
def test_slow_threads_of_mavsdk_change_nothing(request, tmp_path, monkeypatch):
    delays_s = [0.6, 0.6, 0.6]
    call_in_loop = mavsdk_reader._call_in_loop

    def call_late(loop, function, *values):
        if delays_s:
            threading.Event().wait(delays_s.pop())  # It delays MAVSDK's thread, as a busy computer does.
        call_in_loop(loop, function, *values)

    monkeypatch.setattr(mavsdk_reader, "_call_in_loop", call_late)
    test_replays_as_before("real-arduplane", request, tmp_path)
    assert not delays_s


def test_the_recordings_are_small():
    for file in FOLDER.iterdir():
        assert file.stat().st_size < 300_000, file.name
