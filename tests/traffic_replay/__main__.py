"""``make traffic-replay``: recorded aircraft about flights; prints what was told, missed and told wrongly."""

import argparse
import functools
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from sim.threats.recorded_tracks import recorded_from_text
from tests.traffic_replay.pieces import HOW, leap_fixes, pieces_of
from tests.traffic_replay.replay_flights import LENGTH_S, flown

TURNS = tuple(how for how in HOW if how != "leap")
COLUMNS = (
    "flights", "reports", "impossible", "errors", "alerts", "unjustified", "near alone", "of these told",
    "near", "told", "missed", "sudden", "wrong detours",
)  # fmt: skip


def chosen_flights(path, limit, first=0):
    """At most ``limit`` pieces of a recording, spread over it, each with how it is placed; then its leaps.

    The ways of placing them follow each other, beginning with number ``first``.
    """
    tracks = recorded_from_text(path.read_text(encoding="utf-8"), path.name)
    pieces = pieces_of(path.stem, tracks, LENGTH_S)
    others = [*pieces, *pieces_of(path.stem, tracks, LENGTH_S, 0.5 * LENGTH_S)]
    leaping = [piece for piece in others if len(leap_fixes(piece))]
    found = [(piece, TURNS[turn % len(TURNS)]) for turn, piece in enumerate(spread(pieces, limit), first)]
    return found + [(piece, "leap") for piece in spread(leaping, limit)]


def spread(pieces, limit):
    """At most ``limit`` of the pieces, evenly."""
    if len(pieces) <= limit:
        return pieces
    return [pieces[int(index)] for index in np.linspace(0, len(pieces) - 1, limit)]


def flight(entry):
    """Fly an entry: number, piece, and how it is placed."""
    number, piece, how = entry
    return flown(piece, how, number)


def tally(counts, before_s, told):
    """Count a flight; keep how long before the pilot was told."""
    counts["flights"] += 1
    counts["reports"] += told.reports
    counts["impossible"] += told.impossible
    counts["errors"] += len(told.errors)
    counts["alerts"] += len(told.alerts_s)
    counts["unjustified"] += len(told.unjustified_s)
    is_near = len(told.alone) > 0
    counts["near alone"] += is_near
    counts["of these told"] += is_near and len(told.alerts_s) > 0
    counts["near"] += len(told.told_before_s)
    counts["told"] += sum(np.isfinite(told.told_before_s))
    counts["sudden"] += len(told.sudden_s)
    counts["missed"] += len(told.missed)
    counts["wrong detours"] += told.is_wrong_detour
    before_s += [stamp for stamp in told.told_before_s if np.isfinite(stamp)]


def say(text):
    """One line, at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main():
    """Fly about each recording, and end with 1 if anything was not as it should be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings, CSV")
    parser.add_argument("-n", type=int, default=20, help="flights a recording, and as many with leaps")
    parser.add_argument("--first", type=int, default=0, help="number of the first flight: others draw others")
    parser.add_argument("--jobs", type=int, default=1, help="flights at once")
    chosen = parser.parse_args()
    began, total, before_s, wrong = time.time(), Counter(), [], 0
    say("recording | " + " | ".join(COLUMNS))
    with ProcessPoolExecutor(chosen.jobs) as pool:
        fly = map if chosen.jobs == 1 else functools.partial(pool.map, chunksize=4)
        for place, path in enumerate(chosen.files):
            entries = [
                (chosen.first + number, *entry)
                for number, entry in enumerate(chosen_flights(path, chosen.n, place))
            ]
            counts = Counter()
            for told in filter(None, fly(flight, entries)):
                tally(counts, before_s, told)
                if told.is_wrong:
                    wrong += 1
                    say(f"  {told}")
            say(f"{path.stem} | " + " | ".join(str(counts[column]) for column in COLUMNS))
            total += counts
    say("all | " + " | ".join(str(total[column]) for column in COLUMNS))
    if before_s:
        quantiles = np.quantile(before_s, [0.0, 0.1, 0.5])
        say("told before, least, 10 %, median: " + ", ".join(f"{value:.1f} s" for value in quantiles))
    say(f"{wrong} flights wrong; {time.time() - began:.0f} s")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
