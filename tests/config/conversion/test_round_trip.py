"""A mission that is exported and imported again is the same mission, in every format."""

import json
import math
import string

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from companion.cli_options import Targets
from companion.config import load_mission, mission_from_text
from companion.config.conversion.exchange_files import export_mission, imported
from companion.config.conversion.mission_composition import Wishes
from companion.config.load import text_of
from companion.errors import ConfigError
from tests.sim.client import CONFIGS

FORMATS = ("plan", "kml", "geojson")
TOLERANCE_M = 1e-3
LISTED = sorted(CONFIGS.glob("*.yaml"))


def again(mission, folder, form, like):
    """A mission exported and imported again; with ``like``, settings come from the mission itself."""
    file, target = folder / "mission.yaml", folder / f"out.{form}"
    file.write_text(text_of(mission), encoding="utf-8")
    export_mission(file, Targets(**{form: target}, replaces=True))
    text = imported([target], Wishes(mission.name, like=mission if like else None))
    return mission_from_text(text, "again.yaml"), text


def near(one, other):
    """Whether two values are the same, and places the same to a millimetre."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(near(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(near, one, other))
    if isinstance(one, float) and isinstance(other, float | int):
        return math.isclose(one, other, rel_tol=0.0, abs_tol=TOLERANCE_M)
    return one == other


PLACES = {
    "origin",
    "bounds",
    "start",
    "goals",
    "radars",
    "dynamic_threats",
    "obstacles",
    "glide",
    "dimension",
}


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("path", LISTED, ids=lambda path: path.stem)
def test_a_shipped_mission_comes_back(path, form, tmp_path):
    mission = load_mission(path)
    same, _ = again(mission, tmp_path, form, like=True)
    assert near(same.model_dump(exclude={"description"}), mission.model_dump(exclude={"description"}))


def places(low, high):
    """Coordinates to a tenth of a metre."""
    return st.integers(low * 10, high * 10).map(lambda tenths: tenths / 10.0)


NAMES = st.text(string.ascii_letters + string.digits, min_size=1, max_size=8)


@st.composite
def missions(draw):
    """Missions anywhere on the globe, obstacles in cells of a grid that start and goals keep out of."""
    latitude, longitude = draw(places(-70, 70)), draw(places(-179, 179))
    heights = draw(st.sampled_from([(100.0, 100.0), (80.0, 140.5)]))
    cells = draw(st.lists(st.integers(1, 8), unique=True, max_size=5))
    obstacles = []
    for number, cell in enumerate(cells):
        east, size = 400.0 * cell + draw(places(0, 50)), draw(places(20, 200))
        top = draw(places(10, 300))
        corners = [[east, 900.0], [east + size, 900.0], [east + size, 900.0 + size], [east, 900.0 + size]]
        obstacles.append({"name": f"o {number}", "polygon_enu_m": corners, "base_m": 0.0, "top_m": top})
    radars = [
        {
            "name": name,
            "east_m": draw(places(0, 4_000)),
            "north_m": draw(places(0, 3_000)),
            "up_m": draw(places(0, 90)),
            "max_threat_radius_m": draw(places(1, 900)),
            "boundary_coefficient_per_m": draw(st.sampled_from([0.0, 0.001])),
            "known_beforehand": draw(st.booleans()),
        }
        for name in draw(st.lists(NAMES, unique=True, max_size=3))
    ]
    goals = [
        {"east_m": draw(places(0, 4_000)), "north_m": draw(places(2_000, 3_000)), "up_m": heights[1]}
        for _ in range(draw(st.integers(1, 4)))
    ]
    route = draw(st.lists(st.tuples(places(0, 4_000), places(1_500, 1_900)).map(list), max_size=3))
    threat = {
        "name": "car",
        "east_m": 5.0,
        "north_m": 1_500.0,
        "speed_m_s": 10.0,
        "max_threat_radius_m": 120.0,
    }
    threat |= {"behaviour": "drive", "route_enu_m": route} if route else {"behaviour": "stand"}
    document = {
        "name": "drawn",
        "dimension": 2 if heights[0] == heights[1] else 3,
        "unit_m": 25.0,
        "origin": {
            "latitude_deg": latitude,
            "longitude_deg": longitude,
            "altitude_amsl_m": draw(places(0, 900)),
        },
        "bounds": {"east_m": [-100.0, 4_500.0], "north_m": [-50.5, 3_500.0], "up_m": [20.0, 220.0]},
        "start": {
            "east_m": draw(places(0, 300)),
            "north_m": 100.0,
            "up_m": heights[0],
            "course_deg": draw(places(0, 359)),
        },
        "goals": goals,
        "obstacles": obstacles,
        "radars": radars,
        "dynamic_threats": [threat],
        "vehicle": {
            "airspeed_min_m_s": 12.5,
            "airspeed_max_m_s": 37.5,
            "airspeed_cruise_m_s": 25.0,
            "acceleration_max_m_s2": 0.5,
            "turn_radius_min_m": 125.0,
            "straight_length_min_m": 125.0,
            "penetration_speed_m_s": 30.0,
        },
        "planning": {"sensing_horizon_m": 825.0, "time_horizon_s": 15.0, "total_planning_time_s": 250.0},
    }
    return mission_from_text(json.dumps(document), "drawn.yaml")


@pytest.mark.parametrize("form", FORMATS)
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mission=missions())
def test_any_mission_comes_back(form, tmp_path, mission):
    """Without another mission to take settings from: the places alone."""
    same, text = again(mission, tmp_path, form, like=False)
    assert near(same.model_dump(include=PLACES), mission.model_dump(include=PLACES))
    assert text.count("# - ") == 0


@pytest.mark.parametrize("form", FORMATS)
def test_a_radar_keeps_its_model_and_its_values(form, tmp_path, packages):
    packages.install_example("example-threat")
    mission = load_mission(CONFIGS.parent / "docs" / "example-threat" / "sector.yaml")
    same, text = again(mission, tmp_path, form, like=True)
    (radar,) = same.radars
    assert (radar.model, radar.model_values) == ("sector", (0.0, 120.0))
    assert "model_values: [0, 120]" in text
    assert text.count("# - ") == 0


def test_a_plan_that_was_changed_since_is_read_as_it_stands(tmp_path):
    mission = load_mission(CONFIGS / "slow-aircraft.yaml")
    file, target = CONFIGS / "slow-aircraft.yaml", tmp_path / "out.plan"
    export_mission(file, Targets(plan=target))
    plan = json.loads(target.read_text(encoding="utf-8"))
    plan["mission"]["items"][1]["params"][5] += 1e-3
    target.write_text(json.dumps(plan), encoding="utf-8")
    text = imported([target], Wishes("changed", like=mission))
    changed = mission_from_text(text, "changed.yaml")
    assert "the plan was changed since" in text
    assert changed.goals[0].acceptance_radius_m == 40.0
    # Home is the start's place, 80 m east; a thousandth of a degree there is 90.9 m.
    assert changed.goals[0].east_m == pytest.approx(1_100.0 - 80.0 + 90.9, abs=0.1)
    # What a plan holds for itself: the box as a fence with its walls, obstacles without names.
    assert len(changed.obstacles) == len(mission.obstacles) + 4
    assert changed.bounds.east_m[1] - changed.bounds.east_m[0] == pytest.approx(1_200.0, abs=0.5)


def test_a_file_that_exists_is_kept(tmp_path):
    target = tmp_path / "out.kml"
    target.write_text("mine", encoding="utf-8")
    with pytest.raises(ConfigError, match="a new name, or --force"):
        export_mission(CONFIGS / "convoy.yaml", Targets(kml=target))
    assert target.read_text(encoding="utf-8") == "mine"
    export_mission(CONFIGS / "convoy.yaml", Targets(kml=target, replaces=True))
    assert "<kml" in target.read_text(encoding="utf-8")
