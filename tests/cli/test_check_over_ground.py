"""``check`` of a mission over ground: heights over ground in words, as JSON, and in the picture."""

import json

import numpy as np
import pytest
from matplotlib.image import imread

from companion.config import load_mission
from companion.config.sections.terrain_map import posts_of
from sim.vehicle.true_ground import TrueGround
from tests.cli.calls import FIRST_FLIGHT
from tests.sim.client import CONFIGS

RIDGE = CONFIGS / "ridge.yaml"


def heights_by_the_simulator():
    """Heights over ground of the start and the goal of ``ridge``, and along the line between them."""
    mission = load_mission(RIDGE)
    ground = TrueGround(posts_of(mission))
    begin, end = (
        np.array([place.east_m, place.north_m, place.up_m], dtype=float)
        for place in (mission.start, mission.goals[0])
    )
    line = begin + np.linspace(0.0, 1.0, 20_001)[:, None] * (end - begin)
    over = line[:, 2] - ground.ups_m(line[:, 0], line[:, 1])
    return over, np.hypot(*(line - begin)[:, :2].T)


def test_each_place_and_the_straight_way_have_their_height_over_ground(companion):
    over, along = heights_by_the_simulator()
    told = json.loads(companion("check", RIDGE, "--json", "-").out)["ground"]
    assert told["start_over_ground_m"] == pytest.approx(over[0], abs=0.1)
    assert told["goals_over_ground_m"] == [pytest.approx(over[-1], abs=0.1)]
    assert over.min() < 0.0  # The straight way leads through the ridges.
    assert told["straight_way_over_ground_m"] == pytest.approx(over.min(), abs=0.5)
    assert told["straight_way_lowest_after_m"] == pytest.approx(along[np.argmin(over)], abs=10.0)


def test_the_table_says_so_in_words(companion):
    over, _ = heights_by_the_simulator()
    words = " ".join(companion("check", RIDGE).out.replace("│", " ").split())
    assert f"150 m up, 90°, {over[0]:.0f} m over ground" in words
    assert f"within 60 m, {over[-1]:.0f} m over ground" in words
    assert f"at cruise; lowest {over.min():.0f} m over ground, after " in words
    assert "over ground" not in companion("check", FIRST_FLIGHT).out


def test_the_straight_way_leads_over_all_goals(companion):
    """From 1,800 east, 2,500 north to 3,500, 700 are 2,476 m, and 1,500 m on to 3,500, 2,200."""
    words = " ".join(companion("check", CONFIGS / "leeward.yaml").out.replace("│", " ").split())
    assert "3976 m, 159 s at cruise" in words


def test_the_picture_has_the_ground_from_the_side(companion, tmp_path):
    flat, over_ground = tmp_path / "flat.png", tmp_path / "ground.png"
    assert companion("check", FIRST_FLIGHT, "--plot", flat).code == 0
    assert companion("check", RIDGE, "--plot", over_ground).code == 0
    pixels = imread(over_ground)[..., :3]
    side = pixels[int(0.75 * len(pixels)) :]
    brown = np.abs(side - np.array([0.78, 0.74, 0.68])).max(axis=2) < 0.06  # 45 % of the ground's colour.
    assert brown.mean() > 0.05
    below = imread(flat)[..., :3]
    below = below[int(0.75 * len(below)) :]
    assert (np.abs(below - np.array([0.78, 0.74, 0.68])).max(axis=2) < 0.06).mean() < 0.01
