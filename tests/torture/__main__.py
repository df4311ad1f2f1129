"""``make torture`` and ``make campaigns``: flights under faults by the hundred; prints the counts."""

import argparse
import logging
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from companion.types.events import Dialect
from sim.faults import Schedule
from tests.torture import campaigns, senses, wind
from tests.torture.harness import WORLDS, broken_after, fly, num_messages, random_flight

# In which the first mission is flown, and replaced; on ArduPlane a second time, then by a part only.
EXCHANGE_S = {Dialect.ARDUPILOT: 23.0, Dialect.PX4: 34.0}
SILENT_S, AFTER_S = 8.0, 14.0
TOLD_FLIGHTS = 50


def tally(counts, dialect, what, verdict):
    """Count a flight; the violations it had, in words."""
    counts["flights"] += 1
    counts["judged"] += verdict.num_judged
    counts["swaps"] += verdict.num_swaps
    counts["rejected"] += verdict.rejected
    counts["arrived"] += verdict.arrived
    counts["collisions"] += verdict.collision
    counts["violations"] += len(verdict.violations)
    if verdict.violations or verdict.collision:
        sys.stdout.write(f"  {dialect.value} {what}: {len(verdict.violations)} {verdict.violations[:2]}\n")
        sys.stdout.flush()


def report(name, counts, began_s):
    """One line of counts."""
    figures = ", ".join(f"{counts[key]} {key}" for key in sorted(counts))
    sys.stdout.write(f"{name}: {figures}; {time.time() - began_s:.0f} s\n")
    sys.stdout.flush()


def broken_flight(dialect, message):
    """A flight whose first exchanges are broken off after a message."""
    duration_s = EXCHANGE_S[dialect] + AFTER_S
    return fly(dialect, 1, Schedule(), broken_after(message, SILENT_S), duration_s)[0]


def scheduled_flight(dialect, world, seed):
    """A flight under a random schedule."""
    return random_flight(dialect, seed, world)[0]


def flown_all(name, dialect, flights, words, jobs):
    """Fly them, so many at once, and print the counts; how many went wrong."""
    began, counts = time.time(), Counter()
    with ProcessPoolExecutor(jobs, initializer=logging.disable, initargs=(logging.CRITICAL,)) as pool:
        for what, verdict in zip(words, pool.map(*flights), strict=True):
            tally(counts, dialect, what, verdict)
            if sys.stderr.isatty() or counts["flights"] % TOLD_FLIGHTS == 0:
                sys.stderr.write(f"{name}: {counts['flights']} of {len(words)}\n")
    report(name, counts, began)
    return counts["violations"] + counts["collisions"]


def run_broken(dialects, every, jobs):
    """Exchanges broken off after each message."""
    total = 0
    for dialect in dialects:
        until = num_messages(dialect, EXCHANGE_S[dialect])
        messages = range(1, until + 1, every)
        total += flown_all(
            f"{dialect.value}, broken off after each of {until} messages", dialect,
            (broken_flight, [dialect] * len(messages), messages),
            [f"broken after message {message}" for message in messages], jobs,
        )  # fmt: skip
    return total


def run_random(dialects, worlds, seeds, jobs):
    """Random schedules; the seeds are dealt out to the worlds."""
    total = 0
    for dialect in dialects:
        for place, world in enumerate(worlds):
            dealt = seeds[place :: len(worlds)]
            total += flown_all(
                f"{dialect.value}, random schedules in {world}", dialect,
                (scheduled_flight, [dialect] * len(dealt), [world] * len(dealt), dealt),
                [f"seed {seed} in {world}" for seed in dealt], jobs,
            )  # fmt: skip
    return total


def say(text):
    """One line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main():
    """Run what was chosen, and end with 1 if anything was violated."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "what",
        nargs="?",
        default="swaps",
        choices=("swaps", "random", "losses", "kills", "pilots", "senses", "wind"),
    )
    parser.add_argument(
        "-n", type=int, default=1000, help="flights of a random kind, half of them an autopilot"
    )
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--every", type=int, default=1, help="break after every so many messages")
    parser.add_argument("--jobs", type=int, default=1, help="flights at once")
    sorts = [kind.__name__ for kind in senses.SENSES]
    parser.add_argument("--sort", choices=sorts, help="of the senses' flights only those with this fault")
    parser.add_argument("--clearance", type=float, help="of those, in place of the missions' [m]")
    parser.add_argument("--wanted", type=float, help="of those, in place of what is wanted [m]")
    parser.add_argument("--kinds", default=",".join(dialect.value for dialect in Dialect))
    parser.add_argument("--worlds", default=",".join(WORLDS))
    chosen = parser.parse_args()
    logging.disable(logging.CRITICAL)
    if chosen.what in ("swaps", "random"):
        dialects = [Dialect(kind) for kind in chosen.kinds.split(",")]
        seeds = range(chosen.first_seed, chosen.first_seed + chosen.n // len(Dialect))
        total = run_broken(dialects, chosen.every, chosen.jobs) if chosen.what == "swaps" else 0
        total += run_random(dialects, chosen.worlds.split(","), seeds, chosen.jobs)
    elif chosen.what == "senses":
        with ProcessPoolExecutor(
            chosen.jobs, initializer=logging.disable, initargs=(logging.CRITICAL,)
        ) as pool:
            numbers = [
                number
                for number in range(chosen.first_seed, chosen.first_seed + chosen.n)
                if chosen.sort in (None, senses.kind_of(number).__name__)
            ]
            given = {"clearance_min_m": chosen.clearance, "clearance_wanted_m": chosen.wanted}
            planning = {key: value for key, value in given.items() if value is not None}
            total = senses.run_senses(numbers, say, pool, planning)
    elif chosen.what == "wind":
        with ProcessPoolExecutor(
            chosen.jobs, initializer=logging.disable, initargs=(logging.CRITICAL,)
        ) as pool:
            total = wind.run_wind(wind.cases(), say, pool)
    elif chosen.what == "losses":
        total = campaigns.run_losses(chosen.n, chosen.first_seed, say)
    elif chosen.what == "pilots":
        total = campaigns.run_pilots(chosen.n, chosen.first_seed, say)
    else:
        with tempfile.TemporaryDirectory() as folder:
            total = campaigns.run_kills(chosen.n, chosen.first_seed, say, Path(folder))
    say(f"{total} violations")
    return int(total > 0)


if __name__ == "__main__":
    sys.exit(main())
