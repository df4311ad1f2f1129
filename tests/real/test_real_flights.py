"""Each flight beside a real autopilot as a test: ``pytest -m real``, where ARDUPLANE or PX4 name a binary."""

import os
from pathlib import Path

import pytest

from tests.real.flights_pool import Binaries, Wanted, flown
from tests.real.scenarios import SCENARIOS

VARIABLE = {"arduplane": "ARDUPLANE", "px4": "PX4"}
SEEDS = range(1, 1 + int(os.environ.get("SEEDS", "1")))


@pytest.mark.real
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("scenario", [scenario.number for scenario in SCENARIOS])
@pytest.mark.parametrize("kind", VARIABLE)
def test_a_flight_is_as_it_should_be(kind, scenario, seed, tmp_path):
    binaries = Binaries.named(os.environ)
    if binaries.of(kind) is None:
        pytest.skip(f"{VARIABLE[kind]} names no binary of your own")
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
    folder = Path(os.environ.get("REAL_OUT", tmp_path)).resolve()
    row = flown(binaries, Wanted(kind, scenario, seed), folder, worker + 1)
    assert row["verdict"] == "ok", row
