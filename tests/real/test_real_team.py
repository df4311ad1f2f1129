"""Two real autopilots that share their plans: ``pytest -m real``, where ARDUPLANE or PX4 name a binary."""

import os
from pathlib import Path

import pytest

from tests.real.flights_pool import Binaries
from tests.real.rig.autopilots import KINDS
from tests.real.team_flights import TEAMS, flown_team, is_good


@pytest.mark.real
@pytest.mark.parametrize("how", ["plans", "goals"])
@pytest.mark.parametrize(("kind", "variable"), [("arduplane", "ARDUPLANE"), ("px4", "PX4")])
def test_two_come_through_a_gap_from_both_sides(kind, variable, how, tmp_path):
    binaries = Binaries.named(os.environ)
    if binaries.of(kind) is None:
        pytest.skip(f"{variable} names no binary of your own")
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
    folder = Path(os.environ.get("REAL_OUT", tmp_path)).resolve() / f"team-{kind}-{how}"
    row = flown_team(KINDS[kind], binaries, folder, 1 + 2 * worker, team=TEAMS[how])
    assert is_good(row), {name: value for name, value in row.items() if name != "paths"}
