"""``make glide``: flights whose engine stops, by the hundred; prints where they end, and what went wrong."""

import argparse
import functools
import logging
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor

from tests.glide.glide_flights import OVER_GROUND, WORLDS, flown

WRONG = frozenset({"touched", "elsewhere", "not down"})
TOLD_FLIGHTS = 25


def outcome(number, worlds):
    """The outcome of a flight, without its harness."""
    return flown(number, worlds)[0]


def say(text):
    """One line, at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main():
    """Fly what was chosen, and end with 1 if a flight ended where it should not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=500, help="flights")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--jobs", type=int, default=1, help="flights at once")
    parser.add_argument("--ground", action="store_true", help="over maps of heights")
    chosen = parser.parse_args()
    worlds = OVER_GROUND if chosen.ground else WORLDS
    began, counts = time.time(), Counter()
    numbers = range(chosen.first, chosen.first + chosen.n)
    with ProcessPoolExecutor(chosen.jobs, initializer=logging.disable, initargs=(logging.CRITICAL,)) as pool:
        for told in pool.map(functools.partial(outcome, worlds=worlds), numbers):
            counts[told.verdict] += 1
            if told.verdict in WRONG:
                say(f"  {told}")
            if counts.total() % TOLD_FLIGHTS == 0:
                sys.stderr.write(f"{counts.total()} of {chosen.n}\n")
    wrong = sum(counts[verdict] for verdict in WRONG)
    figures = ", ".join(f"{counts[verdict]} {verdict}" for verdict in sorted(counts))
    say(f"{counts.total()} flights: {figures}; {wrong} wrong; {time.time() - began:.0f} s")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
