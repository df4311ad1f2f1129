"""Flights over random places of real and generated ground, and the judge of what became of them.

The judge reads the simulator's ground. How much of a flight radars saw is found on that ground, too, by lines
of sight that the planner does not compute.
"""

import json
import math
from dataclasses import asdict, dataclass, replace

import numpy as np

from companion.config import mission_from_text
from companion.config.sections.terrain_map import posts_of
from companion.errors import ConfigError
from companion.types.events import Dialect
from sim.vehicle.true_ground import TrueGround
from tests.support.sitl_harness import SitlHarness

SIDE_M, TURN_M = 5_000.0, 125.0
LEAST_M, MOST_M = 60.0, 200.0
PURSUER_FAR_M = 1_000.0
FLOWN_S = 900.0
SAMPLE_ORIGIN = "{latitude_deg: 36.59, longitude_deg: -84.245, altitude_amsl_m: 0.0}"
SAMPLE_M = 14_000.0  # The sample map reaches this far from that origin, east, west, north and south.
OTHER_ORIGIN = "{latitude_deg: 47.4, longitude_deg: 8.5, altitude_amsl_m: 400.0}"

MISSION = """
name: ground
dimension: 3
unit_m: 25
origin: {origin}
bounds: {{east_m: [{west:.0f}, {east:.0f}], north_m: [{south:.0f}, {north:.0f}], up_m: [-200, 1500]}}
start: {{east_m: {a[0]:.0f}, north_m: {a[1]:.0f}, up_m: {a[2]:.0f}, course_deg: {course:.0f}}}
goals:
  - {{east_m: {b[0]:.0f}, north_m: {b[1]:.0f}, up_m: {b[2]:.0f}, acceptance_radius_m: 60}}
vehicle: {{airspeed_min_m_s: 12.5, airspeed_max_m_s: 37.5, airspeed_cruise_m_s: 25,
  acceleration_max_m_s2: 0.5, turn_radius_min_m: 125, straight_length_min_m: 40, penetration_speed_m_s: 30}}
planning: {{sensing_horizon_m: 1500, time_horizon_s: 15, total_planning_time_s: 600}}
terrain: {{{source}, height_min_m: 60, height_max_m: 200}}
simulation: {{wind_speed_m_s: {wind:.1f}, wind_from_deg: {wind_from:.0f}, turbulence: light}}
radars:
{radars}
dynamic_threats:
{pursuers}
"""


@dataclass
class GroundFlight:
    """What became of one flight.

    ``least_m`` is the least height over ground from the first mission of the service on, ``before_m`` that
    before it, on the straight line to the goal by the operator's list.
    """

    seed: int
    ground: str
    dialect: str
    reached: bool = False
    collision: bool = False
    least_m: float = math.inf
    before_m: float = math.inf
    seen_s: float = 0.0
    num_pursuers: int = 0
    threatened_s: float = 0.0
    straight_m: float = 0.0
    flown_m: float = 0.0
    lasted_s: float = 0.0
    plan_ms: float = 0.0


def scenario(seed):
    """A mission over a random place of random ground, between two circles that keep their height."""
    return mission_from_text(scenario_text(seed), f"ground {seed}")


def scenario_text(seed, *, range_times=1.0, is_known=False, has_pursuers=True):
    """The mission file of a seed; its radars see so many times as far, and may be known beforehand."""
    rng = np.random.default_rng(seed)
    is_sample = seed % 3 != 2
    reach = SAMPLE_M - SIDE_M
    west, south = rng.uniform(-reach, reach, 2) if is_sample else (0.0, 0.0)
    kind = ("ridges", "hills")[int(rng.integers(2))]
    relief = rng.uniform(100.0, 350.0)
    source = f"generated: {{kind: {kind}, seed: {seed}, relief_m: {relief:.0f}}}"
    values = {
        "origin": SAMPLE_ORIGIN if is_sample else OTHER_ORIGIN, "radars": "  []", "pursuers": "  []",
        "course": 0.0,
        "west": west, "east": west + SIDE_M, "south": south, "north": south + SIDE_M,
        "source": "sample: jacksboro_fault" if is_sample else source,
        "wind": rng.uniform(0.0, 8.0), "wind_from": rng.uniform(0.0, 359.0),
    }  # fmt: skip
    ground = TrueGround(_posts(values, west, south))
    while True:
        a, b = (_place(rng, ground, west, south) for _ in range(2))
        if math.dist(a[:2], b[:2]) < 0.5 * SIDE_M:
            continue
        radars = []
        for number in range(2):
            east, north = west + rng.uniform(0.0, SIDE_M), south + rng.uniform(0.0, SIDE_M)
            up, reach = ground.up_m(east, north) + 10.0, rng.uniform(600.0, 1_500.0)
            radars.append(
                f"  - {{name: r{number}, east_m: {east:.0f}, north_m: {north:.0f}, up_m: {up:.0f}, "
                f"max_threat_radius_m: {range_times * reach:.0f}, known_beforehand: {str(is_known).lower()}}}"
            )
        values |= {"a": a, "b": b, "course": rng.uniform(0.0, 359.0), "radars": "\n".join(radars)}
        if has_pursuers:
            values["pursuers"] = _pursuers(seed, a, b, west, south)
        text = MISSION.format(**values)
        try:
            mission_from_text(text, f"ground {seed}")
            return text
        except ConfigError:  # The highest ground of a cell is too high for the start or the goal.
            continue


def _pursuers(seed, a, b, west, south):
    """Two slow pursuers, far from the start and the goal, in every second pair of seeds."""
    rng, rows = np.random.default_rng((seed, 1)), []
    while seed % 4 >= 2 and len(rows) < 2:
        place = west + rng.uniform(0.0, SIDE_M), south + rng.uniform(0.0, SIDE_M)
        if min(math.dist(place, a[:2]), math.dist(place, b[:2])) > PURSUER_FAR_M:
            rows.append(
                f"  - {{name: p{len(rows)}, east_m: {place[0]:.0f}, north_m: {place[1]:.0f}, "
                f"speed_m_s: {rng.uniform(5.0, 10.0):.1f}, max_threat_radius_m: 250}}"
            )
    return "\n".join(rows) or "  []"


def _posts(values, west, south):
    """The map of a mission whose start and goal are not known yet, which are put high over its middle."""
    middle = west + 0.5 * SIDE_M, south + 0.5 * SIDE_M, 1_400.0
    text = MISSION.format(**(values | {"a": middle, "b": middle, "radars": "  []"}))
    text = text.replace(", height_max_m: 200", "")
    return posts_of(mission_from_text(text, "ground"))


def _place(rng, ground, west, south):
    """A place on a circle about which the aircraft keeps its height over ground at both limits."""
    angles = np.linspace(0.0, 2.0 * math.pi, 36)
    while True:
        east = west + rng.uniform(2.0 * TURN_M, SIDE_M - 2.0 * TURN_M)
        north = south + rng.uniform(2.0 * TURN_M, SIDE_M - 2.0 * TURN_M)
        ups = ground.ups_m(
            np.append(east + TURN_M * np.sin(angles), east), np.append(north + TURN_M * np.cos(angles), north)
        )
        low, high = float(ups.max()) + LEAST_M + 10.0, float(ups.min()) + MOST_M - 10.0
        if low < high:
            return east, north, 0.5 * (low + high)


def fly(seed):
    """Fly one seed."""
    mission, dialect = scenario(seed), list(Dialect)[seed % 2]
    harness = SitlHarness(mission, seed=seed, dialect=dialect)
    source = mission.terrain.sample or mission.terrain.generated.kind
    flight = GroundFlight(seed, source, dialect.value)

    def end(harness):
        harness.is_over = harness.flight.goal_reached or harness.simulator.truth.collision

    harness.fly(FLOWN_S, end)
    truth = harness.simulator.truth
    rows = np.array(truth.path)
    flight.reached, flight.collision = bool(harness.flight.goal_reached), truth.collision
    flight.lasted_s = harness.now_s
    over = rows[:, 3] - TrueGround(posts_of(mission)).ups_m(rows[:, 1], rows[:, 2])
    swaps = [entry.stamp_s for entry in harness.recorder.decisions if entry.kind == "swap"]
    is_ours = rows[:, 0] >= min(swaps, default=math.inf)
    flight.least_m, flight.before_m = (
        float(over[chosen].min(initial=math.inf)) for chosen in (is_ours, ~is_ours)
    )
    measures = harness.flight.measures().over_all()
    flight.seen_s, flight.threatened_s = measures["seconds_in_radar"], measures["seconds_in_reach_and_sight"]
    flight.num_pursuers = len(mission.dynamic_threats)
    flight.flown_m = float(np.linalg.norm(np.diff(rows[:, 1:3], axis=0), axis=1).sum())
    start, goal = mission.start, mission.goals[0]
    flight.straight_m = math.dist((start.east_m, start.north_m), (goal.east_m, goal.north_m))
    flight.plan_ms = float(np.median(harness.recorder.plan_ms or [math.nan]))
    return flight


def line_of(flight):
    """One line of JSON."""
    return json.dumps(asdict(replace(flight)))
