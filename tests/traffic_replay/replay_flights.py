"""Flights about which recorded aircraft pass, and the judge of what the pilot was told and what was flown."""

import asyncio
import functools
import logging
import math
from dataclasses import dataclass, field

import numpy as np

from companion.config import load_mission
from companion.flight.state.modes import Mode
from sim.sitl import Flight
from sim.threats.replayed_reports import ReplayedReports
from tests.sim.client import CONFIGS
from tests.traffic_replay.oracle import TIME, impossible_rows, is_justified, losses
from tests.traffic_replay.pieces import placed

MISSION = CONFIGS.parent / "campaigns" / "encounters" / "passing.yaml"
LENGTH_S = 115.0  # Pieces are as long as a flight takes.
SEEDS = 4  # Flights alone, about which pieces are placed.
TOLD_MIN_S = 5.0  # An aircraft must be told of if it was reported for so long before it comes near.
FORGOTTEN_S = 75.0  # An alert longer ago than that does not count: it was about something else.
WIDE, WIDE_UP_M, WIDE_AHEAD_S = 2.0, 150.0, 120.0  # What stays farther away has no effect on the path.
ASIDE_MAX_M, ASIDE_UP_MAX_M = 60.0, 20.0  # Differences of two flights that are no detour.


@dataclass
class Outcome:
    """What became of a flight."""

    name: str
    how: str
    reports: int = 0
    impossible: int = 0
    errors: list = field(default_factory=list)
    alerts_s: list = field(default_factory=list)
    alone: list = field(default_factory=list)  # When it would have lost well clear without the service [s].
    sudden_s: list = field(default_factory=list)  # When it was lost without a report before [s].
    told_before_s: list = field(default_factory=list)  # Of each other loss; NaN if nothing was told [s].
    missed: list = field(default_factory=list)
    unjustified_s: list = field(default_factory=list)
    aside_m: tuple = (0.0, 0.0)
    is_wrong_detour: bool = False

    @property
    def is_wrong(self):
        """Whether anything was not as it should be."""
        return bool(self.errors or self.missed or self.unjustified_s or self.is_wrong_detour)


class ErrorsHeard(logging.Handler):
    """Keeps what is logged as an error."""

    def __init__(self):
        super().__init__(logging.ERROR)
        self.texts = []

    def emit(self, record):
        """Keep a line."""
        self.texts.append(record.getMessage())


@functools.cache
def mission():
    """The mission that is flown."""
    return load_mission(MISSION)


def path_of(flight):
    """The path that was flown (N, 4): time [s], east, north, up [m]."""
    return np.array(flight.simulator.truth.path)[:, :4]


@functools.cache
def path_alone(seed):
    """The path of the flight about which nobody is (N, 4)."""
    flight = Flight(mission(), seed)
    asyncio.run(flight.fly())
    assert flight.app.mode is Mode.ARRIVED
    return path_of(flight)


def flown(piece, how, number):
    """Fly with a piece that is placed ``how`` and drawn by ``number``; None if it cannot be placed so."""
    seed = 1 + number % SEEDS
    alone, frame = path_alone(seed), mission().frame
    there = placed(piece, how, alone, frame, np.random.default_rng([number, 5]))
    if there is None:
        return None
    flight = Flight(mission(), seed)
    reports = zip(there.rows[:, TIME], there.reports, strict=True)
    receiver = ReplayedReports(flight.simulator.autopilot, reports)
    heard = ErrorsHeard()
    logging.getLogger().addHandler(heard)
    told = Outcome(piece.name, how, len(there.reports))
    try:
        asyncio.run(flight.fly(lambda flown: receiver.update(round(flown.now_s * 1e6))))
    except Exception as error:  # Whatever it is, it is what is looked for.
        told.errors.append(repr(error))
    finally:
        logging.getLogger().removeHandler(heard)
    told.errors += heard.texts
    if flight.app.mode is not Mode.ARRIVED or flight.simulator.truth.collision:
        told.errors.append(f"not arrived: {flight.app.mode.name}")
    judge(told, there, flight, alone)
    return told


def judge(told, piece, flight, alone):
    """Compare what was told and flown with what the reports say."""
    path, sea_m = path_of(flight), mission().frame.altitude_amsl_m
    told.impossible = len(impossible_rows(piece.rows, sea_m))
    name = f"icao:{piece.address:06X}"
    told.alerts_s = [
        round(entry.stamp_s, 2)
        for entry in flight.recorder.decisions
        if entry.kind == "traffic" and entry.text.startswith(name)
    ]
    told.alone = losses(piece.rows, alone, sea_m)
    for when, heard_s, gap_s in losses(piece.rows, path, sea_m):
        if heard_s < TOLD_MIN_S + gap_s:
            told.sudden_s.append(round(when, 1))  # Nobody could have told of it.
            continue
        before = [when - stamp for stamp in told.alerts_s if 0.0 <= when - stamp <= FORGOTTEN_S]
        told.told_before_s.append(round(max(before, default=math.nan), 1))
        if not before:
            told.missed.append((round(when, 1), round(heard_s, 1), round(gap_s, 1)))
    told.unjustified_s = [
        stamp for stamp in told.alerts_s if not is_justified(piece.rows, path, stamp, sea_m)
    ]
    told.aside_m = aside(path, alone)
    if told.aside_m[0] > ASIDE_MAX_M or told.aside_m[1] > ASIDE_UP_MAX_M:
        told.is_wrong_detour = not any(
            is_justified(piece.rows, path, now_s, sea_m, room=WIDE, room_up_m=WIDE_UP_M, ahead_s=WIDE_AHEAD_S)
            for now_s in np.arange(1.0, path[-1, 0])
        )


def aside(path, alone):
    """How far a flight leaves the path of another one at most, horizontally and vertically [m]."""
    east = np.abs(np.subtract.outer(path[::10, 1], alone[:, 1]))
    away = np.hypot(east, np.subtract.outer(path[::10, 2], alone[:, 2]))
    nearest = away.argmin(axis=1)
    up = np.abs(path[::10, 3] - alone[nearest, 3])
    return round(float(away.min(axis=1).max()), 1), round(float(up.max()), 1)
