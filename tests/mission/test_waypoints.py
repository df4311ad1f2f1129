"""From paths to fly-by waypoints, and from those to mission items."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.frames import equivalent_airspeed
from companion.mission.list_layout import bank_items
from companion.mission.waypoints import mission_part, waypoints_from_path
from companion.types.mission import ALL_SLOPES, Command, MavFrame, SlopeMin
from companion.world.ground.autopilot_ground import AutopilotGround
from tests.mission.made import FRAME, path_along, waypoints

RADIUS = 125.0
QUARTER = 0.5 * math.pi
TANGENT_45 = RADIUS * math.tan(math.radians(22.5))  # 51.777 m


def ground_rising():
    """The ground of an autopilot: 30 m above the origin there, and a tenth of the way to the north."""

    def heights(latitude, longitude):
        return FRAME.altitude_amsl_m + 30.0 + 0.1 * (latitude - FRAME.latitude_deg) * 111_195.0

    return AutopilotGround(heights, FRAME, (-500.0, 500.0, -500.0, 1500.0), 100.0)


def test_a_right_angle_becomes_two_corners_of_45_degrees():
    """North to (0, 500), right about (125, 500) to (125, 625), east to (625, 625)."""
    path = path_along((500.0, 20), (RADIUS, QUARTER, 8), (500.0, 20))
    made = waypoints_from_path(path, 25.0)
    np.testing.assert_allclose(
        made.positions_enu_m,
        [
            [0.0, 50.0, 100.0],  # the entry: first row at least 45 m along
            [0.0, 500.0 + TANGENT_45, 100.0],
            [125.0 - TANGENT_45, 625.0, 100.0],
            [625.0, 625.0, 100.0],
        ],
        atol=1e-6,
    )
    assert made.airspeed_m_s == 25.0


def test_left_turns_are_mirrored():
    right = waypoints_from_path(path_along((500.0, 20), (RADIUS, QUARTER, 8), (500.0, 20)), 25.0)
    left = waypoints_from_path(path_along((500.0, 20), (RADIUS, -QUARTER, 8), (500.0, 20)), 25.0)
    np.testing.assert_allclose(left.positions_enu_m, right.positions_enu_m * [-1.0, 1.0, 1.0], atol=1e-6)


def test_turns_to_either_side_have_corners_of_their_own():
    """An S of two quarter turns without a straight between them: four corners, none shared."""
    path = path_along((500.0, 20), (RADIUS, QUARTER, 8), (RADIUS, -QUARTER, 8), (500.0, 20))
    corners = waypoints_from_path(path, 25.0).positions_enu_m[1:-1, :2]
    t = TANGENT_45
    expected = [[0.0, 500.0 + t], [125.0 - t, 625.0], [125.0 + t, 625.0], [250.0, 750.0 - t]]
    np.testing.assert_allclose(corners, expected, atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(
    radius=st.floats(100.0, 300.0),
    degrees=st.floats(60.0, 300.0),
    side=st.sampled_from([-1.0, 1.0]),
    course=st.floats(0.0, 6.2),
)
def test_rounding_the_corners_at_the_radius_gives_the_arc_back(radius, degrees, side, course):
    """Every leg of the polygon touches the circle: its distance from the centre is the radius."""
    turn = side * math.radians(degrees)
    rows = math.ceil(radius * abs(turn) / 25.0)
    path = path_along((400.0, 16), (radius, turn, rows), (400.0, 16), course=course)
    legs = waypoints_from_path(path, 25.0).positions_enu_m[:, :2]
    start = 400.0 * np.array([math.sin(course), math.cos(course)])
    centre = start + side * radius * np.array([math.cos(course), -math.sin(course)])
    for a, b in itertools.pairwise(legs):
        along = (b - a) / np.linalg.norm(b - a)
        away = abs(along[0] * (centre - a)[1] - along[1] * (centre - a)[0])
        assert away == pytest.approx(radius, abs=1e-6)
    turned = np.unwrap(np.arctan2(*np.diff(legs, axis=0).T))
    assert np.abs(np.diff(turned)).max() <= math.radians(50.0) + 1e-9
    assert turned[-1] - turned[0] == pytest.approx(turn, abs=1e-9)


def test_straight_flight_is_an_entry_and_its_end():
    made = waypoints_from_path(path_along((1000.0, 40)), 25.0)
    np.testing.assert_allclose(made.positions_enu_m, [[0.0, 50.0, 100.0], [0.0, 1000.0, 100.0]])


def test_a_short_straight_has_no_entry_of_its_own():
    made = waypoints_from_path(path_along((150.0, 6)), 25.0)
    np.testing.assert_allclose(made.positions_enu_m, [[0.0, 150.0, 100.0]])


def test_no_entry_where_it_would_take_the_room_of_the_first_turn():
    """First corner's middle at 100 + 49 m: less than 45 + 110 m."""
    made = waypoints_from_path(path_along((100.0, 4), (RADIUS, QUARTER, 8), (500.0, 20)), 25.0)
    np.testing.assert_allclose(made.positions_enu_m[0], [0.0, 100.0 + TANGENT_45, 100.0], atol=1e-6)


def test_a_corner_right_at_the_start_counts_as_flown():
    """Turning from the first row on, 20 degrees: its middle lies 21.8 m along, nearer than 45 m."""
    path = path_along((RADIUS, math.radians(20.0), 2), (500.0, 20))
    made = waypoints_from_path(path, 25.0)
    np.testing.assert_allclose(made.positions_enu_m, path.positions_enu_m[-1:], atol=1e-6)


def test_height_has_a_waypoint_where_it_leaves_the_line():
    """Level for 500 m, then up 50 m in 500: 25 m off the line at 500 m."""
    path = path_along((1000.0, 40), up=lambda at: 100.0 + max(0.0, at - 500.0) * 0.1)
    made = waypoints_from_path(path, 25.0)
    expected = [[0.0, 50.0, 100.0], [0.0, 500.0, 100.0], [0.0, 1000.0, 150.0]]
    np.testing.assert_allclose(made.positions_enu_m, expected, atol=1e-9)


@pytest.mark.parametrize(("climb", "num"), [(14.0, 2), (18.0, 3)])  # 7 m and 9 m off: 8 m are left alone
def test_height_is_left_alone_within_its_tolerance(climb, num):
    path = path_along((1000.0, 40), up=lambda at: 100.0 + max(0.0, at - 500.0) * climb / 500.0)
    assert len(waypoints_from_path(path, 25.0, flies_by=False, slope_min=ALL_SLOPES).positions_enu_m) == num


@pytest.mark.parametrize(("climb", "heights"), [
    (3.0, [100.15, 103.0]), (-6.0, [99.7, 96.85, 94.0]), (12.0, [100.6, 106.3, 112.0]),
    (20.0, [101.0, 120.0]),
])  # fmt: skip
def test_a_leg_that_arduplane_flies_level_is_divided(climb, heights):
    """Up or down evenly on 1000 m, entered after 50 m: ArduPlane flies changes below 15 m at once.

    An aircraft climbed into a radar's sight by 6 m at once.
    """
    path = path_along((1000.0, 40), up=lambda at: 100.0 + climb * at / 1000.0)
    made = waypoints_from_path(path, 25.0).positions_enu_m
    np.testing.assert_allclose(made[:, 2], heights, atol=1e-9)
    assert len(waypoints_from_path(path, 25.0, flies_by=False, slope_min=ALL_SLOPES).positions_enu_m) == 2


@pytest.mark.parametrize(("climb", "slope_min", "num"), [
    (20.0, (15.0, 15.0), 1), (20.0, (21.0, 15.0), 3), (20.0, (math.inf, 15.0), 3),
    (-20.0, (math.inf, 15.0), 1), (-20.0, (15.0, math.inf), 3), (10.0, (9.0, 9.0), 1),
    (200.0, (math.inf, 15.0), 15),
])  # fmt: skip
def test_which_legs_are_divided_depends_on_the_autopilots_parameters(climb, slope_min, num):
    """A straight path of 1000 m, entered after 50 m, in steps of at most 7.5 m or at least 60 m long."""
    path = path_along((1000.0, 200), up=lambda at: 300.0 + climb * at / 1000.0)
    made = waypoints_from_path(path, 25.0, slope_min=SlopeMin(*slope_min))
    assert len(made.positions_enu_m) - 1 == num
    points = made.positions_enu_m
    assert points[:, 2] == pytest.approx(300.0 + climb * points[:, 1] / 1000.0, abs=0.01 * abs(climb))


def test_rounding_does_not_make_a_straight_leg_a_turn():
    path = path_along((1000.0, 40), up=lambda at: 100.0 + 0.012 * at)
    rounded = replace(path, courses_rad=path.courses_rad + 1e-9 * (np.arange(len(path)) % 3))
    made = [waypoints_from_path(each, 25.0).positions_enu_m for each in (path, rounded)]
    np.testing.assert_allclose(*made, atol=1e-3)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-0.15, 0.15), min_size=4, max_size=8))
def test_no_height_of_the_path_is_far_from_the_waypoints_line(slopes):
    """Piecewise climbs of 250 m each; beyond 60 m from a waypoint the line holds to 8 m."""
    edges = np.cumsum([0.0, *(250.0 * slope for slope in slopes)]) + 200.0
    length = 250.0 * len(slopes)
    path = path_along(
        (length, 10 * len(slopes)), up=lambda at: float(np.interp(at, np.arange(len(edges)) * 250.0, edges))
    )
    made = waypoints_from_path(path, 25.0).positions_enu_m
    line = np.interp(path.positions_enu_m[:, 1], [0.0, *made[1:, 1]], [edges[0], *made[1:, 2]])
    marks = np.array([0.0, *made[1:, 1]])
    spare = np.abs(path.positions_enu_m[:, 1, None] - marks).min(axis=1) > 60.0
    assert np.abs(line - path.positions_enu_m[:, 2])[spare].max(initial=0.0) <= 8.0 + 2.0 + 1e-9


# ISO 2533, by geopotential altitude: density in kg/m³.
@pytest.mark.parametrize(
    ("altitude_m", "density"), [(0.0, 1.225), (1000.0, 1.11164), (3000.0, 0.909122), (5000.0, 0.736116)]
)
def test_equivalent_airspeed_of_the_standard_atmosphere(altitude_m, density):
    expected = 25.0 * math.sqrt(density / 1.225)
    assert equivalent_airspeed(25.0, altitude_m) == pytest.approx(expected, rel=1e-4)


def test_a_bank_is_waypoints_the_airspeed_and_loiters():
    made = waypoints((0.0, 0.0, 100.0), (0.0, 500.0, 120.0), loiter_radius_m=-125.0)
    bank = bank_items(mission_part(made, FRAME), 6)
    way, speed, loiter = Command.NAV_WAYPOINT, Command.DO_CHANGE_SPEED, Command.NAV_LOITER_UNLIM
    assert [entry.command for entry in bank] == [way, speed, way, loiter, loiter, loiter]
    assert bank[0].latitude_e7 == -353_632_610
    assert bank[0].longitude_e7 == 1_491_652_300
    assert [entry.altitude_m for entry in bank] == [684.0, 0.0, 704.0, 704.0, 704.0, 704.0]
    assert {entry.frame for entry in bank if entry.command != speed} == {MavFrame.GLOBAL_INT}
    # 25 m/s true at 684 m, where the density is 0.9358 of that at sea level: 24.2 m/s.
    assert bank[1].parameters == (0.0, 24.2, -1.0, 0.0)
    assert bank[3].parameters[2] == -125.0
    assert (bank[3].latitude_e7, bank[3].longitude_e7) == (bank[2].latitude_e7, bank[2].longitude_e7)


def test_the_airspeed_is_commanded_again_for_who_enters_late():
    made = waypoints(*((0.0, 300.0 * n, 100.0) for n in range(4)), airspeed_again=2)
    way, speed, loiter = Command.NAV_WAYPOINT, Command.DO_CHANGE_SPEED, Command.NAV_LOITER_UNLIM
    bank = bank_items(mission_part(made, FRAME), 7)
    assert [entry.command for entry in bank] == [way, speed, way, way, speed, way, loiter]
    assert bank[1].parameters == bank[4].parameters


def test_the_loiter_stands_at_its_centre():
    made = waypoints(
        (0.0, 0.0, 100.0), (0.0, 500.0, 100.0), loiter_centre_enu_m=np.array([125.0, 500.0, 90.0])
    )
    last = bank_items(mission_part(made, FRAME), 5)[-1]
    east, north, up = FRAME.local_from_global(
        last.latitude_e7 * 1e-7, last.longitude_e7 * 1e-7, last.altitude_m
    )
    assert (east, north, up) == pytest.approx((125.0, 500.0, 90.0), abs=0.02)


def test_over_ground_waypoints_have_their_height_over_it_and_the_circle_is_level():
    """Ground 30 m high at the start that rises by a tenth to the north; a path 100 m above the origin."""
    ground = ground_rising()
    path = path_along((1000.0, 40), up=100.0)
    found = waypoints_from_path(path, 25.0, ground=ground)
    assert found.positions_enu_m[:, 2] == pytest.approx(100.0, abs=0.1)
    items = mission_part(replace(found, loiter_radius_m=125.0), FRAME).items
    placed = [item for item in items if item.command == Command.NAV_WAYPOINT]
    assert {item.frame for item in placed} == {MavFrame.GLOBAL_TERRAIN_ALT_INT}
    for waypoint, item in zip(found.positions_enu_m, placed, strict=True):
        assert item.altitude_m == pytest.approx(100.0 - 30.0 - 0.1 * waypoint[1], abs=0.7)
    circle = mission_part(replace(found, loiter_radius_m=125.0), FRAME).loiter
    assert (circle.frame, circle.altitude_m) == (MavFrame.GLOBAL_INT, pytest.approx(684.0, abs=0.1))


def test_over_ground_a_straight_path_has_waypoints_where_the_ground_would_lower_it():
    """A valley 40 m deep between 400 and 800 m; without waypoints in it the aircraft would fly down."""

    def valley(latitude, longitude):
        north = (latitude - FRAME.latitude_deg) * 111_195.0
        return FRAME.altitude_amsl_m - np.interp(north, [400.0, 600.0, 800.0], [0.0, 40.0, 0.0])

    ground = AutopilotGround(valley, FRAME, (-200.0, 200.0, -200.0, 1500.0), 50.0)
    found = waypoints_from_path(
        path_along((1200.0, 60), up=100.0), 25.0, ground=ground, height_tolerance_m=2.5
    )
    passed, over = (
        found.positions_enu_m[:, 1],
        found.positions_enu_m[:, 2] - ground.up_m(found.positions_enu_m),
    )
    north = np.arange(50.0, 1200.0, 5.0)
    flown = np.interp(north, passed, over) + ground.up_m(np.column_stack([0.0 * north, north]))
    assert flown.min() > 100.0 - 6.0  # Waypoints lie 60 m apart at least, in which the valley falls by 12 m.
    assert flown.max() < 115.0 + 3.0
    assert len(passed) > len(waypoints_from_path(path_along((1200.0, 60), up=100.0), 25.0).positions_enu_m)


def test_something_to_be_done_on_a_straight_has_a_waypoint_of_its_own():
    # 2000 m straight: an entry and the end, 45 and 2000 m along; what is to be done 990 m along is put on
    # the row nearest to it, 1000 m along, and nothing where a waypoint stands within 40 m.
    path = path_along((2000.0, 80))
    plain = waypoints_from_path(path, 25.0)
    marked = waypoints_from_path(path, 25.0, marked_m=[990.0, 1980.0])
    assert marked.distances_m.tolist() == [*plain.distances_m[:-1], 1000.0, 2000.0]
    assert marked.positions_enu_m[-2] == pytest.approx(path.positions_enu_m[40])
