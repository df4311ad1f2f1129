"""``make soak``: flights back to back in one process, faults on, and what grew meanwhile.

Each flight is a whole one, recorded to disk, with the real link and so MAVSDK's threads, on ArduPlane
and PX4 in turn. Memory, descriptors and threads are read after each; the first flights warm up and do
not count.
"""

import argparse
import asyncio
import gc
import logging
import os
import statistics
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from companion.config import load_mission
from companion.flight.state.modes import Mode
from companion.link.missions.autopilot_link import AutopilotLink
from companion.types.events import Dialect
from sim.faults import FaultKind, random_schedule
from tests.hostile.hostile_hour import MEBIBYTE, resident_bytes
from tests.torture.harness import KINDS, TortureHarness, flown

MISSIONS = ("first-flight", "paper-2d", "paper-3d")
FAULTS_S = 120.0
LIMIT_S = 240.0
WARM_SHARE = 0.2  # of the flights, at least three
GROWTH_MAX_MIB_PER_H = 10.0


@dataclass(frozen=True)
class Reading:
    """What this process holds after a flight."""

    flight: int
    wall_s: float
    memory_mib: float
    descriptors: int
    threads: int


def reading(flight, began_s):
    """Read it, with everything that nobody needs collected."""
    gc.collect()
    return Reading(
        flight, time.time() - began_s, resident_bytes() / MEBIBYTE,
        len(os.listdir("/proc/self/fd")), len(os.listdir("/proc/self/task")),
    )  # fmt: skip


def flight(number, first_seed, folder):
    """One flight under faults; how it ended, and how long it lasted [s]."""
    seed, dialect = first_seed + number, list(Dialect)[number % 2]
    kinds = tuple(kind for kind in KINDS[dialect] if kind is not FaultKind.KILL)
    mission = load_mission(Path("mission_configs") / f"{MISSIONS[number // 2 % 3]}.yaml")
    harness = TortureHarness(dialect, seed, random_schedule(seed, FAULTS_S, kinds), folder, mission)
    harness.link_kind = AutopilotLink
    harness.judge.look = lambda now_s, verdict: None
    verdict = asyncio.run(flown(harness, LIMIT_S))
    how = "collision" if verdict.collision else "goal" if harness.app.mode is Mode.ARRIVED else "flying"
    return how, harness.now_s


def growth_per_hour(readings):
    """Slope of the memory over the computer's time by Theil and Sen: the median of all pairs' [MiB/h]."""
    slopes = [
        (b.memory_mib - a.memory_mib) / (b.wall_s - a.wall_s) * 3600.0
        for n, a in enumerate(readings)
        for b in readings[n + 1 :]
        if b.wall_s > a.wall_s
    ]
    return statistics.median(slopes) if slopes else 0.0


def verdict_on(readings):
    """What grew, in words; empty if nothing did."""
    counted = readings[max(3, int(WARM_SHARE * len(readings))) :]
    if len(counted) < 4:
        return ["too few flights to tell"]
    half = len(counted) // 2
    found = []
    for name in ("descriptors", "threads"):
        before = max(getattr(entry, name) for entry in counted[:half])
        after = max(getattr(entry, name) for entry in counted[half:])
        if after > before:
            found.append(f"{name} grew from {before} to {after}")
    slope = growth_per_hour(counted)
    if slope > GROWTH_MAX_MIB_PER_H and counted[-1].memory_mib - counted[0].memory_mib > GROWTH_MAX_MIB_PER_H:
        found.append(f"memory grew by {slope:.1f} MiB an hour")
    return found


def say(text):
    """One line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main():
    """Fly until the time is over; end with 1 if something grew or was hit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=120.0, help="of the computer's time")
    parser.add_argument("--first-seed", type=int, default=1)
    chosen = parser.parse_args()
    logging.disable(logging.CRITICAL)
    began, readings, ends, simulated_s = time.time(), [], Counter(), 0.0
    while time.time() - began < 60.0 * chosen.minutes:
        with tempfile.TemporaryDirectory() as folder:
            how, lasted_s = flight(len(readings), chosen.first_seed, Path(folder))
        ends[how] += 1
        if how == "collision":
            seed = chosen.first_seed + len(readings)
            say(f"flight {len(readings)}, seed {seed}: collision after {lasted_s:.1f} s")
        simulated_s += lasted_s
        readings.append(reading(len(readings), began))
        if len(readings) % 10 == 1:
            now = readings[-1]
            say(
                f"{now.wall_s:6.0f} s, {len(readings)} flights: {now.memory_mib:.1f} MiB, "
                f"{now.descriptors} descriptors, {now.threads} threads"
            )
    found = verdict_on(readings)
    last = readings[-1]
    say(
        f"{len(readings)} flights, {simulated_s / 3600.0:.1f} h simulated in {last.wall_s / 60.0:.1f} min: "
        f"{dict(ends)}; {growth_per_hour(readings[3:]):+.1f} MiB/h after the first three; at the end "
        f"{last.memory_mib:.1f} MiB, {last.descriptors} descriptors, {last.threads} threads"
    )
    for words in found:
        say(words)
    return int(bool(found) or ends["collision"] > 0)


if __name__ == "__main__":
    sys.exit(main())
