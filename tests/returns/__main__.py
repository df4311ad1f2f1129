"""``make returns``: returns at random moments by the hundred, with the service's return path and without."""

import argparse
import logging
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from functools import partial
from pathlib import Path

from tests.returns.return_flights import ReturnFlight, fly, is_bad, line_of, scenario


def main():
    parser = argparse.ArgumentParser(prog="python -m tests.returns", description=__doc__)
    parser.add_argument("-n", type=int, default=100, help="flights of each sort")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--autoland", type=int, default=4, choices=(2, 4), help="RTL_AUTOLAND of ArduPlanes")
    parser.add_argument("--without", action="store_true", help="also without a return path, for comparison")
    parser.add_argument("--out", type=Path, default=None, help="file of JSON lines")
    given = parser.parse_args()
    seeds, bad = range(given.first_seed, given.first_seed + given.n), 0
    with given.out.open("w", encoding="utf-8") if given.out else nullcontext() as out:
        for is_with_path in (True, False)[: 1 + given.without]:
            flown = partial(flown_or_error, is_with_path=is_with_path, autoland=given.autoland)
            bad += is_with_path * returned(flown, seeds, given.jobs, out, is_with_path=is_with_path)
    return int(bad > 0)


def flown_or_error(seed, *, is_with_path, autoland):
    """Fly a seed; a flight in which the service ends with an error is a bad one, and the next is flown."""
    try:
        return fly(seed, is_with_path=is_with_path, autoland=autoland)
    except Exception as error:  # Whatever it is, it is what is looked for.
        _, name, dialect, begun_s, is_killed, _ = scenario(seed)
        flight = ReturnFlight(seed, name, dialect.value, begun_s, is_killed, is_with_path)
        flight.ended = f"error: {error!r}"
        return flight


def returned(flown, seeds, jobs, out, *, is_with_path):
    """Fly the seeds, write each flight as a line of JSON, and return how many went wrong."""
    counts, bad = Counter(), 0
    quiet = {"initializer": logging.disable, "initargs": (logging.CRITICAL,)}
    with ProcessPoolExecutor(jobs, **quiet) as pool:
        for flight in pool.map(flown, seeds):
            counts[flight.dialect, "flights"] += 1
            counts[flight.dialect, "with a path"] += flight.has_path
            counts[flight.dialect, "touched"] += bool(flight.touched)
            counts[flight.dialect, "crossed"] += bool(flight.crossed)
            counts[flight.dialect, flight.ended.split(" ")[0]] += 1
            bad += is_bad(flight)
            if out is not None:
                out.write(line_of(flight) + "\n")
                out.flush()
            if is_bad(flight) and is_with_path:
                sys.stdout.write(f"  {line_of(flight)}\n")
                sys.stdout.flush()
    name = "with a return path" if is_with_path else "straight home"
    figures = ", ".join(f"{key[0]} {key[1]} {counts[key]}" for key in sorted(counts))
    sys.stdout.write(f"{name}: {figures}\n")
    sys.stdout.flush()
    return bad


if __name__ == "__main__":
    sys.exit(main())
