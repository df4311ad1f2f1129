"""Planners of other packages: found by name, loaded late, never in place of ours, named where broken."""

import sys

import pytest

from companion.config import mission_from_text
from companion.errors import ConfigError, PlannerError
from companion.planning.comparators import ANYTIME_METHODS, FLOWN_METHODS, METHODS
from companion.planning.plugins import foreign_code
from companion.planning.plugins.installed_planners import (
    BUILT_IN,
    installed_names,
    installed_planner,
    method_fault,
)
from companion.research.campaign.campaign_spec import load_campaign
from tests.sim.client import CONFIGS
from tests.support.sitl_harness import FIRST_FLIGHT

FINDS_NOTHING = "def find(problem, should_stop):\n    return None\n"
BY_CLASS = """class Finder:
    def __call__(self, problem, should_stop):
        return None
"""


@pytest.mark.parametrize(("place", "text"), [("nothing:find", FINDS_NOTHING), ("nothing:Finder", BY_CLASS)])
def test_a_function_or_a_class_is_a_planner_under_its_name(packages, place, text):
    packages.install("nothing-finder", {"nothing-at-all": place}, {"nothing": text})
    assert installed_names() == ["nothing-at-all"]
    assert "nothing" not in sys.modules
    assert method_fault("nothing-at-all") == ""
    loaded = installed_planner("nothing-at-all")
    assert loaded.states(None, lambda: False) is None
    assert loaded.origin == f"'nothing-at-all' of nothing-finder 1.0 ({place})"
    assert installed_planner("nothing-at-all") is loaded


@pytest.mark.parametrize(
    ("place", "text", "told"),
    [
        ("absent:find", None, "ModuleNotFoundError: No module named 'absent'"),
        ("broken:find", "import absent_library\n", "No module named 'absent_library'"),
        ("broken:find", "def find(:\n", "SyntaxError"),
        ("broken:find", "1 / 0\n", "ZeroDivisionError"),
        ("broken:find", "other = 1\n", "AttributeError"),
        ("broken:find", "find = 3\n", "got int; expected what can be called with"),
        ("broken:find", "def find(problem):\n    return None\n", "got function find; expected what can be"),
        ("broken:Find", "class Find:\n    def __init__(self, size):\n        pass\n", "TypeError"),
        ("broken:Find", "class Find:\n    pass\n", "got Find; expected what can be called with"),
    ],
)
def test_a_broken_planner_is_told_with_its_package_and_what_was_expected(packages, place, text, told):
    packages.install("broken-one", {"broken": place}, {"broken": text} if text else {})
    with pytest.raises(PlannerError) as caught:
        installed_planner("broken")
    assert f"'broken' of broken-one 1.0 ({place})" in str(caught.value)
    assert told in str(caught.value)
    assert "expected" in str(caught.value)
    assert method_fault("broken").startswith("a method that can be loaded: planner 'broken' of broken-one")


def test_a_mission_file_that_names_a_broken_planner_is_refused_at_its_line(packages):
    packages.install("broken-one", {"broken": "broken:find"}, {"broken": "1 / 0\n"})
    with pytest.raises(ConfigError, match=r"m\.yaml:\d+: planning\.method: .*broken-one 1\.0.*ZeroDivision"):
        mission_from_text(FIRST_FLIGHT.replace("planning:", "planning:\n  method: broken"), "m.yaml")


def test_a_planner_of_two_packages_is_refused_with_both(packages):
    packages.install("first-one", {"same": "one:find"}, {"one": FINDS_NOTHING})
    packages.install("second-one", {"same": "two:find"}, {"two": FINDS_NOTHING})
    with pytest.raises(PlannerError, match=r"got 2 planners of one name") as caught:
        installed_planner("same")
    assert "first-one 1.0" in str(caught.value)
    assert "second-one 1.0" in str(caught.value)


@pytest.mark.parametrize("name", ["safe-rrt", "rrt", "plan-once", "ompl-rrt"])
def test_no_name_of_ours_is_taken(packages, name):
    packages.install("shadow", {name: "shadow:find"}, {"shadow": "raise RuntimeError('loaded')\n"})
    assert {*METHODS, *FLOWN_METHODS, *ANYTIME_METHODS} == BUILT_IN
    assert installed_names() == []
    assert (method_fault(name) == "") is (name in METHODS)
    assert method_fault(name, (name,)) == ""
    with pytest.raises(PlannerError, match="0 planners of one name"):
        installed_planner(name)
    assert "shadow" not in sys.modules


def test_names_of_ours_are_known_without_a_look_at_other_packages(monkeypatch):
    def look(group):
        raise AssertionError("other packages were looked at")

    monkeypatch.setattr(foreign_code, "entry_points", look)
    foreign_code.entries_of.cache_clear()
    for name in METHODS:
        assert method_fault(name) == ""
        mission_from_text(FIRST_FLIGHT.replace("planning:", f"planning:\n  method: {name}"), "m.yaml")


def test_only_the_planner_that_is_named_is_loaded(packages):
    packages.install("asked", {"asked-for": "asked:find"}, {"asked": FINDS_NOTHING})
    packages.install("other", {"other-one": "other:find"}, {"other": "raise SystemExit(1)\n"})
    assert method_fault("asked-for") == ""
    assert method_fault("unknown").endswith(", taddrrt, asked-for, other-one")
    assert "other" not in sys.modules


def test_a_campaign_knows_which_version_of_a_planner_it_ran(packages, tmp_path):
    packages.install_example()
    file = tmp_path / "mine.yaml"
    file.write_text(
        f"name: mine\nkind: plans\nmissions: [{CONFIGS / 'first-flight.yaml'}]\nseeds: 1\n"
        "methods: [safe-rrt, beeline]\n",
        encoding="utf-8",
    )
    told = load_campaign(file).identity()
    assert told["planners"] == [["beeline", "'beeline' of example-planner 1.0 (example_planner:beeline)"]]
    file.write_text(file.read_text(encoding="utf-8").replace("beeline", "bee-line"), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"methods\.1: got .*bee-line.*; expected one of .*, beeline"):
        load_campaign(file)
