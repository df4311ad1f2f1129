"""The campaigns that come with the project: each is valid, and one run of each kind works."""

import re
import sqlite3

import pytest

from companion.research.campaign.campaign_spec import load_campaign
from companion.research.campaign.run_store import DATABASE
from tests.sim.client import CONFIGS

CAMPAIGNS = sorted((CONFIGS.parent / "campaigns").glob("*.yaml"))
NUM_RUNS = {
    "ablations": 3000, "anytime": 100, "encounters": 400, "faults": 120, "flights": 640, "ideas": 300,
    "paper": 6000, "prices": 120, "small": 72, "wind": 180,
}  # fmt: skip
METHOD = "edbm"


@pytest.mark.parametrize("file", CAMPAIGNS, ids=lambda file: file.stem)
def test_each_is_valid_and_named_as_its_file(file):
    campaign = load_campaign(file)
    assert campaign.config.name == file.stem
    assert len(campaign.runs) == NUM_RUNS[file.stem]


def smallest(file, tmp_path):
    """The same file with one seed, and the first mission, method and settings only."""
    text = file.read_text(encoding="utf-8")
    text = re.sub(r"^seeds: \d+", "seeds: 1", text, flags=re.M)
    mission = file.parent / load_campaign(file).config.missions[0]
    text = re.sub(r"^missions: .*$", f"missions: [{mission}]", text, flags=re.M)
    text = text.replace("encounter.model: ", f"encounter.model: {file.parent}/")
    text = re.sub(r"^methods:(.*\n(  .*\n)*)", f"methods: [{METHOD}]\n", text, flags=re.M)
    text = re.sub(r"^settings:\n(  .*\n)((  .*\n)*)", r"settings:\n\1", text, flags=re.M)
    small = tmp_path / file.name
    small.write_text(text, encoding="utf-8")
    return small


@pytest.mark.slow
@pytest.mark.compiled
@pytest.mark.parametrize("file", CAMPAIGNS, ids=lambda file: file.stem)
def test_a_run_of_each_has_its_measures_and_results(file, tmp_path, companion_command):
    small = smallest(file, tmp_path)
    assert len(load_campaign(small).runs) == 1
    done = companion_command("campaign", small, "--out", tmp_path / "out")
    assert (done.code, "0 of these errors" in done.out) == (0, True), done.out + done.err
    with sqlite3.connect(tmp_path / "out" / DATABASE) as connection:
        ((measures, paths),) = connection.execute("SELECT measures, length(paths) FROM runs").fetchall()
    connection.close()
    wanted = {
        "plans": ("PC", "TDTA", "RRS"),
        "flights": ("seconds_in_reach_and_sight", "is_safe"),
        "encounters": ("without.lowc", "lowc", "severity", "detour_s"),
        "anytime": (),
    }
    kind = load_campaign(small).config.kind
    assert all(f'"{name}"' in measures for name in wanted.get(kind, ()))
    assert paths > 100 or kind == "anytime"
    assert companion_command("results", tmp_path / "out").code == 0
    assert METHOD in (tmp_path / "out" / "results.md").read_text(encoding="utf-8")
