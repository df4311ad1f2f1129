"""Whole flights: repeatable, judged by the truth, through the real mission files."""

from __future__ import annotations

import math

import pytest
from shapely.geometry import LineString, Point

from sim.simulator import Simulator
from tests.sim.client import CONFIGS, WAYPOINT, Client, item, mission_file, nearest_m, plain_mission, route

WIND = "simulation: {wind_speed_m_s: 6, wind_from_deg: 200, turbulence: light}\n"
WALL = "obstacles: [{name: wall, polygon_enu_m: [[300, -100], [350, -100], [350, 100], [300, 100]]"


def test_flies_and_replaces_a_mission_in_flight():
    client = Client(Simulator(plain_mission(WIND), seed=3))
    assert client.upload(route((500.0, 0.0), (1000.0, 0.0), loiter=(1500.0, 0.0))) == 0
    assert client.set_current(1) == 0
    client.until(lambda: client.simulator.autopilot.current_sequence == 2, 60.0)
    assert client.upload(route((700.0, 300.0), (1000.0, 800.0), loiter=(1000.0, 1200.0))) == 0
    assert client.set_current(1) == 0
    assert client.until(lambda: client.simulator.autopilot.current_sequence == 3, 90.0)
    east, north = client.simulator.autopilot.flight.position
    assert math.dist((east, north), (1000.0, 800.0)) < 55.0


def test_tracks_legs_within_six_metres_away_from_corners():
    client = Client(Simulator(plain_mission(WIND), seed=1))
    corners = [(800.0, 0.0), (1400.0, 500.0), (2200.0, 500.0)]
    client.upload(route(*corners))
    client.set_current(1)
    client.until(lambda: client.simulator.autopilot.mode == "RTL", 150.0)
    legs = [LineString(pair) for pair in zip([(0.0, 0.0), *corners], corners, strict=False)]
    for row in client.simulator.truth.path:
        place = Point(row[1:3])
        leg = min(legs, key=place.distance)
        part = leg.project(place)
        if 300.0 < part < leg.length - 60.0:
            assert leg.distance(place) < 6.0


def flown_bytes(seed: int, mission: str = "paper-2d.yaml") -> bytes:
    client = Client(Simulator(mission_file(mission), seed=seed))
    taken = bytearray()
    client.simulator.receive(b"")
    for number in range(500):
        client.simulator.step(0.02)
        if number == 100:
            client.count(3)
        if number in (105, 110, 115):
            client.send(client.item_message((number - 105) // 5, item(WAYPOINT, 400.0, 1800.0)))
        taken += client.simulator.take_outgoing()
    return bytes(taken)


def test_the_same_seed_gives_the_same_bytes_and_another_one_others():
    first = flown_bytes(7)
    assert first == flown_bytes(7)
    assert first != flown_bytes(8)


def test_two_simulators_side_by_side_do_not_disturb_each_other():
    alone = Simulator(plain_mission(WIND), seed=4)
    alone.step(5.0)
    first, second = (Simulator(plain_mission(WIND), seed=seed) for seed in (4, 5))
    for _ in range(250):
        first.step()
        second.step()
    assert first.truth.path == alone.truth.path
    assert first.truth.path != second.truth.path


@pytest.mark.parametrize("name", sorted(path.name for path in CONFIGS.glob("*.yaml")))
def test_the_operators_mission_is_safe_in_every_mission_file(name):
    simulator = Simulator(mission_file(name), seed=1)
    items = simulator.autopilot.mission_items
    assert [entry.command for entry in items] == [16, 16, 17]
    simulator.step(90.0)
    assert simulator.autopilot.mode == "AUTO"
    assert simulator.autopilot.current_sequence == 2
    assert not simulator.truth.collision
    assert simulator.truth.min_obstacle_clearance_m > 20.0


def test_first_flight_round_the_parked_vehicle_to_the_goal():
    simulator = Simulator(mission_file("first-flight.yaml"), seed=1)
    client = Client(simulator)
    assert client.upload(route((500.0, 750.0), (950.0, 400.0), (1400.0, 600.0), (1750.0, 750.0))) == 0
    assert client.set_current(1) == 0
    assert client.until(lambda: simulator.autopilot.mode == "RTL", 120.0)
    path = simulator.truth.path
    assert min(math.dist(row[1:3], (1750.0, 750.0)) for row in path) < 60.0
    assert not simulator.truth.collision
    assert simulator.truth.min_obstacle_clearance_m > 100.0
    assert nearest_m(simulator.truth) > 280.0
    assert len(path) == pytest.approx(simulator.now_s * 10.0, abs=2)
    assert [row[1:] for row in simulator.truth.dt_path[-1:]] == [[950.0, 750.0]]


def test_truth_sees_a_collision_and_a_flight_above():
    wall = WALL + ", base_m: 0, top_m: 150}]\n"
    simulator = Simulator(plain_mission(wall), seed=1)
    client = Client(simulator)
    client.upload(route((900.0, 0.0)))
    client.set_current(1)
    client.step(20.0)
    assert simulator.truth.collision
    assert simulator.truth.min_obstacle_clearance_m == 0.0
    low = Simulator(plain_mission(WALL + ", base_m: 0, top_m: 60}]\n"), seed=1)
    low.step(20.0)
    assert not low.truth.collision
    assert low.truth.min_obstacle_clearance_m == math.inf


def test_rows_of_the_truth_are_consistent():
    simulator = Simulator(plain_mission(), seed=1)
    simulator.step(2.0)
    first, last = simulator.truth.path[10], simulator.truth.path[-1]
    assert first[0] == pytest.approx(1.0)
    assert last[0] == pytest.approx(2.0)
    assert last[4] == pytest.approx(math.radians(90.0), abs=0.02)
    assert (last[1] - first[1]) / (last[0] - first[0]) == pytest.approx(last[6], rel=0.02)


def test_simulated_time_and_messages_are_the_simulators_own():
    client = Client(Simulator(plain_mission(), seed=1))
    client.step(3.0)
    assert client.simulator.now_s == pytest.approx(3.0)
    stamp = client.all("SYSTEM_TIME")[-1]
    assert stamp.time_unix_usec // 1000 - stamp.time_boot_ms == 1_767_225_600_000
    assert stamp.time_boot_ms <= 3000


def test_the_pilots_switch_knows_its_positions():
    simulator = Simulator(plain_mission(), seed=1)
    simulator.set_mode("RTL")
    assert simulator.autopilot.mode == "RTL"
    with pytest.raises(ValueError, match="no such mode: HOVER"):
        simulator.set_mode("HOVER")
