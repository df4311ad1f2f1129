#!/usr/bin/env python3
"""Makes what a release consists of, and proves the wheel in an environment of its own.

The sdist is built from the commit that is checked out, and the wheel from the sdist, so that each holds what
the next needs. Both are built with the installed setuptools; nothing is fetched. The wheel is installed into
a fresh environment. There it names its version, checks a shipped mission and plans it. What passes is put
into dist, beside the checksums and the notes: the newest section of CHANGELOG.md.
"""

from __future__ import annotations

import argparse
import hashlib
import io
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

SOURCE = Path(__file__).resolve().parents[1]
MISSION = "mission_configs/first-flight.yaml"
PACKAGES = ("companion/", "sim/")
NOT_PACKED = {"companion/kernels/ruff.toml"}  # A linter's settings are for the checkout.
OURS = ("safe_rrt_companion-*", "SHA256SUMS", "RELEASE_NOTES.md")
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
    own = {name for name in tracked if name.startswith(PACKAGES)}
    return sorted(own - NOT_PACKED - set(packed))


def checksums(files: list[Path]) -> str:
    """Return lines of SHA-256 and name, as ``sha256sum --check`` reads them."""
    digests = ((hashlib.sha256(file.read_bytes()).hexdigest(), file.name) for file in sorted(files))
    return "".join(f"{digest}  {name}\n" for digest, name in digests)


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
    (site / "needed.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
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
    for command in ("check", "plan"):
        _ran(program, command, "mission.yaml", folder=work, environment=environment)
        log.info("companion %s: passes", command)


def make(target: Path, work: Path) -> None:
    """Build and prove everything, and put it into a folder in place of an earlier release.

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
        missing = left_out(tracked, packed.namelist())
    if missing:
        raise RuntimeError(f"the wheel lacks {len(missing)} files, the first is {missing[0]}")
    prove(wheel, version, tree, work)
    title = version if section == version else f"{section}, since {version}"
    target.mkdir(parents=True, exist_ok=True)
    for file in (found for pattern in OURS for found in target.glob(pattern)):
        file.unlink()
    for file in (sdist, wheel):
        shutil.copy(file, target)
    (target / "SHA256SUMS").write_text(checksums([sdist, wheel]), encoding="utf-8")
    (target / "RELEASE_NOTES.md").write_text(f"# {title}\n\n{notes}\n", encoding="utf-8")
    if section != version:
        log.info("a rehearsal: for a release the newest section of CHANGELOG.md has a version and a day")
    log.info("in %s: %s", target.name, ", ".join(sorted(file.name for file in target.iterdir())))


def main() -> int:
    """Make a release; the exit code says whether it passed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--to", type=Path, default=SOURCE / "dist", help="folder of the result")
    target = parser.parse_args().to.resolve()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    try:
        with tempfile.TemporaryDirectory() as work:
            make(target, Path(work).resolve())
    except (OSError, ValueError, RuntimeError, subprocess.SubprocessError) as error:
        log.error("no release: %s", error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
