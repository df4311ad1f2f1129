"""install.sh below a folder: again and again, without doing anything, and back."""

import shutil
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
# Stands in for Python: makes an environment with itself in it, and leaves in a folder that it installs from
# what a build leaves there.
PYTHON = """#!/bin/sh
case "$*" in
    "-m venv "*) install -D "$0" "$3/bin/python" ;;
    "-m pip install "*)
        for source; do :; done
        [ ! -d "$source" ] || mkdir "$source/build" "$source/x.egg-info"
        echo "$*: $(echo $(ls "$source"))" >> LOG ;;
esac
"""


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


@pytest.fixture
def checkout(tmp_path):
    """A checkout of one module, whose install.sh puts the program below the root, too."""
    made = tmp_path / "checkout"
    shutil.copytree(SCRIPT.parent, made / "packaging")
    shutil.copytree(SCRIPT.parents[1] / "mission_configs", made / "mission_configs")
    for folder in ("companion", "requirements"):
        (made / folder).mkdir()
    for name in (
        "pyproject.toml",
        "setup.py",
        "README.md",
        "requirements/service.txt",
        "companion/__init__.py",
    ):
        shutil.copy(SCRIPT.parents[1] / name, made / name)
    script = made / "packaging" / "install.sh"
    text = script.read_text(encoding="utf-8").replace("program=no; shift", "shift")
    text = text.replace(" /opt/companion", f" {tmp_path}/opt/companion")
    script.write_text(text.replace("stamp=/opt/", f"stamp={tmp_path}/opt/"), encoding="utf-8")
    python = tmp_path / "python"
    python.write_text(PYTHON.replace("LOG", str(tmp_path / "pip.log")), encoding="utf-8")
    python.chmod(0o755)
    return made


def test_the_program_is_built_in_a_copy_and_the_checkout_stays_as_it_is(checkout, tmp_path):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    before = files(checkout)

    def install(*options):
        subprocess.run(
            ["sh", checkout / "packaging" / "install.sh", "--root", tmp_path / "root", *options,
             "--python", tmp_path / "python"],
            check=True, capture_output=True, env={"PATH": "/usr/bin:/bin", "TMPDIR": str(temporary)},
        )  # fmt: skip

    install("--dry-run")
    assert not (tmp_path / "pip.log").exists()
    install()
    libraries, program = (tmp_path / "pip.log").read_text(encoding="utf-8").splitlines()
    lock = checkout / "requirements" / "service.txt"
    assert libraries.endswith(f" --only-binary :all: --require-hashes -r {lock}: {lock}")
    done, _, inside = program.rpartition(": ")
    assert f" --no-deps --no-build-isolation {temporary}/" in done
    assert inside == "README.md build companion pyproject.toml setup.py x.egg-info"
    assert list(temporary.iterdir()) == []
    assert files(checkout) == before
    assert [path for path in checkout.rglob("*") if path.name in ("build", "x.egg-info")] == []
    install()
    assert len((tmp_path / "pip.log").read_text(encoding="utf-8").splitlines()) == 2
    (checkout / "companion" / "__init__.py").write_text("", encoding="utf-8")
    install()
    assert len((tmp_path / "pip.log").read_text(encoding="utf-8").splitlines()) == 4


def test_purging_without_taking_away_is_refused_and_installs_nothing(install, tmp_path):
    install("--purge", code=2)
    assert files(tmp_path) == set()


@pytest.mark.parametrize("options", [[], ["--uninstall", "--purge"]])
def test_what_the_debian_package_has_installed_is_left_to_it(install, tmp_path, options):
    stamp = tmp_path / "opt/companion/installed"
    stamp.parent.mkdir(parents=True)
    stamp.write_text("package\n", encoding="ascii")
    install(*options, code=1)
    assert files(tmp_path) == {"opt/companion/installed"}


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
