"""The simulator's own pursuer after a way that it is told from the start, without flying."""

import itertools
import math

import numpy as np

from sim.threats.pursuer import TargetEstimate
from sim.threats.pursuers import pursuers_of
from tests.games.geometry import STEPS
from tests.games.oracle import game_of, kind_of, seconds_under_threat

PERIOD_S = 0.1  # as the simulator drives it


def hunted_s(rows, mission):
    """Seconds under threat on a way, rows (t, east, north), with the mission's pursuer after it."""
    ((_, pursuer),) = pursuers_of(mission)
    game, driven = game_of(mission), []
    times = np.arange(0.0, rows[-1, 0], PERIOD_S)
    flown = np.column_stack([times, *(np.interp(times, rows[:, 0], rows[:, axis]) for axis in (1, 2))])
    for row, following in itertools.pairwise(flown):
        speed = math.dist(row[1:], following[1:]) / PERIOD_S
        ahead = tuple(map(tuple, rows[rows[:, 0] > row[0]][::STEPS, 1:]))
        pursuer.step(round(row[0] * 1e6), PERIOD_S, TargetEstimate(tuple(row[1:]), speed, ahead, 1))
        driven.append((row[0], *pursuer.position))
    return seconds_under_threat(flown, driven, game.polygons, game.reach_m)


def is_game(kind, mission):
    """Whether a map is a game of a kind, and the simulator's pursuer threatens its shortest way."""
    game = game_of(mission)
    return kind_of(game) == kind and hunted_s(game.shortest, mission) > 0.0
