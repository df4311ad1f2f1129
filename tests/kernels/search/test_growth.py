"""The edge of a node that is added, by hand."""

import numpy as np
import pytest

from companion.kernels.search.growth import is_edge_clear
from companion.world.vehicle.vehicle_model import VehicleModel
from tests.support.paths import box
from tests.support.worlds import packed

BOUNDS = (-1000.0, 1000.0, -1000.0, 1000.0, 0.0, 300.0)


@pytest.mark.parametrize(
    ("turn_rate", "needed_m"), [(0.0, 15.0), (0.2, 17.5), (-0.2, 17.5)], ids=["straight", "left", "right"]
)
def test_an_edge_keeps_the_margin_and_its_sagitta_beside_it(turn_rate, needed_m):
    # 50 m in 2 s, turning by 0.4 rad: the arc's sagitta is an eighth of 50 m times 0.4.
    limits = VehicleModel().limits(2, BOUNDS, 15.0, 2.0)
    state, out = np.array([0.0, 0.0, 100.0, 0.0, 0.0, 25.0]), np.array([50.0, 0.0, 100.0, 0.0, 0.0, 25.0])
    for north_m, is_clear in ((needed_m - 0.1, False), (needed_m + 0.1, True)):
        walls = packed([box("wall", 20.0, north_m, 30.0, north_m + 50.0)], BOUNDS)
        assert is_edge_clear(state, out, turn_rate, walls, limits) is is_clear
