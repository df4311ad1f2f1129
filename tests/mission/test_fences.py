"""The autopilot's fences as obstacles."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.mission.fences import (
    CIRCLE_IN,
    CIRCLE_OUT,
    POLYGON_IN,
    POLYGON_OUT,
    RETURN_POINT,
    FenceError,
    FenceLimits,
    Fences,
    fence_obstacles,
    fences_of,
)
from tests.mission.made import FRAME, item

BOUNDS = (0.0, 2000.0, 0.0, 1000.0, 60.0, 160.0)
SQUARE = [(500.0, 200.0), (900.0, 200.0), (900.0, 600.0), (500.0, 600.0)]


def corner(command, east, north, value):
    latitude, longitude, _ = FRAME.global_from_local(east, north, 0.0)
    return item(
        0, command, parameters=(value, 0.0, 0.0, 0.0), latitude_e7=round(latitude * 1e7),
        longitude_e7=round(longitude * 1e7), altitude_m=0.0,
    )  # fmt: skip


def polygon(command, corners):
    return [corner(command, *place, float(len(corners))) for place in corners]


def circle(command, east, north, radius):
    return [corner(command, east, north, radius)]


def obstacles(*lists):
    items = [replace(entry, sequence=n) for n, entry in enumerate(entry for part in lists for entry in part)]
    return fence_obstacles(fences_of(items, FRAME), BOUNDS)


def covered(found, east, north):
    return any(shapely.Polygon(entry.polygon_enu_m).contains(shapely.Point(east, north)) for entry in found)


def test_no_fence_is_no_obstacle():
    assert obstacles() == ()


def test_an_excluded_polygon_stands_as_it_is_at_all_heights():
    (found,) = obstacles(polygon(POLYGON_OUT, SQUARE))
    np.testing.assert_allclose(found.polygon_enu_m, SQUARE, atol=0.02)
    assert found.base_m < 60.0 - 500.0
    assert found.top_m > 160.0 + 500.0


def test_an_excluded_circle_lies_inside_its_polygon():
    (found,) = obstacles(circle(CIRCLE_OUT, 700.0, 400.0, 200.0))
    shape = shapely.Polygon(found.polygon_enu_m)
    assert shape.buffer(0.05).contains(shapely.Point(700.0, 400.0).buffer(200.0))
    assert shape.area < 1.02 * math.pi * 200.0**2


def test_of_an_inclusion_it_is_what_lies_outside():
    found = obstacles(polygon(POLYGON_IN, SQUARE))
    for east, north in [(100.0, 100.0), (1900.0, 900.0), (700.0, 650.0), (490.0, 400.0)]:
        assert covered(found, east, north)
    for east, north in [(700.0, 400.0), (510.0, 210.0), (890.0, 590.0)]:
        assert not covered(found, east, north)


def test_an_included_circle_contains_its_polygon():
    found = obstacles(circle(CIRCLE_IN, 1000.0, 500.0, 300.0))
    for angle in np.linspace(0.0, 6.28, 100):
        assert covered(found, 1000.0 + 301.0 * math.sin(angle), 500.0 + 301.0 * math.cos(angle))
    assert not covered(found, 1000.0, 500.0)


def test_it_must_stay_inside_of_all_inclusions():
    found = obstacles(polygon(POLYGON_IN, SQUARE), circle(CIRCLE_IN, 500.0, 400.0, 250.0))
    assert covered(found, 850.0, 400.0)
    assert covered(found, 450.0, 400.0)
    assert not covered(found, 600.0, 400.0)


def test_a_return_point_is_no_zone():
    assert obstacles([corner(RETURN_POINT, 0.0, 0.0, 0.0)]) == ()


def test_several_zones_in_one_list():
    found = obstacles(
        polygon(POLYGON_OUT, SQUARE),
        circle(CIRCLE_OUT, 1500.0, 500.0, 50.0),
        polygon(POLYGON_OUT, SQUARE[:3]),
    )
    assert [len(entry.polygon_enu_m) for entry in found] == [4, 24, 3]
    assert len({entry.name for entry in found}) == 3


@pytest.mark.parametrize(
    ("items", "reason"),
    [
        (polygon(POLYGON_OUT, SQUARE)[:3], "not complete"),
        (polygon(POLYGON_OUT, SQUARE)[:3] + polygon(POLYGON_IN, SQUARE)[:1], "not complete"),
        (polygon(POLYGON_OUT, SQUARE[:2]), "not complete"),
        (polygon(POLYGON_OUT, [SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]]), "crosses itself"),
        (polygon(POLYGON_OUT, [SQUARE[0]] * 3), "encloses nothing"),
        (circle(CIRCLE_OUT, 0.0, 0.0, 0.0), "radius 0 m"),
        (circle(CIRCLE_OUT, 0.0, 0.0, math.inf), "radius inf m"),
        ([item(0)], "no fence"),
        ([item(0)] * 3000, "more than"),
    ],
)
def test_what_cannot_be_understood(items, reason):
    with pytest.raises(FenceError, match=reason):
        fences_of(items, FRAME)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(100.0, 1900.0), st.floats(100.0, 900.0), st.floats(20.0, 400.0)), max_size=4
    ),
    st.lists(
        st.tuples(st.floats(600.0, 1400.0), st.floats(300.0, 700.0), st.floats(300.0, 900.0)), max_size=3
    ),
    st.floats(0.0, 2000.0),
    st.floats(0.0, 1000.0),
)
def test_a_point_is_free_if_and_only_if_it_is_inside_of_all_and_outside_of_all(out, inside, east, north):
    """Against the circles themselves; points within a metre of a chord's sagitta of an edge are left out."""
    found = obstacles(
        *(circle(CIRCLE_OUT, *zone) for zone in out), *(circle(CIRCLE_IN, *zone) for zone in inside)
    )
    gaps = [math.dist((east, north), zone[:2]) - zone[2] for zone in out]
    gaps += [zone[2] - math.dist((east, north), zone[:2]) for zone in inside]
    slack = [0.01 * zone[2] + 1.0 for zone in (*out, *inside)]
    if any(-1.0 <= gap <= room for gap, room in zip(gaps, slack, strict=True)):
        return
    assert covered(found, east, north) is any(gap < 0.0 for gap in gaps)


def test_a_circle_about_home_that_is_a_parameter_is_stayed_in():
    limits = FenceLimits((100.0, 200.0, 5.0), radius_m=400.0)
    (zone,) = limits.added_to(Fences()).inclusions
    away = np.linalg.norm(zone - (100.0, 200.0), axis=1)
    np.testing.assert_allclose(away, 400.0)
    assert str(limits) == ", within 400 m of home"


def test_a_ceiling_that_is_a_parameter_is_what_lies_above():
    limits = FenceLimits((0.0, 0.0, 5.0), height_m=120.0)
    (ceiling,) = fence_obstacles(limits.added_to(Fences()), BOUNDS)
    assert ceiling.base_m == 125.0
    assert ceiling.top_m > BOUNDS[5]
    assert shapely.Polygon(ceiling.polygon_enu_m).contains(
        shapely.box(BOUNDS[0], BOUNDS[2], BOUNDS[1], BOUNDS[3])
    )
    assert str(limits) == ", below 120 m"


def test_a_ceiling_above_the_bounds_is_no_obstacle():
    limits = FenceLimits((0.0, 0.0, 0.0), height_m=BOUNDS[5])
    assert fence_obstacles(limits.added_to(Fences()), BOUNDS) == ()
    assert FenceLimits().added_to(Fences()) == Fences()
