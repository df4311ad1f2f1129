"""One flight of each sort of the campaign that is quick to fly; `make torture` flies five hundred."""

import pytest

from tests.torture.senses import SENSES, TOLD_S, sensed_flight


@pytest.mark.parametrize("number", range(32, 32 + len(SENSES)), ids=[kind.__name__ for kind in SENSES])
def test_a_flight_without_one_of_its_senses_ends_in_no_obstacle(number):
    _, how, waited_s = sensed_flight(number)
    assert how == "goal"
    assert waited_s <= TOLD_S
