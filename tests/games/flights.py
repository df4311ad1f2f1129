"""Games that are flown in the simulator, and what became of them."""

import asyncio
import math
from dataclasses import dataclass

import numpy as np
import yaml

from companion.config import mission_from_text
from companion.types.events import Dialect
from sim.faults import FaultyLink, LinkFaults
from sim.sitl import Flight
from sim.threats.adsb_source import SOURCE_SYSTEM
from tests.games.generator import random_game
from tests.games.oracle import first_threatened_s, game_of, seconds_under_threat

_SENDER = 5  # place of the system id in a MAVLink 2 frame


def unchanged(text):
    """The service gets the mission file that the simulator gets."""
    return text


def without_threats(text):
    """The service is told of no moving threat."""
    document = yaml.safe_load(text)
    del document["dynamic_threats"]
    return yaml.safe_dump(document, sort_keys=False)


def by_method(method):
    """The service plans by another method."""

    def changed(text):
        document = yaml.safe_load(text)
        document["planning"]["method"] = method
        return yaml.safe_dump(document, sort_keys=False)

    return changed


# Mission file of the service, made of the game's, by planner. If it names no moving threat, reports of
# them do not get through to the service either.
PLANNERS = {
    "ours": unchanged,
    "cruise": by_method("safe-rrt-cruise"),
    "rs": by_method("safe-rrt-rs"),
    "blind": without_threats,
}


@dataclass(frozen=True)
class Outcome:
    """How a game ended.

    ``caught_s`` is when a pursuer that knew the flown path from the start could first have threatened it;
    all figures are of the flight until the goal, or until its end.
    """

    kind: str
    seed: int
    is_at_goal: bool
    is_hit: bool
    threatened_s: float
    caught_s: float
    airspeed_m_s: float
    flown_s: float

    @property
    def is_won(self):
        """Whether it arrived unhurt and was never threatened."""
        return self.is_at_goal and not self.is_hit and self.threatened_s == 0.0

    @property
    def is_safe(self):
        """Whether it arrived unhurt and could never have been threatened."""
        return self.is_at_goal and not self.is_hit and self.caught_s == math.inf


def played(kind, seed, planner):
    """Fly one game; the simulator's mission is the game's whatever the planner is told."""
    text = random_game(seed, kind)
    mission = mission_from_text(text, f"{kind}_{seed:05d}.yaml")
    flight = Flight(mission, seed, None, Dialect.ARDUPILOT)
    flight.mission = mission_from_text(PLANNERS[planner](text), f"{planner}.yaml")
    if not flight.mission.dynamic_threats:
        link = FaultyLink(flight.simulator, LinkFaults(), seed=seed)
        link.watch = lambda frame, is_from_client: is_from_client or frame[_SENDER] != SOURCE_SYSTEM
        flight.wire = link
    asyncio.run(flight.fly())
    return outcome_of(flight, mission, kind, seed)


def outcome_of(flight, mission, kind, seed):
    """Judge a flight by the true paths."""
    truth, goal, game = flight.simulator.truth, mission.goals[-1], game_of(mission)
    rows = np.array(truth.path)
    away = np.linalg.norm(rows[:, 1:4] - (goal.east_m, goal.north_m, goal.up_m), axis=1)
    is_there = away <= goal.acceptance_radius_m
    if is_there.any():
        rows = rows[: int(np.argmax(is_there)) + 1]
    return Outcome(
        kind, seed, bool(is_there.any()), truth.collision,
        seconds_under_threat(rows, truth.dt_path, game.polygons, game.reach_m),
        first_threatened_s(rows[:, :3], game), float(rows[:, 6].mean()), float(rows[-1, 0]),
    )  # fmt: skip
