"""Distances beside legs, by hand."""

import numpy as np
import pytest

from tests.real.return_legs import farthest_beside_legs

PLACES = [(0.0, 0.0, 100.0), (1000.0, 0.0, 100.0), None, (1000.0, 1000.0, 100.0), (0.0, 1000.0, 0.0)]
COMMANDS = [16, 16, 178, 16, 21]


def path(*rows):
    return np.array([(second, *place, 100.0) for second, place in rows])


@pytest.mark.parametrize(
    ("flown", "currents", "farthest"),
    [
        (path((1, (500, 40)), (11, (1020, 500)), (21, (500, 1090))), [(0, 1), (10, 3), (20, 4)], 20.0),
        (
            path((11, (1070, -30)), (12, (975, 10))),
            [(0, 1), (10, 3), (20, 4)],
            25.0,
        ),  # the first is not abeam
        (path((1, (500, 40))), [(0, 1), (10, 3)], None),  # only the way to the first item
        (path((21, (500, 1090)), (31, (0, 1500))), [(0, 3), (20, 4), (30, 0)], None),  # only a landing
    ],
)
def test_the_farthest_beside_a_leg(flown, currents, farthest):
    assert farthest_beside_legs(flown, currents, PLACES, COMMANDS) == (
        farthest if farthest is None else pytest.approx(farthest)
    )
