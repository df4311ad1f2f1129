from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.types.threat import Obstacle
from sim.simulator import Simulator
from sim.threats.pursuer import CLEARANCE_M, Pursuer, TargetEstimate
from sim.threats.roads import Roads
from tests.sim.client import Client, mission_file, nearest_m, plain_mission, route

BOUNDS = (0.0, 0.0, 2500.0, 2500.0)
THREAT = """
dynamic_threats:
  - {name: hunter, east_m: 1000, north_m: -900, speed_m_s: 25, max_threat_radius_m: 250}
"""


def roads_of(name: str) -> Roads:
    return Roads(mission_file(name).obstacle_list, BOUNDS, CLEARANCE_M)


def drive(pursuer: Pursuer, target: TargetEstimate, duration_s: float) -> np.ndarray:
    rows = []
    for turn in range(round(duration_s * 10)):
        pursuer.step(turn * 100_000, 0.1, target)
        rows.append(pursuer.position)
    return np.array(rows)


@pytest.mark.parametrize("seed", range(4))
def test_never_enters_an_obstacle_nor_breaks_its_limits(seed):
    roads = roads_of("paper-2d.yaml")
    generator = np.random.default_rng(seed)

    def free() -> tuple[float, float]:
        while True:
            east, north = generator.uniform(30.0, 2470.0, 2)
            if roads.is_clear(np.array([[east, north]])).all():
                return float(east), float(north)

    start = free()
    pursuer = Pursuer(roads, start, 25.0, 15.0)
    rows = [np.array([start])]
    for revision in range(4):
        # The aircraft circles far off in time: the pursuer goes and waits at its route's end.
        target = TargetEstimate(free(), 10.0, (free(), free()), revision)
        pursuer._next_plan_us = 0
        rows.append(drive(pursuer, target, 60.0))
    path = np.vstack(rows)
    assert not shapely.intersects(roads.walls, shapely.linestrings(path))
    steps = np.hypot(*np.diff(path, axis=0).T)
    assert steps.max() <= 2.5 + 1e-6


def test_goes_round_a_wall_by_the_shorter_end():
    wall = Obstacle(
        "wall", np.array([[500.0, 400.0], [520.0, 400.0], [520.0, 1200.0], [500.0, 1200.0]]), 0, 50
    )
    roads = Roads((wall,), BOUNDS, CLEARANCE_M)
    pursuer = Pursuer(roads, (300.0, 600.0), 20.0, 15.0)
    path = drive(pursuer, TargetEstimate((700.0, 600.0), 10.0, (), 0), 60.0)
    assert math.dist(path[-1], (700.0, 600.0)) < 15.0
    assert path[:, 1].min() < 400.0
    length = np.hypot(*np.diff(path, axis=0).T).sum()
    assert length < 1.1 * 2 * math.hypot(200.0, 212.0) + 60.0


def test_stays_inside_the_bounds_and_drives_under_what_does_not_stand_on_the_ground():
    wall = Obstacle("wall", np.array([[500.0, 0.0], [520.0, 0.0], [520.0, 2400.0], [500.0, 2400.0]]), 0, 50)
    roads = Roads((wall,), BOUNDS, CLEARANCE_M)
    assert roads.corners[:, 1].min() >= 0.0
    bridge = Obstacle("bridge", wall.polygon_enu_m, 30.0, 50.0)
    assert Roads((bridge,), BOUNDS, CLEARANCE_M).is_free(510.0, 100.0)


def test_turns_no_tighter_than_its_radius():
    pursuer = Pursuer(Roads((), BOUNDS, CLEARANCE_M), (1000.0, 1000.0), 20.0, 30.0)
    path = drive(pursuer, TargetEstimate((1400.0, 700.0), 10.0, (), 0), 30.0)
    courses = np.unwrap(np.arctan2(*np.diff(path[:-80], axis=0).T))
    assert np.abs(np.diff(courses)).max() <= 2.0 / 30.0 + 1e-6


def test_cuts_off_a_straight_flight():
    simulator = Simulator(plain_mission(THREAT), seed=1)
    client = Client(simulator)
    client.upload(route((2000.0, 0.0), loiter=(2600.0, 0.0)))
    client.set_current(1)
    client.until(lambda: simulator.autopilot.current_sequence == 2, 120.0)
    # The aircraft passes 100 m above it.
    assert nearest_m(simulator.truth) < 115.0
    path = np.array([row[1:] for row in simulator.truth.dt_path])
    assert np.hypot(*np.diff(path, axis=0).T).max() <= 2.5 + 1e-6


def test_the_pursuer_of_the_paper_keeps_off_the_walls():
    simulator = Simulator(mission_file("paper-2d.yaml"), seed=2)
    simulator.step(120.0)
    path = np.array([row[1:] for row in simulator.truth.dt_path])
    walls = shapely.unary_union([shapely.Polygon(o.polygon_enu_m) for o in simulator.truth.obstacles])
    assert not shapely.intersects(walls, shapely.linestrings(path))
    assert nearest_m(simulator.truth) < 250.0


def test_tracks_come_once_a_second_with_noise_from_a_system_of_their_own():
    simulator = Simulator(plain_mission(THREAT.replace("speed_m_s: 25", "speed_m_s: 0")), seed=1)
    client = Client(simulator)
    client.step(60.0)
    tracks = client.all("ADSB_VEHICLE")
    assert len(tracks) == pytest.approx(60, abs=1)
    assert {(t.get_srcSystem(), t.get_srcComponent()) for t in tracks} == {(200, 156)}
    assert {(t.emitter_type, t.ICAO_address, t.callsign) for t in tracks} == {(18, 0xD70001, "HUNTER")}
    projection = simulator.autopilot.projection
    errors = np.array([projection.local(t.lat * 1e-7, t.lon * 1e-7) for t in tracks]) - [1000.0, -900.0]
    assert 5.0 < errors.std() < 11.0
    assert simulator.truth.dt_path[-1][1:] == [1000.0, -900.0]


def test_adsb_type_1_sends_tracks_as_the_autopilots_own():
    client = Client(Simulator(plain_mission(THREAT), seed=1))
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"ADSB_TYPE", 1.0, 2))
    client.step(3.0)
    last = client.all("ADSB_VEHICLE")[-1]
    assert (last.get_srcSystem(), last.get_srcComponent()) == (1, 1)


def test_a_threat_told_to_stand_stands():
    threat = THREAT.replace("speed_m_s: 25", "speed_m_s: 25, behaviour: stand")
    simulator = Simulator(plain_mission(threat), seed=1)
    simulator.step(10.0)
    assert simulator.truth.dt_path[-1][1:] == [1000.0, -900.0]


def test_one_that_drives_a_route_hunts_nobody_and_stops_at_its_end():
    """Legs of 500 and 300 m at 25 m/s: 32 s, and a moment for the corner."""
    route = "behaviour: drive, route_enu_m: [[1500, -900], [1500, -600]]"
    simulator = Simulator(plain_mission(THREAT.replace("speed_m_s: 25", f"speed_m_s: 25, {route}")), seed=1)
    simulator.step(40.0)
    rows = np.array(simulator.truth.dt_path)
    way = shapely.LineString([(1000.0, -900.0), (1500.0, -900.0), (1500.0, -600.0)])
    assert shapely.distance(way, shapely.points(rows[:, 1:])).max() < 16.0  # its turn radius
    assert math.dist(rows[-1, 1:], (1500.0, -600.0)) < 3.0
    assert 31.0 < rows[np.argmax((rows[:, 1:] == rows[-1, 1:]).all(axis=1)), 0] < 36.0
