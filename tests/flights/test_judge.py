"""The judge of the flights judges."""

import itertools

import numpy as np
import pytest

from tests.flights.flown import miss_distance_m, mission_named, reaches, stays_inside, touches_anything

FIRST = mission_named("first-flight")  # wall from (1000, 1050) to (1300, 1100), up to 300 m


def line(*points, spacing_m=2.5):
    """Places along a line, as often as a flight is recorded."""
    rows = [np.array(points[0], dtype=float)]
    for start, end in itertools.pairwise(np.array(points, dtype=float)):
        num = int(np.ceil(np.linalg.norm(end - start) / spacing_m))
        rows += [start + (end - start) * k / num for k in range(1, num + 1)]
    return np.array(rows)


@pytest.mark.parametrize(
    ("points", "is_hit"),
    [
        ([(1150.0, 1000.0, 100.0), (1150.0, 1200.0, 100.0)], True),
        ([(1150.0, 1000.0, 310.0), (1150.0, 1200.0, 310.0)], False),
        ([(900.0, 1049.0, 100.0), (1400.0, 1049.0, 100.0)], False),
        ([(1150.0, 1075.0, 400.0), (1150.0, 1075.0, 299.0)], True),
        ([(200.0, 200.0, 100.0), (300.0, 200.0, -1.0)], True),
    ],
)
def test_touching(points, is_hit):
    assert touches_anything(FIRST, line(*points)) is is_hit


def test_a_jump_across_a_wall_is_a_hit():
    assert touches_anything(FIRST, np.array([(1150.0, 1000.0, 100.0), (1150.0, 1200.0, 100.0)]))


@pytest.mark.parametrize(("east", "is_reached"), [(1691.0, True), (1689.0, False)])
def test_reaching(east, is_reached):
    assert reaches(FIRST, line((1000.0, 750.0, 100.0), (east, 750.0, 100.0))) is is_reached


def test_missing_and_straying():
    places = line((0.0, 700.0, 100.0), (1900.0, 700.0, 100.0))
    assert miss_distance_m(places, 950.0, 750.0) == pytest.approx(50.0)
    assert stays_inside(FIRST, places)
    assert not stays_inside(FIRST, places + np.array([0.0, 831.0, 0.0]))
