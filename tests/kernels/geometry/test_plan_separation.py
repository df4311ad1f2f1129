"""The least margin of two timed paths against many instants, each looked at by itself."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from companion.kernels.geometry.plan_separation import first_conflict, least_margin

APART_M, UP_M = 100.0, 30.0
NUM_INSTANTS = 4000


def path(*rows):
    return np.array(rows, dtype=float)


def places(rows, times):
    return [np.interp(times, rows[:, 0], rows[:, column]) for column in (1, 2, 3)]


def sampled_margin(one, radius, other, other_radius, since):
    """Least of the larger excess over many instants, all times of rows among them, and just before them."""
    end = max(one[-1, 0], other[-1, 0], since) + 1.0
    times = np.concatenate([np.linspace(since, end, NUM_INSTANTS), one[:, 0], other[:, 0]])
    times = np.concatenate([times, times - 1e-9])
    times = times[times >= since]
    (east, north, up), (east2, north2, up2) = places(one, times), places(other, times)
    discs = radius * (times >= one[-1, 0]) + other_radius * (times >= other[-1, 0])
    horizontal = np.hypot(east2 - east, north2 - north) - discs - APART_M
    return np.maximum(horizontal, abs(up2 - up) - UP_M).min()


def speeds_of(rows):
    """Speed on each leg, the sum of its parts."""
    return abs(np.diff(rows[:, 1:], axis=0)).sum(axis=1) / np.diff(rows[:, 0])


def margin(one, radius, other, other_radius, since=0.0):
    discs, other_discs = (np.array([0.0, each]) for each in (radius, other_radius))
    return least_margin(one, discs, other, other_discs, since, APART_M, UP_M)


COORDINATE = st.integers(-60, 60).map(lambda tens: 10.0 * tens)
HEIGHT = st.integers(0, 12).map(lambda tens: 10.0 * tens)


@st.composite
def paths(draw):
    num = draw(st.integers(1, 5))
    steps = [draw(st.integers(1, 40)) for _ in range(num)]
    times = draw(st.integers(-20, 20)) + np.cumsum(steps)
    return path(*[(float(t), draw(COORDINATE), draw(COORDINATE), draw(HEIGHT)) for t in times])


RADIUS = st.sampled_from((0.0, 60.0))


@settings(max_examples=150, deadline=None)
@given(paths(), RADIUS, paths(), RADIUS, st.integers(-10, 60).map(float))
def test_no_instant_has_less_margin_and_one_has_as_little(one, radius, other, other_radius, since):
    exact = margin(one, radius, other, other_radius, since)
    sampled = sampled_margin(one, radius, other, other_radius, since)
    # Between two instants the margin changes no faster than the two move.
    fastest = sum(max([0.0, *speeds_of(p)]) for p in (one, other))
    step = (max(one[-1, 0], other[-1, 0], since) + 1.0 - since) / (NUM_INSTANTS - 1)
    assert exact <= sampled + 1e-6
    assert sampled <= exact + fastest * step + 1e-6


def test_margins_by_hand():
    # Head on at the same height, 10 m/s each: they meet at 10 s. Circles of 60 m are far away.
    east, west = path((0, 0, 0, 0), (100, 1000, 0, 0)), path((0, 200, 0, 0), (100, -800, 0, 0))
    assert margin(east, 60.0, west, 60.0) == pytest.approx(-UP_M)  # no height between them: 0 m of 30 m
    # Side by side, 150 m: an excess of 50 m, until the first is in its circle of 60 m.
    beside = path((0, 0, 150, 0), (100, 1000, 150, 0))
    assert margin(east, 0.0, beside, 0.0) == pytest.approx(50.0)
    assert margin(east, 60.0, beside, 0.0) == pytest.approx(-10.0)
    # Above by 40 m: the vertical excess of 10 m suffices.
    above = east + np.array([0.0, 0.0, 0.0, 40.0])
    assert margin(east, 60.0, above, 60.0) == pytest.approx(10.0)
    # It is passed at 40 s, and looked at from 50 s on; both end 600 m apart, without the circles.
    crossing = path((30, 400, -200, 0), (50, 400, 200, 0), (60, 1000, 600, 0))
    assert margin(east, 0.0, crossing, 0.0) < 0.0
    assert margin(east, 0.0, crossing, 0.0, 50.0) > 0.0


def test_climbing_through_a_height_conflicts_only_where_both_distances_fall_short_at_once():
    level = path((0, 0, 0, 100), (100, 1000, 0, 100))
    # It crosses below at 50 s, 60 m lower, and is at the same height only when 300 m to the north.
    climber = path((40, 500, -100, 40), (60, 500, 100, 40), (80, 500, 300, 100), (100, 500, 500, 160))
    assert margin(level, 0.0, climber, 0.0) > 0.0
    sooner = path((40, 500, -100, 40), (60, 500, 100, 100))
    assert margin(level, 0.0, sooner, 0.0) < 0.0


def test_a_jump_into_the_circle_takes_no_time():
    # The circle's centre is 60 m beyond the last place on the way: from then on the aircraft is in the disc.
    ending = path((0, 0, 0, 0), (10, 100, 0, 0), (10, 160, 0, 0))
    waiting = path((0, 160, 190, 0))
    assert margin(ending, 60.0, waiting, 0.0) == pytest.approx(30.0)


@settings(max_examples=100, deadline=None)
@given(paths(), RADIUS, paths(), RADIUS)
@example(path((0, 0, 0, 0)), 0.0, path((0, 0, 0, 0)), 0.0)
def test_the_margin_is_symmetric(one, radius, other, other_radius):
    there, back = margin(one, radius, other, other_radius), margin(other, other_radius, one, radius)
    assert there == pytest.approx(back, abs=1e-6)


@settings(max_examples=100, deadline=None)
@given(paths(), RADIUS, paths(), RADIUS, COORDINATE, COORDINATE, HEIGHT, st.integers(-500, 500))
def test_moving_both_in_space_and_time_changes_nothing(one, radius, other, other_radius, e, n, u, shift_s):
    move = np.array([shift_s, e, n, u])
    moved = margin(one + move, radius, other + move, other_radius, float(shift_s))
    assert moved == pytest.approx(margin(one, radius, other, other_radius), abs=1e-5)


@settings(max_examples=60, deadline=None)
@given(paths(), RADIUS, st.lists(paths(), min_size=1, max_size=6))
def test_the_first_of_many_that_conflicts_is_found(one, radius, others):
    offsets = np.cumsum([0, *map(len, others)]).astype(np.int64)
    limits = np.array([(0.0, 20.0 * n, APART_M + n, UP_M) for n in range(len(others))])
    discs = np.array([0.0, radius])
    pairs = zip(others, limits, strict=True)
    margins = [least_margin(one, discs, other, row, 0.0, *row[2:]) for other, row in pairs]
    expected = next((n for n, found in enumerate(margins) if found < 0.0), -1)
    assert first_conflict(one, discs, np.concatenate(others), offsets, limits, 0.0) == expected


def test_who_begins_in_a_circle_is_in_its_disc_until_the_second_row():
    waiting = path((0, 0, 0, 0), (60, 0, 80, 0), (160, 0, 1080, 0))
    discs, none = np.array([80.0, 0.0]), np.zeros(2)
    passing = path((0, 200, -1000, 0), (100, 200, 1000, 0))  # abreast of the circle at 50 s
    assert least_margin(waiting, discs, passing, none, 0.0, APART_M, UP_M) == pytest.approx(20.0)
    assert least_margin(waiting, none, passing, none, 0.0, APART_M, UP_M) == pytest.approx(100.0, abs=5.0)
    assert least_margin(passing, none, waiting, discs, 0.0, APART_M, UP_M) == pytest.approx(20.0)
    late = path((100, -1000, 0, 0), (200, 1000, 0, 0))  # at the centre when nobody is there any more
    assert least_margin(waiting, discs, late, none, 0.0, APART_M, UP_M) > 0.0
