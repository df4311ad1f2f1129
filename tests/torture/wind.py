"""Campaign of the wind: how well flights know when they will be where, and what they hit."""

import itertools
from collections import Counter

import numpy as np

from companion.types.events import Dialect
from sim.bench.arrival import fly_in_wind
from tests.torture.harness import NARROW

MEDIAN_MAX_S, P95_MAX_S = 1.0, 3.0
SPEEDS_M_S = (0, 5, 10, 14)
DIRECTIONS_DEG = tuple(range(0, 360, 45))
SEEDS = (1, 2, 3)


def cases(speeds=SPEEDS_M_S, directions=DIRECTIONS_DEG, seeds=SEEDS):
    """World, autopilot, wind speed [m/s], direction it comes from [deg], seed; still air has but one."""
    every = itertools.product(NARROW, Dialect, speeds, directions, seeds)
    return [case for case in every if case[2] or case[3] == directions[0]]


def windy_flight(case):
    """A flight in the wind: the case, how it ended, and by how much places were passed late [s]."""
    world, *others = case
    return case, *fly_in_wind(NARROW[world], *others)


def run_wind(chosen, say, pool):
    """Fly them; how many hit something or did not arrive, and winds whose arrival was not foreseen."""
    ends, late, bad = {}, {}, 0
    for (world, dialect, speed, direction, seed), how, errors in pool.map(windy_flight, chosen):
        ends.setdefault(speed, Counter())[how] += 1
        late.setdefault(speed, []).extend(np.abs(errors))
        if how != "goal":
            bad += 1
            say(f"  {world} {dialect.value} {speed} m/s from {direction}, seed {seed}: {how}")
    for speed, counts in ends.items():
        median, most = np.percentile(late[speed], [50.0, 95.0])
        say(
            f"wind {speed} m/s: {dict(counts)}; arrival 30 s ahead off by {median:.2f} s median, "
            f"{most:.2f} s in 95 %, {len(late[speed])} places"
        )
        bad += median > MEDIAN_MAX_S or most > P95_MAX_S
    return bad
