"""V near ground: the time of flight on level ground, the climb up a slope, and no way that is too steep."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from companion.kernels.objective.cost_over_ground import (
    DIRECTIONS,
    SHORTENED,
    STEEPER,
    fill_cost_over_ground,
    step_of,
    time_along,
)
from companion.kernels.objective.cost_to_go import CostField, Heap, cost_to_go, cost_to_go_on
from companion.planning.least_objective.cost_field import buckets
from companion.world.vehicle.vehicle_model import VehicleModel

SPACING_M, LEVEL_M, COLUMNS, LEVELS = 100.0, 20.0, 21, 4
SHAPE = (COLUMNS, COLUMNS, LEVELS)


def field_over(height):
    """V to (1800, 1000) over ground whose height is a function of east and north [m]."""
    at = SPACING_M * np.arange(COLUMNS)
    floor = np.asarray(height(*np.meshgrid(at, at, indexing="ij")), dtype=np.float64)
    field = CostField(
        np.array([0.0, 0.0, 0.0, SPACING_M, SPACING_M, LEVEL_M]), floor,
        np.ones(SHAPE), np.empty((DIRECTIONS, *SHAPE)), np.zeros(1),
    )  # fmt: skip
    room = field.rate.size
    goal = np.array([1800.0, 1000.0, float(floor[18, 10]) + LEVEL_M])
    heap = Heap(np.empty(room), np.empty(room, dtype=np.int64))
    fill_cost_over_ground(field, 0, goal, LIMITS, heap, buckets(room))
    return field


LIMITS = VehicleModel().limits(3, (0.0, 2000.0, 0.0, 2000.0, 0.0, 5000.0), 15.0, 1.0, (0.0, 0.0))
FLAT = field_over(lambda east, north: 0.0 * east)


def test_eight_steps_lead_all_round():
    assert {step_of(d) for d in range(DIRECTIONS)} == {
        (i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)
    }
    for d in range(DIRECTIONS):
        east, north = step_of(d)
        assert math.atan2(north, east) % (2.0 * math.pi) == pytest.approx(d * math.pi / 4.0)


def test_on_level_ground_it_is_the_time_of_flight():
    straight_s = 1600.0 / LIMITS.v_cruise
    found = cost_to_go_on(FLAT, 0, 200.0, 1000.0, LEVEL_M, 0.0)
    assert 0.9 * straight_s <= found <= straight_s


def test_who_flies_the_other_way_turns_first():
    there, back = (cost_to_go_on(FLAT, 0, 1000.0, 1000.0, LEVEL_M, theta) for theta in (0.0, math.pi))
    assert back > there + 4.0  # Half a circle of eighths takes four steps of 100 m at least.
    assert cost_to_go(FLAT, 0, 1000.0, 1000.0, LEVEL_M) <= there + 1e-9


def test_a_gentle_slope_costs_its_way_and_a_steep_one_is_flown_along():
    gentle, steep = 0.5 * math.tan(LIMITS.climb_max), 2.5 * math.tan(LIMITS.climb_max)
    up_s = cost_to_go(field_over(lambda east, north: gentle * east), 0, 200.0, 1000.0, LEVEL_M)
    assert up_s == pytest.approx(cost_to_go(FLAT, 0, 200.0, 1000.0, LEVEL_M), rel=0.06)
    slope = field_over(lambda east, north: steep * east)
    longer_s = cost_to_go(slope, 0, 200.0, 1000.0, 200.0 * steep + LEVEL_M)
    climb_s = steep * 1600.0 / math.tan(1.1 * LIMITS.climb_max) / LIMITS.v_cruise
    assert longer_s > 0.9 * climb_s


def test_a_bank_is_crossed_that_is_higher_than_two_levels_and_steeper_than_the_climb():
    """The aircraft crosses it at one height: high over the foot, low over the top."""
    bank_m = 2.6 * LEVEL_M
    bank = field_over(lambda east, north: bank_m * (east > 1000.0))
    found = cost_to_go_on(bank, 0, 200.0, 1000.0, 3.0 * LEVEL_M, 0.0)
    assert found <= 1.05 * 1600.0 / LIMITS.v_cruise


def test_a_cliff_is_not_flown_over():
    cliff = field_over(lambda east, north: 400.0 * (east > 1000.0))
    assert cost_to_go(cliff, 0, 200.0, 1000.0, LEVEL_M) == math.inf
    assert cost_to_go(cliff, 0, 1400.0, 1000.0, 400.0 + LEVEL_M) < math.inf


@given(st.floats(-900.0, 900.0), st.floats(-900.0, 900.0), st.floats(-8.0, 8.0), st.floats(-8.0, 8.0))
def test_the_time_along_a_leg_is_that_of_the_wind_triangle(dx, dy, wind_x, wind_y):
    """Flown for that time, the air carries the aircraft so that it arrives."""
    flat = math.hypot(dx, dy)
    if flat < 1.0:
        return
    windy = LIMITS._replace(wind_x=wind_x, wind_y=wind_y)
    taken = time_along(dx, dy, windy)
    through_air = math.hypot(dx - taken * wind_x, dy - taken * wind_y)
    assert through_air == pytest.approx(taken * LIMITS.v_cruise, rel=1e-9)


def by_dijkstra(field, goal):
    """V in every direction at every node of a field, by SciPy's search of the same graph."""
    rate, num = field.rate, DIRECTIONS * field.rate.size
    up = field.floor[:, :, None] + field.grid[5] * np.arange(rate.shape[2])
    slope = math.tan(LIMITS.climb_max)
    rows, columns, costs = [], [], []

    def join(begin, end, cost):
        rows.append(begin)
        columns.append(end)
        costs.append(cost)

    for d, i, j, k in np.ndindex(DIRECTIONS, *rate.shape):
        here = d * rate.size + np.ravel_multi_index((i, j, k), rate.shape)
        flat, over = SPACING_M * math.hypot(i - goal[0], j - goal[1]), abs(up[i, j, k] - goal[2])
        if flat <= 1.5 * SPACING_M and over <= 1.5 * LEVEL_M:  # The search begins at these nodes.
            join(num, here, max(1e-9, rate[i, j, k] * max(flat, over / slope) / LIMITS.v_cruise))
        for turn in (-1, 0, 1):
            east, north = step_of(d + turn)
            a, b = i + east, j + north
            if not (0 <= a < rate.shape[0] and 0 <= b < rate.shape[1]):
                continue
            way = SPACING_M * math.hypot(east, north)
            for c in range(rate.shape[2]):
                if abs(up[a, b, c] - up[i, j, k]) <= STEEPER * slope * way:
                    there = (d + turn) % DIRECTIONS * rate.size + np.ravel_multi_index((a, b, c), rate.shape)
                    mean = 0.5 * (rate[i, j, k] + rate[a, b, c])
                    join(there, here, SHORTENED * way / LIMITS.v_cruise * mean)
    graph = csr_matrix((costs, (rows, columns)), shape=(num + 1, num + 1))
    return dijkstra(graph, indices=num)[:num].reshape(DIRECTIONS, *rate.shape)


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_cheapest_way_over_the_graph(seed):
    rng = np.random.default_rng(seed)
    shape = (9, 8, LEVELS)
    field = CostField(
        np.array([0.0, 0.0, 0.0, SPACING_M, SPACING_M, LEVEL_M]), rng.uniform(0.0, 90.0, shape[:2]),
        rng.uniform(1.0, 9.0, shape), np.empty((DIRECTIONS, *shape)), np.zeros(1),
    )  # fmt: skip
    goal = (5, 3, float(field.floor[5, 3]) + LEVEL_M)
    heap = Heap(np.empty(field.rate.size), np.empty(field.rate.size, dtype=np.int64))
    place = np.array([SPACING_M * goal[0], SPACING_M * goal[1], goal[2]])
    fill_cost_over_ground(field, 0, place, LIMITS, heap, buckets(field.rate.size))
    expected = by_dijkstra(field, goal)
    assert np.isfinite(expected).mean() > 0.3
    np.testing.assert_allclose(field.values, expected, rtol=1e-6, atol=1e-4)
