"""Mission legs as they are flown: straight legs, fly-by corners, a loiter at the end."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.assurance.checker import Checker
from tests.support.paths import box, check_limits, prism_distance

LEGS = [(0.0, 0.0, 100.0), (0.0, 500.0, 100.0), (500.0, 500.0, 100.0)]


def check(points, obstacles=(), loiter=125.0, ends=True, wind=(0.0, 0.0), airspeed=None, **changes):
    checker = Checker(obstacles, check_limits(**changes))
    return checker.check_legs(
        np.array(points, dtype=float), ends_in_loiter=ends, loiter_radius_m=loiter,
        wind_enu_m_s=wind, airspeed_m_s=airspeed,
    )  # fmt: skip


def rules(violations):
    return {violation.rule for violation in violations}


def test_legs_with_room_pass():
    assert check(LEGS) == ()


def test_a_mission_needs_two_waypoints():
    assert rules(check(LEGS[:1])) == {"rows"}
    assert rules(check(np.zeros((3, 2)))) == {"rows"}


@pytest.mark.parametrize("number", [math.nan, math.inf, 1e300])
def test_numbers_that_are_none_are_refused(number):
    assert [(v.rule, v.row) for v in check([LEGS[0], (0.0, number, 100.0), LEGS[2]])] == [("finite", 1)]


def test_waypoints_out_of_bounds():
    found = check(LEGS, bounds=(-200.0, 700.0, -10.0, 499.0, 0.0, 500.0))
    assert ("bounds", 1) in {(v.rule, v.row) for v in found}


def test_a_leg_too_near_to_an_obstacle_names_it():
    # 14 m from the first leg, margin 15 m (tolerance 0.2 m).
    found = check(LEGS, [box("shed", -30.0, 200.0, -14.0, 220.0)])
    assert [(v.rule, v.row) for v in found] == [("clearance", 1)]
    assert found[0].value == pytest.approx(14.0)
    assert check(LEGS, [box("shed", -30.0, 200.0, -15.0, 220.0)]) == ()


def test_climb_between_waypoints():
    # 100 m over 500 m: 11.3°; 80 m: 9.1°.
    steep = [(0, 0, 100.0), (0, 500, 200.0)]
    assert rules(check(steep)) == {"climb"}
    assert check([(0, 0, 100.0), (0, 500, 180.0)]) == ()
    assert rules(check([(0, 0, 100.0), (0, 0, 150.0)])) == {"climb"}  # straight up


@pytest.mark.parametrize("rise", [1.0, -1.0], ids=["climb", "descent"])
def test_with_the_wind_behind_a_climb_is_flatter_over_the_ground(rise):
    # 10° at 25 m/s rises 4.34 m/s. Over the ground 24.62 + 10 m/s north: 62.7 m in 500 m. Against it and
    # across no more is granted than in still air, 88.2 m.
    def leg(height):
        return [(0, 0, 200.0), (0, 500, 200.0 + rise * height)]

    behind = {"wind": (0.0, 10.0), "airspeed": 25.0}
    assert check(leg(62.0), **behind) == ()
    assert rules(check(leg(64.0), **behind)) == {"climb"}
    assert check(leg(88.0), wind=(0.0, -10.0), airspeed=25.0) == ()
    assert check(leg(88.0), wind=(10.0, 0.0), airspeed=25.0) == ()
    assert rules(check(leg(89.5), wind=(0.0, -10.0), airspeed=25.0)) == {"climb"}
    assert rules(check(leg(62.0), wind=(0.0, 10.0))) == {"climb"}  # at the slowest that there is


def test_a_turn_that_has_no_room_on_its_legs():
    # 90° with r = 125 m needs 125·tan 45° = 125 m of each leg; two corners on one leg 250 m.
    shape = [(0, -500, 100), (0, 0, 100), (260.0, 0, 100), (260.0, 500, 100)]
    assert check(shape) == ()
    shape = [(0, -500, 100), (0, 0, 100), (200.0, 0, 100), (200.0, 500, 100)]
    found = [v for v in check(shape) if v.rule == "corner"]
    assert [(v.row, v.value, v.limit) for v in found] == [(2, 200.0, pytest.approx(250.0))]


def test_turning_back_on_the_spot_is_refused():
    assert "corner" in rules(check([(0, 0, 100), (0, 500, 100), (0.1, 0, 100)]))


def test_waypoints_on_an_arc_of_the_smallest_radius_pass():
    # Every 30° on a circle of 125 m: legs of 64.7 m, tangents 2·125·tan 15° = 67 m, 4 % more: tolerated.
    angles = np.radians(np.arange(0, 181, 30))
    points = np.column_stack([125 * np.sin(angles), 125 * np.cos(angles), np.full(len(angles), 100.0)])
    assert "corner" not in rules(check(points))


def test_repeated_waypoints_are_no_corners():
    assert check([LEGS[0], LEGS[1], LEGS[1], LEGS[2]]) == ()


def test_the_inside_of_a_corner_has_to_be_clear():
    # The arc passes r·(√2 − 1) = 51.8 m inside the corner at (0, 500): at (36.6, 463.4).
    post = box("post", 36.0, 463.0, 37.0, 464.0)
    found = check(LEGS, [post])
    assert rules(found) == {"clearance"}
    assert {v.row for v in found} == {1}
    assert check(LEGS, [box("post", 60.0, 440.0, 61.0, 441.0)]) == ()  # 33 m farther inside


def test_the_loiter_circle_has_to_be_clear():
    # The circle about (500, 500) reaches east 625.
    found = check(LEGS, [box("mast", 630.0, 499.0, 631.0, 501.0)])
    assert [(v.rule, v.row) for v in found] == [("clearance", 2)]
    assert found[0].value == pytest.approx(5.0, abs=0.15)
    assert check(LEGS, [box("mast", 645.0, 499.0, 646.0, 501.0)]) == ()
    assert check(LEGS, [box("mast", 630.0, 499.0, 631.0, 501.0)], loiter=-250.0) == ()


def test_the_loiter_circle_has_to_lie_inside_the_bounds():
    assert [(v.rule, v.row) for v in check(LEGS, bounds=(-10.0, 624.0, -10.0, 700.0, 0.0, 500.0))] == [
        ("bounds", 2)
    ]
    assert check(LEGS, bounds=(-10.0, 626.0, -10.0, 700.0, 0.0, 500.0)) == ()


@pytest.mark.parametrize("radius", [None, 0.0, 100.0, math.nan, math.inf])
def test_a_loiter_that_cannot_be_flown(radius):
    assert [(v.rule, v.row) for v in check(LEGS, loiter=radius)] == [("ending", 2)]


def test_a_mission_has_to_end_in_a_loiter():
    assert [(v.rule, v.row) for v in check(LEGS, ends=False)] == [("ending", 2)]


@settings(max_examples=100, deadline=None)
@given(
    st.floats(0.2, 1.9), st.sampled_from([-1, 1]), st.floats(-300.0, 300.0), st.floats(0.0, 700.0),
    st.floats(1.0, 60.0), st.floats(0.0, 150.0), st.floats(-60.0, 60.0),
)  # fmt: skip
def test_no_obstacle_on_the_flown_corner_gets_past(turn, side, x, y, size, base, rise):
    points = np.array(
        [
            (0, 0, 100.0),
            (0, 500, 100.0),
            (side * 500 * math.sin(turn), 500 + 500 * math.cos(turn), 100.0 + rise),
        ]
    )
    obstacle = box("b", x, y, x + size, y + size, base, base + 40.0)
    cut = 125.0 * math.tan(0.5 * turn)
    courses = side * np.linspace(0.0, turn, 400)
    arc = np.column_stack(
        [
            side * 125.0 * (1.0 - np.cos(courses)),
            500.0 - cut + side * 125.0 * np.sin(courses),
            np.linspace(100.0, 100.0 + rise * cut / 500.0, 400),
        ]
    )
    legs = np.vstack([np.linspace(points[0], points[1], 300), np.linspace(points[1], points[2], 300)])
    nearest = min(prism_distance(point, obstacle) for point in np.vstack([arc, legs]))
    found = "clearance" in rules(check(points, [obstacle]))
    away_from_loiter = prism_distance(points[2], obstacle) > 250.0
    if nearest < 15.0 - 0.2:
        assert found
    if nearest > 15.0 + 2.0 and away_from_loiter:
        assert not found
