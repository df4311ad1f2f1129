"""Damage to recordings, and replays of the rest: ``python -m tests.service.replay.corruptions -n 1000``."""

import argparse
import asyncio
import itertools
import logging
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

import numpy as np

from companion.config import load_mission
from companion.config.models import Goal
from companion.recording.reader import load_recording
from companion.service.replay.engine import Replay

DATA = Path(__file__).parents[2] / "data"
RECORDINGS = {
    "arduplane-4.7dev-replace.tlog": "arduplane-replace.yaml",
    "px4-1.17dev-replace.tlog": "px4-replace.yaml",
}
KINDS = ("cut", "flipped", "duplicated", "shuffled")
TAKEN = ("accepted", "unknown_message")  # what the codec counts and is no loss


def damaged(data, kind, random):
    """A recording with one kind of damage, in as many places as chance has it."""
    data = bytearray(data)
    if kind == "cut":
        start, end = sorted(random.integers(0, len(data), 2))
        return bytes(data[start:end]) if random.random() < 0.5 else bytes(data[:start] + data[end:])
    if kind == "flipped":
        for place in random.integers(0, len(data), int(10 ** random.uniform(0, 3.5))):
            data[place] ^= 1 << int(random.integers(8))
        return bytes(data)
    if kind == "duplicated":
        for _ in range(random.integers(1, 6)):
            start, end = sorted(random.integers(0, len(data), 2))
            end = min(end, start + len(data) // 8)
            place = int(random.integers(0, len(data)))
            data[place:place] = data[start:end]
        return bytes(data)
    edges = [0, *sorted(random.integers(0, len(data), random.integers(1, 20))), len(data)]
    blocks = [bytes(data[start:end]) for start, end in itertools.pairwise(edges)]
    random.shuffle(blocks)
    return b"".join(blocks)


def mission_for(name):
    """The recording's world, planned in quickly and seldom."""
    mission = load_mission(DATA / RECORDINGS[name])
    quick = mission.planning.model_copy(update={"max_iterations": 50, "time_horizon_s": 60.0})
    nimble = mission.vehicle.model_copy(update={"turn_radius_min_m": 30.0})
    goal = Goal(east_m=1500.0, north_m=-500.0, up_m=100.0)
    return mission.model_copy(update={"planning": quick, "vehicle": nimble, "goals": (goal,)})


def replayed(data, mission, folder):
    """A replay of bytes, whatever they are."""
    file = Path(folder) / "damaged.tlog"
    file.write_bytes(data)
    return asyncio.run(Replay(load_recording(file), mission).run())


def lost(result):
    """What was left out, by reason."""
    return Counter({reason: n for reason, n in result.counters.items() if reason not in TAKEN})


def _main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=1000, help="corruptions of each recording")
    parser.add_argument("recordings", nargs="*", default=list(RECORDINGS))
    arguments = parser.parse_args()
    number = arguments.n
    logging.disable(logging.WARNING)
    for name in arguments.recordings:
        data, mission = (DATA / name).read_bytes(), mission_for(name)
        drops, faults, slowest, with_drops, began = Counter(), 0, 0.0, 0, time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            for seed in range(number):
                random = np.random.default_rng(seed)
                kind, since = KINDS[seed % len(KINDS)], time.perf_counter()
                try:
                    dropped = lost(replayed(damaged(data, kind, random), mission, folder))
                except Exception:
                    faults += 1
                    sys.stdout.write(f"{name}, seed {seed}, {kind}\n{traceback.format_exc()}\n")
                    continue
                drops += dropped
                with_drops += bool(dropped)
                slowest = max(slowest, time.perf_counter() - since)
        took = time.perf_counter() - began
        sys.stdout.write(
            f"{name}: {number} corruptions, {faults} faults, {with_drops} with counted drops\n"
            f"  {took:.0f} s in all, the slowest {slowest:.1f} s; {dict(drops)}\n"
        )


if __name__ == "__main__":
    _main()
