"""What is left over ground: many places at once give what the kernel gives for each."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.kernels.arrays import Ground
from companion.kernels.geometry.ground_surface import over_ground
from companion.world.ground.cell_lookup import cells_along, left_over_ground

SIDE_M = 25.0


@pytest.mark.parametrize("most_m", [150.0, math.inf])
def test_many_places_are_as_single_ones_also_on_borders_and_beyond(most_m: float) -> None:
    rng = np.random.default_rng(1)
    low = rng.uniform(0.0, 100.0, (12, 7)).astype(np.float32)
    ground = Ground(low + 20.0, low, np.array([-100.0, 50.0, SIDE_M]), 30.0, 60.0, most_m, 0.5)
    places = rng.uniform([-200.0, 0.0, 0.0], [300.0, 400.0, 300.0], (500, 3))
    places[:200, :2] = SIDE_M * np.round(places[:200, :2] / SIDE_M)
    singly = [over_ground(east, north, up, ground) for east, north, up in places]
    assert left_over_ground(ground, places).tolist() == singly


def test_a_border_belongs_to_the_cell_after_it() -> None:
    flat = np.zeros((4, 2), dtype=np.float32)
    ground = Ground(flat, flat, np.array([10.0, 0.0, 5.0]), 0.0, 1.0, math.inf, 0.5)
    at = np.array([-1.0, 10.0, 14.9, 15.0, 29.9, 99.0])
    assert cells_along(ground, 0, at).tolist() == [0, 0, 0, 1, 3, 3]
    assert cells_along(ground, 1, at).tolist() == [0, 1, 1, 1, 1, 1]
