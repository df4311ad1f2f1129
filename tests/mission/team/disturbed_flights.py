"""Flights of teams that anything happens to: pilots switch modes, members are gone, radios fall silent."""

import itertools
from dataclasses import dataclass, field

import numpy as np

from companion.config.sections.team_section import TeamConfig
from companion.types.events import Dialect
from sim.team.team_flight import TeamFlight, fly_team
from tests.mission.team.shared_goal_flights import mission_of
from tests.returns.return_flights import random_world

MODES = {
    Dialect.ARDUPILOT: (("LOITER", "RTL", "CIRCLE", "FBWB", "GUIDED"), "AUTO"),
    Dialect.PX4: (("LOITER", "RTL", "POSCTL"), "MISSION"),
}
LATEST_S = 120.0  # Everything begins before this time.
SHARED_SHARE, GONE_SHARE, SILENT_SHARE = 0.6, 0.3, 0.4  # Of the flights.


@dataclass
class Outcome:
    """What became of a flight; ``near`` and ``hit`` count only members that nothing happened to."""

    seed: int
    dialect: str
    num: int
    is_shared: bool
    switched: list[tuple[float, int, str]]
    gone_s: dict[int, float]
    silent_s: tuple[float, float] | None
    arrived: int = 0
    near: list[tuple[int, int]] = field(default_factory=list)
    hit: list[int] = field(default_factory=list)
    error: str = ""

    @property
    def is_kept(self):
        """Whether no service ended, nothing was hit, and no two came too near; arrivals may be barred."""
        return not self.error and not self.near and not self.hit


class Disturbed(TeamFlight):
    """A flight in which switches are moved, and in which all radios are silent for a time."""

    switched = ()
    silent_s = None

    def members_there(self, now_s):
        """The members that are there; what is due happens before."""
        while self.switched and self.switched[0][0] <= now_s:
            _, member, mode = self.switched.pop(0)
            self.flights[member - 1].simulator.set_mode(mode)
        if self.silent_s is not None:
            is_silent = self.silent_s[0] <= now_s < self.silent_s[1]
            self.radio._loss = 1.0 if is_silent else self.mission.simulation.radio_loss
        return super().members_there(now_s)


def scenario(seed):
    """The mission, how many fly it, the autopilot, and what happens."""
    rng = np.random.default_rng(seed)
    num, is_shared = int(rng.integers(2, 5)), rng.random() < SHARED_SHARE
    if is_shared:
        side_m, apart_m = rng.choice([(1000.0, 200.0), (1000.0, 300.0), (1800.0, 550.0), (2800.0, 550.0)])
        mission = mission_of(seed, int(rng.integers(2, 7)), float(side_m), float(apart_m))
    else:
        mission = random_world(np.random.default_rng(1000 + seed))
    team = mission.team or TeamConfig(members=(1, 2))
    changed = {"members": tuple(range(1, num + 1)), "lost_after_s": float(rng.choice([10, 20, 60]))}
    weather = {
        "radio_loss": float(rng.choice([0, 0.2, 0.5])),
        "radio_delay_s": float(rng.choice([0, 0.5, 1.5])),
    }
    mission = mission.model_copy(
        update={
            "team": team.model_copy(update=changed),
            "simulation": mission.simulation.model_copy(update=weather),
        }
    )
    dialect = list(Dialect)[seed % 2]
    others, flown = MODES[dialect]
    switched = []
    for _ in range(int(rng.integers(0, 4))):
        member, at_s = int(rng.integers(1, num + 1)), float(rng.uniform(3.0, LATEST_S))
        switched.append((at_s, member, str(rng.choice(others))))
        switched.append((at_s + float(rng.uniform(1.0, 40.0)), member, flown))
    is_gone = num > 2 and rng.random() < GONE_SHARE
    gone_s = {int(rng.integers(1, num + 1)): float(rng.uniform(5.0, LATEST_S))} if is_gone else {}
    begins_s = float(rng.uniform(5.0, LATEST_S))
    silent_s = (begins_s, begins_s + float(rng.uniform(5.0, 40.0))) if rng.random() < SILENT_SHARE else None
    return mission, num, dialect, sorted(switched), gone_s, silent_s


def flown(seed):
    """Fly a seed."""
    mission, num, dialect, switched, gone_s, silent_s = scenario(seed)
    outcome = Outcome(seed, dialect.value, num, mission.shares_goals, list(switched), gone_s, silent_s)
    touched = {member for _, member, _ in switched} | set(gone_s)
    try:
        team = Disturbed(mission, num, seed, dialect, gone_s=gone_s)
        team.switched, team.silent_s = switched, silent_s
        fly_team(team)
    except Exception as error:  # Whatever it is, it is what is looked for.
        outcome.error = repr(error)
        return outcome
    config, others = mission.team, set(range(1, num + 1)) - touched
    outcome.arrived, outcome.hit = len(team.arrived_s), sorted(others & set(team.hit_s))
    if silent_s is None:  # Members that lost each other may conflict.
        outcome.near = [
            pair
            for pair in itertools.combinations(sorted(others), 2)
            if team.least_m[pair][0] < config.apart_m and team.least_m[pair][1] < config.apart_up_m
        ]
    return outcome
