"""Tries a Debian package in a clean Debian: install, start, upgrade, downgrade, power cuts, purge.

The Debian is that of prove_image.py, and the packages that ours depends on come from where this computer gets
its own. A newer and an older package are the same one with another version and other defaults. A power cut is
SIGKILL for every process of dpkg at once.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import logging
import os
import re
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from prove_image import FROM_OUTSIDE, debian

NAME = "safe-rrt-companion"
RELEASE = "bookworm"
PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
STAMP = "opt/companion/installed"
STATE = ("etc/companion", "var/lib/companion")
ENVIRONMENT, MISSION = "etc/companion/environment", "etc/companion/mission.yaml"
EDITED = "# edited by the operator\nCOMPANION_LINK=udpin://127.0.0.1:14540\n"
NEW_DEFAULT = "# a default of the newer package\n"
ACCOUNTS = ("passwd", "group", "shadow", "gshadow")
# What dpkg and apt keep of their own work, and what they leave of every package.
NOT_COMPARED = ("proc", "dev", "sys", "run", "tmp", "var/log", "var/cache", "var/lib/apt", "var/lib/dpkg")
OLD_CONFIGURATION = ["-o", "Dpkg::Options::=--force-confdef", "-o", "Dpkg::Options::=--force-confold"]
LOG = "var/log/dpkg.log"
READY_MAX_S = 60.0
HEARTBEAT_S = 0.1
# Of system 1, an ArduPlane that is not armed: MAVLink 2, CRC included.
HEARTBEAT = bytes.fromhex("fd090000000101000000000000000103010303894b")

ENTER = """set -e
root=$1 user=$2; shift 2
mount -t proc proc "$root/proc"
mount --rbind /dev "$root/dev"
exec chroot --userspec="$user" "$root" "$@"
"""

log = logging.getLogger("deb")


class Debian:
    """A Debian in a folder, whose processes end when the one that entered it is killed."""

    def __init__(self, root: Path) -> None:
        self.root = root
        shutil.copy("/etc/resolv.conf", root / "etc/resolv.conf")
        outside = {key: value for key, value in os.environ.items() if key.startswith(FROM_OUTSIDE)}
        self._environment = outside | {
            "PATH": PATH, "HOME": "/root", "LC_ALL": "C.UTF-8", "DEBIAN_FRONTEND": "noninteractive",
        }  # fmt: skip

    def started(self, *command: str, user: str = "root", **more: str) -> subprocess.Popen[str]:
        """Start a command in it; more is its environment."""
        entered = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "--propagation", "private"]
        return subprocess.Popen(
            [*entered, "/bin/sh", "-c", ENTER, "enter", str(self.root), user, *command],
            env=self._environment | more,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip

    def ran(self, *command: str, **more: str) -> str:
        """Return what a command says.

        Raises
        ------
        RuntimeError
            If it fails; with the end of what it said.
        """
        with self.started(*command, **more) as running:
            said, _ = running.communicate()
        if running.returncode != 0:
            raise RuntimeError(f"{' '.join(command)}: exit code {running.returncode}: {said[-600:]}")
        return said.strip()

    def install(self, package: Path) -> None:
        """Install a package, newer or older than what there is, as a script of an operator would."""
        shutil.copy(package, self.root / "tmp")
        self.ran(
            "apt-get", "-qq", "install", "--yes", "--no-install-recommends", "--allow-downgrades",
            *OLD_CONFIGURATION, f"/tmp/{package.name}",
        )  # fmt: skip

    def state(self) -> dict[str, str]:
        """Return the digest of every file of the operator and of the service, with its mode and owner."""
        found = {}
        for folder in STATE:
            for path in sorted((self.root / folder).rglob("*")):
                if ".dpkg-" in path.name:  # the package's version of a file that the operator changed
                    continue
                about = path.stat()
                digest = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
                found[str(path.relative_to(self.root))] = f"{digest} {about.st_mode:o} {about.st_uid}"
        return found

    def everything(self) -> set[str]:
        """Return every path that a package could leave behind."""
        found: set[str] = set()
        for folder, folders, files in os.walk(self.root):
            inside = os.path.relpath(folder, self.root)
            if inside in NOT_COMPARED:
                folders.clear()
                continue
            found.update(os.path.normpath(os.path.join(inside, name)) for name in files + folders)
        return found


def repacked(package: Path, version: str, into: Path, change: Callable[[Path], None]) -> Path:
    """Return the same package with another version, after something in it was changed."""
    root = into / f"package-{version}"
    subprocess.run(["dpkg-deb", "--raw-extract", package, root], check=True)
    control = root / "DEBIAN/control"
    lines = control.read_text(encoding="utf-8").splitlines()
    control.write_text(
        "".join(f"{f'Version: {version}' if line.startswith('Version: ') else line}\n" for line in lines),
        encoding="utf-8",
    )
    change(root)
    made = into / f"{NAME}_{version}.deb"
    subprocess.run(
        ["dpkg-deb", "--root-owner-group", "-Znone", "--build", root, made],
        check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    shutil.rmtree(root)
    return made


def _new_defaults(root: Path) -> None:
    """Change both files of configuration, as a newer version may."""
    for name in (ENVIRONMENT, MISSION):
        with (root / name).open("a", encoding="utf-8") as file:
            file.write(NEW_DEFAULT)


def must(is_so: bool, otherwise: str) -> None:
    """Raise RuntimeError unless something is so."""
    if not is_so:
        raise RuntimeError(otherwise)


def prove_purged(system: Debian) -> None:
    """Purge, and see that nothing has our name any more."""
    system.ran("apt-get", "-qq", "purge", "--yes", NAME)
    left = sorted(path for path in system.everything() if "companion" in path)
    must(not left, f"purge leaves {', '.join(left[:5])}")
    prove_accounts_gone(system.root)


def prove_accounts_gone(root: Path) -> None:
    """See that the service's user and group are gone."""
    for name in ACCOUNTS:
        text = (root / "etc" / name).read_text(encoding="utf-8")
        must("companion" not in text, f"purge leaves the user in /etc/{name}")


def free_address() -> tuple[str, int]:
    """Return an address of this computer at which nobody listens."""
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return "127.0.0.1", probe.getsockname()[1]


def _end(running: subprocess.Popen[str], by: signal.Signals) -> None:
    """Send a signal to the process that was started, which is unshare's child."""
    children = Path(f"/proc/{running.pid}/task/{running.pid}/children").read_text(encoding="ascii")
    for child in children.split():
        os.kill(int(child), by)


def prove_start(system: Debian) -> None:
    """Start the service as its unit does, let it hear an autopilot, and stop it.

    Raises
    ------
    RuntimeError
        If it does not become ready, compiles something or ends badly.
    """
    for folder in ("lib", "cache", "log"):
        system.ran("install", "-d", "-o", "companion", "-g", "companion", f"/var/{folder}/companion")
    manager, autopilot = (
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM),
        socket.socket(type=socket.SOCK_DGRAM),
    )
    with manager, autopilot:
        notify = system.root / "run/notify"
        manager.bind(str(notify))
        notify.chmod(0o666)
        manager.settimeout(HEARTBEAT_S)
        address = free_address()
        began = time.monotonic()
        running = system.started(
            "/opt/companion/bin/companion", "run", f"/{MISSION}", "--link", f"udpin://127.0.0.1:{address[1]}",
            "--record", "/var/lib/companion/flights", user="companion", NOTIFY_SOCKET="/run/notify",
            NUMBA_CPU_NAME="generic", NUMBA_CACHE_DIR="/var/cache/companion", OPENBLAS_NUM_THREADS="1",
            HOME="/var/lib/companion", STATE_DIRECTORY="/var/lib/companion",
        )  # fmt: skip
        told = b""
        while b"READY=1" not in told:
            is_late = running.poll() is not None or time.monotonic() - began > READY_MAX_S
            if is_late:
                _end(running, signal.SIGKILL)
            must(not is_late, "the service did not become ready")
            autopilot.sendto(HEARTBEAT, address)
            with contextlib.suppress(TimeoutError):
                told = manager.recv(4096)
        log.info("ready %.1f s after its first start", time.monotonic() - began)
        _end(running, signal.SIGTERM)
        said, _ = running.communicate(timeout=READY_MAX_S)
    must(running.returncode == 0, f"the service ends with exit code {running.returncode}: {said[-600:]}")
    compiled = list((system.root / "var/cache/companion").rglob("*.o"))
    must(not compiled, f"{len(compiled)} kernels were compiled at the first start")


def prove_versions(system: Debian, package: Path, work: Path) -> None:
    """Upgrade, downgrade and break off an upgrade; what the operator has, stays.

    Raises
    ------
    RuntimeError
        If something is lost, or the program does not run afterwards.
    """
    newer = repacked(package, "9999.1", work, _new_defaults)
    older = repacked(package, "0.0.1", work, lambda _: None)
    (system.root / ENVIRONMENT).write_text(EDITED, encoding="utf-8")
    (system.root / "etc/companion/own.yaml").write_text("# the operator's\n", encoding="utf-8")
    kept = system.state()
    for made, version in ((newer, "9999.1"), (older, "0.0.1")):
        system.install(made)
        now = system.state()
        lost = [name for name in kept if name != MISSION and now.get(name) != kept[name]]
        must(not lost, f"{version}: {', '.join(lost)} changed")
        has_new = NEW_DEFAULT in (system.root / MISSION).read_text(encoding="utf-8")
        must(has_new is (made is newer), f"{version}: a file that nobody edited is not the package's")
        system.ran("companion", "check", f"/{MISSION}")
    log.info("upgrade and downgrade: %d files of configuration and state are kept", len(kept))
    prove_power_cuts(system, newer, older)


def prove_power_cuts(system: Debian, newer: Path, older: Path) -> None:
    """Cut dpkg off at moments of an upgrade; what the operator has, stays, and the next one mends it.

    Raises
    ------
    RuntimeError
        If something is lost, half a program would be started, or is not mended.
    """
    kept = system.state()

    def lost() -> list[str]:
        now = system.state()
        return [name for name, was in kept.items() if name != MISSION and now.get(name) != was]

    for (name, is_there), package in zip(MOMENTS.items(), itertools.cycle((newer, older)), strict=False):
        version = package.stem.removeprefix(f"{NAME}_")
        shutil.copy(package, system.root / "tmp")
        (system.root / LOG).write_text("", encoding="ascii")
        with system.started("dpkg", "--install", "--force-confold", f"/tmp/{package.name}") as running:
            while running.poll() is None and not is_there(system.root, version):
                time.sleep(0.005)
            must(running.poll() is None, f"{name}: dpkg ended before its power was cut")
            running.kill()
        must(not lost(), f"power cut while it {name}: {', '.join(lost())} changed")
        must(not (system.root / STAMP).exists(), f"power cut while it {name}: the unit would start it")
        system.ran("dpkg", "--install", "--force-confold", f"/tmp/{package.name}")
        must(not lost(), f"mended after a power cut while it {name}: {', '.join(lost())} changed")
        must((system.root / STAMP).exists(), f"power cut while it {name}: not mended")
        system.ran("companion", "check", f"/{MISSION}")
        log.info("power cut while dpkg %s: all is kept, and the next installation mends it", name)


Moment = Callable[[Path, str], bool]  # It is told the root, and the version that is being installed.


def _logs(status: str) -> Moment:
    """Return what tells whether dpkg has logged that the new version has a status."""

    def is_logged(root: Path, version: str) -> bool:
        text = (root / LOG).read_text(encoding="utf-8")
        return re.search(rf" status {status} {NAME}:\S+ {re.escape(version)}\n", text) is not None

    return is_logged


MOMENTS: dict[str, Moment] = {
    "ends the service": lambda root, _: not (root / STAMP).exists(),
    "unpacks": lambda root, _: any(root.glob("opt/companion/lib/python3*/site-packages/numpy/*.dpkg-new")),
    "has unpacked": _logs("unpacked"),
    "configures": _logs("half-configured"),
}


def prove_removal(system: Debian) -> None:
    """Remove the package, which leaves what the operator has, and purge it, which leaves nothing.

    Raises
    ------
    RuntimeError
        If it is otherwise.
    """
    system.ran("systemctl", "enable", "companion")
    kept = system.state()
    system.ran("apt-get", "-qq", "remove", "--yes", NAME)
    must(system.state() == kept, "removal changes configuration or state")
    must(not (system.root / "opt/companion").exists(), "removal leaves files in /opt/companion")
    prove_purged(system)
    log.info("removal keeps configuration and state, purge leaves nothing")


def clean_debian(root: Path, cache: Path) -> Debian:
    """Return a clean Debian in a new folder, which knows the packages that there are."""
    root.mkdir()
    subprocess.run(["tar", "-C", root, "-xf", debian(cache, RELEASE)], check=True)
    system = Debian(root)
    system.ran("apt-get", "-qq", "update")
    return system


def prove(package: Path, cache: Path, work: Path) -> None:
    """Try a package in a clean Debian.

    Raises
    ------
    RuntimeError, subprocess.CalledProcessError
        If it does not do what a package has to.
    """
    root = work / "debian"
    system = clean_debian(root, cache)
    system.install(package)
    prove_purged(system)
    clean = system.everything()  # with the packages that ours needs
    system.install(package)
    for name in (ENVIRONMENT, MISSION):
        about = (root / name).stat()
        must(about.st_mode & 0o777 == 0o640, f"/{name} has mode {about.st_mode & 0o777:o}")
    is_enabled = (root / "etc/systemd/system/multi-user.target.wants/companion.service").is_symlink()
    must(not is_enabled, "the service was enabled before the operator has set it up")
    log.info("installed: version %s", system.ran("companion", "--version"))
    prove_start(system)
    prove_versions(system, package, work)
    prove_removal(system)
    left = sorted(system.everything() ^ clean)
    must(not left, f"after purge these differ: {', '.join(left[:5])}")
