"""One flight of each sort of the campaign that is quick to fly; `make torture` flies five hundred."""

import pytest

from tests.torture.senses import SENSES, TOLD_S, Phantoms, sensed_flight


def kinds():
    """A flight of each, the longest among the slow tests."""
    for number, kind in enumerate(SENSES, 32):
        marks = [pytest.mark.slow] if kind is Phantoms else []
        yield pytest.param(number, id=kind.__name__, marks=marks)


@pytest.mark.parametrize("number", list(kinds()))
@pytest.mark.thorough
def test_a_flight_without_one_of_its_senses_ends_in_no_obstacle(number):
    _, how, waited_s, _ = sensed_flight(number)
    assert how == "goal"
    assert waited_s <= TOLD_S


def test_a_position_that_is_wrong_by_40_m_is_survived():
    """Nothing is planned on such a position: the autopilot flies what it has, 40 m beside it."""
    assert sensed_flight(11)[:2] == ("Jump px4 paper-2d", "goal")


@pytest.mark.slow
def test_it_is_survived_by_room():
    assert sensed_flight(11, {"clearance_wanted_m": 0.0})[:2] == ("Jump px4 paper-2d", "collision")
