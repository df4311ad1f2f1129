"""Small recordings, and what a replay of each gives, as text to be read in a diff.

A change of the planner, the checker or the link shows here as another decision or mission. Where it is
meant, ``pytest tests/replay --update-refs`` renews the texts; where not, the first line that differs names
the decision it changed. ``python -m tests.replay.renew`` flies and records the simulated ones anew, for
changes after which nothing of the old flights fits.
"""

import asyncio
import difflib

import pytest

from companion.config import load_mission
from companion.daemon.comparison import lines_of
from companion.daemon.recording import load_recording
from companion.daemon.replay import Replay
from tests.replay.corruptions import DATA, RECORDINGS, mission_for
from tests.replay.renew import FLIGHTS, FOLDER


def cases():
    for name in FLIGHTS:
        yield name, FOLDER / f"{name}.tlog", None
    for name in RECORDINGS:
        yield name.removesuffix(".tlog"), DATA / name, name


@pytest.mark.parametrize(("name", "log", "foreign"), list(cases()), ids=[case[0] for case in cases()])
def test_replays_as_before(name, log, foreign, request):
    mission = mission_for(foreign) if foreign else load_mission(FOLDER / f"{name}.yaml")
    result = asyncio.run(Replay(load_recording(log), mission).run())
    lines = [f"said as in flight until {result.apart_s:.2f} s" if result.apart else "said as in flight"]
    lines += lines_of(result.decisions, result.uploads)
    reference = FOLDER / f"{name}.txt"
    if request.config.getoption("--update-refs", default=False):
        reference.write_text("\n".join(lines) + "\n", encoding="utf-8")
    expected = reference.read_text(encoding="utf-8").splitlines()
    told = "\n".join(difflib.unified_diff(expected, lines, "reference", "now", lineterm="", n=2))
    assert lines == expected, f"\n{told}"


def test_the_recordings_are_small():
    for file in FOLDER.iterdir():
        assert file.stat().st_size < 300_000, file.name
