"""State of the companion computer: load, memory, temperature, disk."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import psutil

MEGABYTE = 2**20
CORE_SENSORS = ("cpu_thermal", "coretemp", "k10temp", "soc_thermal", "cpu-thermal")


@dataclass(frozen=True, slots=True)
class HostStatus:
    """State of the companion computer at an instant.

    Parameters
    ----------
    uptime_s : float
        Time since the computer was started [s].
    cores_percent : tuple of float
        Load of each core since the previous call [%].
    temperature_c : float or None
        Temperature of the processor [°C]; None without a sensor.
    memory_used_mb, memory_total_mb, disk_used_mb, disk_total_mb : float
        Memory, and the disk of the flights [MiB].
    """

    uptime_s: float
    cores_percent: tuple[float, ...]
    temperature_c: float | None
    memory_used_mb: float
    memory_total_mb: float
    disk_used_mb: float
    disk_total_mb: float


def host_status(folder: Path) -> HostStatus:
    """Return the state of the computer, and of the disk that contains a folder."""
    memory = psutil.virtual_memory()
    try:
        disk = psutil.disk_usage(str(folder))
        used, total = disk.used / MEGABYTE, disk.total / MEGABYTE
    except OSError:  # The folder or its disk does not exist any more.
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
    if not hasattr(psutil, "sensors_temperatures"):  # Only Linux has it.
        return None
    sensors = psutil.sensors_temperatures()
    for name in (*CORE_SENSORS, *sensors):
        for reading in sensors.get(name, ()):
            return float(reading.current)
    return None
