"""Flights of teams in a city's streets: one circle fills a street, and whoever waits in one bars it."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from companion.config import mission_from_text
from companion.config.sections.team_section import TeamConfig
from companion.types.events import Dialect
from sim.team.team_flight import TeamFlight, fly_team
from tests.flight.replanning.test_surprise import LONG
from tests.mission.team import map_flights

BLOCKS, BLOCK_M = 4, 600.0  # Blocks a side, and the side of each.
WIDTHS_M, WINDS_M_S, NUMS = (330.0, 400.0), (0.0, 6.0), (3, 4)  # Of streets, of the mean wind, of aircraft.
LEAST_APART_M, LEAST_WAY_M, CORNER_M = 600.0, 700.0, 250.0
BLOCK = """  - name: block_{0}
    polygon_enu_m: [[{1}, {2}], [{3}, {2}], [{3}, {4}], [{1}, {4}]]
    base_m: 0
    top_m: 300
"""


@dataclass
class PlacedTeam(TeamFlight):
    """A team whose members have starts and goals of their own.

    ``places`` has for each member east and north of its start [m], its course there [deg], and east and north
    of its goal [m].
    """

    places: tuple[tuple[float, float, float, float, float], ...] = ()

    def missions(self):
        """The missions of all members."""
        team = TeamConfig(members=tuple(range(1, self.num + 1)))
        made = []
        for number, (east, north, course, goal_east, goal_north) in enumerate(self.places, 1):
            start = {"east_m": east, "north_m": north, "course_deg": course}
            goal = self.mission.goals[-1].model_copy(update={"east_m": goal_east, "north_m": goal_north})
            own = {
                "name": f"{self.mission.name}-{number}",
                "team": team,
                "start": self.mission.start.model_copy(update=start),
                "goals": (goal,),
            }
            made.append(self.mission.model_copy(update=own))
        return made


@dataclass
class Outcome(map_flights.TeamOutcome):
    """What became of a team in the streets.

    ``moved`` counts who moved out of another one's way, and ``last_s`` is when the last one arrived.
    """

    width_m: float = 0.0
    wind_m_s: float = 0.0
    moved: int = 0
    last_s: float = 0.0


def in_streets(rng, width_m):
    """A place in the middle of a street, and a course along it: east, north [m], course [deg]."""
    pitch_m = BLOCK_M + width_m
    across = 0.5 * width_m + pitch_m * float(rng.integers(BLOCKS + 1))
    along = float(rng.uniform(CORNER_M, BLOCKS * pitch_m + width_m - CORNER_M))
    back = 180.0 * float(rng.integers(2))
    return (across, along, back) if rng.random() < 0.5 else (along, across, 90.0 + back)


def places_of(seed, num, width_m):
    """Starts, far enough from each other, and goals likewise, each far enough from its start."""
    rng = np.random.default_rng(seed)
    while True:
        starts, goals = ([in_streets(rng, width_m) for _ in range(num)] for _ in range(2))
        pairs = [*itertools.combinations(starts, 2), *itertools.combinations(goals, 2)]
        least_m = min(math.dist(one[:2], other[:2]) for one, other in pairs)
        ways_m = [math.dist(start[:2], goal[:2]) for start, goal in zip(starts, goals, strict=True)]
        if least_m > LEAST_APART_M and min(ways_m) > LEAST_WAY_M:
            return tuple((*start, *goal[:2]) for start, goal in zip(starts, goals, strict=True))


def mission_of(width_m, wind_m_s):
    """The mission of a city with streets of a width, in a wind from the north-east."""
    pitch_m = BLOCK_M + width_m
    side = f"[-10, {BLOCKS * pitch_m + width_m}]"
    corners = [
        (width_m + east * pitch_m, width_m + north * pitch_m)
        for east, north in itertools.product(range(BLOCKS), repeat=2)
    ]
    blocks = [
        BLOCK.format(k, east, north, east + BLOCK_M, north + BLOCK_M)
        for k, (east, north) in enumerate(corners)
    ]
    text = LONG.replace("east_m: [-6000, 6000], north_m: [-6000, 6000]", f"east_m: {side}, north_m: {side}")
    mission = mission_from_text(text + "obstacles:\n" + "".join(blocks), "streets.yaml")
    weather = {"radio_loss": map_flights.LOSS, "wind_speed_m_s": wind_m_s, "wind_from_deg": 40.0}
    return mission.model_copy(update={"simulation": mission.simulation.model_copy(update=weather)})


def flown(seed):
    """Fly a seed."""
    dialect, width_m = list(Dialect)[seed % 2], WIDTHS_M[seed // 2 % 2]
    wind_m_s, num = WINDS_M_S[seed // 4 % 2], NUMS[seed // 8 % 2]
    outcome = Outcome(seed, "streets", dialect.value, num, width_m=width_m, wind_m_s=wind_m_s)
    places = places_of(seed, num, width_m)
    try:
        team = PlacedTeam(mission_of(width_m, wind_m_s), num, seed, dialect, places=places)
        fly_team(team)
    except Exception as error:  # Whatever it is, it is what is looked for.
        outcome.error = repr(error)
        return outcome
    outcome.note(team)
    outcome.last_s = max(team.arrived_s.values(), default=0.0)
    texts = [decision.told for flight in team.flights for decision in flight.recorder.decisions]
    outcome.moved = sum(text.startswith("Moving aside") for text in texts)
    return outcome
