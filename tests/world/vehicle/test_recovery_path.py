"""The way out, by hand where it is straight, and never nearer to anything where it is not."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.world.obstacles import NO_GROUND
from companion.world.vehicle.recovery_path import ObstacleDistances, recovery_path
from companion.world.vehicle.vehicle_model import VehicleModel
from tests.support.paths import box

BOUNDS = (0.0, 3000.0, 0.0, 3000.0, 50.0, 200.0)
PLANE = VehicleModel().limits(2, BOUNDS, 15.0, 1.0)
SPACE = VehicleModel().limits(3, BOUNDS, 15.0, 1.0)


def state(east, north, up=100.0, direction=0.0):
    return np.array([east, north, up, direction, 0.0, 25.0])


def test_where_a_plan_may_begin_there_is_none():
    assert recovery_path(state(1000.0, 1000.0), [], PLANE, NO_GROUND) is None
    assert (
        recovery_path(state(1000.0, 1000.0), [box("b", 1000.0, 1016.0, 1100.0, 1100.0)], PLANE, NO_GROUND)
        is None
    )


def test_flying_in_it_is_straight_on():
    # From 60 m out, in steps of 25 m, until 5 m within: three steps.
    rows = recovery_path(state(-60.0, 1000.0), [], PLANE, NO_GROUND)
    assert rows[:, 0] == pytest.approx([-60.0, -35.0, -10.0, 15.0])
    assert rows[:, 1] == pytest.approx(np.full(4, 1000.0))


def test_flying_out_it_turns_back_and_then_flies_straight_as_long_as_a_plan_asks():
    rows = recovery_path(state(-60.0, 1000.0, direction=math.pi), [], PLANE, NO_GROUND)
    turned = np.flatnonzero(np.abs(np.diff(rows[:, 3])) > 1e-3)
    assert 25.0 * (len(rows) - 2 - turned[-1]) >= 125.0
    assert rows[:, 0].min() == pytest.approx(-60.0 - 125.0, abs=3.0)  # a radius out of the turn


def test_too_low_it_climbs_as_steeply_as_it_can():
    # 20 m and 5 more at tan 10 degrees: 142 m, six steps, and one that is level.
    rows = recovery_path(state(1000.0, 1000.0, up=30.0), [], SPACE, NO_GROUND)
    assert rows[-1, 2] == pytest.approx(55.0)
    assert rows[1, 2] - rows[0, 2] == pytest.approx(25.0 * math.tan(math.radians(10.0)))
    assert len(rows) == 7


def test_without_a_way_there_is_none():
    cage = [box("w", -400.0, 600.0, -380.0, 1400.0), box("e", 380.0, 600.0, 400.0, 1400.0),
            box("s", -400.0, 600.0, 400.0, 620.0), box("n", -400.0, 1380.0, 400.0, 1400.0)]  # fmt: skip
    assert (
        recovery_path(state(-100.0, 1000.0), cage[1:] + cage[:1], PLANE, NO_GROUND) is not None
    )  # within the bounds there
    assert (
        recovery_path(state(-100.0, 1000.0), [box("wall", -90.0, 0.0, -20.0, 3000.0)], PLANE, NO_GROUND)
        is None
    )


@settings(max_examples=60, deadline=None)
@given(st.floats(-300.0, 300.0), st.floats(500.0, 2500.0), st.floats(-math.pi, math.pi), st.integers(0, 50))
def test_it_ends_inside_and_clear_and_keeps_its_distance(east, north, direction, seed):
    random = np.random.default_rng(seed)
    corners = random.uniform([0.0, 300.0], [800.0, 2700.0], (4, 2))
    walls = [box(f"w{k}", *c, *(c + random.uniform(20.0, 150.0, 2))) for k, c in enumerate(corners)]
    begin = state(east, north, direction=direction)
    rows = recovery_path(begin, walls, PLANE, NO_GROUND)
    if rows is None:
        return
    around = ObstacleDistances(walls)
    clear = around.distances(rows)
    assert (rows[-1, :2] >= 0.0).all()
    assert clear[-1].min() >= 15.0
    held = np.where(clear[0] >= 15.0, 15.0, 0.5 * clear[0])
    assert (clear >= held - 1e-9).all()
    steps = np.linalg.norm(np.diff(rows[:, :2], axis=0), axis=1)
    assert (steps <= 25.0 + 1e-6).all()
    assert np.abs(np.diff(np.unwrap(rows[:, 3]))).max() <= 25.0 / 125.0 + 1e-9
