"""Tries a Debian package under systemd, which runs in namespaces of its own: start, failure, upgrade, purge.

systemd is process 1 of a clean Debian there, as on an aircraft's computer, with the unit as it is shipped. If
it does not start in namespaces on this computer, that is said.
"""

from __future__ import annotations

import contextlib
import logging
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from prove_deb import (
    ENVIRONMENT,
    HEARTBEAT,
    HEARTBEAT_S,
    NAME,
    PATH,
    READY_MAX_S,
    clean_debian,
    free_address,
    must,
    prove_accounts_gone,
    prove_purged,
    repacked,
)

BOOT_MAX_S = 20.0
UNIT = "companion"
BOOTED = ("running", "degraded")  # What systemd says of a system whose start is over.
NEEDED = ("systemd", "dbus")
FOLDERS = ("etc", "opt", "var/lib", "var/cache", "var/log")
DEVICES = ("null 3", "zero 5", "random 8", "urandom 9")  # Character devices of major number 1.
UNSHARED = ("--mount", "--pid", "--uts", "--ipc", "--cgroup", "--fork", "--kill-child")
BOOT = """set -e
cd "$1"; shift
mount --bind . .; cd "$PWD"
mount -t proc proc proc
mount -t sysfs sysfs sys
mount -t cgroup2 cgroup2 sys/fs/cgroup
for folder in run tmp dev; do mount -t tmpfs tmpfs $folder; done
mkdir dev/shm dev/pts
while [ $# -gt 0 ]; do mknod -m 666 "dev/$1" c 1 "$2"; shift 2; done
exec chroot . /usr/bin/env -i container=companion PATH=/usr/sbin:/usr/bin:/sbin:/bin \\
    /lib/systemd/systemd --system
"""

log = logging.getLogger("deb")


class Booted:
    """A Debian whose process 1 is systemd.

    Parameters
    ----------
    process : int
        Number of systemd, outside of its namespaces.
    """

    def __init__(self, process: int) -> None:
        self._enter = ["nsenter", "-t", str(process), "-m", "-p", "-u", "-i", "-C", "-r", "-w", "env", "-i"]
        self._enter += [f"PATH={PATH}", "DEBIAN_FRONTEND=noninteractive", "LC_ALL=C.UTF-8"]

    def started(self, *command: str) -> subprocess.Popen[str]:
        """Start a command in it."""
        return subprocess.Popen(
            [*self._enter, *command],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip

    def says(self, *command: str) -> str:
        """Return what a command says, whatever its exit code is."""
        with self.started(*command) as running:
            return running.communicate()[0].strip()

    def ran(self, *command: str, meanwhile: Callable[[], None] = lambda: None) -> str:
        """Return what a command says; something is done again and again until it has ended.

        Raises
        ------
        RuntimeError
            If it fails, or takes too long.
        """
        began = time.monotonic()
        with self.started(*command) as running:
            while running.poll() is None and time.monotonic() - began < READY_MAX_S:
                meanwhile()
                time.sleep(HEARTBEAT_S)
            if running.poll() is None:
                running.kill()
            said = running.communicate()[0].strip()
        must(running.returncode == 0, f"{' '.join(command)}: exit code {running.returncode}: {said[-600:]}")
        return said

    def shows(self, key: str) -> str:
        """Return a property of the service."""
        return self.says("systemctl", "show", UNIT, "--property", key, "--value")


@contextlib.contextmanager
def booted(root: Path) -> Iterator[Booted | None]:
    """Start systemd in a Debian, and end it with all that it started; None if it does not start here."""
    entered = ["unshare", *UNSHARED, "--propagation", "private", "/bin/sh", "-c", BOOT, "boot", str(root)]
    numbers = [word for device in DEVICES for word in device.split()]
    with subprocess.Popen(
        [*entered, *numbers],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as running:  # fmt: skip
        try:
            began, state, system = time.monotonic(), "", None
            children = Path(f"/proc/{running.pid}/task/{running.pid}/children")
            while running.poll() is None and time.monotonic() - began < BOOT_MAX_S:
                found = children.read_text(encoding="ascii").split()
                system = Booted(int(found[0])) if found else None
                state = "" if system is None else system.says("systemctl", "is-system-running")
                if state in BOOTED:
                    break
                time.sleep(HEARTBEAT_S)
            yield system if state in BOOTED else None
        finally:
            running.send_signal(signal.SIGKILL)


def prove_under_systemd(package: Path, cache: Path, work: Path) -> None:
    """Install, start, break off, upgrade and purge a package under systemd.

    Raises
    ------
    RuntimeError, subprocess.CalledProcessError
        If the service does not do what its unit promises.
    """
    root = work / "booted"
    system = clean_debian(root, cache)
    system.ran("apt-get", "-qq", "install", "--yes", "--no-install-recommends", *NEEDED)
    system.install(package)  # It brings the packages that it needs.
    prove_purged(system)
    newer = repacked(package, "9999.2", work, lambda _: None)
    for made in (package, newer):
        shutil.copy(made, root / "root")
    with booted(root) as there:
        if there is None:
            log.warning("under systemd: not tried, since systemd does not start in namespaces here")
            return
        _prove(there, root, f"/root/{package.name}", f"/root/{newer.name}")


def _prove(there: Booted, root: Path, package: str, newer: str) -> None:
    """Try the service in a Debian that runs."""
    address = free_address()
    with socket.socket(type=socket.SOCK_DGRAM) as autopilot:

        def heartbeat() -> None:
            autopilot.sendto(HEARTBEAT, address)

        def until_active(restarts: str) -> None:
            began = time.monotonic()
            while there.shows("NRestarts") != restarts or there.shows("ActiveState") != "active":
                heartbeat()
                must(time.monotonic() - began < READY_MAX_S, "the service is not started again")
                time.sleep(HEARTBEAT_S)

        there.ran("apt-get", "-qq", "install", "--yes", package)
        must(there.shows("ActiveState") == "inactive", "the installation started the service")
        (root / ENVIRONMENT).write_text(
            f"COMPANION_MISSION=/etc/companion/mission.yaml\nCOMPANION_LINK=udpin://{address[0]}:{address[1]}\n",
            encoding="utf-8",
        )
        there.ran("systemctl", "enable", UNIT)
        began = time.monotonic()
        there.ran("systemctl", "start", UNIT, meanwhile=heartbeat)
        log.info("under systemd: ready %.1f s after its first start", time.monotonic() - began)
        there.ran("systemctl", "kill", "--signal", "KILL", UNIT)
        until_active("1")
        there.ran("apt-get", "-qq", "install", "--yes", newer, meanwhile=heartbeat)
        until_active("0")
        there.ran("apt-get", "-qq", "purge", "--yes", NAME)
        must(there.shows("LoadState") == "not-found", "purge leaves the unit")
        left = [name for name in FOLDERS if (root / name / UNIT).exists()]
        must(not left, f"purge leaves {', '.join(left)}")
        prove_accounts_gone(root)
        failed = there.says("systemctl", "--failed", "--plain", "--no-legend")
        must(not failed, f"units failed: {failed}")
    log.info("under systemd: killed, it is started again; upgraded, it runs on; purged, nothing is left")
