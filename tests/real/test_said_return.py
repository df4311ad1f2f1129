"""Distances from the way that was said, by hand."""

from itertools import pairwise

import numpy as np
import pytest

from tests.real.said_return import farthest_from

BEND = np.array([(0.0, 0.0), (1000.0, 0.0), (1000.0, 1000.0)])


@pytest.mark.parametrize(
    ("corners", "farthest"),
    [
        ([(0.0, 0.0), (1000.0, 0.0), (1000.0, 1000.0)], 0.0),
        ([(0.0, 0.0), (0.0, 40.0), (1040.0, 40.0), (1000.0, 1000.0)], 40.0),
        ([(0.0, 0.0), (900.0, 0.0), (1000.0, 100.0), (1000.0, 1000.0)], 50.0),
        ([(0.0, 0.0), (1000.0, 0.0), (1000.0, 1000.0), (0.0, 1000.0)], 0.0),  # It ends before the last leg.
    ],
)
def test_the_farthest_from_a_bend(corners, farthest):
    flown = np.vstack([np.linspace(a, b, 60) for a, b in pairwise(corners)])
    assert farthest_from(BEND, flown) == pytest.approx(farthest, abs=3.0)


def test_a_way_that_crosses_itself_is_followed_in_its_order():
    eight = np.array([(0.0, 0.0), (900.0, 0.0), (900.0, 600.0), (450.0, 600.0), (450.0, -600.0)])
    flown = np.vstack([np.linspace(a, b, 40) for a, b in pairwise(eight)])
    assert farthest_from(eight, flown) < 3.0
    short_cut = np.vstack([np.linspace(a, b, 40) for a, b in (eight[[0, 1]], eight[[1, 4]])])
    assert farthest_from(eight, short_cut) > 200.0
