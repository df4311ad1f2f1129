"""Flights of teams over random maps and shipped ones, a fifth of all messages lost, beside each alone."""

from dataclasses import dataclass, field

import numpy as np

from companion.config import load_mission
from companion.types.events import Dialect
from sim.team.team_flight import NoPlaceError, TeamFlight, fly_team
from tests.returns.return_flights import random_world
from tests.sim.client import CONFIGS

SHIPPED = ("paper-2d", "city-block")
LOSS = 0.2
LINGER_S = 90.0  # PX4s fly on to their landings for so long after the last one has arrived.


@dataclass
class TeamOutcome:
    """What became of a team; ``error`` is what ended the service."""

    seed: int
    world: str
    dialect: str
    num: int
    arrived: int = 0
    is_separate: bool = False
    has_hit: bool = False
    nearest_m: float = 0.0
    error: str = ""

    @property
    def is_kept(self):
        """Whether all arrived, apart and unhurt."""
        return self.arrived == self.num and self.is_separate and not self.has_hit and not self.error

    def note(self, team):
        """Note what became of a team that was flown."""
        self.num, self.arrived, self.is_separate = team.num, len(team.arrived_s), team.is_separate
        self.has_hit = bool(team.hit_s)
        self.nearest_m = round(min(flat for flat, _, _ in team.least_m.values()), 1)


@dataclass
class Outcome(TeamOutcome):
    """What became of a team, and of the same aircraft that do not share their plans.

    ``ratios`` are the members' arrivals over those of the same member alone.
    """

    ratios: list[float] = field(default_factory=list)
    bytes_s: float = 0.0
    is_separate_alone: bool = True


def scenario(seed):
    """Mission, the world's name, how many aircraft, and the autopilot: three of five maps are random."""
    number, sort = divmod(seed, 5)
    name = SHIPPED[sort] if sort < len(SHIPPED) else "random"
    mission = (
        load_mission(CONFIGS / f"{name}.yaml")
        if sort < len(SHIPPED)
        else random_world(np.random.default_rng(100_000 + seed))
    )
    weather = mission.simulation.model_copy(update={"radio_loss": LOSS})
    dialect = list(Dialect)[number % 2]
    return mission.model_copy(update={"simulation": weather}), name, (2, 4, 8)[number // 2 % 3], dialect


def flown(seed):
    """Fly a seed with shared plans and without."""
    mission, name, num, dialect = scenario(seed)
    outcome = Outcome(seed, name, dialect.value, num)
    try:
        team, alone = with_place(mission, num, seed, dialect)
        fly_team(team)
        fly_team(alone)
    except Exception as error:  # Whatever it is, it is what is looked for.
        outcome.error = repr(error)
        return outcome
    outcome.note(team)
    outcome.bytes_s = max(team.summary()["bytes_s"])
    outcome.ratios = [
        round(at_s / alone.arrived_s[number], 3)
        for number, at_s in sorted(team.arrived_s.items())
        if number in alone.arrived_s
    ]
    outcome.is_separate_alone = alone.is_separate
    return outcome


def with_place(mission, num, seed, dialect):
    """The team, with and without shared plans; half as many aircraft if a map has no place for all."""
    try:
        return (
            TeamFlight(mission, num, seed, dialect, linger_s=LINGER_S),
            TeamFlight(mission, num, seed, dialect, shares=False),
        )
    except NoPlaceError:
        if num <= 2:
            raise
        return with_place(mission, num // 2, seed, dialect)
