"""Waves from where the aircraft is: how early it is at places, and which of them pursuers bar."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from companion.kernels.aircraft.dubins import distance_to_point
from companion.kernels.objective.before_pursuers import Wave, fill_before_pursuers, time_to_fly
from companion.kernels.objective.cost_to_go import CostField, Heap
from companion.kernels.objective.row_costs import Objective, Prices
from companion.world.obstacles import packed_obstacles
from companion.world.pursuer_trees import threat_trees
from companion.world.pursuit import pursuit_game
from companion.world.threats import packed_threats
from companion.world.vehicle.vehicle_model import VehicleModel
from tests.support.worlds import track

BOUNDS = (0.0, 3000.0, 0.0, 3000.0, 60.0, 160.0)
CELL, NUM = 50.0, 61
START = (500.0, 1500.0, 100.0)
LIMITS = VehicleModel().limits(2, BOUNDS, 15.0, 1.0)


def wave_over(tracks, *, danger_max=0.8, price=0.0, airspeed=25.0, direction=0.0):
    """A wave over an empty map, and the field that it adds to."""
    packed = packed_obstacles([], BOUNDS)
    objective = Objective(
        prices=Prices(3.0, 3.0, 0.0, 0.35, 0.0, 0.0, 25.0), obstacles=packed,
        threats=packed_threats([], packed, BOUNDS), game=pursuit_game(tracks, packed, 100.0, BOUNDS, 3.0),
        pursuers=threat_trees(tracks, packed, 100.0, BOUNDS, ()), limits=LIMITS, deviations=np.ones(1),
        start=0.0,
    )  # fmt: skip
    shape = (NUM, NUM, 1)
    grid = np.array([0.0, 0.0, 100.0, CELL, CELL, 1.0])
    field = CostField(grid, np.zeros(shape[:2]), np.ones(shape), np.empty((0, *shape)), np.zeros(0))
    start = np.array([*START, 0.0, airspeed, direction])
    empty = (np.zeros(shape) for _ in range(3))
    wave = Wave(start, np.ones(shape), *empty, danger_max, price, LIMITS.r_min)
    room = 8 * field.rate.size
    fill_before_pursuers(wave, field, objective, Heap(np.empty(room), np.empty(room, dtype=np.int64)))
    return wave, field


def away_s(i, j):
    """Straight flight to a node at 25 m/s."""
    return math.hypot(i * CELL - START[0], j * CELL - START[1]) / 25.0


def test_a_wave_is_nowhere_later_than_straight_flight_and_ahead_hardly_sooner():
    wave, field = wave_over(())
    assert (field.rate == 1.0).all()
    for i, j in ((20, 30), (40, 30), (60, 30), (50, 38), (55, 25)):  # ahead, where no turn is needed
        assert 0.97 * away_s(i, j) - 0.1 < wave.time[i, j, 0] < 1.005 * away_s(i, j)


def test_behind_the_aircraft_a_turn_comes_first():
    """Straight behind, 300 m: a turn of some 227° at 125 m, and a tangent as long as √(300² ...) by hand."""
    wave, _ = wave_over(())
    from_centre = math.hypot(300.0, 125.0)
    straight = math.sqrt(from_centre**2 - 125.0**2)
    turned = 2.0 * math.pi + math.atan2(-300.0, 125.0) - math.atan2(straight, 125.0)
    assert straight == pytest.approx(300.0)
    assert wave.time[4, 30, 0] == pytest.approx(0.98 * (125.0 * turned + straight) / 25.0, rel=0.02)


@given(st.floats(-2000.0, 2000.0), st.floats(-2000.0, 2000.0), st.floats(-3.0, 3.0))
def test_no_way_with_turns_is_shorter_than_it_says(x, y, direction):
    """By trying: turns to either side in steps, then straight on, and how near the point that leads."""
    assume(math.hypot(x, y) > 30.0)
    least = distance_to_point(0.0, 0.0, direction, x, y, 125.0)
    assert least >= math.hypot(x, y) - 1e-6
    best = math.inf
    for side in (1.0, -1.0):
        turned = np.linspace(0.0, 2.0 * math.pi, 721)
        ahead, aside = 125.0 * np.sin(turned), side * 125.0 * (1.0 - np.cos(turned))
        east = ahead * math.cos(direction) - aside * math.sin(direction)
        north = ahead * math.sin(direction) + aside * math.cos(direction)
        course = direction + side * turned
        along = (x - east) * np.cos(course) + (y - north) * np.sin(course)
        beside = np.abs((y - north) * np.cos(course) - (x - east) * np.sin(course))
        fits = (along >= 0.0) & (beside <= 125.0 * 0.01 + 0.01 * np.abs(along))
        if fits.any():
            best = min(best, float((125.0 * turned + along)[fits].min()))
    assert least <= best + 30.0
    centre = min(math.hypot(x - 125.0 * -side * math.sin(direction), y - 125.0 * side * math.cos(direction))
                 for side in (1.0, -1.0))  # fmt: skip
    if centre > 130.0:
        assert least >= best - 30.0


def test_a_point_straight_ahead_needs_no_turn():
    """Rounding once made it a whole circle."""
    for direction in np.linspace(-3.0, 3.0, 101):
        x, y = 700.0 * math.cos(direction), 700.0 * math.sin(direction)
        assert distance_to_point(0.0, 0.0, direction, x, y, 125.0) == pytest.approx(700.0, abs=0.01)


def test_how_long_it_takes_to_gain_speed_by_hand():
    """At 0.5 m/s² from 20 to 25 m/s: 10 s and 225 m; then 25 m/s."""
    assert time_to_fly(225.0, 20.0, LIMITS) == pytest.approx(10.0)
    assert time_to_fly(475.0, 20.0, LIMITS) == pytest.approx(20.0)
    assert time_to_fly(500.0, 25.0, LIMITS) == pytest.approx(20.0)
    # v·t + t²/4 = 100 at v = 20: t = 4.72 s.
    assert time_to_fly(100.0, 20.0, LIMITS) == pytest.approx(4.7214, abs=1e-3)


def test_what_a_pursuer_reaches_first_is_barred_and_what_it_reaches_later_is_not():
    """It drives 20 m/s from 1500 m ahead, and reaches 200 m: by hand, but for a cell of the game's grid."""
    pursuer = track(2000.0, 1500.0, speed=20.0, radius=200.0)
    wave, field = wave_over([pursuer])
    for i in range(NUM):
        for j in range(NUM):
            due = away_s(i, j)
            threatened = max(0.0, math.hypot(i * CELL - 2000.0, j * CELL - 1500.0) - 200.0) / 20.0
            if due > threatened + 2.0:
                assert math.isinf(field.rate[i, j, 0])
            elif i * CELL > 500.0 and abs(j - 30) < i - 10 and due < threatened - 6.0:
                assert field.rate[i, j, 0] == 1.0
                assert wave.value[i, j, 0] < 1.02 * due


def test_with_a_price_nothing_is_barred_and_a_second_within_reach_costs_it():
    pursuer = track(2000.0, 1500.0, speed=0.0, radius=200.0)
    wave, field = wave_over([pursuer], danger_max=1.0, price=3.0)
    assert np.isfinite(field.rate).all()
    assert field.rate[40, 30, 0] == pytest.approx(4.0)
    assert field.rate[20, 30, 0] == 1.0
    # Behind it the cheapest way leads round its reach: later than straight through.
    assert wave.time[55, 30, 0] > away_s(55, 30)
