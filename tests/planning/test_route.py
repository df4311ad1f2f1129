"""Routes made of states, by hand."""

import math

import numpy as np
import pytest

from companion.planning.explore import Exploration
from companion.planning.route import route_along
from tests.support.worlds import problem


def test_states_along_a_climbing_turn_become_rows_with_the_rates_of_their_edges():
    # Two edges of a second at 25 m/s: one turns by 0.2 rad across north-south, one pulls up by 0.1 rad.
    exploration = Exploration(problem(dimension=3), np.random.default_rng(1))
    start = exploration.problem.start
    assert exploration.limits.tau == 1.0
    states = np.array(
        [
            [0.0, 0.0, 150.0, math.pi - 0.1, 0.0, 25.0],
            [-25.0, 0.0, 150.0, -math.pi + 0.1, 0.0, 25.0],
            [-50.0, 0.0, 150.0, -math.pi + 0.1, 0.1, 25.0],
        ]
    )
    route = route_along(exploration, states)
    assert route.rates == pytest.approx(np.array([[0.0, 0.0], [0.2, 0.0], [0.0, 0.1]]))
    assert route.times == pytest.approx(start.stamp_s + np.arange(3.0))
    assert route.states == pytest.approx(states)
