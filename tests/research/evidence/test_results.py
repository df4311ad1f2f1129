"""From a campaign's rows to what is written of them."""

import contextlib
import csv
import io
import re
import sqlite3
from html.parser import HTMLParser

import pytest
from rich.console import Console

from companion import run_places
from companion.research.campaign.run_store import DATABASE
from companion.research.evidence.evidence_commands import campaign_from_file, results_in
from tests.sim.client import CONFIGS

SPEC = f"""\
name: made
kind: plans
missions: [{CONFIGS / "paper-2d.yaml"}]
methods: [safe-rrt, taddrrt, rrt]
seeds: 12
settings:
  zeta: {{}}
  alpha: {{planning.certainty: literal}}
"""
FILES = ["differences.csv", "measures.csv", "results.html", "results.md", "verdicts.csv"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Rows and what is written of them, made once."""
    tmp_path = tmp_path_factory.mktemp("made")
    file = tmp_path / "spec.yaml"
    file.write_text(SPEC, encoding="utf-8")
    console = Console(file=io.StringIO(), width=200)
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(run_places._PLACES, "plans", "tests.research.campaign.made_runs:Quick")
        campaign_from_file(file, jobs=1, resumes=False, folder=tmp_path / "out", console=console)
    assert "72 runs, 72 of them made now, 8 of these errors" in console.file.getvalue()
    results_in(tmp_path / "out", console)
    return tmp_path / "out"


def rows_of(file):
    with file.open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def test_the_same_rows_give_the_same_files(folder, companion_command):
    before = {name: (folder / name).read_bytes() for name in FILES}
    done = companion_command("results", folder)
    assert sorted(line.rpartition("/")[2] for line in done.out.splitlines()) == FILES
    assert {name: (folder / name).read_bytes() for name in FILES} == before


def test_csv_has_what_the_rows_have(folder):
    found = {(row["setting"], row["method"], row["measure"]): row for row in rows_of(folder / "measures.csv")}
    assert next(key[0] for key in found) == "zeta"  # the file's order, not the alphabet's
    assert ("zeta", "rrt", "Q") not in found  # which was never a number
    success, cost = found["alpha", "rrt", "success"], found["alpha", "rrt", "PC"]
    assert success["runs"] == "12"
    assert float(success["mean"]) == int(cost["runs"]) / 12  # a fault has no cost, nor has a failure
    assert float(cost["mean_low"]) < float(cost["mean"]) < float(cost["mean_high"])
    assert float(cost["median_low"]) <= float(cost["median"]) <= float(cost["median_high"])
    differences = rows_of(folder / "differences.csv")
    assert {(row["method"], row["less"]) for row in differences} == {
        ("taddrrt", "safe-rrt"), ("rrt", "safe-rrt"),
    }  # fmt: skip


def test_verdicts_are_those_of_the_papers_tables(folder):
    found = rows_of(folder / "verdicts.csv")
    cost = [row for row in found if (row["measure"], row["table"], row["setting"]) == ("PC", "1", "zeta")]
    assert [(row["less"], row["more"], row["verdict"]) for row in cost][1:3] == [
        ("safe-rrt", "nfz-ddrrt", "not measured"), ("safe-rrt", "rrt-star", "not measured"),
    ]  # fmt: skip
    assert cost[0]["verdict"] != "not measured"


def test_markdown_has_every_table_whole(folder):
    text = (folder / "results.md").read_text(encoding="utf-8")
    assert text.startswith("# made\n\n72 of 72 plans.")
    for block in re.findall(r"(?:^\|.*\n)+", text, flags=re.M):
        assert len({line.count("|") for line in block.splitlines()}) == 1
    assert text.index("## paper-2d, zeta") < text.index("## paper-2d, alpha")


class Page(HTMLParser):
    """What a page holds: open elements, rows a table, and what it would load from elsewhere."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tables, self.loaded = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "link", "img", "br", "use", "path", "rect"):
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append(0)
        if tag in ("td", "th"):
            self.tables[-1][-1] += 1
        for name, value in attrs:
            if name in ("src", "href", "xlink:href") and not value.startswith("#"):
                self.loaded.append(value)

    def handle_endtag(self, tag):
        if tag in self.open:
            assert self.open.pop() == tag


def test_the_page_is_whole_and_loads_nothing(folder):
    page = Page((folder / "results.html").read_text(encoding="utf-8"))
    assert (page.open, page.loaded) == ([], [])
    assert len(page.tables) > 8
    assert all(len(set(table)) == 1 for table in page.tables)


def test_the_curves_end_at_the_share_that_has_a_value(folder):
    text = (folder / "results.html").read_text(encoding="utf-8")
    assert text.count('role="img"') == 4  # curves and violins of two settings
    assert text.count("data-value=") > 100


def test_who_stops_a_campaign_is_told_how_to_go_on(tmp_path, monkeypatch, companion_command):
    def stopped(*_arguments, **_named):
        raise KeyboardInterrupt

    monkeypatch.setattr("companion.research.evidence.evidence_commands.run_campaign", stopped)
    file = tmp_path / "spec.yaml"
    file.write_text(SPEC, encoding="utf-8")
    done = companion_command("campaign", file, "--out", tmp_path / "out")
    assert done.code == 130
    assert "stopped; what was made is kept, and --resume goes on" in done.out


def test_an_unfinished_campaign_says_so(folder, tmp_path):
    with contextlib.closing(sqlite3.connect(folder / DATABASE)) as rows:
        rows.execute("VACUUM INTO ?", (str(tmp_path / DATABASE),))
    with contextlib.closing(sqlite3.connect(tmp_path / DATABASE)) as rows:
        rows.execute("DELETE FROM runs WHERE number >= 50")
        rows.execute("UPDATE runs SET commit_id = 'another' WHERE number = 0")
        rows.commit()
    results_in(tmp_path, Console(file=io.StringIO()))
    text = (tmp_path / "results.md").read_text(encoding="utf-8")
    assert "50 of 72 plans. The campaign is not finished" in text
    assert "Commit another, " in text
    assert "More than one commit made these rows." in text


def test_a_folder_without_a_campaign_and_one_without_a_row_are_told(folder, tmp_path, companion_command):
    done = companion_command("results", tmp_path)
    assert done.code == 2
    assert "nothing of a campaign" in done.err
    with contextlib.closing(sqlite3.connect(folder / DATABASE)) as rows:
        rows.execute("VACUUM INTO ?", (str(tmp_path / DATABASE),))
    with contextlib.closing(sqlite3.connect(tmp_path / DATABASE)) as rows:
        rows.execute("DELETE FROM runs")
        rows.commit()
    done = companion_command("results", tmp_path)
    assert done.code == 2
    assert "a campaign without a row" in done.err
