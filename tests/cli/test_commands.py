"""``check``, ``plan`` and ``sitl``: what they print, and the JSON that others read."""

import json
import math
import re
import subprocess
import sys

import numpy as np
import pytest

from companion import __version__
from tests.cli.calls import FIRST_FLIGHT, GOOD, changed, in_a_process
from tests.sim.client import CONFIGS

PLAN_KEYS = {
    *("seed", "method", "success", "status", "PST", "NCDC", "NTN", "ESR", "TSI", "PC", "Q", "TTA"),
    *("ATP", "NHTW", "PSR", "J", "gap", "seen_s", "path"),
}
SITL_KEYS = {
    *("success", "goal_reached", "collision", "min_obstacle_clearance_m", "min_dt_distance_m"),
    "min_ground_height_m",
    *("missions_uploaded", "missions_rejected", "replans", "plan_ms", "track_to_mission_ms"),
    *("flight_s", "wall_s", "true_path", "dt_path", "dt_paths", "dynamic_threats", "threatened", "is_safe"),
    *("seconds_in_reach", "seconds_in_reach_and_sight", "t_f_s", "miss_distance_m", "miss_s"),
    *("TDTA", "ADTP", "TTA", "ATP", "seconds_in_radar"),
}


@pytest.mark.parametrize("command", ["check", "plan", "run", "sitl", "warm-up"])
def test_help(companion, command):
    result = companion(command, "--help")
    assert result.code == 0
    assert f"companion {command}" in result.out
    assert "--help" in result.out


def test_help_of_the_installed_entry():
    result = in_a_process("--help")
    assert result.code == 0
    assert {"check", "plan", "run", "sitl"} <= set(result.out.replace("│", " ").split())


def test_what_plans_and_flies_nothing_loads_no_planner():
    """``companion health`` is asked every half minute, on a small computer."""
    heavy = {"numba", "numpy", "scipy", "filterpy", "jsbsim", "matplotlib", "mavsdk", "pymavlink", "shapely"}
    code = "\n".join(
        [
            "import sys",
            "from companion import cli",
            "sys.argv = ['companion', '--version']",
            "try:",
            "    cli.main()",
            "except SystemExit:",
            "    pass",
            f"print(sorted({heavy!r} & set(sys.modules)))",
        ]
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [__version__, "[]"]


def test_version(companion):
    assert companion("--version").out.strip() == __version__


def test_check_prints_what_it_understood(companion):
    result = companion("check", FIRST_FLIGHT)
    assert result.code == 0
    assert "first-flight" in result.out
    assert "1750 E, 750 N, 100 m up, within 60 m" in result.out
    assert "1600 m, 64 s at cruise" in result.out


def test_check_as_json(companion):
    result = companion("check", FIRST_FLIGHT, "--json", "-")
    assert result.code == 0
    told = json.loads(result.out)
    agreed = (
        "origin",
        "start_enu_m",
        "goals_enu_m",
        "bounds_enu_m",
        "obstacles",
        "radars",
        "dynamic_threats",
    )
    assert set(agreed) <= told.keys()
    assert told["origin"] == {"lat_deg": -35.363261, "lon_deg": 149.165230, "alt_amsl_m": 584.0}
    assert told["start_enu_m"] == [150, 750, 100]
    assert told["goals_enu_m"] == [[1750, 750, 100]]
    assert told["bounds_enu_m"] == [[0, 2000], [0, 1500], [60, 160]]
    wall = [[1000, 1050], [1300, 1050], [1300, 1100], [1000, 1100]]
    assert told["obstacles"] == [{"name": "wall", "polygon_enu_m": wall, "base_m": 0, "top_m": 300}]
    assert told["radars"][0]["name"] == "radar_1"
    assert told["radars"][0]["max_threat_radius_m"] == 500
    assert told["dynamic_threats"][0]["position_enu_m"] == [950, 750, 0]
    assert told["dynamic_threats"][0]["speed_m_s"] == 0


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_shipped_mission_is_understood(companion, tmp_path, path):
    target = tmp_path / "new" / "out.json"
    assert companion("check", path, "--json", target).code == 0
    assert json.loads(target.read_text())["name"] == path.stem
    assert [entry.name for entry in target.parent.iterdir()] == ["out.json"]


def test_check_tells_what_goals_cost(companion):
    told = companion("check", CONFIGS / "search-area.yaml")
    assert told.code == 0
    words = " ".join(told.out.split())
    assert "energy: 90 Wh at the start, straight legs at cruise, wind 3 m/s from 240" in words
    assert "the reserve of 18 Wh reached by" in words
    document = json.loads(companion("check", CONFIGS / "search-area.yaml", "--json", "-").out)
    assert len(document["energy"]["goals"]) == 3
    assert "energy" not in json.loads(companion("check", FIRST_FLIGHT, "--json", "-").out)


def test_check_draws(companion, tmp_path):
    target = tmp_path / "map.png"
    assert companion("check", FIRST_FLIGHT, "--plot", target).code == 0
    assert target.read_bytes().startswith(b"\x89PNG")


def test_plans_as_json(companion, tmp_path):
    target = tmp_path / "plans.json"
    result = companion("plan", FIRST_FLIGHT, "--seed", "3", "--runs", "2", "--json", target)
    assert result.code == 0
    plans = json.loads(target.read_text())
    assert [set(entry) for entry in plans] == [PLAN_KEYS, PLAN_KEYS]
    assert [entry["seed"] for entry in plans] == [3, 4]
    assert {entry["method"] for entry in plans} == {"safe-rrt"}
    for entry in plans:
        assert entry["success"] is True
        assert entry["status"] == "exact"
        assert entry["ESR"] == pytest.approx(entry["NTN"] / entry["NCDC"], abs=1e-6)
        assert entry["TSI"] == pytest.approx(entry["PST"] / entry["NCDC"], abs=1e-6)
        assert 0.0 <= entry["PSR"] <= 1.0
        rows = np.array(entry["path"])
        assert rows.shape[1] == 7
        np.testing.assert_allclose(rows[0], [0.0, 150.0, 750.0, 100.0, 0.5 * math.pi, 0.0, 25.0], atol=1e-6)
        assert np.hypot(*(rows[-1, 1:3] - (1750.0, 750.0))) <= 60.0
        assert (np.diff(rows[:, 0]) > 0.0).all()
        assert ((rows[:, 4] >= 0.0) & (rows[:, 4] < 2.0 * math.pi)).all()
        step = np.diff(rows[:, 1:3], axis=0)
        middle = (
            rows[:-1, 4] + 0.5 * np.remainder(np.diff(rows[:, 4]) + math.pi, 2.0 * math.pi) - 0.5 * math.pi
        )
        offset = np.remainder(np.arctan2(*step.T) - middle + math.pi, 2.0 * math.pi) - math.pi
        assert np.abs(offset).max() < 0.1  # east, north and course belong together


def test_the_same_seed_prints_the_same_plan(companion):
    def path():
        return json.loads(companion("plan", FIRST_FLIGHT, "--seed", "5", "--json", "-").out)[0]["path"]

    assert path() == path()


def test_no_safe_plan_exits_with_one(companion, tmp_path):
    """A ring of walls round the goal."""
    old = "obstacles:\n"
    ring = "".join(
        f"  - {{name: {name}, polygon_enu_m: {corners}, base_m: 0, top_m: 300}}\n"
        for name, corners in {
            "south": "[[1600, 600], [1900, 600], [1900, 620], [1600, 620]]",
            "north": "[[1600, 880], [1900, 880], [1900, 900], [1600, 900]]",
            "west": "[[1600, 621], [1620, 621], [1620, 879], [1600, 879]]",
            "east": "[[1880, 621], [1900, 621], [1900, 879], [1880, 879]]",
        }.items()
    )
    assert old in GOOD
    path, _ = changed(tmp_path, old, old + ring)
    text = path.read_text().replace(
        "total_planning_time_s: 80", "total_planning_time_s: 80\n  max_iterations: 800"
    )
    path.write_text(text)
    result = companion("plan", path, "--json", "-")
    assert result.code == 1
    entry = json.loads(result.out)[0]
    assert entry["success"] is False
    assert entry["status"] != "exact"


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """One headless flight by the installed entry."""
    target = tmp_path_factory.mktemp("flown") / "flight.json"
    result = in_a_process("sitl", FIRST_FLIGHT, "--headless", "--seed", "2", "--json", target)
    return result, json.loads(target.read_text())


def test_a_flight_exits_with_zero_and_a_table(flown):
    result, told = flown
    assert result.code == 0, result.err
    assert "goal reached" in result.out
    assert told["success"] is True
    (under,) = re.findall(r"under threat +│ +(.*?) +│", result.out)
    assert under == ("never" if told["is_safe"] else f"{told['seconds_in_reach_and_sight']:.1f} s of 63")


def test_the_keys_of_a_flight_are_those_agreed(flown):
    _, told = flown
    assert told.keys() == SITL_KEYS
    assert told["plan_ms"].keys() == {"median", "p95", "max"}
    assert told["track_to_mission_ms"].keys() == {"median", "p95"}


def test_the_measures_of_a_flight_have_their_types(flown):
    _, told = flown
    assert {type(told[key]) for key in ("success", "goal_reached", "collision")} == {bool}
    assert {type(told[key]) for key in ("missions_uploaded", "missions_rejected", "replans")} == {int}
    for key in ("min_obstacle_clearance_m", "min_dt_distance_m", "flight_s", "wall_s"):
        assert isinstance(told[key], float)
    assert told["missions_uploaded"] >= 2
    assert 0.0 < told["plan_ms"]["median"] <= told["plan_ms"]["p95"] <= told["plan_ms"]["max"]
    assert told["track_to_mission_ms"]["median"] <= told["track_to_mission_ms"]["p95"]


def test_measures_of_single_threats_are_by_name(flown):
    _, told = flown
    of_it = told["dynamic_threats"]["parked_vehicle"]
    assert of_it.keys() == {
        *("seconds_in_reach", "seconds_in_reach_and_sight", "t_f_s", "miss_distance_m", "miss_s"),
        *("TDTA", "ADTP"),
    }
    assert of_it == {key: told[key] for key in of_it}  # there is no other
    assert told["dt_paths"] == {"parked_vehicle": told["dt_path"]}


def test_the_true_paths_are_sampled_at_ten_hertz(flown):
    _, told = flown
    rows = np.array(told["true_path"])
    assert rows.shape[1] == 7
    np.testing.assert_allclose(np.diff(rows[:, 0]), 0.1, atol=1e-6)
    assert rows[-1, 0] == pytest.approx(told["flight_s"], abs=0.11)
    np.testing.assert_allclose(rows[0, 1:4], [150.0, 750.0, 100.0], atol=3.0)
    speeds = np.hypot(*np.diff(rows[:, 1:3], axis=0).T) / 0.1
    assert 15.0 < speeds.min() < speeds.max() < 40.0
    threats = np.array(told["dt_path"])
    assert threats.shape[1] == 3
    np.testing.assert_allclose(threats[:, 1:], [[950.0, 750.0]] * len(threats), atol=1e-6)


def test_a_flight_that_cannot_be_reported_says_so(companion, tmp_path, monkeypatch):
    """The flight itself is left out."""

    async def nowhere(*_):
        return None

    monkeypatch.setattr("sim.sitl.Flight.fly", nowhere)
    monkeypatch.setattr("sim.sitl.Flight.document", lambda _: {})
    (tmp_path / "file").write_text("")
    result = companion("sitl", FIRST_FLIGHT, "--headless", "--json", tmp_path / "file" / "out.json")
    assert result.code == 2
    assert "--json" in result.err
