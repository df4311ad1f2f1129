"""Rows of a campaign name the commit of the checkout in which they were made."""

import shutil
import subprocess
import sys
from pathlib import Path

import companion

ROOT = Path(companion.__file__).parents[1]
ASKED = "from companion.research.campaign.provenance import provenance; print(provenance().commit)"


def git(folder, *arguments):
    command = ["git", "-C", str(folder), "-c", "user.name=n", "-c", "user.email=n@example.org", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def commit_in(folder):
    done = subprocess.run(
        [sys.executable, "-c", ASKED], cwd=folder, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def test_the_commit_is_that_of_the_checkout_and_says_whether_it_was_changed(tmp_path):
    ignored = shutil.ignore_patterns("static", "*.nbi", "*.nbc", "__pycache__")
    shutil.copytree(ROOT / "companion", tmp_path / "companion", ignore=ignored)
    assert commit_in(tmp_path) == "unknown"  # It is no checkout.
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "one")
    head = git(tmp_path, "rev-parse", "HEAD")
    assert commit_in(tmp_path) == head
    (tmp_path / "companion" / "py.typed").write_text("changed\n", encoding="utf-8")
    assert commit_in(tmp_path) == f"{head}-changed"
