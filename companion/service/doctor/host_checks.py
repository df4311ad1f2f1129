"""Checks of this computer for ``companion doctor``."""

from __future__ import annotations

import os
import shutil
from datetime import UTC, datetime
from pathlib import Path

from companion.clock import UNSYNCHRONISED, clock_state
from companion.config import MissionConfig
from companion.errors import CompanionError
from companion.kernels.native.store import kernel_store
from companion.link.wire.key_file import read_key
from companion.service.doctor.finding import Finding, fail, ok, warn

NOT_BEFORE = datetime(2026, 1, 1, tzinfo=UTC)
DISK_MIN_MB, DISK_GOOD_MB = 200, 2_000
MEGABYTE = 2**20
SERIAL_PORT = "serial port"


def local_findings(mission: MissionConfig | None, url: str | None, flights: Path) -> list[Finding]:
    """Check this computer.

    Parameters
    ----------
    mission : MissionConfig, optional
        Mission file, whose signing key is checked.
    url : str, optional
        URL of the link, whose serial port is checked.
    flights : Path
        Folder for recordings.
    """
    findings = [clock_set(datetime.now(UTC)), clock_synchronised(clock_state())]
    findings += [kernel_cache(kernel_store().folder, kernel_store().packed), disk(flights)]
    if url is not None and url.startswith("serial://"):
        findings.append(serial_port(Path(url.removeprefix("serial://").rpartition(":")[0])))
    if mission is not None and mission.link.signing is not None:
        findings.append(signing_key(Path(mission.link.signing.key_file)))
    return findings


def clock_set(now: datetime) -> Finding:
    """Check that the time is plausible."""
    if now < NOT_BEFORE:
        return fail("clock", f"{now:%Y-%m-%d}", "set the time: recordings would be of the past")
    return ok("clock", f"{now:%Y-%m-%d %H:%M:%S} UTC")


def clock_synchronised(state: int) -> Finding:
    """Check that the clock is synchronised."""
    check, advice = "clock synchronised", "run chrony or systemd-timesyncd; GPS through gpsd in the field"
    if state < 0:
        return warn(check, "unknown on this computer", advice)
    if state == UNSYNCHRONISED:
        return warn(check, "no", advice)
    return ok(check, "yes")


def kernel_cache(folder: Path, packed: Path | None = None) -> Finding:
    """Check that compiled kernels are stored, and that there are any, here or with the program."""
    check = "kernel cache"
    if not os.access(folder, os.W_OK):
        return fail(check, f"{folder} cannot be written", "set NUMBA_CACHE_DIR to a folder of the service's")
    if folder.name.startswith("safe-rrt-companion-"):  # kernel_store falls back to this folder.
        return warn(check, f"{folder} is temporary", "set NUMBA_CACHE_DIR: each start compiles again")
    number = sum(1 for _ in folder.glob("*.o"))
    if number == 0 and packed is not None and any(packed.glob("*.o")):
        return ok(check, f"{folder} is empty, and there are kernels in {packed}")
    if number == 0:
        return warn(check, f"{folder} is empty", "let the service start once on the ground: it compiles")
    return ok(check, f"{number} kernels in {folder}")


def disk(flights: Path) -> Finding:
    """Check that flights can be recorded."""
    folder = flights
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    free = shutil.disk_usage(folder).free // MEGABYTE
    found, advice = f"{free} MB free for {flights}", "remove old flights, or record to another disk"
    if free < DISK_MIN_MB:
        return fail("disk", found, advice)
    if not os.access(folder, os.W_OK):
        return fail("disk", f"{folder} cannot be written", "let --record name a folder of the service's")
    return ok("disk", found) if free >= DISK_GOOD_MB else warn("disk", found, advice)


def serial_port(device: Path) -> Finding:
    """Check that the port exists and may be used."""
    check = SERIAL_PORT
    if not device.exists():
        return fail(check, f"{device} is not there", "plug it in; enable the UART; see dmesg for its name")
    if not device.is_char_device():
        return fail(
            check, f"{device} is no serial port", "name the device, as in serial:///dev/ttyAMA0:921600"
        )
    if not os.access(device, os.R_OK | os.W_OK):
        advice = "usermod -aG dialout USER, then log in again; the service's unit does that itself"
        return fail(check, f"{device} may not be read and written", advice)
    return ok(check, str(device))


def signing_key(file: Path) -> Finding:
    """Check that the key can be used."""
    try:
        read_key(file)
    except CompanionError as error:
        return fail("signing key", str(error), "give it to the service alone: 32 bytes, mode 0600")
    return ok("signing key", str(file))
