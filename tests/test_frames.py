"""Frames against PROJ's geodesics, which the frame itself does not use, and the two senses of angles."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pyproj import Geod

from companion.frames import LocalFrame, course_from_direction, direction_from_course, wrapped_angle

WGS84 = Geod(ellps="WGS84")
FRAME = LocalFrame(-35.363261, 149.165230, 584.0)
frames = st.builds(LocalFrame, st.floats(-80.0, 80.0), st.floats(-179.0, 179.0), st.floats(-100.0, 3000.0))
# PROJ takes what lies within 0.64 mm of the origin for the origin: such lengths have a test of their own.
lengths = st.floats(-10_000.0, 10_000.0).filter(lambda length: length == 0.0 or abs(length) > 1e-3)
tiny_lengths = st.floats(-1e-3, 1e-3)
angles = st.floats(-50.0, 50.0)


def test_the_origin_is_zero():
    assert FRAME.local_from_global(-35.363261, 149.165230, 584.0) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_up_counts_from_the_origins_altitude():
    assert FRAME.local_from_global(-35.363261, 149.165230, 684.5)[2] == 100.5
    assert FRAME.global_from_local(0.0, 0.0, -84.0)[2] == 500.0


@pytest.mark.parametrize(
    ("azimuth_deg", "east", "north"),
    [(0.0, 0.0, 1000.0), (90.0, 1000.0, 0.0), (180.0, 0.0, -1000.0), (270.0, -1000.0, 0.0)],
)
def test_a_kilometre_to_each_side(azimuth_deg, east, north):
    longitude, latitude, _ = WGS84.fwd(149.165230, -35.363261, azimuth_deg, 1000.0)
    found = FRAME.local_from_global(latitude, longitude, 584.0)
    assert found == pytest.approx((east, north, 0.0), abs=1e-6)


@given(frames, lengths, lengths)
def test_distance_and_bearing_from_the_origin_are_the_geodesic_ones(frame, east, north):
    latitude, longitude, _ = frame.global_from_local(east, north, 0.0)
    azimuth, _, distance = WGS84.inv(frame.longitude_deg, frame.latitude_deg, longitude, latitude)
    assert distance == pytest.approx(math.hypot(east, north), abs=1e-4)
    if distance > 1.0:
        course = math.atan2(east, north)
        assert wrapped_angle(math.radians(azimuth) - course) == pytest.approx(0.0, abs=1e-6)


@given(frames, lengths, lengths, lengths, lengths)
def test_lengths_between_points_within_ten_kilometres_hold_to_a_millionth(frame, e1, n1, e2, n2):
    if max(math.hypot(e1, n1), math.hypot(e2, n2)) > 10_000.0:
        return
    (lat1, lon1, _), (lat2, lon2, _) = (frame.global_from_local(e, n, 0.0) for e, n in ((e1, n1), (e2, n2)))
    _, _, distance = WGS84.inv(lon1, lat1, lon2, lat2)
    assert distance == pytest.approx(math.hypot(e2 - e1, n2 - n1), rel=1e-6, abs=1e-3)


@given(frames, lengths, lengths, st.floats(-500.0, 5000.0))
def test_there_and_back(frame, east, north, up):
    back = frame.local_from_global(*frame.global_from_local(east, north, up))
    assert back == pytest.approx((east, north, up), abs=1e-6)


@given(frames, tiny_lengths, tiny_lengths)
@example(LocalFrame(0.0, 0.0, 0.0), 0.0, 6.103515625e-05)
def test_what_lies_within_a_millimetre_of_the_origin_comes_back_within_a_millimetre(frame, east, north):
    back = frame.local_from_global(*frame.global_from_local(east, north, 0.0))
    assert back == pytest.approx((east, north, 0.0), abs=1e-3)


@pytest.mark.parametrize(
    ("direction_deg", "course_deg"),
    [(0.0, 90.0), (90.0, 0.0), (180.0, 270.0), (-90.0, 180.0), (135.0, 315.0)],
)
def test_courses_turn_clockwise_from_north(direction_deg, course_deg):
    assert math.degrees(course_from_direction(math.radians(direction_deg))) == pytest.approx(course_deg)
    back = math.degrees(direction_from_course(math.radians(course_deg)))
    assert back == pytest.approx(direction_deg)


@given(angles)
@example(0.5 * math.pi + 1e-16)
@example(math.nextafter(0.5 * math.pi, 4.0))  # a hair west of north rounds to the full turn
def test_courses_are_in_a_turn_and_directions_in_half_a_turn_either_way(angle):
    assert 0.0 <= course_from_direction(angle) < 2.0 * math.pi
    assert -math.pi < direction_from_course(angle) <= math.pi


@given(angles)
def test_both_point_the_same_way(angle):
    course = course_from_direction(angle)
    assert (math.sin(course), math.cos(course)) == pytest.approx((math.cos(angle), math.sin(angle)), abs=1e-9)
    direction = direction_from_course(course)
    assert wrapped_angle(direction - angle) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (math.pi, math.pi),
        (-math.pi, math.pi),
        (3.0 * math.pi, math.pi),
        (5.0, 5.0 - 2.0 * math.pi),
    ],
)
def test_wrapping(angle, wrapped):
    assert wrapped_angle(angle) == pytest.approx(wrapped)


@given(frames, st.lists(st.tuples(lengths, lengths), min_size=1, max_size=5))
def test_many_places_at_once_are_those_of_one_at_a_time(frame, points):
    east, north = np.array(points).T
    latitudes, longitudes = frame.places_from_local(east, north)
    again = np.column_stack(frame.places_from_global(latitudes, longitudes))
    assert again == pytest.approx(np.array(points), abs=1e-6)
    for place, (latitude, longitude) in zip(again, zip(latitudes, longitudes, strict=True), strict=True):
        assert frame.local_from_global(latitude, longitude, 0.0)[:2] == pytest.approx(tuple(place), abs=1e-9)
