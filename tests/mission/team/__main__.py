"""``python -m tests.mission.team``: teams of which one is gone, over maps, in streets, disturbed."""

import argparse
import dataclasses
import itertools
import json
import logging
import statistics
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from companion.types.events import Dialect
from tests.mission.team import disturbed_flights, hearing_cost, map_flights, planning_cost, street_flights
from tests.mission.team.shared_goal_flights import flown


def say(text):
    """One line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def gone_words(outcomes):
    """What became of flights of which one member is gone."""
    kept, had_goals = sum(each.is_kept for each in outcomes), sum(each.left > 0 for each in outcomes)
    return (
        f"{len(outcomes)} flights, one of four gone: {kept} with all goals flown, apart and unhurt; in "
        f"{had_goals} it had goals left; {sum(each.twice for each in outcomes)} goals flown twice"
    )


def map_words(outcomes):
    """What became of flights over maps, beside the same aircraft without shared plans."""
    kept, alone = sum(each.is_kept for each in outcomes), sum(not each.is_separate_alone for each in outcomes)
    ratios = [statistics.median(each.ratios) for each in outcomes if each.ratios]
    return (
        f"{len(outcomes)} flights: {kept} arrived, apart and unhurt; without shared plans {alone} lost "
        f"separation; arrival {statistics.median(ratios or [1.0]):.3f} times that of each alone"
    )


def street_words(outcomes):
    """What became of flights in streets."""
    kept, moved = sum(each.is_kept for each in outcomes), sum(each.moved for each in outcomes)
    last_s = max(each.last_s for each in outcomes)
    return (
        f"{len(outcomes)} flights: {kept} arrived, apart and unhurt, the last after {last_s:.0f} s; {moved} "
        f"times one moved out of another one's way"
    )


def disturbed_words(outcomes):
    """What became of flights that something happened to."""
    kept = sum(each.is_kept for each in outcomes)
    return f"{len(outcomes)} flights: {kept} without an error, a hit or two too near that nothing happened to"


def main():
    """Fly them, and end with 1 if one goes wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "what", nargs="?", default="gone", choices=("gone", "maps", "streets", "disturbed", "cost")
    )
    parser.add_argument("-n", type=int, default=50, help="flights")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="flights at once")
    parser.add_argument("--px4", action="store_true", help="PX4 instead of ArduPlane, where one is gone")
    chosen = parser.parse_args()
    if chosen.what == "cost":
        logging.disable(logging.CRITICAL)
        for line in itertools.chain(hearing_cost.lines(), planning_cost.lines()):
            say(line)
        return
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.n)
    dialect = Dialect.PX4 if chosen.px4 else Dialect.ARDUPILOT
    fly, words = (partial(flown, dialect=dialect), gone_words)
    if chosen.what == "maps":
        fly, words = map_flights.flown, map_words
    elif chosen.what == "streets":
        fly, words = street_flights.flown, street_words
    elif chosen.what == "disturbed":
        fly, words = disturbed_flights.flown, disturbed_words
    outcomes = []
    with ProcessPoolExecutor(chosen.jobs, initializer=logging.disable, initargs=(logging.CRITICAL,)) as pool:
        for outcome in pool.map(fly, seeds):
            outcomes.append(outcome)
            say(json.dumps(dataclasses.asdict(outcome)) + ("" if outcome.is_kept else " FAILED"))
            say(words(outcomes))
    sys.exit(not all(each.is_kept for each in outcomes))


if __name__ == "__main__":
    main()
