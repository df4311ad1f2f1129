"""``import``, ``new`` and ``export`` of a mission file, as a user calls them."""

import io
import json
import sys

import pytest

from companion.config import load_mission
from tests.cli.calls import FIRST_FLIGHT
from tests.config.conversion.files import EXAMPLES, collection, feature, plan, waypoint, written

HOME, GOAL = "-35.363261,149.165230,584", "-35.3565 149.1845"


def test_import_tells_what_it_made_and_what_not(companion, tmp_path):
    target = tmp_path / "my flight.yaml"
    files = [EXAMPLES / name for name in ("field.plan", "buildings.kml", "radars.csv")]
    result = companion("import", *files, "-o", target)
    assert result.code == 0
    assert "2 goals, 8 obstacles, 2 radars, 0 moving threats" in result.out
    assert "remark: field.plan: NAV_RETURN_TO_LAUNCH (20) item 5: not taken" in result.err
    assert load_mission(target).name == "my-flight"
    said = [line.removeprefix("remark: ") for line in result.err.splitlines()]
    assert [f"# - {line}" for line in said] == target.read_text(encoding="utf-8").splitlines()[
        2 : 2 + len(said)
    ]
    assert companion("check", target).code == 0


def test_an_existing_file_is_kept_without_force(companion, tmp_path):
    target = written(tmp_path, "m.yaml", "mine")
    result = companion("import", EXAMPLES / "field.plan", "-o", target)
    assert (result.code, "a new name, or --force" in result.err) == (2, True)
    assert target.read_text(encoding="utf-8") == "mine"
    assert companion("import", EXAMPLES / "field.plan", "-o", target, "--force").code == 0
    assert load_mission(target).name == "m"


def test_a_wrong_file_writes_nothing(companion, tmp_path):
    target = tmp_path / "m.yaml"
    result = companion("import", written(tmp_path, "a.plan", plan(version=9)), "-o", target)
    assert result.code == 2
    assert "a.plan: mission.version: got 9; expected 2" in result.err
    assert not target.exists()


def test_options_of_import(companion, tmp_path):
    target = tmp_path / "m.yaml"
    goal = written(tmp_path, "a.geojson", collection(feature("goal", "Point", [149.18, -35.36])))
    result = companion(
        "import", goal, "-o", target, "--home", HOME, "--aircraft", "fast", "--height", 120, "--name", "Nº 1"
    )
    assert result.code == 0
    mission = load_mission(target)
    assert (mission.name, mission.start.up_m, mission.vehicle.airspeed_cruise_m_s) == ("No-1", 120, 35)
    wrong = companion("import", goal, "-o", tmp_path / "n.yaml", "--home", "95,0,0")
    assert (wrong.code, "--home: got 95,0,0; expected LATITUDE,LONGITUDE,ALTITUDE" in wrong.err) == (2, True)
    wrong = companion("import", goal, "-o", tmp_path / "n.yaml", "--kind", "lake")
    assert (wrong.code, "--kind: got lake; expected one of origin" in wrong.err) == (2, True)


def test_export_to_all_formats_and_import_again(companion, tmp_path):
    targets = {form: tmp_path / f"out.{form}" for form in ("plan", "kml", "geojson")}
    options = [word for form, path in targets.items() for word in (f"--{form}", path)]
    result = companion("export", FIRST_FLIGHT, *options)
    assert result.code == 0
    assert "companion import --like brings them back" in result.out
    for form, path in targets.items():
        again = tmp_path / f"{form}.yaml"
        result = companion("import", path, "-o", again, "--like", FIRST_FLIGHT)
        assert (result.code, result.err) == (0, "")
        assert [entry.name for entry in load_mission(again).radars] == ["radar_1"]
    assert json.loads(targets["plan"].read_text(encoding="utf-8"))["fileType"] == "Plan"
    assert companion("export", FIRST_FLIGHT, *options).code == 2
    plain = companion("export", FIRST_FLIGHT)
    assert (plain.code, "--plan, --kml or --geojson with a file to write" in plain.err) == (2, True)


@pytest.mark.parametrize("aircraft", ["slow", "medium", "fast"])
def test_new_without_a_terminal(companion, tmp_path, aircraft):
    target = tmp_path / "m.yaml"
    result = companion("new", target, "--home", HOME, "--aircraft", aircraft, "--goal", GOAL, "--height", 90)
    assert result.code == 0
    assert companion("check", target).code == 0
    mission = load_mission(target)
    assert (mission.start.up_m, mission.goals[0].north_m) == (90, pytest.approx(750.0, abs=0.5))
    assert target.read_text(encoding="utf-8").count("#") > 8


def test_new_asks_and_asks_again(companion, tmp_path, monkeypatch):
    target = tmp_path / "m.yaml"
    monkeypatch.setattr(sys, "stdin", io.StringIO(f"95,1,1\n{HOME}\n\n{GOAL}\n\n"))
    result = companion("new", target)
    assert result.code == 0
    assert "expected LATITUDE,LONGITUDE,ALTITUDE" in result.out + result.err
    mission = load_mission(target)
    assert (mission.vehicle.airspeed_cruise_m_s, mission.start.up_m) == (25, 100)


def test_new_without_an_answer_names_the_option(companion, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    result = companion("new", tmp_path / "m.yaml", "--home", HOME)
    assert result.code == 2
    assert "--aircraft: got nothing; expected" in result.err
    wrong = companion(
        "new", tmp_path / "m.yaml", "--home", HOME, "--aircraft", "slow", "--goal", "5", "--height", 90
    )
    assert (wrong.code, "--goal: got 5; expected LATITUDE,LONGITUDE" in wrong.err) == (2, True)
    assert not (tmp_path / "m.yaml").exists()


def test_what_was_left_out_is_told_before_the_error_that_comes_of_it(companion, tmp_path):
    terrain = plan(items=[waypoint(0, 0, 0, None, -35.35, 149.18, 80, frame=10)])
    result = companion("import", written(tmp_path, "a.plan", terrain), "-o", tmp_path / "m.yaml")
    assert result.code == 2
    remark, error = result.err.strip().splitlines()
    assert "item 1: not taken: its height is in frame 10, over terrain" in remark
    assert "a.plan: goals: got nothing; expected waypoints" in error
