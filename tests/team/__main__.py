"""``python -m tests.team``: flights in which one of four is gone: do the others fly its goals?"""

import argparse
import dataclasses
import json
import logging
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from companion.types.events import Dialect
from tests.team.shared_goal_flights import flown


def say(text):
    """One line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main():
    """Fly them, and end with 1 if a goal is left."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=50, help="flights")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="flights at once")
    parser.add_argument("--px4", action="store_true", help="PX4 instead of ArduPlane")
    chosen = parser.parse_args()
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.n)
    dialect = Dialect.PX4 if chosen.px4 else Dialect.ARDUPILOT
    num, failed, had_goals, twice = 0, 0, 0, 0
    with ProcessPoolExecutor(chosen.jobs, initializer=logging.disable, initargs=(logging.CRITICAL,)) as pool:
        for outcome in pool.map(partial(flown, dialect=dialect), seeds):
            say(json.dumps(dataclasses.asdict(outcome)) + ("" if outcome.is_kept else " FAILED"))
            num, failed = num + 1, failed + (not outcome.is_kept)
            had_goals, twice = had_goals + (outcome.left > 0), twice + outcome.twice
            say(
                f"{num} flights, one of four gone: {num - failed} with all goals flown, apart and unhurt; "
                f"in {had_goals} it had goals left; {twice} goals flown twice"
            )
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
