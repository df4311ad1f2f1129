"""CITATION.cff keeps to the Citation File Format 1.2.0, and agrees with the project."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

from companion import __version__

ROOT = Path(__file__).parents[2]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
# Keys of the format that the file may use, each with the pattern of its value.
TEXT, DATE, DOI = r"\S.*", r"\d{4}-\d{2}-\d{2}", r"10\.\d{4,9}(\.\d+)?/[A-Za-z0-9:/_;\-.()\[\]\\]+"
ROOT_KEYS = {
    "cff-version": r"1\.2\.0", "message": TEXT, "type": "software|dataset", "title": TEXT, "abstract": TEXT,
    "version": r"\d+\.\d+\.\d+", "date-released": DATE, "license": r"[A-Za-z0-9.\-]+",
}  # fmt: skip
REFERENCE_KEYS = {"type": "article", "title": TEXT, "journal": TEXT, "doi": DOI}


def faults(entry, patterns, lists):
    """Keys that the format does not know here, and values that do not fit."""
    plain = {key: value for key, value in entry.items() if key not in lists}
    unknown = plain.keys() - patterns.keys()
    wrong = {
        key for key, value in plain.items()
        if key in patterns and not (isinstance(value, str) and re.fullmatch(patterns[key], value))
    }  # fmt: skip
    return unknown | wrong


def test_it_is_of_the_format():
    assert faults(CITATION, ROOT_KEYS, {"authors", "keywords", "references"}) == set()
    assert {"cff-version", "message", "title", "authors"} <= CITATION.keys()
    assert len(set(CITATION["keywords"])) == len(CITATION["keywords"]) > 0
    for reference in CITATION["references"]:
        assert faults(reference, REFERENCE_KEYS, {"authors"}) == set()
        assert {"authors", "title", "type"} <= reference.keys()


@pytest.mark.parametrize("entry", [CITATION, *CITATION["references"]], ids=["software", "paper"])
def test_authors_are_persons_or_entities(entry):
    assert entry["authors"]
    for author in entry["authors"]:
        assert set(author) in ({"name"}, {"family-names", "given-names"})
        assert all(re.fullmatch(TEXT, name) for name in author.values())


def test_it_is_of_this_version_and_its_day():
    assert CITATION["version"] == __version__
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## [{__version__}] - {CITATION['date-released']}\n" in changes


def test_it_says_what_the_project_says():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert (CITATION["title"], CITATION["license"]) == (project["name"], project["license"])
    assert CITATION["abstract"].rstrip(".") == project["description"]
    formulas = (ROOT / "docs" / "formulas.md").read_text(encoding="utf-8")
    assert f'"{CITATION["references"][0]["title"]}"' in formulas
