"""What ``.ci/audit`` makes of each answer that it may get."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.packaging.tools import needed

SCRIPT = Path(__file__).parents[2] / ".ci" / "audit"
# Stands in for pip-audit: gives the answer laid out for the list, or complains.
PROGRAM = """#!/bin/sh
while [ $# -gt 0 ]; do
    case $1 in --requirement) list=$2 ;; --output) output=$2 ;; esac
    shift
done
echo "$list" >> asked
if [ -f "$list.answer" ]; then cat "$list.answer" > "$output"; grep -q '"id"' "$output" && exit 1; exit 0; fi
cat complaint >&2
exit 1
"""
SOUND = [{"name": "a", "version": "1", "vulns": []}]
UNKNOWN = [{"name": "a", "skip_reason": "not found"}]
WEAK = [{"name": "a", "version": "1", "vulns": [{"id": "CVE-1", "fix_versions": ["2"], "aliases": []}]}]


@pytest.fixture
def audit(tmp_path):
    for folder in (".ci", ".venv/bin", "requirements"):
        (tmp_path / folder).mkdir(parents=True)
    shutil.copy(SCRIPT, tmp_path / ".ci" / "audit")
    program = tmp_path / ".venv/bin/pip-audit"
    program.write_text(PROGRAM, encoding="utf-8")
    program.chmod(0o755)

    def run(complaint="", **answers):
        (tmp_path / "complaint").write_text(complaint, encoding="utf-8")
        for name, rows in answers.items():
            (tmp_path / "requirements" / f"{name}.txt").write_text(len(name) * "x", encoding="utf-8")
            if rows is not None:
                answer = tmp_path / "requirements" / f"{name}.txt.answer"
                answer.write_text(json.dumps({"dependencies": rows}), encoding="utf-8")
        done = subprocess.run(
            ["bash", tmp_path / ".ci" / "audit"], capture_output=True, text=True, check=False, cwd=tmp_path
        )
        return done.returncode, done.stdout, (tmp_path / "asked").read_text(encoding="utf-8").split()

    return run


def test_where_nothing_is_known_to_be_wrong_all_lists_are_asked_about_the_shortest_first(audit):
    code, told, asked = audit(long_one=SOUND, short=SOUND)
    assert code == 0
    assert "1 packages looked up, 0 not known, 0 vulnerabilities" in told
    assert asked == ["requirements/short.txt", "requirements/long_one.txt"]


def test_a_vulnerability_is_a_failure_and_is_told(audit):
    code, told, _ = audit(a=SOUND, bb=SOUND + WEAK)
    assert code == 1
    assert "  a 1: CVE-1, mended in 2" in told


@pytest.mark.parametrize(
    ("complaint", "answers"),
    [
        ("ERROR: ConnectionError: Failed to establish a new connection", {"a": None, "bb": None}),
        ("ERROR: ReadTimeout: timed out", {"a": None, "bb": None}),
        ("", {"a": UNKNOWN, "bb": SOUND}),
    ],
)
def test_where_the_data_cannot_be_had_that_is_said_and_asked_once(audit, complaint, answers):
    code, told, asked = audit(complaint, **answers)
    assert code == 0
    assert "NOT DONE" in told
    assert len(asked) == 1


def test_a_list_that_cannot_be_read_is_a_failure(audit):
    code, told, _ = audit("ERROR: requirement foo is not pinned", a=None)
    assert code == 1
    assert "NOT DONE" not in told


@pytest.mark.parametrize("name", ["audit", "run", "pythons"])
def test_shellcheck_finds_nothing(name):
    done = subprocess.run(
        [needed("shellcheck"), SCRIPT.parent / name], capture_output=True, text=True, check=False
    )
    assert done.stdout == ""
