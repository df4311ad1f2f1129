"""The Debian package's files, versions and scripts. ``make deb`` makes it and tries it in a clean Debian."""

import itertools
import os
import subprocess
from pathlib import Path

import pytest

from tests.packaging.tools import ROOT, loaded, needed

deb = loaded("make_deb")
proof = loaded("prove_deb")
TEMPLATES = ROOT / "packaging" / "debian"


@pytest.fixture
def image(tmp_path):
    """What is taken from an image, and what is not."""
    root = tmp_path / "image"
    for name in (
        "opt/companion/bin/companion", "opt/companion/bin/pip", "opt/companion/lib/python3.11/x.py",
        "opt/companion/lib/python3.11/__pycache__/x.pyc", "var/cache/companion/kernels/k.o",
        "var/cache/companion/kernels/k.bc", "opt/companion/share/sbom.cdx.json",
    ):  # fmt: skip
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(name, encoding="ascii")
    return root


@pytest.fixture
def package(image, tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    root = tmp_path / "package"
    deb.lay_out(image, ROOT, root, "11")
    deb.describe(root, ROOT, "1.0+deb12", "amd64", "11")
    deb._set_modes(root)
    return root


def files(root):
    return {path.relative_to(root).as_posix() for path in root.rglob("*") if not path.is_dir()}


def test_versions_have_the_order_of_what_they_are_made_of():
    made = [
        deb.debian_version(*of) for of in
        (("1.0rc1", "12"), ("1.0", "12"), ("1.0", "12", "202601010000"), ("1.0", "12", "202601020000"),
         ("1.0.1.dev3", "12"), ("1.0.1", "12"))
    ]  # fmt: skip
    assert made[:3] == ["1.0~rc1+deb12", "1.0+deb12", "1.0+deb12+202601010000"]
    program = needed("dpkg")
    for older, newer in itertools.pairwise(made):
        subprocess.run([program, "--compare-versions", older, "lt", newer], check=True)


def test_the_images_program_and_kernels_are_in_it_and_what_made_them_is_not(package):
    program = {name for name in files(package) if name.startswith("opt/")}
    links = {"opt/companion/bin/python", "opt/companion/bin/python3", "opt/companion/bin/python3.11"}
    assert program == links | {
        "opt/companion/bin/companion", "opt/companion/lib/python3.11/x.py", "opt/companion/pyvenv.cfg",
        "opt/companion/share/companion/kernels/k.o", "opt/companion/share/sbom.cdx.json",
        "opt/companion/share/doc",
    }  # fmt: skip
    for link in links:
        assert os.readlink(package / link) == "/usr/bin/python3.11"


def test_what_the_operator_edits_is_kept_and_not_for_everybody_to_read(package):
    listed = (package / "DEBIAN/conffiles").read_text(encoding="ascii").splitlines()
    assert {f"/{name}" for name in files(package) if name.startswith("etc/")} == set(listed)
    assert {(package / name.lstrip("/")).stat().st_mode & 0o777 for name in listed} == {0o640}
    assert (package / "opt/companion/bin/companion").stat().st_mode & 0o777 == 0o755
    assert (package / "opt/companion/lib/python3.11/x.py").stat().st_mode & 0o777 == 0o644


def test_its_control_file_names_the_python_that_it_is_for_and_every_file_has_a_sum(package):
    control = (package / "DEBIAN/control").read_text(encoding="utf-8")
    assert "\nVersion: 1.0+deb12\n" in control
    assert "python3 (>= 3.11), python3 (<< 3.12)" in control
    summed = {line.split("  ")[1] for line in deb.sums(package).splitlines()}
    own = {name for name in files(package) if not (package / name).is_symlink()}
    assert summed == {name for name in own if not name.startswith(("DEBIAN/", "etc/"))}


def test_folders_that_were_emptied_are_left_out(tmp_path):
    (tmp_path / "a/b/c").mkdir(parents=True)
    (tmp_path / "d").mkdir()
    (tmp_path / "d/file").touch()
    deb._remove_empty_folders(tmp_path)
    assert [path.name for path in tmp_path.rglob("*")] == ["d", "file"]


def test_the_unit_starts_nothing_until_the_program_is_whole():
    stamp = "/opt/companion/installed"
    assert f"AssertPathExists={stamp}\n" in (TEMPLATES / "package.conf").read_text(encoding="utf-8")
    assert stamp == f"/{proof.STAMP}"
    first = (TEMPLATES / "prerm").read_text(encoding="utf-8").index(f"rm -f {stamp}")
    assert first < (TEMPLATES / "prerm").read_text(encoding="utf-8").index("stop companion.service")
    lines = (TEMPLATES / "postinst").read_text(encoding="utf-8").splitlines()
    assert lines.index(f"echo package > {stamp}") > lines.index(
        "py3compile -p safe-rrt-companion /opt/companion"
    )


def test_purge_names_every_folder_that_the_unit_has():
    unit = (ROOT / "packaging/companion.service").read_text(encoding="utf-8")
    kinds = {"State": "/var/lib", "Cache": "/var/cache", "Logs": "/var/log", "Configuration": "/etc"}
    removed = (TEMPLATES / "postrm").read_text(encoding="utf-8").split()
    for kind, base in kinds.items():
        assert f"\n{kind}Directory=companion\n" in unit
        assert f"{base}/companion" in removed


def test_what_lintian_may_not_say_of_ours_is_few():
    """Whatever is overridden for packages of others must not hide the same in ours."""
    rows = (TEMPLATES / "lintian-overrides").read_text(encoding="utf-8").splitlines()
    of_all = [row for row in rows if not row.startswith("#") and "site-packages/" not in row]
    assert len(of_all) == 4


@pytest.mark.parametrize("name", deb.SCRIPTS)
def test_shellcheck_finds_nothing(name):
    done = subprocess.run(
        [needed("shellcheck"), "--shell=sh", TEMPLATES / name], capture_output=True, text=True, check=False
    )
    assert done.stdout == ""


def test_a_computer_that_cannot_make_it_is_told_what_it_lacks(monkeypatch):
    monkeypatch.setattr(deb.os, "geteuid", lambda: 1000)
    monkeypatch.setattr(deb.shutil, "which", lambda name: None if name == "lintian" else name)
    assert deb.lacking() == ["root", "lintian"]
    monkeypatch.setattr(deb.sys, "argv", ["make_deb.py"])
    assert deb.main() == deb.EXIT_CANNOT == loaded("make_release").DEB_CANNOT


def test_the_states_digests_show_a_change_of_content_mode_or_name(tmp_path):
    system = proof.Debian.__new__(proof.Debian)
    system.root = tmp_path
    for folder in proof.STATE:
        (tmp_path / folder).mkdir(parents=True)
    file = tmp_path / proof.MISSION
    file.write_text("one", encoding="ascii")
    before = system.state()
    assert list(before) == [proof.MISSION]
    file.chmod(0o600)
    changed = system.state()
    file.write_text("two", encoding="ascii")
    assert len({before[proof.MISSION], changed[proof.MISSION], system.state()[proof.MISSION]}) == 3


def test_dpkgs_own_files_are_not_what_a_package_leaves(tmp_path):
    system = proof.Debian.__new__(proof.Debian)
    system.root = tmp_path
    for name in ("etc/a", "var/lib/dpkg/b", "var/lib/c", "proc/d"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert {"etc/a", "var/lib/c"} <= system.everything()
    assert not {"var/lib/dpkg/b", "proc/d"} & system.everything()
    assert Path(proof.STAMP).name == "installed"
