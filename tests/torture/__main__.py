"""``make torture`` and ``make campaigns``: flights under faults by the hundred; prints the counts."""

import argparse
import logging
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from companion.types.events import Dialect
from sim.faults import Schedule
from tests.torture import campaigns
from tests.torture.harness import WORLDS, broken_after, fly, num_messages, random_flight

# In which the first mission is flown, and replaced; on ArduPlane a second time, then by a part only.
EXCHANGE_S = {Dialect.ARDUPILOT: 23.0, Dialect.PX4: 34.0}
SILENT_S, AFTER_S = 8.0, 14.0


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


def run_swaps(number, first_seed, every):
    """Broken exchanges, and random schedules."""
    total = 0
    for dialect in Dialect:
        began, counts = time.time(), Counter()
        until = num_messages(dialect, EXCHANGE_S[dialect])
        for message in range(1, until + 1, every):
            verdict, _ = fly(
                dialect, 1, Schedule(), broken_after(message, SILENT_S), EXCHANGE_S[dialect] + AFTER_S
            )
            tally(counts, dialect, f"broken after message {message}", verdict)
        report(f"{dialect.value}, broken off after each of {until} messages", counts, began)
        total += counts["violations"] + counts["collisions"]
    for dialect in Dialect:
        for place, world in enumerate(WORLDS):
            began, counts = time.time(), Counter()
            for seed in range(first_seed + place, first_seed + number // 2, len(WORLDS)):
                verdict, _ = random_flight(dialect, seed, world)
                tally(counts, dialect, f"seed {seed} in {world}", verdict)
            report(f"{dialect.value}, random schedules in {world}", counts, began)
            total += counts["violations"] + counts["collisions"]
    return total


def say(text):
    """One line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main():
    """Run what was chosen, and end with 1 if anything was violated."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="?", default="swaps", choices=("swaps", "losses", "kills", "pilots"))
    parser.add_argument(
        "-n", type=int, default=1000, help="flights of a random kind, half of them an autopilot"
    )
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--every", type=int, default=1, help="break after every so many messages")
    chosen = parser.parse_args()
    logging.disable(logging.CRITICAL)
    if chosen.what == "swaps":
        total = run_swaps(chosen.n, chosen.first_seed, chosen.every)
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
