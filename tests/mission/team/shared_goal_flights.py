"""Flights of four aircraft that share six goals, one of which is gone at a random moment."""

import math
from dataclasses import dataclass

import numpy as np

from companion.config import mission_from_text
from companion.types.events import Dialect
from sim.team.team_flight import TeamFlight, fly_team

NUM_GOALS, SIDE_M, APART_M = 6, 2800.0, 550.0
GONE_S = (5.0, 60.0)
TEXT = """
name: shared-goals
dimension: 2
unit_m: 25
origin: {{latitude_deg: 47.4, longitude_deg: 8.5, altitude_amsl_m: 450}}
bounds: {{east_m: [-500, 3300], north_m: [-700, 3300], up_m: [0, 200]}}
start: {{east_m: 1400, north_m: 100, up_m: 100, course_deg: 0}}
goals:
{goals}
vehicle:
  airspeed_min_m_s: 12.5
  airspeed_cruise_m_s: 25
  airspeed_max_m_s: 37.5
  acceleration_max_m_s2: 0.5
  turn_radius_min_m: 100
  straight_length_min_m: 100
  penetration_speed_m_s: 30
planning: {{sensing_horizon_m: 825, time_horizon_s: 15, total_planning_time_s: 250, max_iterations: 12000}}
team: {{members: [1, 2, 3, 4], share_goals: true, lost_after_s: 20}}
simulation: {{radio_loss: 0.2}}
"""


def mission_of(seed, num_goals=NUM_GOALS, side_m=SIDE_M, apart_m=APART_M):
    """A mission with goals at random places in a square."""
    rng, places = np.random.default_rng(seed), []
    while len(places) < num_goals:
        place = rng.uniform(0.0, side_m, 2)
        if all(math.dist(place, other) > apart_m for other in places):
            places.append(place)
    goals = "\n".join(
        f"  - {{east_m: {east:.0f}, north_m: {north:.0f}, up_m: 100}}" for east, north in places
    )
    return mission_from_text(TEXT.format(goals=goals), "shared-goals.yaml")


@dataclass
class Outcome:
    """What became of a flight.

    ``left`` is how many goals the member that is gone still had, ``twice`` how many goals two members flew.
    """

    seed: int
    gone: int
    gone_s: float
    left: int
    unflown: int
    twice: int
    arrived: int
    is_separate: bool
    has_hit: bool
    flight_s: float
    bytes_s: float

    @property
    def is_kept(self):
        """Whether all goals are flown, the three others know that, and nobody came too near."""
        return self.unflown == 0 and self.arrived == 3 and self.is_separate and not self.has_hit


def flown(seed, dialect=Dialect.ARDUPILOT):
    """Fly a team of four; one member, and when it is gone, are drawn."""
    rng = np.random.default_rng(seed + 1000)
    gone, gone_s = int(rng.integers(1, 5)), round(float(rng.uniform(*GONE_S)), 1)
    team = TeamFlight(mission_of(seed), 4, seed, dialect, gone_s={gone: gone_s})
    fly_team(team)
    by = [[number for number, _ in passed] for passed in team.flown_by()]
    lost = team.flights[gone - 1].app.state
    return Outcome(
        seed, gone, gone_s, len(lost.goals) - lost.next_goal, sum(not each for each in by),
        sum(len(each) > 1 for each in by), len([n for n in team.arrived_s if n != gone]), team.is_separate,
        bool(team.hit_s), max(flight.now_s for flight in team.flights), max(team.summary()["bytes_s"]),
    )  # fmt: skip
