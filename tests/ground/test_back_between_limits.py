"""An aircraft that is too low or too high over ground flies back between the limits first."""

import math

import numpy as np
import pytest

from companion.kernels.geometry.ground_surface import over_ground
from companion.world.ground.ground_cells import ground_cells
from companion.world.vehicle.recovery_path import recovery_path
from companion.world.vehicle.vehicle_model import VehicleModel
from tests.ground.maps import posts_over

AREA = (0.0, 4000.0, 0.0, 4000.0)
LIMITS = VehicleModel().limits(3, (*AREA, 0.0, 1000.0), 15.0, 1.0, (0.0, 0.0))
GROUND = ground_cells(
    posts_over(lambda east, north: 0.05 * east, bounds=AREA), AREA, least_m=60.0 - LIMITS.margin,
    wanted_m=60.0, most_m=200.0 + LIMITS.margin, drivable=1.0,
)  # fmt: skip


def state(over_m):
    """Flying east at a height over the ground below, which rises to the east by 5 %."""
    return np.array([1000.0, 2000.0, 50.0 + over_m, 0.0, 0.0, 25.0])


@pytest.mark.parametrize("over_m", [40.0, 52.0, 215.0, 230.0])
def test_it_ends_between_the_limits_and_goes_no_farther_out(over_m):
    rows = recovery_path(state(over_m), [], LIMITS, GROUND)
    left = np.array([over_ground(*row[:3], GROUND) for row in rows])
    assert left[0] < LIMITS.margin <= left[-1]
    assert left.min() >= left[0] - 10.0
    slopes = np.diff(rows[:, 2]) / np.hypot(*np.diff(rows[:, :2], axis=0).T)
    assert np.abs(slopes).max() <= math.tan(LIMITS.climb_max) + 1e-6


def test_between_the_limits_there_is_none():
    assert recovery_path(state(130.0), [], LIMITS, GROUND) is None
