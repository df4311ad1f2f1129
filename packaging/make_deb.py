#!/usr/bin/env python3
"""Makes the Debian package and the image of the commit that is checked out, and tries them.

The package holds what the image holds: the Dockerfile is carried out in a clean Debian, as ``make image``
does, and the program, its Python packages and its compiled kernels are taken from there. So they come from
the lock file by their hashes, and the package is for that Debian, its Python and this architecture. lintian
must find nothing. prove_deb.py then installs, upgrades, breaks off and purges it in a clean Debian, and
prove_systemd.py under systemd. Needs root, debootstrap and lintian.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import logging
import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
import time
from email.utils import formatdate
from pathlib import Path

from image_archive import image_archive, prove_image_archive
from make_release import committed_tree, newest_section
from prove_deb import prove
from prove_image import Builder, Stage, instructions
from prove_systemd import prove_under_systemd

SOURCE = Path(__file__).resolve().parents[1]
NAME = "safe-rrt-companion"
MADE = (f"{NAME}_*.deb", f"{NAME}_*.image.tar")
DOCUMENTS = f"usr/share/doc/{NAME}"
MAINTAINER = re.compile(r"(?m)^Maintainer: (.+)$")
BASE = re.compile(r"^FROM python:3\.(?P<minor>\d+)-slim-(?P<release>\w+)", flags=re.MULTILINE)
VERSION = re.compile(r'(?m)^__version__ = "([^"]+)"$')
PRE_RELEASE = re.compile(r"\.?(a|b|rc|dev)(\d+)")
NEEDED = ("debootstrap", "dpkg-deb", "lintian", "nsenter", "unshare")
SCRIPTS = ("preinst", "postinst", "prerm", "postrm")
CONFIGURATION = {
    "packaging/environment.example": "etc/companion/environment",
    "mission_configs/first-flight.yaml": "etc/companion/mission.yaml",
}
SHIPPED = {
    "packaging/companion.service": "lib/systemd/system/companion.service",
    "packaging/debian/package.conf": "lib/systemd/system/companion.service.d/package.conf",
    "packaging/companion.sysusers": "usr/lib/sysusers.d/companion.conf",
    "packaging/companion.tmpfiles": "usr/lib/tmpfiles.d/companion.conf",
    "packaging/99-companion.rules.example": f"{DOCUMENTS}/99-companion.rules.example",
    "README.md": f"{DOCUMENTS}/README.md",
    "CHANGELOG.md": f"{DOCUMENTS}/CHANGELOG.md",
    "packaging/debian/copyright": f"{DOCUMENTS}/copyright",
    "packaging/debian/lintian-overrides": f"usr/share/lintian/overrides/{NAME}",
}
EXIT_CANNOT = 3  # Something that it needs is not on this computer.

log = logging.getLogger("deb")


def lacking() -> list[str]:
    """Return what this computer lacks to make a package."""
    programs = [name for name in NEEDED if shutil.which(name) is None]
    return programs if os.geteuid() == 0 else ["root", *programs]


def debian_version(version: str, debian: str, snapshot: str = "") -> str:
    """Return a version as Debian orders it.

    Parameters
    ----------
    version : str
        As Python writes it.
    debian : str
        Number of the Debian release.
    snapshot : str, optional
        When the commit was made, if it is none of a release: such a package is newer than the last release.
    """
    ordered = PRE_RELEASE.sub(r"~\1\2", version)  # 1.0~rc1 comes before 1.0
    return f"{ordered}+deb{debian}" + (f"+{snapshot}" if snapshot else "")


def sums(root: Path) -> str:
    """Return the MD5 sums of a package's files, as dpkg keeps them to tell changed files."""
    files = sorted(path for path in root.rglob("*") if path.is_file() and not path.is_symlink())
    own = [path for path in files if path.relative_to(root).parts[0] not in ("DEBIAN", "etc")]
    digests = ((hashlib.md5(path.read_bytes()).hexdigest(), path.relative_to(root)) for path in own)
    return "".join(f"{digest}  {name}\n" for digest, name in digests)


def lay_out(image: Path, tree: Path, root: Path, minor: str) -> None:
    """Put the files of a package in place: the image's program, and what the checkout has beside it."""
    program = root / "opt/companion"
    shutil.copytree(
        image / "opt/companion", program, symlinks=True, ignore=shutil.ignore_patterns("__pycache__", "bin")
    )
    (program / "bin").mkdir()
    shutil.copy(image / "opt/companion/bin/companion", program / "bin")
    for name in ("python", "python3", f"python3.{minor}"):
        (program / "bin" / name).symlink_to(f"/usr/bin/python3.{minor}")
    (program / "pyvenv.cfg").write_text(
        "home = /usr/bin\ninclude-system-site-packages = false\n", encoding="ascii"
    )
    kernels = program / "share/companion/kernels"
    kernels.mkdir(parents=True)
    for file in (image / "var/cache/companion/kernels").glob("*.o"):
        shutil.copy(file, kernels)
    shutil.copytree(tree / "mission_configs", root / "usr/share/companion/mission_configs")
    for source, target in (CONFIGURATION | SHIPPED).items():
        (root / target).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(tree / source, root / target)
    (program / "share/doc").symlink_to(f"/{DOCUMENTS}")  # where the unit refers to it
    (root / "usr/bin").mkdir()
    (root / "usr/bin/companion").symlink_to("/opt/companion/bin/companion")
    manual = root / "usr/share/man/man1/companion.1.gz"
    manual.parent.mkdir(parents=True)
    manual.write_bytes(
        gzip.compress((tree / "packaging/debian/companion.1").read_bytes(), mtime=0, compresslevel=9)
    )


def _remove_empty_folders(root: Path) -> None:
    """Remove what trimming the image has left empty."""
    for folder, _, _ in os.walk(root, topdown=False):
        if not os.listdir(folder):
            os.rmdir(folder)


def _set_modes(root: Path) -> None:
    """Give every file the mode that it has for everybody, whatever the one who builds has set."""
    for path in (root, *root.rglob("*")):
        if path.is_symlink():
            continue
        is_run = path.is_dir() or path.name in SCRIPTS or path.parent.name == "bin"
        path.chmod(0o755 if is_run else 0o644)
    for target in CONFIGURATION.values():
        (root / target).chmod(0o640)  # a token may be written into it


def describe(root: Path, tree: Path, version: str, architecture: str, minor: str) -> None:
    """Write what dpkg reads of a package: its control files, and the changelog that Debian asks for."""
    templates, control = tree / "packaging/debian", root / "DEBIAN"
    control.mkdir()
    text = (templates / "control").read_text(encoding="utf-8")
    maintainer = MAINTAINER.search(text)
    assert maintainer is not None
    moment = formatdate(float(os.environ["SOURCE_DATE_EPOCH"]))
    changelog = f"{NAME} ({version}) unstable; urgency=medium\n\n  * CHANGELOG.md beside this file"
    changelog += f" tells what is new.\n\n -- {maintainer[1]}  {moment}\n"
    (root / DOCUMENTS / "changelog.gz").write_bytes(
        gzip.compress(changelog.encode(), mtime=0, compresslevel=9)
    )
    for name in SCRIPTS:
        shutil.copy(templates / name, control)
    (control / "conffiles").write_text(
        "".join(f"/{target}\n" for target in CONFIGURATION.values()), encoding="ascii"
    )
    (control / "md5sums").write_text(sums(root), encoding="utf-8")
    size_kb = sum(path.lstat().st_size for path in root.rglob("*") if stat.S_ISREG(path.lstat().st_mode))
    (control / "control").write_text(
        text.format(
            version=version, architecture=architecture, size_kb=size_kb // 1024 + 1,
            python=f"3.{minor}", next_python=f"3.{int(minor) + 1}",
        ),
        encoding="utf-8",
    )  # fmt: skip


def image_of(tree: Path, cache: Path, work: Path) -> Stage:
    """Return the image that a checkout's Dockerfile describes."""
    builder = Builder(cache, work, tree)
    for step in instructions((tree / "Dockerfile").read_text(encoding="utf-8")):
        log.info("Dockerfile:%d: %s %.60s", step.line, step.word, step.rest)
        builder.carry_out(step)
    return builder.stage


def version_of(tree: Path) -> str:
    """Return the version that a checkout says it is of.

    Raises
    ------
    ValueError
        If it says none.
    """
    found = VERSION.search((tree / "companion/__init__.py").read_text(encoding="utf-8"))
    if found is None:
        raise ValueError("companion names no version")
    return found[1]


def packed(image: Path, tree: Path, work: Path) -> Path:
    """Return the package of a checkout and its image.

    Raises
    ------
    ValueError
        If the checkout does not say its version, or for which Python and Debian it is.
    """
    base, own = BASE.search((tree / "Dockerfile").read_text(encoding="utf-8")), version_of(tree)
    if base is None:
        raise ValueError("the Dockerfile names no Python and Debian")
    section, _ = newest_section((tree / "CHANGELOG.md").read_text(encoding="utf-8"))
    moment = time.strftime("%Y%m%d%H%M", time.gmtime(float(os.environ["SOURCE_DATE_EPOCH"])))
    debian = (image / "etc/debian_version").read_text(encoding="ascii").partition(".")[0].strip()
    version = debian_version(own, debian, "" if section == own else moment)
    architecture, root = _said("dpkg", "--print-architecture"), work / "package"
    lay_out(image, tree, root, base["minor"])
    _remove_empty_folders(root)
    describe(root, tree, version, architecture, base["minor"])
    _set_modes(root)
    made = work / f"{NAME}_{version}_{architecture}.deb"
    subprocess.run(["dpkg-deb", "--root-owner-group", "-Zxz", "--build", root, made], check=True)
    log.info("%s: %.0f MB", made.name, made.stat().st_size / 1e6)
    return made


def check(package: Path) -> None:
    """Let lintian look at a package; raises CalledProcessError if it finds something."""
    subprocess.run(
        ["lintian", "--allow-root", "--display-info", "--fail-on", "error,warning,info", package], check=True
    )
    log.info("lintian has nothing to say")


def _said(*command: str | Path) -> str:
    return subprocess.run(command, cwd=SOURCE, check=True, capture_output=True, text=True).stdout.strip()


def main() -> int:
    """Make and try the package; the exit code says whether it passed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    parser.add_argument("--cache", type=Path, default=Path(home) / "companion-image")
    parser.add_argument("--to", type=Path, default=SOURCE / "dist", help="folder of the result")
    options = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if lacks := lacking():
        log.error("no Debian package: this computer lacks %s", ", ".join(lacks))
        return EXIT_CANNOT
    cache, target = options.cache.resolve(), options.to.resolve()
    cache.mkdir(parents=True, exist_ok=True)
    target.mkdir(parents=True, exist_ok=True)
    os.environ["SOURCE_DATE_EPOCH"] = _said("git", "log", "-1", "--format=%ct")
    os.umask(0o022)
    try:
        with tempfile.TemporaryDirectory(dir=cache) as name:
            work = Path(name)
            tree = committed_tree(work)
            image = image_of(tree, cache, work)
            made = packed(image.root, tree, work)
            check(made)
            version, architecture = version_of(tree), _said("dpkg", "--print-architecture")
            archive = image_archive(image, version, architecture, work)
            prove_image_archive(archive, work)
            prove(made, cache, work)
            prove_under_systemd(made, cache, work)
            for old in (found for pattern in MADE for found in target.glob(pattern)):
                old.unlink()
            for file in (made, archive):
                shutil.copy(file, target)
    except (OSError, ValueError, RuntimeError, subprocess.SubprocessError) as error:
        log.error("no Debian package: %s", error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
