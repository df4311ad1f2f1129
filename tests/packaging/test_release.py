"""What a release consists of: its notes, its checksums, and a wheel that lacks nothing."""

import hashlib
import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from companion import __version__

ROOT = Path(__file__).parents[2]


def loaded():
    spec = importlib.util.spec_from_file_location("make_release", ROOT / "packaging" / "make_release.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


release = loaded()


def test_the_notes_are_the_newest_section_whole_and_nothing_else():
    older = "\n\n## [0.2.0] - 2026-11-21\n\n- Old.\n"
    text = "# Changelog\n\nWords.\n\n## [0.3.0] - 2027-01-02\n\n### In flight\n\n- One."
    assert release.newest_section(text + older) == ("0.3.0", "### In flight\n\n- One.")
    assert release.newest_section("## [Unreleased]\n\n- New.\n") == ("Unreleased", "- New.")
    name, notes = release.newest_section((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    assert name in ("Unreleased", __version__)
    assert "\n## " not in notes


@pytest.mark.parametrize("text", ["# Changelog\n", "## [Unreleased]\n\n## [0.2.0] - 2026-11-21\n\n- Old.\n"])
def test_a_release_without_notes_is_none(text):
    with pytest.raises(ValueError, match=r"CHANGELOG\.md"):
        release.newest_section(text)


def test_a_file_that_a_wheel_lacks_is_named():
    tracked = ["companion/a.py", "companion/ui/page.css", "companion/kernels/ruff.toml", "docs/README.md"]
    assert release.left_out(tracked, ["companion/a.py", "x.dist-info/RECORD"]) == ["companion/ui/page.css"]
    assert release.left_out(tracked, ["companion/a.py", "companion/ui/page.css"]) == []


def test_checksums_are_read_by_the_program_for_them(tmp_path):
    for name in ("b.whl", "a.tar.gz"):
        (tmp_path / name).write_bytes(name.encode())
    text = release.checksums([tmp_path / "b.whl", tmp_path / "a.tar.gz"])
    assert text.splitlines()[0] == f"{hashlib.sha256(b'a.tar.gz').hexdigest()}  a.tar.gz"
    (tmp_path / "SHA256SUMS").write_text(text, encoding="utf-8")
    done = subprocess.run(
        ["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=tmp_path, capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_commit_becomes_a_release_whose_wheel_plans_by_itself(tmp_path, monkeypatch):
    """Of a copy with one commit, so that it does not matter what is being changed here."""
    copy = tmp_path / "checkout"
    for command in (["clone", "--quiet", ROOT, copy], ["-C", copy, "rev-parse", "HEAD"]):
        subprocess.run(["git", *command], check=True, capture_output=True)
    monkeypatch.setattr(release, "SOURCE", copy)
    work, target = tmp_path / "work", tmp_path / "dist"
    work.mkdir()
    release.make(target, work)
    assert {file.name for file in target.iterdir()} == {
        f"safe_rrt_companion-{__version__}.tar.gz", f"safe_rrt_companion-{__version__}-py3-none-any.whl",
        "SHA256SUMS", "RELEASE_NOTES.md",
    }  # fmt: skip
    notes = (target / "RELEASE_NOTES.md").read_text(encoding="utf-8")
    assert notes.startswith((f"# {__version__}\n\n", f"# Unreleased, since {__version__}\n\n"))
    (copy / "README.md").write_text("changed", encoding="utf-8")
    with pytest.raises(ValueError, match=r"differ from the commit: .*README\.md"):
        release.make(target, work)


def test_what_fails_ends_it_with_the_words_of_the_program(tmp_path):
    with pytest.raises(RuntimeError, match="exit code 3: no luck"):
        release._ran(sys.executable, "-c", "import sys; print('no luck'); sys.exit(3)", folder=tmp_path)
