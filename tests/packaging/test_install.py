"""install.sh below a folder: again and again, without doing anything, and back."""

import subprocess
from pathlib import Path

import pytest

from tests.packaging.tools import needed

SCRIPT = Path(__file__).parents[2] / "packaging" / "install.sh"
OURS = {
    "etc/systemd/system/companion.service", "usr/lib/sysusers.d/companion.conf",
    "usr/lib/tmpfiles.d/companion.conf", "opt/companion/share/doc/README.md",
    "opt/companion/share/doc/99-companion.rules.example",
}  # fmt: skip
OPERATORS = {"etc/companion/environment", "etc/companion/mission.yaml"}


@pytest.fixture
def install(tmp_path):
    def run(*options, code=0):
        done = subprocess.run(
            ["sh", SCRIPT, "--root", tmp_path, *options], capture_output=True, text=True, check=False
        )
        assert done.returncode == code, done.stderr
        return [line for line in done.stdout.splitlines() if line.startswith("+")]

    return run


def files(root):
    return {path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()}


def test_everything_is_put_in_place_once(install, tmp_path):
    assert install()
    assert files(tmp_path) == OURS | OPERATORS
    assert install() == []


def test_what_the_operator_edited_stays_and_what_is_ours_is_renewed(install, tmp_path):
    install()
    (tmp_path / "etc/companion/environment").write_text("mine", encoding="utf-8")
    (tmp_path / "etc/systemd/system/companion.service").write_text("old", encoding="utf-8")
    assert len(install()) == 1
    assert (tmp_path / "etc/companion/environment").read_text(encoding="utf-8") == "mine"
    unit = (tmp_path / "etc/systemd/system/companion.service").read_bytes()
    assert unit == (SCRIPT.parent / "companion.service").read_bytes()


@pytest.mark.parametrize("options", [(), ("--uninstall",), ("--uninstall", "--purge")])
def test_a_dry_run_tells_and_does_nothing(install, tmp_path, options):
    if options:
        install()
    before = files(tmp_path)
    assert install("--dry-run", *options)
    assert files(tmp_path) == before


def test_it_is_taken_away_again_but_for_what_is_the_operators(install, tmp_path):
    (tmp_path / "opt").mkdir()
    install()
    install("--uninstall")
    assert files(tmp_path) == OPERATORS
    assert install("--uninstall") == []
    install("--uninstall", "--purge")
    assert files(tmp_path) == set()
    assert (tmp_path / "opt").is_dir()


def test_an_unknown_option_is_bad_usage(install):
    install("--everything", code=2)


def test_the_environment_file_has_what_the_unit_asks_for():
    unit = (SCRIPT.parent / "companion.service").read_text(encoding="utf-8")
    environment = (SCRIPT.parent / "environment.example").read_text(encoding="utf-8")
    for name in ("COMPANION_MISSION", "COMPANION_LINK"):
        assert f"${{{name}}}" in unit
        assert f"\n{name}=" in environment


def test_shellcheck_finds_nothing():
    done = subprocess.run([needed("shellcheck"), SCRIPT], capture_output=True, text=True, check=False)
    assert done.stdout == ""
