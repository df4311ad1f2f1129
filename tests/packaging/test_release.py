"""What a release consists of: notes, checksums, a bill of materials, and a wheel that lacks nothing."""

import configparser
import hashlib
import json
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from companion import __version__
from tests.packaging.tools import loaded

ROOT = Path(__file__).parents[2]
LOCK = (ROOT / "requirements" / "service.txt").read_text(encoding="utf-8")


release = loaded("make_release")


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
    assert release.left_out(["sim/a.py", "sim/b.py"], ["companion_sim/a.py", "sim/b.py"]) == ["sim/b.py"]


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """The tracked files that an installation needs, as they are in the work tree."""
    made = tmp_path_factory.mktemp("tree")
    listed = subprocess.run(
        ["git", "ls-files", "companion", "sim", "pyproject.toml", "setup.py", "README.md"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    ).stdout.split()  # fmt: skip
    for name in listed:
        (made / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, made / name)
    return made


def commands(wheel):
    """The commands that a wheel adds to the program, by name."""
    with zipfile.ZipFile(wheel) as packed:
        (name,) = (name for name in packed.namelist() if name.endswith("/entry_points.txt"))
        read = configparser.ConfigParser()
        read.read_string(packed.read(name).decode())
    return dict(read["companion.commands"])


def test_a_wheel_installs_the_simulator_under_a_name_of_its_own(tree, tmp_path):
    wheel = release.built("wheel", tree, tmp_path)
    with zipfile.ZipFile(wheel) as packed:
        names = packed.namelist()
    assert {name.partition("/")[0] for name in names if ".dist-info/" not in name} == {
        "companion",
        "companion_sim",
    }
    assert release.strangers(names) == []
    assert release.strangers([*names, "sim/__init__.py"]) == ["sim"]
    assert "companion_sim/vehicle/aircraft/small_uav/small_uav.xml" in names
    assert {place.partition(".")[0] for place in commands(wheel).values()} == {"companion_sim"}


def test_an_editable_installation_names_the_simulator_as_the_checkout_does(tree, tmp_path):
    """An installer may prepare the metadata first, and then they are those of a wheel."""
    subprocess.run(
        [sys.executable, "-c",
         "import sys; from setuptools import build_meta as build; place = sys.argv[1];"
         "prepared = build.prepare_metadata_for_build_editable(place);"
         "build.build_editable(place, None, f'{place}/{prepared}')",
         tmp_path],
        cwd=tree, check=True, capture_output=True,
    )  # fmt: skip
    (wheel,) = tmp_path.glob("*.whl")
    assert {place.partition(".")[0] for place in commands(wheel).values()} == {"sim"}


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


@pytest.fixture
def bill(monkeypatch):
    """Let another bill be made than that of the lock file."""

    def given(components):
        told = {"bomFormat": "CycloneDX", "metadata": {"component": {}}, "components": components}
        monkeypatch.setattr(release, "_ran", lambda *command, folder: json.dumps(told))

    return given


def test_a_bill_of_materials_names_the_version_and_lists_the_lock_file(bill):
    rows = [{"name": name, "version": version} for name, version in release.locked(LOCK)]
    assert {"name": "numpy", "version": re.search(r"(?m)^numpy==(\S+)", LOCK)[1]} in rows
    bill(rows)
    made = json.loads(release.bill_of_materials(ROOT, "1.2.3"))
    assert made["metadata"]["component"]["version"] == "1.2.3"
    bill([*rows, {"name": "another", "version": "1"}])
    with pytest.raises(RuntimeError, match=r"of something else: .*another"):
        release.bill_of_materials(ROOT, "1.2.3")


@pytest.mark.parametrize(("code", "names"), [(0, ["a.deb"]), (release.DEB_CANNOT, [])])
def test_a_release_has_a_debian_package_where_one_can_be_made(tmp_path, monkeypatch, code, names):
    def stand_in(command, **_):
        if code == 0:
            (tmp_path / "deb").mkdir()
            (tmp_path / "deb" / "a.deb").touch()
        return subprocess.CompletedProcess(command, code)

    monkeypatch.setattr(release.subprocess, "run", stand_in)
    assert [path.name for path in release.debian_package(tmp_path)] == names


def test_a_debian_package_that_does_not_pass_ends_the_release(tmp_path, monkeypatch):
    monkeypatch.setattr(
        release.subprocess, "run", lambda command, **_: subprocess.CompletedProcess(command, 1)
    )
    with pytest.raises(RuntimeError, match="does not pass"):
        release.debian_package(tmp_path)


@pytest.mark.slow
def test_a_commit_becomes_a_release_whose_wheel_plans_by_itself(tmp_path, monkeypatch):
    """Of a copy with one commit, so that it does not matter what is being changed here."""
    if not release.BILL_MAKER.exists():
        pytest.skip("make release makes the environment of the bill of materials")
    copy = tmp_path / "checkout"
    for command in (["clone", "--quiet", ROOT, copy], ["-C", copy, "rev-parse", "HEAD"]):
        subprocess.run(["git", *command], check=True, capture_output=True)
    monkeypatch.setattr(release, "SOURCE", copy)
    work, target = tmp_path / "work", tmp_path / "dist"
    work.mkdir()
    release.make(target, work, has_deb=False)
    assert {file.name for file in target.iterdir()} == {
        f"safe_rrt_companion-{__version__}.tar.gz", f"safe_rrt_companion-{__version__}-py3-none-any.whl",
        f"safe_rrt_companion-{__version__}.cdx.json", "SHA256SUMS", "RELEASE_NOTES.md",
    }  # fmt: skip
    assert (target / "SHA256SUMS").read_text(encoding="utf-8").count("\n") == 3
    notes = (target / "RELEASE_NOTES.md").read_text(encoding="utf-8")
    assert notes.startswith((f"# {__version__}\n\n", f"# Unreleased, since {__version__}\n\n"))
    (copy / "README.md").write_text("changed", encoding="utf-8")
    with pytest.raises(ValueError, match=r"differ from the commit: .*README\.md"):
        release.make(target, work, has_deb=False)


def test_what_fails_ends_it_with_the_words_of_the_program(tmp_path):
    with pytest.raises(RuntimeError, match="exit code 3: no luck"):
        release._ran(sys.executable, "-c", "import sys; print('no luck'); sys.exit(3)", folder=tmp_path)
