"""``python -m tests.energy``: flights with a worn battery: how many come home, and what was predicted."""

import argparse
import logging
import statistics
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial

from tests.energy.worn_battery import flown, prediction_error

NOTICE_S = 30.0  # The pilot is told this long before the service turns back, at least.


def say(text):
    """One line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def told(outcome):
    """A flight in a line."""
    moments = {
        "told": outcome.told_s,
        "turned": outcome.turned_s,
        "goal": outcome.at_goal_s,
        "home": outcome.home_s,
    }
    words = ", ".join(f"{name} {at:.0f} s" for name, at in moments.items() if at is not None)
    end = f"{outcome.left_wh:.1f} Wh of {outcome.capacity_wh:g} left, reserve {outcome.reserve_wh:g}"
    return f"  {outcome.world} {outcome.seed}: {words}; {end}{', HIT' if outcome.has_hit else ''}"


def is_kept(outcome):
    """Whether a flight keeps what is promised: home with the reserve, and told before the turn."""
    return outcome.is_home and (outcome.turned_s is None or (outcome.notice_s or 0.0) >= NOTICE_S)


def summary(name, outcomes):
    """All flights in a line."""
    notices = [outcome.notice_s for outcome in outcomes if outcome.notice_s is not None]
    extra = [outcome.left_wh - outcome.reserve_wh for outcome in outcomes]
    line = (
        f"{name}: {len(outcomes)} flights, {sum(each.is_home for each in outcomes)} home with the reserve, "
        f"{sum(each.home_s is not None and not each.is_empty for each in outcomes)} home with anything left, "
        f"{sum(each.turned_s is not None for each in outcomes)} turned back, "
        f"{sum(each.has_hit for each in outcomes)} hit something; left at home beyond the reserve: "
        f"median {statistics.median(extra):.1f}, least {min(extra):.1f} Wh"
    )
    if notices:
        line += f"; told before the turn: median {statistics.median(notices):.0f}, least {min(notices):.0f} s"
    return line


def main():
    """Fly them, and end with 1 if a flight that knows its battery breaks a promise."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=100, help="flights of each sort")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="flights at once")
    parser.add_argument("--all", action="store_true", help="print every flight, not only those that fail")
    chosen = parser.parse_args()
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.n)
    failures = 0
    with ProcessPoolExecutor(chosen.jobs, initializer=logging.disable, initargs=(logging.CRITICAL,)) as pool:
        for name, knows in (("with the section and turn_back", True), ("without the section", False)):
            began, outcomes = time.time(), []
            for outcome in pool.map(partial(flown, knows=knows), seeds):
                outcomes.append(outcome)
                if chosen.all or (knows and not is_kept(outcome)):
                    say(told(outcome))
            say(f"{summary(name, outcomes)}; {time.time() - began:.0f} s")
            if knows:
                failures = sum(not is_kept(outcome) for outcome in outcomes)
        errors = [100.0 * error for error in pool.map(prediction_error, seeds)]
        size = [abs(error) for error in errors]
        say(
            f"sound battery, predicted at the takeover over used up to the goal: {len(errors)} flights, "
            f"median {statistics.median(errors):+.1f} %, without the sign {statistics.median(size):.1f} %, "
            f"worst {max(size):.1f} %"
        )
    say(f"{failures} flights are not home with the reserve, or were told less than {NOTICE_S:.0f} s before")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
