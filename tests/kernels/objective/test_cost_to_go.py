"""The cost-to-go field V against distances worked by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.kernels.objective.cost_to_go import CostField, Heap, cost_to_go, fill_cost_to_go, solved
from companion.world.vehicle.vehicle_model import VehicleModel

SPACING_M = 25.0
BOUNDS = (0.0, 1000.0, 0.0, 1000.0, 0.0, 200.0)


def field_of(levels=1, rate=1.0):
    shape = (41, 41, levels)
    grid = np.array([0.0, 0.0, 0.0, SPACING_M, SPACING_M, 10.0])
    return CostField(
        grid,
        np.zeros(shape[:2]),
        np.full(shape, rate),
        np.empty((1, *shape)),
        np.zeros(1),
    )


def filled(field, goal, *, dimension=2, wind=(0.0, 0.0)):
    limits = VehicleModel().limits(dimension, BOUNDS, 15.0, 1.0, wind)
    room = 8 * field.rate.size
    heap = Heap(np.empty(room), np.empty(room, dtype=np.int64))
    fill_cost_to_go(field, 0, np.array(goal), limits, heap)
    return field, limits


def test_in_open_air_it_is_the_time_of_the_straight_way():
    field, _ = filled(field_of(), (500.0, 500.0, 0.0))
    for east, north in ((900.0, 500.0), (500.0, 100.0), (800.0, 100.0), (0.0, 0.0)):
        straight_s = math.dist((east, north), (500.0, 500.0)) / 25.0
        assert straight_s - 1e-5 <= cost_to_go(field, 0, east, north, 0.0) <= 1.05 * straight_s


def test_on_the_whole_plane_it_is_too_long_by_two_per_cent():
    """By differences of the first order alone it would be too long by 3.1 %."""
    field, _ = filled(field_of(), (500.0, 500.0, 0.0))
    east, north = np.meshgrid(SPACING_M * np.arange(41), SPACING_M * np.arange(41), indexing="ij")
    straight_s = np.hypot(east - 500.0, north - 500.0) / 25.0
    far = straight_s > 4.0
    error = field.values[0, :, :, 0][far] / straight_s[far] - 1.0
    assert error.min() >= -1e-6
    assert error.mean() <= 0.02


def test_a_price_counts_as_often_as_it_is_high():
    """A column of cells in which a second costs four lies across the way: 100 m of it count four times."""
    field = field_of()
    field.rate[28:32] = 4.0
    filled(field, (500.0, 500.0, 0.0))
    assert cost_to_go(field, 0, 900.0, 500.0, 0.0) == pytest.approx((400.0 + 3 * 100.0) / 25.0, rel=1e-6)


def test_a_wall_is_gone_round():
    """A wall from the south up to 750 m: the way leads over its end, which upwind differences make longer."""
    field = field_of()
    field.rate[28, :31] = math.inf
    filled(field, (500.0, 500.0, 0.0))
    over = (math.dist((900.0, 500.0), (700.0, 775.0)) + math.dist((700.0, 775.0), (500.0, 500.0))) / 25.0
    assert over <= cost_to_go(field, 0, 900.0, 500.0, 0.0) <= 1.1 * over


def test_no_way_is_infinite():
    field = field_of()
    field.rate[28] = math.inf
    filled(field, (500.0, 500.0, 0.0))
    assert cost_to_go(field, 0, 900.0, 500.0, 0.0) == math.inf


@pytest.mark.parametrize(("wind", "ground_speed"), [((10.0, 0.0), 35.0), ((-10.0, 0.0), 15.0)])
def test_wind_helps_and_hinders(wind, ground_speed):
    """The goal lies east: a west wind of 10 m/s carries the aircraft there at 35 m/s."""
    field, _ = filled(field_of(), (900.0, 500.0, 0.0), wind=wind)
    # The first spacing and a half about the goal is taken without wind.
    expected = 400.0 / ground_speed
    assert cost_to_go(field, 0, 500.0, 500.0, 0.0) == pytest.approx(expected, abs=1.5 * SPACING_M / 15.0)


def test_a_climb_is_free_on_a_long_way_and_a_spiral_on_a_short_one():
    """By 10° 100 m of height take 567 m of ground: free on 800 m, and all there is to fly above the goal."""
    field, limits = filled(field_of(levels=21), (100.0, 500.0, 100.0), dimension=3)
    assert cost_to_go(field, 0, 900.0, 500.0, 0.0) == pytest.approx(800.0 / 25.0, rel=0.1)
    spiral_s = 100.0 / math.tan(limits.climb_max) / 25.0
    assert cost_to_go(field, 0, 100.0, 500.0, 0.0) == pytest.approx(spiral_s, rel=0.1)


@given(st.floats(0, 50), st.floats(0, 50), st.floats(0.1, 10), st.floats(-0.6, 0.6), st.floats(-0.6, 0.6))
def test_a_node_is_later_than_the_neighbours_that_it_is_made_from(a, b, s, wa, wb):
    value = solved(a, b, math.inf, wa, wb, 0.0, s)
    assert min(a, b) < value <= min(a + s / (1.0 + wa), b + s / (1.0 + wb)) + 1e-9
