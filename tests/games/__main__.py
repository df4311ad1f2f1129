"""``python -m tests.games find`` looks for games that can be won and are lost blind, ``fly`` flies them."""

import argparse
import itertools
import json
import logging
import statistics
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from companion.config import mission_from_text
from tests.games.flights import PLANNERS, played
from tests.games.generator import random_game
from tests.games.hunt import is_game

# What `find --route 50 --speed 50 --first-seed 200` found.
HUNDRED = Path(__file__).with_name("hundred.json")
BATCH = 8  # seeds given to a process at once


def say(text):
    """One line."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def judged(kind, seed):
    """Whether the map of that seed is a game of its kind, and whether the planner blind to it loses it."""
    is_one = is_game(kind, mission_from_text(random_game(seed, kind), f"{kind}_{seed}.yaml"))
    return is_one, is_one and not played(kind, seed, "blind").is_won


def find(wanted, first_seed, pool, jobs):
    """The first so many games of each kind that are lost blind, as pairs of kind and seed."""
    found = []
    for kind, number in wanted.items():
        began, seeds, num_games = time.time(), [], 0
        for first in itertools.count(first_seed, BATCH * jobs):
            if len(seeds) >= number:
                break
            batch = range(first, first + BATCH * jobs)
            verdicts = pool.map(judged, [kind] * len(batch), batch)
            for seed, (is_one, is_lost) in zip(batch, verdicts, strict=True):
                if len(seeds) < number:
                    num_games += is_one
                    seeds += [seed] * is_lost
            if sys.stderr.isatty():
                sys.stderr.write(f"{kind}: {len(seeds)} in {batch.stop - first_seed} maps\n")
        found += [[kind, seed] for seed in seeds]
        tried = seeds[-1] - first_seed + 1 if seeds else 0
        took_s = time.time() - began
        say(f"{kind}: {num_games} games in {tried} maps, {len(seeds)} of them lost blind; {took_s:.0f} s")
    return found


def told(outcome):
    """A flight in a line."""
    words = [
        "won" if outcome.is_won else "not won",
        "safe" if outcome.is_safe else f"catchable at {outcome.caught_s:.1f} s",
        "goal" if outcome.is_at_goal else "no goal",
        *(["HIT"] if outcome.is_hit else []),
        f"{outcome.threatened_s:.1f} s under threat",
        f"{outcome.flown_s:.0f} s at {outcome.airspeed_m_s:.1f} m/s",
    ]
    return f"  {outcome.kind} {outcome.seed}: " + ", ".join(words)


def summary(name, outcomes):
    """All flights of a kind in a line."""
    return (
        f"{name}: {len(outcomes)} flights, {sum(each.is_won for each in outcomes)} won, "
        f"{sum(each.is_safe for each in outcomes)} safe, "
        f"{statistics.median(each.threatened_s for each in outcomes):.1f} s under threat median, "
        f"{sum(each.is_at_goal for each in outcomes)} goals, "
        f"{sum(each.is_hit for each in outcomes)} collisions, "
        f"{statistics.mean(each.airspeed_m_s for each in outcomes):.1f} m/s mean"
    )


def fly(games, planner, pool):
    """Fly the games with a planner."""
    began, outcomes = time.time(), []
    kinds, seeds = [kind for kind, _ in games], [seed for _, seed in games]
    for outcome in pool.map(played, kinds, seeds, [planner] * len(games)):
        outcomes.append(outcome)
        say(told(outcome))
    for kind in sorted(set(kinds)):
        say(summary(f"{planner}, {kind}", [each for each in outcomes if each.kind == kind]))
    say(f"{time.time() - began:.0f} s")


def main():
    """Find or fly."""
    parser = argparse.ArgumentParser(description=__doc__)
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--jobs", type=int, default=1, help="maps or flights at once")
    commands = parser.add_subparsers(dest="what", required=True)
    finding = commands.add_parser("find", parents=[common], help="games that can be won and are lost blind")
    finding.add_argument("--route", type=int, default=20, help="games that another way wins")
    finding.add_argument("--speed", type=int, default=20, help="games that only a faster flight wins")
    finding.add_argument("--first-seed", type=int, default=1)
    finding.add_argument("--out", type=Path, required=True)
    flying = commands.add_parser("fly", parents=[common], help="fly the games of a file")
    flying.add_argument("file", type=Path, nargs="?", default=HUNDRED)
    flying.add_argument("--planner", default="ours", choices=sorted(PLANNERS))
    flying.add_argument("-n", type=int, default=None, help="the first so many only")
    chosen = parser.parse_args()
    logging.disable(logging.CRITICAL)
    with ProcessPoolExecutor(chosen.jobs, initializer=logging.disable, initargs=(logging.CRITICAL,)) as pool:
        if chosen.what == "find":
            wanted = {"route": chosen.route, "speed": chosen.speed}
            found = find(wanted, chosen.first_seed, pool, chosen.jobs)
            chosen.out.write_text(json.dumps(found) + "\n", encoding="utf-8")
        else:
            games = json.loads(chosen.file.read_text(encoding="utf-8"))
            fly(games[: chosen.n], chosen.planner, pool)
    return 0


if __name__ == "__main__":
    sys.exit(main())
