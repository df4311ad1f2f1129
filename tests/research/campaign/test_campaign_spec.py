"""A campaign's file: its runs, and that whatever is wrong in it is named with its place."""

import pytest

from companion.errors import ConfigError
from companion.research.campaign.campaign_spec import load_campaign
from tests.cli.calls import FIRST_FLIGHT
from tests.sim.client import CONFIGS

ROOT = CONFIGS.parent
SPEC = f"""\
name: small
kind: plans
missions: [{FIRST_FLIGHT}]
methods: [safe-rrt, edbm]
seeds: 2
settings:
  shifted: {{}}
  narrow: {{planning.certainty: literal, goals.0.acceptance_radius_m: 50.0}}
"""


def spec(tmp_path, old="", new=""):
    assert old in SPEC
    file = tmp_path / "spec.yaml"
    file.write_text(SPEC.replace(old, new, 1), encoding="utf-8")
    return file


def test_runs_are_all_combinations_each_seed_together(tmp_path):
    runs = load_campaign(spec(tmp_path)).runs
    assert [(run.number, run.seed, run.setting, run.method) for run in runs] == [
        (0, 1, "shifted", "safe-rrt"), (1, 1, "shifted", "edbm"),
        (2, 1, "narrow", "safe-rrt"), (3, 1, "narrow", "edbm"),
        (4, 2, "shifted", "safe-rrt"), (5, 2, "shifted", "edbm"),
        (6, 2, "narrow", "safe-rrt"), (7, 2, "narrow", "edbm"),
    ]  # fmt: skip
    assert {run.mission for run in runs} == {"first-flight"}


def test_seeds_are_counted_or_named(tmp_path):
    named = load_campaign(spec(tmp_path, "seeds: 2", "seeds: [7, 3]"))
    assert named.config.seeds == (7, 3)
    assert load_campaign(spec(tmp_path)).config.seeds == (1, 2)


def test_settings_lie_over_the_mission_and_leave_the_rest(tmp_path):
    campaign = load_campaign(spec(tmp_path))
    plain, narrow = (campaign.mission("first-flight", name) for name in ("shifted", "narrow"))
    assert (plain.planning.certainty, narrow.planning.certainty) == ("shifted", "literal")
    assert (plain.goals[0].acceptance_radius_m, narrow.goals[0].acceptance_radius_m) == (60.0, 50.0)
    changed = narrow.goals[0].model_copy(update={"acceptance_radius_m": 60.0})
    assert changed == plain.goals[0]
    assert narrow.vehicle == plain.vehicle
    assert narrow.planning.model_copy(update={"certainty": "shifted"}) == plain.planning


def test_a_section_that_the_mission_leaves_out_can_be_set(tmp_path):
    file = spec(tmp_path, "planning.certainty: literal", "use_by.position_s: 3.0")
    assert load_campaign(file).mission("first-flight", "narrow").use_by.position_s == 3.0


WRONG = {
    "an unknown key": ("seeds: 2", "seed: 2", r":5: seed: got a key that is not known; expected seeds"),
    "no methods": ("[safe-rrt, edbm]", "[]", r":4: methods: got \[\]; expected at least 1 entries"),
    "an unknown method": ("edbm]", "teleport]", r":4: methods\.1: got teleport; expected one of edbm"),
    "a method twice": ("edbm]", "safe-rrt]", r":4: methods\.1: got safe-rrt; expected each one once"),
    "no seeds": ("seeds: 2", "seeds: 0", r":5: seeds: got 0; expected a number of at least 1"),
    "too many": ("seeds: 2", "seeds: 100001", r":5: seeds: got 100001; expected a number of at most 100000"),
    "half a seed": ("seeds: 2", "seeds: 1.5", r":5: seeds: got 1\.5; expected how many seeds"),
    "a seed twice": ("seeds: 2", "seeds: [4, 4]", r":5: seeds\.1: got 4; expected each one once"),
    "a kind": ("kind: plans", "kind: hopes", r":2: kind: got hopes; expected 'plans', 'flights', 'any"),
    "no file": ("first-flight.yaml", "nowhere.yaml", r":3: missions\.0: .* no such file"),
    "a mission twice": ("yaml]", f"yaml, {FIRST_FLIGHT}]", r":3: missions\.1: got .*; expected each one"),
    "a setting's key": (
        "planning.certainty", "planning.certainy",
        r":8: settings\.narrow\.planning\.certainy: got literal; expected certainty",
    ),
    "a setting's value": (
        "certainty: literal", "certainty: maybe",
        r":8: settings\.narrow\.planning\.certainty: got maybe; expected 'shifted' or 'literal'",
    ),
    "a setting's relation": (
        "planning.certainty: literal", "vehicle.airspeed_min_m_s: 30.0",
        r":8: settings\.narrow.*airspeed",
    ),
    "a bad link of plans": (
        "planning.certainty: literal", "faults.loss: 0.1",
        r":8: settings\.narrow\.faults\.loss: got 0\.1; expected no such key with 'kind: plans'",
    ),
    "a method that only flies": ("edbm]", "plan-once]", r":4: methods\.1: got plan-once; expected one of ed"),
    "a budget of flights": ("kind: plans", "kind: flights\nbudget_s: 1.0", r":3: budget_s: got 1\.0; "),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_is_named_with_its_place(wrong, tmp_path):
    old, new, words = WRONG[wrong]
    with pytest.raises(ConfigError, match=r"spec\.yaml" + words):
        load_campaign(spec(tmp_path, old, new))


FLOWN = SPEC.replace("kind: plans", "kind: flights").replace("edbm]", "plan-once, straight-line]")


def flown(tmp_path, new):
    file = tmp_path / "spec.yaml"
    file.write_text(FLOWN.replace("planning.certainty: literal", new), encoding="utf-8")
    return file


def test_flights_have_a_link_and_methods_that_never_replan(tmp_path):
    campaign = load_campaign(flown(tmp_path, "faults.loss: 0.25, faults.schedule: random"))
    assert [run.method for run in campaign.runs[:3]] == ["safe-rrt", "plan-once", "straight-line"]
    assert campaign.faults("shifted").is_none
    faults = campaign.faults("narrow")
    assert (faults.loss, faults.delay_s, faults.schedule) == (0.25, 0.0, "random")
    assert not faults.is_none
    assert campaign.mission("first-flight", "narrow").goals[0].acceptance_radius_m == 50.0


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("faults.los: 0.1", r"settings\.narrow\.faults\.los: got 0\.1; expected one of loss, duplication"),
        ("faults.loss: 1.5", r"settings\.narrow\.faults\.loss: got 1\.5; expected .*less than or equal to 1"),
        (
            "faults.schedule: bad",
            r"settings\.narrow\.faults\.schedule: got bad; expected .*'none' or 'random'",
        ),
    ],
)
def test_what_is_wrong_with_the_link_is_named_with_its_place(key, words, tmp_path):
    with pytest.raises(ConfigError, match=r"spec\.yaml:8: " + words):
        load_campaign(flown(tmp_path, key))


def test_goals_that_only_an_autopilot_knows_are_refused(tmp_path):
    text = FIRST_FLIGHT.read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("  - {east_m")]
    mission = tmp_path / "operator.yaml"
    mission.write_text("\n".join(lines).replace("goals:", "goals: from_autopilot"), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"missions\.0: .* expected a mission with a list of goals"):
        load_campaign(spec(tmp_path, str(FIRST_FLIGHT), str(mission)))


@pytest.mark.parametrize("content", ["", "  \n"])
def test_an_empty_file_and_none_are_told(content, tmp_path):
    file = tmp_path / "empty.yaml"
    with pytest.raises(ConfigError, match="a campaign's file to read"):
        load_campaign(file)
    file.write_text(content, encoding="utf-8")
    with pytest.raises(ConfigError, match="got nothing; expected the keys of a campaign"):
        load_campaign(file)


def test_what_makes_it_this_campaign(tmp_path):
    first = load_campaign(spec(tmp_path)).identity()
    assert first == load_campaign(spec(tmp_path, "kind", "description: other words\nkind")).identity()
    for old, new in (("seeds: 2", "seeds: 3"), ("literal", "shifted"), ("edbm", "rrt"), ("small", "large")):
        assert first != load_campaign(spec(tmp_path, old, new)).identity()


MODEL = ROOT / "campaigns" / "encounters" / "made-model.txt"


def passed(tmp_path, new):
    file = tmp_path / "spec.yaml"
    text = SPEC.replace("kind: plans", "kind: encounters").replace(
        "shifted: {}", f"shifted: {{encounter.model: {MODEL}}}"
    )
    file.write_text(text.replace("planning.certainty: literal", new), encoding="utf-8")
    return file


def test_encounters_have_a_model_for_each_setting(tmp_path):
    (tmp_path / "here.txt").write_text(MODEL.read_text(encoding="utf-8"), encoding="utf-8")
    campaign = load_campaign(passed(tmp_path, "encounter.model: here.txt, encounter.spread: 1.0"))
    assert (campaign.encounter("shifted").spread, campaign.encounter("narrow").spread) == (1.5, 1.0)
    text = MODEL.read_text(encoding="utf-8")
    assert campaign.models == {"shifted": (text, str(MODEL)), "narrow": (text, "here.txt")}
    assert campaign.mission("first-flight", "narrow").goals[0].acceptance_radius_m == 50.0
    told = campaign.identity()["models"]
    assert told[0][1] == told[1][1]
    changed = MODEL.read_text(encoding="utf-8").replace("300 100", "300 101")
    (tmp_path / "here.txt").write_text(changed, encoding="utf-8")
    again = load_campaign(passed(tmp_path, "encounter.model: here.txt, encounter.spread: 1.0"))
    assert again.identity()["models"] != told


def test_the_models_of_the_shipped_page_are_looked_for_where_the_environment_says(tmp_path, monkeypatch):
    file = MODEL.parent / "lincoln.yaml"
    for name in ("uncor_1200only_fwse_v1p2.txt", "uncor_1200only_rotorcraft_v1p2.txt", "glider_v1.txt"):
        (tmp_path / name).write_text(MODEL.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.setenv("MODELS", str(tmp_path))
    campaign = load_campaign(file)
    assert (campaign.config.name, len(campaign.runs)) == ("lincoln", 15_000)
    assert set(campaign.models) == {"fixed wing", "rotorcraft", "glider"}
    monkeypatch.delenv("MODELS")
    with pytest.raises(ConfigError, match=r"got \$MODELS/uncor_1200only_fwse_v1p2\.txt; expected a model"):
        load_campaign(file)


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("planning.certainty: literal", r"settings\.narrow: .*encounter\.model, the aircraft that pass"),
        ("encounter.model: none.txt", r"settings\.narrow\.encounter\.model: got none\.txt; expected a model"),
        (f"encounter.model: {MODEL}, encounter.spread: 0", r"settings\.narrow\.encounter\.spread: got 0; "),
        (f"encounter.model: {MODEL}, faults.loss: 0.1", r"settings\.narrow\.faults\.loss: .*'kind: flights'"),
        (f"encounter.model: {FIRST_FLIGHT}", r"settings\.narrow\.encounter\.model: .*a model that passes"),
    ],
)
def test_what_is_wrong_with_encounters_is_named_with_its_place(key, words, tmp_path):
    with pytest.raises(ConfigError, match=r"spec\.yaml:8: " + words):
        load_campaign(passed(tmp_path, key))
