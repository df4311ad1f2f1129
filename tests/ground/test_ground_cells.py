"""The planner's cells contain the ground between posts, and the kernels over them agree with many samples."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from companion.kernels.geometry.ground_surface import (
    crosses_ground,
    fill_ground_shadows,
    ground_hides,
    lack_of_height,
    over_ground,
)
from companion.kernels.geometry.prism_distance import clearance, segment_clear
from companion.world.ground.elevation_file import TerrainError
from companion.world.ground.ground_cells import ground_cells, spacing_m
from companion.world.obstacles import packed_obstacles
from tests.ground.maps import BOUNDS, bilinear, hill, posts_over, rough
from tests.support.paths import box

LEAST, WANTED, MOST = 30.0, 70.0, 140.0
EAST, NORTH, UP = st.floats(1.0, 999.0), st.floats(1.0, 799.0), st.floats(0.0, 400.0)
PLACE = st.tuples(EAST, NORTH, UP)
FIELD = (*BOUNDS, 0.0, 400.0)


def cells(posts, **changes):
    limits = {"least_m": LEAST, "wanted_m": WANTED, "most_m": MOST, "drivable": 1.0}
    return ground_cells(posts, BOUNDS, **{**limits, **changes})


HILL = cells(posts_over(hill))
ROUGH = cells(posts_over(rough(3)))


def cell_of(ground, east, north):
    """Row and column of a place's cell, by the definition."""
    return tuple(
        min(int((at - ground.grid[axis]) / ground.grid[2]), ground.high.shape[axis] - 1)
        for axis, at in enumerate((east, north))
    )


@settings(max_examples=300)
@given(EAST, NORTH, st.integers(0, 5))
def test_the_ground_lies_between_the_heights_of_its_cell(east, north, seed):
    posts = posts_over(rough(seed))
    ground, up = cells(posts), bilinear(posts, east, north)
    cell = cell_of(ground, east, north)
    assert ground.low[cell] - 1e-6 <= up <= ground.high[cell] + 1e-6


def test_a_plane_is_as_high_as_the_posts_about_a_cell():
    """Posts are 50 m apart, and cells 12.5 m long; a cell touches two squares of posts a side at most."""
    ground = cells(posts_over(lambda east, north: 0.2 * east))
    side = ground.grid[2]
    assert side == pytest.approx(12.5, rel=1e-3)
    row = int(525.0 / side)
    assert 0.2 * side * (row + 1) - 0.01 <= ground.high[row, 5] <= 0.2 * side * (row + 2) + 0.01
    assert ground.high[row, 5] - ground.low[row, 5] <= 0.2 * 2.0 * side + 0.01


def test_posts_that_are_close_are_not_divided():
    assert cells(posts_over(hill, spacing=12.0)).grid[2] == pytest.approx(12.0, rel=1e-3)


def test_posts_far_apart_have_their_distance():
    assert spacing_m(posts_over(hill, spacing=120.0), BOUNDS) == pytest.approx(120.0, rel=1e-3)


def test_posts_that_do_not_cover_the_bounds_are_refused():
    with pytest.raises(TerrainError, match="cover"):
        ground_cells(
            posts_over(hill), (0.0, 3000.0, 0.0, 800.0), least_m=LEAST, wanted_m=WANTED, most_m=MOST,
            drivable=1.0,
        )  # fmt: skip


@given(PLACE)
def test_what_is_left_over_ground_is_the_lesser_of_both_limits(place):
    cell = cell_of(ROUGH, *place[:2])
    high, low = float(ROUGH.high[cell]), float(ROUGH.low[cell])
    expected = min(place[2] - high - LEAST, low + MOST - place[2])
    assert over_ground(*place, ROUGH) == pytest.approx(expected)
    lacking = (high + WANTED - place[2]) / (WANTED - LEAST)
    assert lack_of_height(*place, ROUGH) == pytest.approx(min(max(lacking, 0.0), 1.0))


@settings(max_examples=300)
@given(PLACE, PLACE, st.floats(0.0, 20.0))
def test_a_segment_has_as_much_to_spare_as_its_worst_place(begin, end, margin):
    shares = np.linspace(0.0, 1.0, 2_001)[:, None]
    places = np.array(begin) + shares * (np.array(end) - np.array(begin))
    worst = min(over_ground(*place, ROUGH) for place in places)
    assume(abs(worst - margin) > 1.0)  # A corner that is cut between two samples.
    if worst < margin:
        assert crosses_ground(*begin, *end, ROUGH, margin)
    else:
        # It may cut a corner of a cell between two samples, which lie less than a metre apart.
        nearest = min(over_ground(*place, ROUGH) for place in around(places))
        assert not crosses_ground(*begin, *end, ROUGH, margin) or nearest < margin


def around(places):
    """Places half a metre beside others."""
    for dx, dy in ((0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5)):
        yield from places + np.array([dx, dy, 0.0])


@settings(max_examples=200)
@given(PLACE, PLACE)
def test_sight_is_blocked_only_where_the_line_runs_under_ground(begin, end):
    posts = posts_over(rough(3))
    shares = np.linspace(0.0, 1.0, 801)[:, None]
    places = np.array(begin) + shares * (np.array(end) - np.array(begin))
    if ground_hides(*begin, *end, ROUGH):
        assert min(place[2] - bilinear(posts, *place[:2]) for place in places) < 1.0


def test_a_hill_hides_what_is_behind_it_and_not_what_is_above():
    assert ground_hides(100.0, 400.0, 50.0, 900.0, 400.0, 50.0, HILL)
    assert not ground_hides(100.0, 400.0, 330.0, 900.0, 400.0, 330.0, HILL)
    assert not ground_hides(100.0, 50.0, 50.0, 900.0, 50.0, 50.0, HILL)


def test_a_shadow_is_where_sight_is_blocked():
    radar, grid = np.array([120.0, 400.0, 20.0]), np.array([0.0, 0.0, 40.0])
    shadows = np.full((26, 21), -math.inf)
    fill_ground_shadows(shadows, grid, radar, HILL)
    for i, j in ((20, 10), (24, 8), (24, 12), (10, 2), (3, 10)):
        x, y = 40.0 * i, 40.0 * j
        for up in (shadows[i, j] - 15.0, shadows[i, j] + 15.0):
            if up > HILL.high[cell_of(HILL, x, y)]:
                assert ground_hides(*radar, x, y, up, HILL) == (up < shadows[i, j])


@given(PLACE)
def test_a_clearance_is_the_least_of_prisms_and_ground(place):
    walls = (box("a", 300.0, 300.0, 400.0, 500.0),)
    alone = clearance(*place, packed_obstacles(walls, FIELD), 500.0)
    both = packed_obstacles(walls, FIELD, ROUGH)
    assert clearance(*place, both, 500.0) == pytest.approx(min(alone, max(0.0, over_ground(*place, ROUGH))))


@given(PLACE, PLACE)
def test_a_segment_is_clear_of_both_or_not_at_all(begin, end):
    walls = (box("a", 300.0, 300.0, 400.0, 500.0),)
    prisms, both = packed_obstacles(walls, FIELD), packed_obstacles(walls, FIELD, ROUGH)
    expected = segment_clear(*begin, *end, prisms, 10.0) and not crosses_ground(*begin, *end, ROUGH, 10.0)
    assert segment_clear(*begin, *end, both, 10.0) == expected


def test_a_map_is_cut_to_the_bounds_before_it_is_divided():
    """The cells are the same, however far the map reaches beyond them."""
    wide = posts_over(rough(1), bounds=(-5000.0, 6000.0, -4000.0, 5000.0))
    narrow = replace(
        wide, up_m=wide.up_m[75:110, 94:130], first_x=wide.first_x + 94 * wide.step_x,
        first_y=wide.first_y + 75 * wide.step_y,
    )  # fmt: skip
    assert np.array_equal(cells(wide).high, cells(narrow).high)
    assert np.array_equal(cells(wide).low, cells(narrow).low)
