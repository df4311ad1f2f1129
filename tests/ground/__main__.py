"""``make ground``: flights over random places of real and generated ground by the hundred."""

import argparse
import logging
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from statistics import median

from tests.ground.ground_flights import LEAST_M, fly, line_of


def main():
    parser = argparse.ArgumentParser(prog="python -m tests.ground", description=__doc__)
    parser.add_argument("-n", type=int, default=300, help="flights")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("flights/ground.jsonl"), help="file of JSON lines")
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    seeds = range(given.first_seed, given.first_seed + given.n)
    flights = []
    quiet = {"initializer": logging.disable, "initargs": (logging.CRITICAL,)}
    with given.out.open("w", encoding="utf-8") as out, ProcessPoolExecutor(given.jobs, **quiet) as pool:
        for flight in pool.map(fly, seeds):
            flights.append(flight)
            out.write(line_of(flight) + "\n")
            out.flush()
    threatened = [flight.threatened_s > 0.0 for flight in flights if flight.num_pursuers]
    low = [flight for flight in flights if flight.least_m < LEAST_M - 3.0]
    sys.stdout.write(
        f"{len(flights)} flights: {sum(f.reached for f in flights)} reach the goal, "
        f"{sum(f.collision for f in flights)} touch the ground, "
        f"{len(low)} come more than 3 m below {LEAST_M:.0f} m over ground; "
        f"{sum(threatened)} of {len(threatened)} with pursuers are threatened; "
        f"seen {median(f.seen_s for f in flights):.1f} s, a plan {median(f.plan_ms for f in flights):.0f} ms "
        "(medians)\n"
    )
    return int(any(flight.collision for flight in flights))


if __name__ == "__main__":
    sys.exit(main())
