"""Shadows against exact lines of sight."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from companion.kernels.geometry.radar_shadow import (
    NO_SHADOW,
    casts_shadow,
    crossing_interval,
    is_hidden,
    shadow_behind,
)
from companion.types.threat import Radar
from companion.world.threats import packed_threats
from tests.support.paths import box
from tests.support.worlds import is_blocked, packed

BOUNDS = (-600.0, 600.0, -600.0, 600.0, 0.0, 300.0)
GROUNDED = (
    box("low", 100.0, -50.0, 150.0, 50.0, 0.0, 40.0),
    box("tower", -80.0, 60.0, -40.0, 100.0, 0.0, 200.0),
)
FLOATING = box("bridge", 100.0, 200.0, 300.0, 220.0, 60.0, 90.0)
WORLD = (*GROUNDED, FLOATING)
PACKED = packed(WORLD)
COORDINATE = st.floats(-500.0, 500.0)


def shadow_height(rx, ry, rz, x, y, obstacles):
    """Below which a point over (x, y) is hidden from a radar, by looking behind every prism."""
    casting = [o for o in range(len(obstacles.heights)) if casts_shadow(obstacles, o)]
    return max([NO_SHADOW, *(shadow_behind(rx, ry, rz, x, y, obstacles, o) for o in casting)])


def test_shadow_height_by_hand():
    # Radar at the origin on the ground, prism from east 100 to 150, top at 40 m. Over east 400 the line
    # that grazes the near edge (100, 40) is at 40·400/100 = 160 m.
    assert shadow_height(0.0, 0.0, 0.0, 400.0, 0.0, PACKED) == pytest.approx(160.0)
    # From a mast of 100 m it grazes the far edge (150, 40): at east 400 it is at 100 − 60·400/150 = −60 m.
    assert shadow_height(0.0, 0.0, 100.0, 400.0, 0.0, PACKED) == pytest.approx(-60.0)
    # At east 200: 100 − 60·200/150 = 20 m.
    assert shadow_height(0.0, 0.0, 100.0, 200.0, 0.0, PACKED) == pytest.approx(20.0)
    assert shadow_height(0.0, 0.0, 0.0, 0.0, -400.0, PACKED) == NO_SHADOW
    assert shadow_height(120.0, 0.0, 10.0, 400.0, 0.0, PACKED) == math.inf  # the radar stands inside it


def test_crossing_interval_by_hand():
    # From the origin to east 400: inside from 100/400 to 150/400.
    assert crossing_interval(0.0, 0.0, 400.0, 0.0, PACKED, 0) == pytest.approx((0.25, 0.375))
    assert crossing_interval(0.0, 0.0, 0.0, -400.0, PACKED, 0) == (1.0, 0.0)
    assert crossing_interval(120.0, 0.0, 400.0, 0.0, PACKED, 0) == pytest.approx((0.0, 30.0 / 280.0))
    assert crossing_interval(0.0, 0.0, 120.0, 0.0, PACKED, 0) == pytest.approx((100.0 / 120.0, 1.0))


@settings(max_examples=400, deadline=None)
@given(COORDINATE, COORDINATE, st.floats(0.0, 120.0), COORDINATE, COORDINATE, st.floats(1.0, 300.0))
def test_a_point_below_the_shadow_height_is_out_of_sight_and_one_above_is_not(rx, ry, rz, x, y, z):
    height = shadow_height(rx, ry, rz, x, y, PACKED)
    assume(abs(z - height) > 1e-3)
    assume(math.hypot(x - rx, y - ry) > 1.0)
    blocked = is_blocked((rx, ry, rz), (x, y, z), GROUNDED)
    near_side = any(
        is_blocked((rx + dx, ry + dy, rz), (x + dx, y + dy, z), GROUNDED) != blocked
        for dx, dy in ((1e-4, 0), (-1e-4, 0), (0, 1e-4), (0, -1e-4))
    )
    assume(not near_side)
    assert (z < height) == blocked


RADAR = Radar("r", (0.0, 0.0, 10.0), 500.0)
THREATS = packed_threats([RADAR], PACKED, BOUNDS)


@settings(max_examples=300, deadline=None)
@given(st.floats(-500.0, 500.0), st.floats(-500.0, 500.0), st.floats(0.0, 300.0))
def test_the_field_claims_no_masking_that_is_not_there(x, y, z):
    if is_hidden(x, y, z, THREATS.shadows[0], THREATS.grid):
        around = [(x + dx, y + dy, z) for dx in (-4.0, 0.0, 4.0) for dy in (-4.0, 0.0, 4.0)]
        assert any(is_blocked(RADAR.position_enu_m, point, GROUNDED) for point in around)


def test_the_field_finds_the_shadows_behind_prisms():
    rng = np.random.default_rng(3)
    points = rng.uniform((-500.0, -500.0, 20.0), (500.0, 500.0, 200.0), (3000, 3))
    exact = np.array([is_blocked(RADAR.position_enu_m, p, GROUNDED) for p in points])
    field = np.array([is_hidden(*p, THREATS.shadows[0], THREATS.grid) for p in points])
    # Cells are 3.75 m: a point is judged wrongly only within a cell of a shadow's edge.
    assert exact.sum() > 150
    assert (field & ~exact).sum() <= 2
    assert (exact & ~field).sum() < 0.25 * exact.sum()


# Corners and radars on whole tens of metres: radars in prisms, on their sides and in line with them come up.
TENS = st.integers(-40, 40).map(lambda tens: 10.0 * tens)


@st.composite
def worlds_and_radars(draw):
    """Up to four boxes, and a radar anywhere."""
    boxes = []
    for number in range(draw(st.integers(1, 4))):
        east, north = draw(TENS), draw(TENS)
        sides = [10.0 * draw(st.integers(1, 30)) for _ in range(2)]
        base = draw(st.sampled_from((0.0, 0.0, 50.0)))
        top = base + draw(st.floats(5.0, 150.0))
        boxes.append(box(f"b{number}", east, north, east + sides[0], north + sides[1], base, top))
    return packed(boxes), (draw(TENS), draw(TENS), draw(st.floats(0.0, 120.0)))


@settings(max_examples=20, deadline=None)  # of thousands of nodes each
@given(worlds_and_radars())
def test_the_field_is_the_shadow_height_at_every_node(world):
    obstacles, place = world
    threats = packed_threats([Radar("r", place, 500.0)], obstacles, BOUNDS)
    east0, north0, spacing = threats.grid
    exact = [
        [shadow_height(*place, east0 + i * spacing, north0 + j * spacing, obstacles)
         for j in range(0, threats.shadows.shape[2], 4)]
        for i in range(0, threats.shadows.shape[1], 4)
    ]  # fmt: skip
    assert np.array_equal(threats.shadows[0, ::4, ::4], exact)


def test_nothing_is_hidden_outside_the_field():
    threats = packed_threats([Radar("r", (0.0, 0.0, 0.0), 500.0)], PACKED, BOUNDS)
    assert is_hidden(400.0, 0.0, 50.0, threats.shadows[0], threats.grid)
    for x, y in ((700.0, 0.0), (-700.0, 0.0), (0.0, 700.0), (0.0, -700.0)):
        assert not is_hidden(x, y, -1e8, threats.shadows[0], threats.grid)
