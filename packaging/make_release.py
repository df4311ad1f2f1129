#!/usr/bin/env python3
"""Makes what a release consists of, and proves the wheel in an environment of its own.

The sdist is built from the commit that is checked out, and the wheel from the sdist, so that each holds what
the next needs. Both are built with the installed setuptools; nothing is fetched. The wheel is installed into
a fresh environment. There it names its version, checks a shipped mission, plans it and flies it in the
simulator. make_deb.py makes and tries the Debian package, where that can be done. What passes is put into
dist, beside a bill of materials, the checksums and the notes: the newest section of CHANGELOG.md.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import logging
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import zipfile
from pathlib import Path

from prove_image import listed, normal

SOURCE = Path(__file__).resolve().parents[1]
MISSION = "mission_configs/first-flight.yaml"
PACKAGES = {"companion": "companion", "sim": "companion_sim"}  # A wheel's package, by directory.
NOT_PACKED = {"companion/kernels/ruff.toml"}  # A linter's settings are for the checkout.
OURS = (
    "safe_rrt_companion-*", "safe-rrt-companion_*.deb", "safe-rrt-companion_*.image.tar", "SHA256SUMS",
    "RELEASE_NOTES.md",
)  # fmt: skip
LOCK = "requirements/service.txt"
LOCKED = re.compile(r"(?m)^([A-Za-z0-9._-]+)(?:\[[^\]]*\])?==([^\s;]+)")
BILL_MAKER = SOURCE / ".venv-sbom/bin/cyclonedx-py"
DEB_CANNOT = 3  # make_deb.py's exit code where this computer lacks what it needs
HEADING = re.compile(r"^## \[(?P<name>[^\]]+)\](?: - (?P<date>\d{4}-\d{2}-\d{2}))?$", flags=re.MULTILINE)
BUILD = (
    "import sys; from setuptools import build_meta; getattr(build_meta, 'build_' + sys.argv[1])(sys.argv[2])"
)

log = logging.getLogger("release")


def newest_section(changelog: str) -> tuple[str, str]:
    """Return the name of the newest section of a changelog, and its text without the heading.

    Raises
    ------
    ValueError
        If there is no section, or the newest one is empty.
    """
    headings = list(HEADING.finditer(changelog))
    if not headings:
        raise ValueError("CHANGELOG.md has no section")
    end = headings[1].start() if len(headings) > 1 else len(changelog)
    text = changelog[headings[0].end() : end].strip()
    if not text:
        raise ValueError(f"the section [{headings[0]['name']}] of CHANGELOG.md is empty")
    return headings[0]["name"], text


def left_out(tracked: list[str], packed: list[str]) -> list[str]:
    """Return the tracked files of the packages that a wheel lacks."""
    folders = {name: name.partition("/")[0] for name in set(tracked) - NOT_PACKED}
    places = {
        name: PACKAGES[folder] + name.removeprefix(folder)
        for name, folder in folders.items()
        if folder in PACKAGES
    }
    return sorted(name for name, place in places.items() if place not in packed)


def strangers(packed: list[str]) -> list[str]:
    """Return what a wheel would put into an environment beside the packages and its metadata."""
    tops = {name.partition("/")[0] for name in packed}
    return sorted(top for top in tops - set(PACKAGES.values()) if not top.endswith(".dist-info"))


def checksums(files: list[Path]) -> str:
    """Return lines of SHA-256 and name, as ``sha256sum --check`` reads them."""
    digests = ((hashlib.sha256(file.read_bytes()).hexdigest(), file.name) for file in sorted(files))
    return "".join(f"{digest}  {name}\n" for digest, name in digests)


def locked(lock: str) -> set[tuple[str, str]]:
    """Return name and version of each package in a lock file."""
    return {(normal(name), version) for name, version in LOCKED.findall(lock)}


def bill_of_materials(tree: Path, version: str) -> str:
    """Return what the service is installed with, by its lock file, as CycloneDX JSON.

    Raises
    ------
    RuntimeError
        If it lists something else.
    """
    told = _ran(
        BILL_MAKER, "requirements", "--pyproject", "pyproject.toml", "--output-reproducible",
        "--output-format", "JSON", LOCK, folder=tree,
    )  # fmt: skip
    bill = json.loads(told)
    bill["metadata"]["component"]["version"] = version  # pyproject.toml leaves it to the program
    differs = listed(bill) ^ locked((tree / LOCK).read_text(encoding="utf-8"))
    if differs:
        raise RuntimeError(f"the bill of materials is of something else: {sorted(differs)[:5]}")
    return json.dumps(bill, indent=2, sort_keys=True) + "\n"


def debian_package(work: Path) -> list[Path]:
    """Return the Debian package and the image of this commit, or nothing where none can be made.

    Raises
    ------
    RuntimeError
        If it does not pass.
    """
    place = work / "deb"
    program = SOURCE / "packaging/make_deb.py"
    code = subprocess.run([sys.executable, program, "--to", place], cwd=SOURCE, check=False).returncode
    if code == DEB_CANNOT:
        return []
    if code != 0:
        raise RuntimeError("the Debian package does not pass")
    return [*place.glob("*.deb"), *place.glob("*.image.tar")]


def _ran(*command: str | Path, folder: Path, environment: dict[str, str] | None = None) -> str:
    """Return what a program says.

    Raises
    ------
    RuntimeError
        If it fails; with the end of what it said.
    """
    done = subprocess.run(
        [str(word) for word in command],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        last = " | ".join((done.stdout + done.stderr).strip().splitlines()[-6:])
        raise RuntimeError(f"{Path(command[0]).name} {command[-1]}: exit code {done.returncode}: {last}")
    return done.stdout.strip()


def _clean_environment(**more: str) -> dict[str, str]:
    """Return this environment without what would lead Python back to the checkout."""
    return {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")} | more


def committed_tree(work: Path) -> Path:
    """Return a folder with the files of the commit that is checked out.

    Raises
    ------
    ValueError
        If files differ from it.
    """
    changed = _ran("git", "status", "--porcelain", "--untracked-files=no", folder=SOURCE)
    if changed:
        raise ValueError(f"files differ from the commit: {', '.join(changed.splitlines()[:3])}")
    packed = subprocess.run(["git", "archive", "HEAD"], cwd=SOURCE, capture_output=True, check=True).stdout
    tree = work / "tree"
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        archive.extractall(tree, filter="data")
    return tree


def built(kind: str, tree: Path, target: Path) -> Path:
    """Return the sdist or the wheel of a tree, built without isolation."""
    target.mkdir(exist_ok=True)
    stamp = _ran("git", "log", "-1", "--format=%ct", folder=SOURCE)  # The wheel's files have this time.
    _ran(
        sys.executable, "-c", BUILD, kind, target, folder=tree,
        environment=_clean_environment(SOURCE_DATE_EPOCH=stamp),
    )  # fmt: skip
    (made,) = target.glob("*.tar.gz" if kind == "sdist" else "*.whl")
    return made


def prove(wheel: Path, version: str, tree: Path, work: Path) -> None:
    """Install a wheel into a fresh environment, and use it as somebody who has no checkout.

    The packages that it needs come from the environment that runs this, by a path that only the proof has:
    a user's installer fetches them.

    Raises
    ------
    RuntimeError
        If something fails, or another copy of the program answers.
    """
    place = work / "environment"
    _ran(sys.executable, "-m", "venv", "--without-pip", place, folder=work)
    python = place / "bin" / "python"
    site = Path(_ran(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", folder=work))
    _ran(
        sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--disable-pip-version-check",
        "--no-index", "--no-deps", wheel, folder=work,
    )  # fmt: skip
    needed = Path(sysconfig.get_path("purelib"))
    (site / "needed.pth").write_text(f"{needed}\n", encoding="utf-8")
    (site / "jsbsim").symlink_to(needed / "jsbsim")  # It looks for its data in the environment's own folder.
    environment = _clean_environment()
    where = _ran(
        python, "-c", "import companion; print(companion.__file__)", folder=work, environment=environment
    )
    if not where.startswith(str(site)):
        raise RuntimeError(f"the proof used {where}")
    shutil.copy(tree / MISSION, work / "mission.yaml")
    program = place / "bin" / "companion"
    told = _ran(program, "--version", folder=work, environment=environment)
    if told != version:
        raise RuntimeError(f"the wheel is of version {version}, and says {told}")
    for command in (["check"], ["plan"], ["sitl", "--headless"]):
        _ran(program, *command, "mission.yaml", folder=work, environment=environment)
        log.info("companion %s: passes", " ".join(command))


def make(target: Path, work: Path, *, has_deb: bool = True) -> None:
    """Build and prove everything, and put it into a folder in place of an earlier release.

    Parameters
    ----------
    target : Path
        The folder.
    work : Path
        A folder for what is on the way.
    has_deb : bool
        Whether the Debian package is part of it.

    Raises
    ------
    ValueError, RuntimeError
        If something is missing or does not pass.
    """
    tree = committed_tree(work)
    section, notes = newest_section((tree / "CHANGELOG.md").read_text(encoding="utf-8"))
    sdist = built("sdist", tree, work / "sdist")
    with tarfile.open(sdist) as archive:
        archive.extractall(work, filter="data")
    wheel = built("wheel", work / sdist.name.removesuffix(".tar.gz"), work / "wheel")
    version = wheel.name.split("-")[1]
    log.info("%s, %s", sdist.name, wheel.name)
    if section not in (version, "Unreleased"):
        raise ValueError(f"the newest section of CHANGELOG.md is [{section}], and the version is {version}")
    tracked = _ran("git", "ls-files", *PACKAGES, folder=SOURCE).splitlines()
    with zipfile.ZipFile(wheel) as packed:
        names = packed.namelist()
    if missing := left_out(tracked, names):
        raise RuntimeError(f"the wheel lacks {len(missing)} files, the first is {missing[0]}")
    if others := strangers(names):
        raise RuntimeError(f"the wheel installs {', '.join(others)}, too")
    prove(wheel, version, tree, work)
    bill = work / f"{wheel.name.split('-')[0]}-{version}.cdx.json"
    bill.write_text(bill_of_materials(tree, version), encoding="utf-8")
    made = [sdist, wheel, bill, *(debian_package(work) if has_deb else [])]
    title = version if section == version else f"{section}, since {version}"
    target.mkdir(parents=True, exist_ok=True)
    for file in (found for pattern in OURS for found in target.glob(pattern)):
        file.unlink()
    for file in made:
        shutil.copy(file, target)
    (target / "SHA256SUMS").write_text(checksums(made), encoding="utf-8")
    (target / "RELEASE_NOTES.md").write_text(f"# {title}\n\n{notes}\n", encoding="utf-8")
    if section != version:
        log.info("a rehearsal: for a release the newest section of CHANGELOG.md has a version and a day")
    log.info("in %s: %s", target.name, ", ".join(sorted(file.name for file in target.iterdir())))


def main() -> int:
    """Make a release; the exit code says whether it passed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--to", type=Path, default=SOURCE / "dist", help="folder of the result")
    parser.add_argument("--no-deb", action="store_true", help="without the Debian package")
    options = parser.parse_args()
    target = options.to.resolve()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    try:
        with tempfile.TemporaryDirectory() as work:
            make(target, Path(work).resolve(), has_deb=not options.no_deb)
    except (OSError, ValueError, RuntimeError, subprocess.SubprocessError) as error:
        log.error("no release: %s", error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
