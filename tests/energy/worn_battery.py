"""Flights with a worn battery that does not reach both goal and home, and with a sound one that does."""

import math
from dataclasses import dataclass

import numpy as np

from companion.config import mission_from_text
from companion.config.compose import energy_budget_of, goals_of, wind_of
from companion.flight.state.modes import Mode
from companion.frames import speed_made_good
from tests.flight.test_app import both
from tests.flights.flown import mission_named
from tests.sim.client import PLAIN
from tests.support.sitl_harness import SitlHarness

DRAIN = 2.0
BY_RETURN_PATH = 4  # RTL_AUTOLAND
# Turning back is due at this share of the way to the goal.
SHARES = (0.55, 0.8)
# Not earlier, though: half a minute after the takeover, at 36 s, it is known how fast the battery falls, and
# the pilot is to be told 30 s before. The rest is for the error of this estimate: the valley bends.
DUE_MIN_S = 90.0
ROUND_WH = 4.0  # One round of the circle at home, which the way home includes.
RESERVE_SHARE = 0.2  # The reserve is this share of the capacity, as in the shipped mission files.
HOME_M = (
    200.0  # The aircraft is home at this distance from it: on the circle, which has 125 m and a turn into it.
)
LIMIT_S = 900.0
AWAY_S = 30.0  # Before this time the aircraft has not left home yet.
NUM_BLOCKS = 7
WAY_M = 6_000.0
CLEAR_M = 500.0  # Start and goal are this far from every block.
WORLDS = ("valley", "blocks")
AMPLE_WH = 300.0  # Goal and home are reached with half of it.


@dataclass
class Outcome:
    """How a flight ended.

    Parameters
    ----------
    seed : int
        Number of the flight.
    world : str
        Where it was flown.
    capacity_wh, reserve_wh : float
        Energy of the full battery, and what must be left [Wh].
    told_s, turned_s : float or None
        When the pilot was told for the first time to turn back, and when the service did [s].
    at_goal_s, home_s : float or None
        When the aircraft was at the goal, and home again [s].
    left_wh : float
        True energy left when the aircraft was home, or at the time limit [Wh].
    has_hit : bool
        Whether it hit anything.
    """

    seed: int
    world: str
    capacity_wh: float
    reserve_wh: float
    told_s: float | None = None
    turned_s: float | None = None
    at_goal_s: float | None = None
    home_s: float | None = None
    left_wh: float = math.nan
    has_hit: bool = False

    @property
    def is_home(self):
        """Whether the aircraft is home with the reserve."""
        return self.home_s is not None and self.left_wh >= self.reserve_wh and not self.has_hit

    @property
    def is_empty(self):
        """Whether the battery was empty before the aircraft was home."""
        return self.left_wh < 0.0

    @property
    def notice_s(self):
        """How long before the turn the pilot was told [s]; None without both."""
        if self.told_s is None or self.turned_s is None:
            return None
        return self.turned_s - self.told_s


def blocks(rng):
    """A map with random blocks between start and goal, as a mission."""
    goal = round(WAY_M)
    text = PLAIN.replace(
        "{east_m: 1750, north_m: 750, up_m: 100}", f"{{east_m: {goal}, north_m: 0, up_m: 100}}"
    )
    text = text.replace(
        "east_m: [-6000, 6000], north_m: [-6000, 6000]", "east_m: [-800, 7000], north_m: [-1500, 1500]"
    )
    text += "obstacles:\n"
    for number in range(NUM_BLOCKS):
        width, height = rng.uniform(150.0, 450.0, 2)
        west = rng.uniform(CLEAR_M, WAY_M - CLEAR_M - width)
        south = rng.uniform(-800.0, 800.0 - height)
        corners = [
            (west, south),
            (west + width, south),
            (west + width, south + height),
            (west, south + height),
        ]
        polygon = [[round(float(value)) for value in corner] for corner in corners]
        text += f"  - {{name: block_{number}, polygon_enu_m: {polygon}, base_m: 0, top_m: 300}}\n"
    valley = mission_named("valley")
    return mission_from_text(text, "blocks.yaml").model_copy(update={"energy": valley.energy})


def straight_s(mission):
    """How long the straight way from the start to the goal takes in the mean wind [s]."""
    start, goal = mission.start, mission.goals[-1]
    east, north = goal.east_m - start.east_m, goal.north_m - start.north_m
    cruise = float(mission.vehicle.airspeed_cruise_m_s)
    return math.hypot(east, north) / speed_made_good(math.atan2(east, north), cruise, wind_of(mission))


def drawn(seed):
    """The mission of a flight: world, wind and capacity; by the model twice as much goes as is told."""
    rng = np.random.default_rng(seed)
    world = WORLDS[seed % len(WORLDS)]
    mission = mission_named("valley") if world == "valley" else blocks(rng)
    weather = mission.simulation.model_copy(
        update={
            "wind_speed_m_s": float(rng.uniform(0.0, 5.0)),
            "wind_from_deg": float(rng.uniform(0.0, 360.0)),
            "turbulence": "light",
        }
    )
    mission = mission.model_copy(update={"simulation": weather})
    goal = energy_budget_of(mission, goals_of(mission)).goals[-1]
    there_wh, back_wh = goal.used_wh, goal.left_wh - goal.left_after_return_wh
    there_s = straight_s(mission)
    share = float(rng.uniform(max(SHARES[0], min(DUE_MIN_S / there_s, SHARES[1])), SHARES[1]))
    used_wh = DRAIN * (share * (there_wh + back_wh) + ROUND_WH)
    capacity_wh = round(used_wh / (1.0 - RESERVE_SHARE), 1)
    energy = mission.energy.model_copy(
        update={"capacity_wh": capacity_wh, "reserve_wh": round(RESERVE_SHARE * capacity_wh, 1)}
    )
    authority = mission.authority.model_copy(update={"turn_back": True})
    return mission.model_copy(update={"energy": energy, "authority": authority})


class Watch:
    """Notes when the aircraft is where; at the goal the pilot returns to launch."""

    def __init__(self, outcome, mission):
        self.outcome, self.mission = outcome, mission

    def __call__(self, harness):
        simulator, outcome, now = harness.simulator, self.outcome, harness.now_s
        outcome.left_wh = outcome.capacity_wh - simulator.energy_used_wh
        outcome.has_hit = bool(simulator.truth.collision)
        start, here = self.mission.start, simulator.truth.path[-1]
        if outcome.at_goal_s is None and harness.app.mode is Mode.ARRIVED:
            outcome.at_goal_s = now
            simulator.set_mode("RTL")
        away_m = math.dist(here[1:3], (float(start.east_m), float(start.north_m)))
        if now > AWAY_S and away_m < HOME_M:
            outcome.home_s = now
        harness.is_over = outcome.has_hit or outcome.home_s is not None


def worn_flight(seed, *, mission=None, knows=True, until_s=LIMIT_S, on_step=None, **simulated):
    """Fly one, and return the harness and the outcome.

    A service that does not know has the mission file without a section ``energy``.
    """
    mission = mission or drawn(seed)
    energy = mission.energy
    outcome = Outcome(seed, WORLDS[seed % len(WORLDS)], float(energy.capacity_wh), float(energy.reserve_wh))
    harness = SitlHarness(mission, seed, battery_drain=DRAIN, **simulated)
    parameters = harness.simulator.autopilot.parameters
    if "RTL_AUTOLAND" in parameters.names:
        parameters["RTL_AUTOLAND"] = BY_RETURN_PATH
    if not knows:
        plain = mission.authority.model_copy(update={"turn_back": False})
        harness.flight.mission = mission.model_copy(update={"energy": None, "authority": plain})
    watch = Watch(outcome, mission)
    harness.fly(until_s, watch if on_step is None else both(watch, on_step))
    told = [decision for decision in harness.recorder.decisions if decision.kind == "energy"]
    warned = (each.stamp_s for each in told if each.told.startswith("Battery: turn back in"))
    outcome.told_s = next(warned, None)
    outcome.turned_s = next((each.stamp_s for each in told if each.told == "Battery: turning back now"), None)
    return harness, outcome


def flown(seed, *, knows=True):
    """Fly one, and return its outcome."""
    return worn_flight(seed, knows=knows)[1]


def prediction_error(seed):
    """Fly to the goal with a sound battery; the relative error of the energy predicted at the takeover."""
    mission = drawn(seed)
    ample = mission.energy.model_copy(update={"capacity_wh": AMPLE_WH, "reserve_wh": 0.0})
    harness, noted = SitlHarness(mission.model_copy(update={"energy": ample}), seed), {}

    def on_step(harness):
        used_wh, energy = harness.simulator.energy_used_wh, harness.app.replanning.energy
        outlook = energy.outlook
        if not noted and outlook is not None and outlook.at_end_wh is not None:
            noted["begin"] = used_wh
            noted["predicted"] = energy.now(harness.now_s).left_wh - outlook.at_end_wh
        harness.is_over = harness.app.mode is Mode.ARRIVED

    harness.fly(LIMIT_S, on_step)
    return noted["predicted"] / (harness.simulator.energy_used_wh - noted["begin"]) - 1.0
