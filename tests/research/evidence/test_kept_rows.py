"""Rows kept small: what a table shows of them is what it shows of the campaign's own."""

import io
import json

import pytest
from rich.console import Console

from companion import run_places
from companion.errors import ConfigError
from companion.research.campaign.campaign_spec import load_campaign
from companion.research.campaign.run_store import RunStore
from companion.research.evidence.document.kept_rows import stored_evidence, stored_text
from companion.research.evidence.evidence_commands import campaign_from_file, results_in
from companion.research.evidence.samples import evidence_of
from tests.sim.client import CONFIGS

SPEC = f"""\
name: made
kind: plans
missions: [{CONFIGS / "paper-2d.yaml"}]
methods: [safe-rrt, rrt]
seeds: 12
settings:
  zeta: {{}}
  alpha: {{planning.certainty: literal}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Rows of a campaign, made once."""
    folder = tmp_path_factory.mktemp("made")
    file = folder / "spec.yaml"
    file.write_text(SPEC, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(run_places._PLACES, "plans", "tests.research.campaign.made_runs:Quick")
        campaign_from_file(file, jobs=1, resumes=False, folder=folder / "out", console=Console(quiet=True))
    return folder / "out"


def test_what_is_kept_is_what_was_made(folder, tmp_path):
    kept = tmp_path / "kept.csv"
    console = Console(file=io.StringIO(), width=200)
    results_in(folder, console, keep=kept)
    assert str(kept) in console.file.getvalue()
    store = RunStore.to_read(folder)
    whole = evidence_of(store)
    assert kept.read_text(encoding="utf-8") == stored_text(store)
    store.close()
    found = stored_evidence(kept)
    assert (found.name, found.kind, found.num_rows, found.num_wanted) == ("made", "plans", 48, 48)
    assert (found.commits, found.machines) == (whole.commits, whole.machines)
    assert [case.title for case in found.cases] == [case.title for case in whole.cases]
    for ours, theirs in zip(found.cases, whole.cases, strict=True):
        assert ours.dimension == theirs.dimension == 2
        for method, sample in theirs.samples.items():
            again = ours.samples[method]
            assert again.num_errors == sample.num_errors
            for seed, row in sample.rows.items():
                other = again.rows[seed]
                assert (other.number, other.error) == (row.number, row.error)
                assert other.measures.get("success") is row.measures.get("success")
                if row.error is None:
                    assert other.measures["PC"] == pytest.approx(row.measures["PC"], rel=1e-5)
                else:
                    assert other.measures == {}
                assert "Q" not in other.measures  # which was no number


def test_a_file_that_is_not_whole_is_told(folder, tmp_path):
    store = RunStore.to_read(folder)
    text = stored_text(store)
    store.close()
    file = tmp_path / "kept.csv"
    head, _, body = text.partition("\n")
    less = json.loads(head.removeprefix("# "))
    del less["dimensions"]
    broken = ("", "no rows at all", body, f"# {json.dumps(less)}\n{body}", text.replace(",true,", ",yes,", 1))
    for wrong in broken:
        file.write_text(wrong, encoding="utf-8")
        with pytest.raises(ConfigError, match=r"kept\.csv: rows: got .*; expected what companion results"):
            stored_evidence(file)
    with pytest.raises(ConfigError, match="No such file"):
        stored_evidence(tmp_path / "none.csv")


def test_of_no_rows_nothing_is_kept(tmp_path):
    file = tmp_path / "spec.yaml"
    file.write_text(SPEC, encoding="utf-8")
    store = RunStore.to_write(tmp_path / "out", load_campaign(file), resumes=False)
    with pytest.raises(ConfigError, match="a campaign without a row"):
        stored_text(store)
    store.close()


def test_a_page_of_no_rows_and_one_that_cannot_be_written_are_told(folder, tmp_path, companion_command):
    done = companion_command("results", tmp_path, "--page", tmp_path / "page.md")
    assert (done.code, r"no *.csv" in done.err) == (2, True)
    (tmp_path / "file").touch()
    done = companion_command("results", folder, "--keep", tmp_path / "file" / "kept.csv")
    assert done.code == 2
    assert "a file to write" in done.err
