"""Pursued in the simulator: with the game of paper 2.3, without it, and by a planner blind to the pursuer."""

import math

import pytest
import yaml

from tests.games.flights import PLANNERS, played

pytestmark = pytest.mark.compiled
GAME = ("route", 13)  # its pursuer threatens whoever flies the shortest way


@pytest.mark.thorough
def test_the_aircraft_that_knows_its_pursuer_is_never_threatened_and_the_others_are():
    ours, printed, blind = (played(*GAME, planner) for planner in ("ours", "rs", "blind"))
    assert ours.is_won
    assert ours.caught_s == math.inf  # a pursuer that had known the flown path would not have come in time
    assert printed.is_at_goal
    assert blind.is_at_goal
    assert printed.threatened_s > 5.0
    assert blind.threatened_s > 5.0


def test_the_planners_that_are_compared_are_what_they_are_called():
    text = yaml.safe_dump({"planning": {"method": "safe-rrt"}, "dynamic_threats": []})
    assert yaml.safe_load(PLANNERS["rs"](text))["planning"]["method"] == "safe-rrt-rs"
    assert "dynamic_threats" not in yaml.safe_load(PLANNERS["blind"](text))
