"""A goal without room for a circle is flown to all the same; beside the same flight by what was before."""

import numpy as np
import pytest

from companion.config import mission_from_text
from companion.flight.construction import mission_construction
from companion.types.events import Dialect
from companion.types.path import Path, run_on
from sim.bench.reaction import MISSION
from tests.support.sitl_harness import SitlHarness

# Walls either side of the way to the goal, 220 m apart, and 50 m on: no circle of 125 m has room between.
WALL = """  - name: {}
    polygon_enu_m: [[900, {}], [1550, {}], [1550, {}], [900, {}]]
    base_m: 0
    top_m: 300
"""
WALLS = WALL.format("left", 110, 110, 160, 160) + WALL.format("right", -160, -160, -110, -110)
LANE = MISSION.replace("{east_m: 4000, north_m: 0", "{east_m: 1500, north_m: 0").replace(
    "planning: {", "planning: {max_iterations: 12000, "
)
TEXT = LANE + "obstacles:\n" + WALLS


# 350 m apart, until 700 m behind the goal: a circle has room, but none that touches the lane's middle.
STREET = WALL.format("left", 175, 175, 1000, 1000) + WALL.format("right", -1000, -1000, -175, -175)
STREET = LANE + "obstacles:\n" + STREET.replace("1550", "2200")


def flown(text=TEXT):
    """The flight of an ArduPlane without items behind the goal, and whether that was passed."""
    harness = SitlHarness(mission_from_text(text, "lane.yaml"), dialect=Dialect.ARDUPILOT)
    harness.fly(90.0)
    away = np.hypot(*(np.array(harness.simulator.truth.path)[:, 1:3] - (1500.0, 0.0)).T)
    return harness, bool((away <= 60.0).any())


def test_it_flies_on_beyond_the_goal_to_where_there_is_room():
    harness, is_there = flown()
    assert is_there
    assert not harness.simulator.truth.collision
    assert "arrived" in [entry.kind for entry in harness.recorder.decisions]
    assert [entry.text for entry in harness.recorder.decisions if entry.kind == "emergency"] == []


def test_else_it_has_no_mission_that_leads_to_the_goal(monkeypatch):
    monkeypatch.setattr(mission_construction, "RUN_ON_M", 0.0)
    harness, is_there = flown()
    rejected = [entry.text for entry in harness.recorder.decisions if entry.kind == "rejected"]
    assert any("mission" in text and "no circle" in text for text in rejected)
    assert not is_there


@pytest.mark.parametrize("is_tried", [True, False])
def test_in_a_street_a_mission_ends_in_a_circle_round_its_path(is_tried, monkeypatch):
    """Beside it the same flight with circles that touch the path alone: nothing leads to the goal."""
    if not is_tried:
        monkeypatch.setattr(mission_construction, "ROUND_PATH", ())
    harness, is_there = flown(STREET)
    assert is_there is is_tried
    assert not harness.simulator.truth.collision
    rejected = [entry.text for entry in harness.recorder.decisions if entry.kind == "rejected"]
    assert any("no circle" in text for text in rejected) is not is_tried


@pytest.mark.parametrize("wind", [(0.0, 0.0), (5.0, -3.0)])
def test_a_path_that_runs_on_goes_straight_by_the_clock(wind):
    ones = np.ones(3)
    path = Path(
        times_s=np.array([0.0, 1.0, 2.0]),
        positions_enu_m=np.array([[0.0, 0.0, 100.0], [0.0, 25.0, 100.0], [0.0, 50.0, 100.0]]),
        courses_rad=0.0 * ones,
        climb_angles_rad=0.0 * ones,
        speeds_m_s=25.0 * ones,
        position_covariances_m2=np.repeat(np.eye(3)[None], 3, axis=0),
        collision_free=ones,
        threat_levels=0.1 * ones,
        wind_enu_m_s=wind,
    )
    longer = run_on(path, 100.0)
    assert longer.positions_enu_m[-1] == pytest.approx([0.0, 150.0, 100.0])
    made_good = wind[1] + np.sqrt(25.0**2 - wind[0] ** 2)  # north, wind from the side taken off
    assert longer.times_s[-1] - 2.0 == pytest.approx(100.0 / made_good)
    assert len(longer) == 7
