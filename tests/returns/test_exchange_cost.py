"""At 57,600 baud the return path hardly delays the mission's own exchange."""

import statistics

import pytest

from companion.config import load_mission
from tests.returns.exchange_cost import exchanges
from tests.sim.client import CONFIGS


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper-3d", "city-block"])
def test_an_exchange_takes_at_most_a_tenth_longer(name):
    mission = load_mission(CONFIGS / f"{name}.yaml")
    with_path, num_stored = exchanges(mission, 57_600, 1, 120.0, keeps_return_path=True)
    without, none_stored = exchanges(mission, 57_600, 1, 120.0, keeps_return_path=False)
    assert num_stored >= 2
    assert none_stored == 0
    assert statistics.fmean(with_path) <= 1.1 * statistics.fmean(without)
