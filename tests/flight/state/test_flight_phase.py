"""When a flight is over."""

import pytest

from companion.flight.state.flight_phase import GROUND_MAX_S, LANDED_S, FlightPhase, after_armed_state


def heard(*beats):
    """What is known after heartbeats: pairs of an instant and whether the aircraft is armed."""
    phase = FlightPhase(0.0)
    for now_s, is_armed in beats:
        phase = after_armed_state(phase, now_s, is_armed=is_armed)
    return phase


def test_nothing_heard_is_neither_ground_nor_flight():
    phase = heard()
    assert not phase.is_grounded(1e6)
    assert not phase.is_over(1e6)


def test_a_flight_is_over_once_the_aircraft_was_disarmed_for_long_enough():
    phase = heard((5.0, False), (6.0, True), (60.0, True), (61.0, False), (62.0, False))
    assert not phase.is_over(61.0 + LANDED_S - 0.001)
    assert phase.is_over(61.0 + LANDED_S)


def test_a_slip_of_the_pilots_ends_nothing():
    phase = heard((0.0, True), (10.0, False), (10.0 + LANDED_S - 1.0, True))
    assert not phase.is_over(1e3)


def test_silence_after_armed_is_flight_however_long():
    phase = heard((0.0, True))
    assert not phase.is_over(1e6)
    assert not phase.is_idle(1e6)


@pytest.mark.parametrize("beats", [(), ((1.0, False), (3_599.0, False))], ids=["unheard", "disarmed"])
def test_an_hour_without_a_flight_is_idle(beats):
    phase = heard(*beats)
    assert not phase.is_idle(GROUND_MAX_S - 1.0)
    assert phase.is_idle(GROUND_MAX_S)
    assert not phase.is_over(GROUND_MAX_S)


def test_before_a_flight_it_is_on_the_ground():
    phase = heard((1.0, False), (2.0, False))
    assert not phase.is_grounded(1.0 + LANDED_S - 0.001)
    assert phase.is_grounded(1.0 + LANDED_S)
