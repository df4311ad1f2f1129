"""The field that is chosen, the circle before it, and open ground without any."""

import math

import numpy as np
import pytest
import shapely

from companion.mission.glide.glide_progress import (
    begin_of,
    best_place,
    circle_is_due,
    final_is_due,
    from_now,
    is_kept,
    is_past,
)
from companion.mission.glide.landing_choice import Begin, best_field, choices, circle_radius_m, open_ground
from companion.types.state import Ownship
from tests.mission.glide.worlds_for_glides import FIELDS, WALL, options_of

EAST = 0.5 * math.pi
TWO = (
    "fields: [{name: meadow, east_m: 1000, north_m: 0, up_m: 0, radius_m: 80},"
    " {name: strip, east_m: 900, north_m: 900, up_m: 30, radius_m: 60}]"
)
BESIDE = """obstacles:
  - {name: wall, polygon_enu_m: [[-400, 50], [400, 50], [400, 90], [-400, 90]], base_m: 0, top_m: 400}
"""
INSIDE = """obstacles:
  - {name: wall, polygon_enu_m: [[45, -200], [400, -200], [400, -15], [45, -15]], base_m: 0, top_m: 400}
"""
PEOPLE = "people: [{name: village, polygon_enu_m: [[-900, -300], [900, -300], [900, -2000], [-900, -2000]]}]"


def at(up, heading=EAST, place=(0.0, 0.0), wind=(0.0, 0.0)):
    return Begin((*place, float(up)), heading, wind)


def test_straight_ahead_the_height_left_is_the_height_less_a_tenth_of_the_way():
    found = best_field(options_of(), at(200.0))
    assert found.place.name == "meadow"
    assert found.spare_m == pytest.approx(100.0)
    assert found.away_m == pytest.approx(1_000.0)


@pytest.mark.parametrize(("up", "is_reached"), [(99.0, False), (101.0, True)])
def test_a_field_is_within_reach_down_to_its_ground(up, is_reached):
    assert (best_field(options_of(), at(up)) is not None) is is_reached


def test_the_field_with_most_height_left_comes_first():
    """The strip is 1273 m away and 30 m up: 100 m are left over the meadow, about 40 over the strip."""
    found = list(choices(options_of(TWO), at(200.0)))
    assert [choice.place.name for choice in found] == ["meadow", "strip"]
    assert found[0].spare_m > found[1].spare_m


def test_home_and_rally_points_are_fields_on_homes_ground():
    options = options_of("", home=(0.0, 800.0, 12.0), rally=((0.0, -600.0, 150.0),))
    assert [(place.name, place.position_enu_m) for place in options.places] == [
        ("home", (0.0, 800.0, 12.0)),
        ("rally 1", (0.0, -600.0, 12.0)),
    ]


def test_a_wall_in_the_way_hides_the_field():
    assert best_field(options_of(extra=WALL), at(290.0)) is None
    assert best_field(options_of(extra=WALL), at(290.0, place=(470.0, 0.0))) is not None


def test_no_wall_is_passed_that_a_little_more_sink_would_not_pass():
    """Over a wall of 100 m, 300 m ahead, the model says 170 - 30: with 15 % more loss it is 25 m or less."""
    low = WALL.replace("top_m: 300", "top_m: 100")
    assert best_field(options_of(extra=low), at(163.0)) is None
    assert best_field(options_of(extra=low), at(180.0)) is not None


def test_the_circle_lies_downwind_and_so_far_that_no_turn_on_it_contains_the_field():
    wind = (0.0, -5.0)
    found = best_field(options_of(), at(290.0, wind=wind))
    east, north, _ = found.approach.centre_enu_m
    assert (east, north) == pytest.approx((1_000.0, -3.3 * found.approach.radius_m))
    assert found.approach.radius_m == pytest.approx(circle_radius_m(options_of().model, wind))
    assert found.approach.radius_m == pytest.approx(
        25.0**2 / (9.80665 * math.tan(math.radians(40.0))), rel=0.3
    )


def test_circles_keep_clear_of_walls():
    near = "fields: [{name: meadow, east_m: 640, north_m: 0, up_m: 0, radius_m: 80}]"
    options = options_of(near, extra=WALL)
    wall = shapely.box(400, -600, 440, 600)
    found = options.approaches(options.places[0], (0.0, 0.0))
    assert 0 < len(found) < 12
    for approach in found:
        circle = shapely.Point(approach.centre_enu_m[:2]).buffer(approach.radius_m)
        assert circle.distance(wall) >= 24.0


def test_a_field_among_people_is_none():
    options = options_of(f"{FIELDS}\n  {PEOPLE}", home=(0.0, -500.0, 0.0))
    assert [place.name for place in options.allowed] == ["meadow"]
    near = options_of(f"{FIELDS}\n  {PEOPLE}", home=(0.0, -250.0, 0.0))
    assert [place.name for place in near.allowed] == ["meadow"]  # Home's circle reaches into the village.
    assert "home" in [place.name for place in options_of(FIELDS, home=(0.0, -250.0, 0.0)).allowed]


def test_open_ground_keeps_away_from_people_and_walls():
    options = options_of(PEOPLE, extra=WALL)
    found = open_ground(options, at(150.0, heading=math.pi))
    place = shapely.Point(found.place.position_enu_m[:2])
    assert found.place.name == "open ground"
    assert shapely.box(-900, -2000, 900, -300).distance(place) > 100.0
    assert shapely.box(400, -600, 440, 600).distance(place) > 100.0
    assert found.spare_m >= 0.0


def own(up, speed=20.0, wind=(0.0, 0.0)):
    return Ownship(0.0, (0.0, 0.0, up), EAST, 0.0, speed, speed + wind[0], wind)


def test_a_slow_aircraft_gives_up_height_for_airspeed():
    """From 10 to 20 m/s: (400 - 100) / (2 · 9.80665) = 15.3 m."""
    assert begin_of(options_of(), own(200.0, 10.0)).position_enu_m[2] == pytest.approx(
        200.0 - 15.296, abs=0.01
    )
    assert begin_of(options_of(), own(200.0, 30.0)).position_enu_m[2] == 200.0


def test_the_heading_is_that_through_the_air():
    begin = begin_of(options_of(), Ownship(0.0, (0.0, 0.0, 200.0), EAST, 0.0, 20.0, 20.0, (0.0, 6.0)))
    assert begin.heading_rad == pytest.approx(math.atan2(20.0, -6.0))


def test_the_final_is_due_when_no_height_is_left_and_not_before():
    options = options_of()
    found = best_field(options, at(200.0))
    assert not final_is_due(options, found, at(197.0, place=(30.0, 0.0)))
    assert final_is_due(options, from_now(options, at(101.0), found), at(98.0, place=(30.0, 0.0)))


def test_a_final_waits_while_either_turn_to_the_field_meets_a_wall():
    """The field is behind, so that the autopilot may turn to either side, and the wall is on one."""
    options, begin = options_of(extra=BESIDE), at(112.0, heading=-EAST)
    found = from_now(options, begin, best_field(options_of(), at(200.0)))
    assert not final_is_due(options, found, begin)
    assert final_is_due(options_of(), found, begin)
    assert final_is_due(options, found, begin._replace(heading_rad=-0.5 * math.pi - 1.0))  # To the left.


def test_no_field_is_chosen_if_the_autopilot_may_turn_into_a_wall_on_the_way():
    options = options_of(extra=BESIDE)
    assert best_field(options_of(), at(300.0, heading=-EAST)).place.name == "meadow"
    assert best_field(options, at(300.0, heading=-EAST)) is None
    assert best_field(options, at(300.0, heading=-0.5 * math.pi - 1.0)).to_circle.turned_rad < 0.0


def test_a_final_that_is_too_high_goes_back_to_the_circle_while_the_field_is_far():
    options = options_of()
    found = best_field(options, at(200.0))
    high = from_now(options, at(80.0, place=(700.0, 0.0)), found)
    assert circle_is_due(options, high)
    assert not circle_is_due(options, from_now(options, at(80.0, place=(950.0, 0.0)), found))
    assert not circle_is_due(options, from_now(options, at(32.0, place=(700.0, 0.0)), found))


def test_no_field_is_chosen_if_a_turn_that_begins_earlier_meets_a_wall():
    """The wall lies on the inside of the turn: an autopilot that turns at once, and tightly, meets it."""
    options = options_of(extra=INSIDE)
    later = at(300.0, heading=0.0, place=(0.0, 0.0))
    sooner = later._replace(position_enu_m=(0.0, -60.0, 300.0))
    assert best_field(options, later).place.name == "meadow"
    assert best_field(options, later._replace(earliest=sooner)) is None
    assert best_field(options_of(), later._replace(earliest=sooner)).place.name == "meadow"


def test_a_final_is_flown_on_if_the_way_by_the_circle_would_end_farther_from_the_field():
    """5 m too high, it would pass the middle by 50 m; a turn to the circle and back takes more height."""
    options = options_of()
    found = best_field(options, at(200.0))
    assert not circle_is_due(options, from_now(options, at(35.0, place=(700.0, 0.0)), found))
    within = at(80.0, place=found.approach.centre_enu_m[:2])
    assert not circle_is_due(options, from_now(options, within, found))


def test_behind_the_aircraft_the_field_is_past():
    options = options_of()
    found = best_field(options, at(200.0))
    assert is_past(from_now(options, at(20.0, place=(1_050.0, 0.0)), found))
    assert not is_past(from_now(options, at(20.0, place=(950.0, 0.0)), found))
    assert not is_past(from_now(options, at(3.0, place=(1_050.0, 0.0)), found))


def test_a_field_out_of_reach_is_given_up_for_another():
    options = options_of(TWO)
    first, second = choices(options, at(200.0))
    sunk = at(75.0, heading=0.0, place=(900.0, 600.0))
    assert is_kept(options, from_now(options, at(150.0), first))
    strip = second._replace(place=second.place)
    assert best_place(options, sunk, from_now(options, sunk, strip)).place.name == "strip"
    assert best_place(options, at(150.0), None).place.name == "meadow"
    lost = from_now(options, at(70.0, place=(-500.0, 0.0)), first)
    assert not is_kept(options, lost)
    assert best_place(options, at(70.0, place=(-500.0, 0.0)), lost).place.name == "open ground"


def test_open_ground_is_left_for_a_field_that_comes_within_reach():
    options = options_of()
    begin = at(150.0, place=(-1_000.0, 0.0))
    ground = open_ground(options, begin)
    assert best_place(options, begin, ground).place.name == "open ground"
    nearer = at(150.0)
    assert best_place(options, nearer, from_now(options, nearer, ground)).place.name == "meadow"


def test_a_glide_keeps_its_heights_above_the_ground():
    found = best_field(options_of(), at(105.0))
    assert (found.to_circle.track(0.0)[:, 2] >= 0.0).all()
    assert np.isfinite(found.to_circle.track(0.0)).all()
