"""A planner that tells of no threat at all, in flight: the check counts for itself."""

from dataclasses import replace

import numpy as np
import pytest

from companion.assurance.exposure import Exposure
from companion.config import mission_from_text
from companion.planning import solver
from tests.flight.replanning.test_surprise import LONG
from tests.flight.test_geofences import BOTH
from tests.support.sitl_harness import SitlHarness

MISSION = mission_from_text(
    LONG.replace("threat_level_max: 0.3", "threat_level_max: 0.2")
    + "radars: [{name: r, east_m: 1200, north_m: 60, up_m: 100, max_threat_radius_m: 500}]\n",
    "radar.yaml",
)


@pytest.fixture
def blind_planner(monkeypatch):
    """It sees no radar, and reports nothing."""
    solve, made = solver.Exploration, solver.path_from_route

    def searching(problem, generator):
        threats = problem.snapshot.threats
        radars = threats.radars * (1.0, 1.0, 1.0, 1e-9, 1.0)  # of no reach
        return solve(
            replace(problem, snapshot=replace(problem.snapshot, threats=threats._replace(radars=radars))),
            generator,
        )

    def telling_nothing(*arguments):
        path = made(*arguments)
        return replace(path, threat_levels=np.zeros(len(path)))

    monkeypatch.setattr(solver, "Exploration", searching)
    monkeypatch.setattr(solver, "path_from_route", telling_nothing)


def flown(dialect):
    harness = SitlHarness(MISSION, dialect=dialect)
    harness.fly(20.0)
    return [(entry.kind, entry.text) for entry in harness.recorder.decisions]


@BOTH
def test_a_path_through_a_radar_is_refused_whatever_the_planner_says_of_it(
    dialect, blind_planner, monkeypatch
):
    told = flown(dialect)
    assert any(kind == "rejected" and "by the check's own count" in text for kind, text in told)
    swaps = [text for kind, text in told if kind == "swap"]
    assert all(text.startswith("emergency") for text in swaps)  # told as what it is, and to the pilot
    monkeypatch.setattr(Exposure, "levels", lambda self, path, picture: np.zeros(len(path)))
    believing = flown(dialect)
    assert any(kind == "swap" and text.startswith("first plan") for kind, text in believing)
