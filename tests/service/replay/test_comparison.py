"""What is compared of a flight and its replay."""

from companion.service.replay.comparison import _pairs
from companion.types.record import Decision


def test_what_is_decided_is_compared_up_to_the_last_instant_that_both_know():
    first, last = Decision(1.0, "mode", "planning (AUTO)"), Decision(2.0, "swap", "first plan")
    assert list(_pairs([first, last], [first], 2.0)) == [(first, first), (last, None)]
    assert list(_pairs([first, last], [first], 1.9)) == [(first, first)]
    assert list(_pairs([first], [first, last], 2.0)) == [(first, first), (None, last)]
