"""How the companion computer is: load, memory, temperature, disk."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import psutil

MEGABYTE = 2**20
CORE_SENSORS = ("cpu_thermal", "coretemp", "k10temp", "soc_thermal", "cpu-thermal")


@dataclass(frozen=True, slots=True)
class HostStatus:
    """A look at the companion computer.

    Parameters
    ----------
    uptime_s : float
        Time since the computer was switched on [s].
    cores_percent : tuple of float
        Load of each core since the last look [%].
    temperature_c : float or None
        Temperature of the processor [°C]; None where there is no sensor.
    memory_used_mb, memory_total_mb, disk_used_mb, disk_total_mb : float
        Memory, and the disk that the flights are on [MiB].
    """

    uptime_s: float
    cores_percent: tuple[float, ...]
    temperature_c: float | None
    memory_used_mb: float
    memory_total_mb: float
    disk_used_mb: float
    disk_total_mb: float


def host_status(folder: Path) -> HostStatus:
    """Look at the computer, and at the disk that a folder is on."""
    memory = psutil.virtual_memory()
    try:
        disk = psutil.disk_usage(str(folder))
        used, total = disk.used / MEGABYTE, disk.total / MEGABYTE
    except OSError:  # the folder is gone, or its disk
        used = total = 0.0
    return HostStatus(
        uptime_s=max(0.0, time.time() - psutil.boot_time()),
        cores_percent=tuple(psutil.cpu_percent(percpu=True)),
        temperature_c=_temperature_c(),
        memory_used_mb=(memory.total - memory.available) / MEGABYTE,
        memory_total_mb=memory.total / MEGABYTE,
        disk_used_mb=used,
        disk_total_mb=total,
    )


def _temperature_c() -> float | None:
    if not hasattr(psutil, "sensors_temperatures"):  # on Linux only
        return None
    sensors = psutil.sensors_temperatures()
    for name in (*CORE_SENSORS, *sensors):
        for reading in sensors.get(name, ()):
            return float(reading.current)
    return None
