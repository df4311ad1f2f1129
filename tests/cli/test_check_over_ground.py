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


RELATIVE, TERRAIN, AMSL, HOME_AMSL_M, OUTSIDE_M = 3, 10, 0, 590.0, -50.0
# Command, frame, east, north, altitude; a take-off, legs over and into ridges, two over terrain, a landing.
OPERATOR = (
    (22, RELATIVE, 250, 1700, 60), (16, RELATIVE, 500, 1700, 160), (16, RELATIVE, 1500, 1750, 300),
    (16, TERRAIN, 2500, 1800, 80), (16, TERRAIN, 3400, 1800, 100), (177, 2, 0, 0, 1e6),
    (16, AMSL, 4500, 1800, 834), (21, RELATIVE, 4700, 1800, 0),
)  # fmt: skip


def operators_items(items=OPERATOR):
    """Rows as a ground station knows them: command, frame, latitude, longitude, altitude."""
    frame = load_mission(RIDGE).frame
    for command, item_frame, east, north, altitude in items:
        latitude, longitude, _ = frame.global_from_local(east, north, 0.0)
        yield command, item_frame, *((latitude, longitude) if east or north else (0.0, 0.0)), altitude


def waypoint_file(path, items=OPERATOR):
    lines = ["QGC WPL 110", f"0\t1\t0\t16\t0\t0\t0\t0\t-35.363\t149.165\t{HOME_AMSL_M}\t1"]
    for number, (command, frame, latitude, longitude, altitude) in enumerate(operators_items(items), 1):
        numbers = (number, 0, frame, command, 0, 0, 0, 0, f"{latitude:.8f}", f"{longitude:.8f}", altitude, 1)
        lines.append("\t".join(map(str, numbers)))
    path.write_text("\n".join(lines))
    return path


def plan_file(path, home_m=HOME_AMSL_M):
    items = [
        {"type": "SimpleItem", "command": row[0], "frame": row[1], "params": [0, 0, 0, None, *row[2:]]}
        for row in operators_items()
    ]
    mission = {"version": 2, "plannedHomePosition": [-35.363, 149.165, home_m], "items": items}
    path.write_text(json.dumps({"fileType": "Plan", "version": 1, "mission": mission}))
    return path


def ups_by_the_simulator():
    """Heights of items 1 to 7 and of the ground there; least heights over ground of the straight legs."""
    mission = load_mission(RIDGE)
    ground = TrueGround(posts_of(mission))
    placed = [item for item in OPERATOR if item[2]]
    below = ground.ups_m(*np.array([item[2:4] for item in placed], dtype=float).T)
    datum = {RELATIVE: HOME_AMSL_M - mission.frame.altitude_amsl_m, AMSL: -mission.frame.altitude_amsl_m}
    ups = [item[4] + datum.get(item[1], up) for item, up in zip(placed, below, strict=True)]
    legs = []
    for number in range(1, len(placed)):
        ends = np.array([(*placed[n][2:4], ups[n]) for n in (number - 1, number)], dtype=float)
        line = ends[0] + np.linspace(0.0, 1.0, 20_001)[:, None] * (ends[1] - ends[0])
        legs.append(float((line[:, 2] - ground.ups_m(line[:, 0], line[:, 1])).min()))
    return np.array(ups) - below, legs


@pytest.mark.parametrize(("file", "name"), [(waypoint_file, "a.waypoints"), (plan_file, "a.plan")])
def test_items_of_an_operator_have_their_heights_over_ground(companion, tmp_path, file, name):
    over, legs = ups_by_the_simulator()
    told = companion("check", RIDGE, "--items", file(tmp_path / name), "--json", "-")
    rows = json.loads(told.out)["items_over_ground"]
    assert [row["over_ground_m"] for row in rows] == pytest.approx(over, abs=0.2)
    # To the landing the aircraft is near the ground; over terrain it follows it.
    expected = [None, legs[0], legs[1], legs[2], 80.0, legs[4], None]
    assert [row["leg_lowest_m"] is None for row in rows] == [leg is None for leg in expected]
    assert [row["leg_lowest_m"] for row in rows if row["leg_lowest_m"] is not None] == pytest.approx(
        [leg for leg in expected if leg is not None], abs=0.5
    )
    assert [row["follows_ground"] for row in rows] == [number == 4 for number in range(len(rows))]


def test_items_are_a_table_and_a_line_in_the_picture(companion, tmp_path):
    file, bare, drawn = waypoint_file(tmp_path / "a.waypoints"), tmp_path / "bare.png", tmp_path / "drawn.png"
    told = companion("check", RIDGE, "--items", file, "--plot", drawn)
    words = " ".join(told.out.replace("│", " ").split())
    _, legs = ups_by_the_simulator()
    assert f"item 3, NAV_WAYPOINT (16) 306 m 170 m {legs[1]:.0f} m" in words
    assert "3 of 5 legs come below 50 m over ground (terrain.height_min_m)" in words
    companion("check", RIDGE, "--plot", bare)
    assert drawn.read_bytes() != bare.read_bytes()


def test_without_a_height_of_home_the_ground_at_the_start_counts(companion, tmp_path):
    told = companion("check", RIDGE, "--items", plan_file(tmp_path / "a.plan", None), "--json", "-")
    assert json.loads(told.out)["items_over_ground"][0]["over_ground_m"] == pytest.approx(60.0, abs=0.1)


@pytest.mark.parametrize(
    ("mission", "name", "items", "named"),
    [
        (FIRST_FLIGHT, "a.waypoints", OPERATOR, "a mission file with a section terrain"),
        (RIDGE, "a.kml", OPERATOR, "a name that ends in .plan"),
        (RIDGE, "a.waypoints", OPERATOR[:1], "1 with a position"),
        (RIDGE, "a.waypoints", (*OPERATOR, (16, RELATIVE, OUTSIDE_M, 100, 100)), "-50 m east, 100 m north"),
        (RIDGE, "missing.plan", None, "no such file"),
    ],
)
def test_items_that_have_no_height_over_the_map_are_refused(companion, tmp_path, mission, name, items, named):
    file = tmp_path / name
    if items is not None:
        waypoint_file(file, items)
    told = companion("check", mission, "--items", file)
    assert told.code == 2
    assert named in told.err
