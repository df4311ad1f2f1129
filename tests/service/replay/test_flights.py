"""Flights of every kind, replayed against themselves by the command; each prints its replay's speed."""

import json
import sys

import pytest

from companion.types.events import Dialect
from tests.cli.calls import Caller
from tests.support.recorded import recorded

pytestmark = pytest.mark.xdist_group("recorded flights")  # they share flights that are made once a process

TEN = [
    ("first-flight", 1, Dialect.ARDUPILOT),
    ("first-flight", 2, Dialect.ARDUPILOT),
    ("first-flight", 3, Dialect.PX4),
    ("first-flight", 4, Dialect.PX4),
    ("paper-2d", 5, Dialect.ARDUPILOT),
    ("paper-2d", 6, Dialect.ARDUPILOT),
    ("paper-2d", 7, Dialect.PX4),
    ("paper-3d", 8, Dialect.ARDUPILOT),
    ("paper-3d", 9, Dialect.ARDUPILOT),
    ("paper-3d", 10, Dialect.PX4),
]


@pytest.mark.slow  # ten whole flights, each flown and replayed
@pytest.mark.parametrize(("name", "seed", "dialect"), TEN)
def test_a_flight_replays_as_flown(name, seed, dialect, tmp_path, monkeypatch, capsys):
    folder, flight = recorded(name, seed, dialect)
    companion = Caller(monkeypatch, capsys)
    out = tmp_path / "out.json"
    done = companion(
        "replay", folder / "flight.tlog", folder / "mission.yaml", "--expect", folder, "--json", out
    )
    told = json.loads(out.read_text())
    with capsys.disabled():
        size = sum(file.stat().st_size for file in folder.iterdir()) / 1e6
        speed = told["duration_s"] / told["wall_s"]
        done_in = f"{told['duration_s']:.0f} s, {size:.1f} MB, flown in {flight.wall_s:.0f} s"
        text = f"{len(told['decisions'])} decisions, {len(told['missions'])} missions"
        sys.stderr.write(f"\n{name} {seed} {dialect.value}: {done_in}; {text}; {speed:.0f} x real time\n")
    assert done.code == 0, done.out + done.err
    assert told["equal"] is True
    assert told["decisions"] == told["flown_decisions"]
    assert len(told["missions"]) >= 1


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed", "dialect"), [TEN[2], TEN[4], TEN[8]])
def test_a_changed_threshold_is_told_by_the_first_decision(
    name, seed, dialect, tmp_path, monkeypatch, capsys
):
    folder, _ = recorded(name, seed, dialect)
    lines = (folder / "mission.yaml").read_text().splitlines()
    lines = [line for line in lines if "swap_gain" not in line]
    lines.insert(
        lines.index(next(line for line in lines if line.startswith("planning:"))) + 1, "  swap_gain: 0.0"
    )
    (tmp_path / "changed.yaml").write_text("\n".join(lines))
    companion = Caller(monkeypatch, capsys)
    done = companion("replay", folder / "flight.tlog", tmp_path / "changed.yaml", "--expect", folder)
    assert done.code == 1, done.out + done.err
    assert "first difference at " in done.out
    assert "flown '" in done.out
