"""Glides over ground: a ridge below the way, the ground before a field, circles, and heights of places."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.assurance.surroundings.ground_heights import GroundHeights
from companion.config import mission_from_text
from companion.config.rules import rules_of
from companion.errors import ConfigError
from companion.mission.glide.glide_coverage import coverage_of_legs
from companion.mission.glide.glide_ground import is_circle_over_ground, is_glide_over_ground, is_level
from companion.mission.glide.landing_choice import Begin, LandingPlace, best_field, choice_for, open_ground
from companion.world.vehicle.glide import GlideModel, glide_to
from tests.ground.maps import posts_over
from tests.mission.glide.worlds_for_glides import glide_text, options_of

MODEL = GlideModel(ratio=10.0, airspeed_m_s=20.0, turn_radius_m=60.0)
BOUNDS = (-500.0, 2_500.0, -500.0, 2_500.0)
NORTH = 0.0


def ground_of(height):
    """Ground with posts 10 m apart."""
    return GroundHeights(posts_over(height, spacing=10.0, bounds=BOUNDS), 50.0, math.inf)


def ridge(top_m, at_m, half_width_m=50.0):
    """A ridge across the way north: a roof with its top at a distance."""
    return lambda east, north: 0.0 * east + np.maximum(0.0, top_m * (1.0 - abs(north - at_m) / half_width_m))


def straight(up_m, length_m=1_000.0):
    """A glide straight north, which loses a tenth of its length."""
    return glide_to(MODEL, (0.0, 0.0, up_m), NORTH, (0.0, length_m), (0.0, 0.0))


@pytest.mark.parametrize(("top_m", "is_over"), [(40.0, True), (56.0, False), (90.0, False)])
def test_a_ridge_below_the_way_needs_the_margin(top_m, is_over):
    """The glide from 100 m to 0 m is 80 m up over the ridge 200 m away: 25 m are kept, so 55 m may stand."""
    ground = ground_of(ridge(top_m, 200.0))
    assert is_glide_over_ground(ground, straight(100.0), 0.0, 50.0, 25.0) is is_over


def test_what_has_been_lost_is_an_unsure_height():
    """Over the ridge 500 m away 50 m of 200 m are lost, and 35 m are left: 15 % are 7.5 m, 80 % are 40 m."""
    ground, glide = ground_of(ridge(115.0, 500.0)), straight(200.0, 1_500.0)
    assert is_glide_over_ground(ground, glide, 50.0, 50.0, 25.0, 0.15)
    assert not is_glide_over_ground(ground, glide, 50.0, 50.0, 25.0, 0.8)


@pytest.mark.parametrize(("slope", "is_over"), [(0.04, True), (0.06, False)])
def test_before_the_field_the_ground_may_rise_half_as_steeply_as_the_glide_sinks(slope, is_over):
    """The ground sinks towards the field, which lies 1,000 m away at 0 m; the glide sinks 0.1."""
    ground = ground_of(lambda east, north: 0.0 * east + slope * np.maximum(0.0, 1_000.0 - north))
    assert is_glide_over_ground(ground, straight(100.0), 0.0, 50.0, 60.0) is is_over


def test_the_field_itself_and_what_lies_beyond_the_final_do_not_count():
    bump = ground_of(ridge(6.0, 980.0, 15.0))
    assert is_glide_over_ground(bump, straight(100.0), 0.0, 50.0, 25.0)
    assert not is_glide_over_ground(bump, straight(100.0), 0.0, 1.0, 25.0)
    late = ground_of(ridge(30.0, 900.0))
    assert not is_glide_over_ground(late, straight(100.0), 0.0, 50.0, 25.0)
    assert is_glide_over_ground(late, straight(60.0), 0.0, 50.0, 25.0), (
        "lower than the place before the ridge"
    )


def test_a_glide_that_begins_low_keeps_what_it_has():
    """It begins 12 m over a plain that sinks faster than the glide does."""
    ground = ground_of(lambda east, north: 0.0 * east - 0.12 * north)
    glide = straight(12.0, 300.0)
    assert is_glide_over_ground(ground, glide, -36.0, 50.0, 25.0)


def test_circles_and_finals_keep_half_of_their_height():
    """The circle is 20 m over the field, 200 m before it; a bank of 15 m lies between or elsewhere."""
    angles = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    circle = np.column_stack([60.0 * np.sin(angles), 60.0 * np.cos(angles), np.full(24, 20.0)])
    place = (0.0, 200.0, 0.0)
    assert is_circle_over_ground(ground_of(lambda east, north: 0.0 * east), circle, place, 50.0)
    assert not is_circle_over_ground(ground_of(ridge(15.0, 100.0)), circle, place, 50.0)
    assert is_circle_over_ground(ground_of(ridge(15.0, 400.0)), circle, place, 50.0)


def test_level_ground():
    """At 60 m a slope of 0.09 is 10.8 m over 120 m, one of 0.11 13.2 m."""
    for slope, is_flat in ((0.09, True), (0.11, False)):
        ground = ground_of(lambda east, north, slope=slope: slope * east + 0.0 * north)
        assert is_level(ground, (500.0, 500.0, 500.0 * slope), 60.0) is is_flat


# --- choices


def options_over(height):
    """The meadow 1,000 m east of a plain mission, over ground; home is far away."""
    ground = ground_of(height)
    options = options_of()
    meadow = next(place for place in options.places if place.name == "meadow")
    up_m = float(ground.up_m(np.array([meadow.position_enu_m[:2]]))[0])
    places = (meadow._replace(position_enu_m=(*meadow.position_enu_m[:2], up_m)),)
    return replace(options, places=places, ground=ground)


def across(top_m, at_m, half_width_m=50.0):
    """A ridge across the way east."""
    return lambda east, north: ridge(top_m, at_m, half_width_m)(north, east)


def test_a_field_behind_a_ridge_is_not_within_reach():
    begin = Begin((0.0, 0.0, 150.0), 0.5 * math.pi, (0.0, 0.0))
    low, high = options_over(across(60.0, 500.0)), options_over(across(90.0, 500.0))
    assert best_field(low, begin).place.name == "meadow"
    assert best_field(high, begin) is None
    flat = replace(high, ground=None)
    assert best_field(flat, begin).place.name == "meadow", "flat ground hides the ridge"


def test_a_field_on_high_ground_needs_the_height():
    """At 150 m the glide of 1,000 m arrives at 50 m: a field 40 m up is within reach, one 60 m up is not."""
    begin = Begin((0.0, 0.0, 150.0), 0.5 * math.pi, (0.0, 0.0))
    for up_m, is_reached in ((40.0, True), (60.0, False)):
        step = options_over(
            lambda east, north, up_m=up_m: 0.0 * north + up_m * np.clip((east - 500) / 300, 0, 1)
        )
        found = choice_for(step, begin, step.places[0])
        assert (found is not None) is is_reached
        if found is not None:
            assert found.spare_m == pytest.approx(10.0, abs=0.5)


def test_coverage_ends_where_the_ridge_comes_between():
    """From the east side of the ridge the meadow is near; on the west side it is behind the ridge."""
    options = options_over(across(120.0, 400.0))
    legs = coverage_of_legs(options, [(-400.0, 0.0, 150.0), (1_000.0, 0.0, 150.0)], 20.0, (0.0, 0.0))
    assert legs.fields[0] is None
    assert legs.fields[-1] == "meadow"
    flat = coverage_of_legs(
        replace(options, ground=None), [(-400.0, 0.0, 150.0), (1_000.0, 0.0, 150.0)], 20.0, (0.0, 0.0)
    )
    assert flat.without_s < legs.without_s


def test_open_ground_is_level_where_there_is_any():
    """The ground is a steep slope east of 200 m, and level west of it."""
    options = options_over(lambda east, north: 0.0 * north + 0.3 * np.maximum(0.0, east - 200.0))
    found = open_ground(replace(options, places=()), Begin((150.0, 0.0, 120.0), 0.5 * math.pi, (0.0, 0.0)))
    east, _, up = found.place.position_enu_m
    assert up == pytest.approx(0.3 * max(0.0, east - 200.0), abs=0.1)
    assert is_level(options.ground, found.place.position_enu_m, 60.0)


# --- mission files

TERRAIN = "terrain: {generated: {kind: hills, seed: 3, relief_m: 30}}\n"
FIELD = "fields: [{name: meadow, east_m: 1000, north_m: 0, radius_m: 80}]"


def over_hills(fields=FIELD):
    return mission_from_text(glide_text(fields, TERRAIN).replace("dimension: 2", "dimension: 3"), "m.yaml")


def test_heights_of_fields_home_and_rally_points_come_from_the_map():
    mission = over_hills()
    options = rules_of(mission).glide_options(None, ((300.0, -400.0, 90.0),))
    places = {place.name: place.position_enu_m for place in options.places}
    at = np.array([places[name][:2] for name in ("meadow", "home", "rally 1")])
    heights = options.ground.up_m(at)
    assert [places[name][2] for name in ("meadow", "home", "rally 1")] == pytest.approx(list(heights))
    assert len(set(heights.round(1))) == 3
    told = rules_of(mission).glide_options((0.0, 0.0, 12.0))
    assert LandingPlace("home", (0.0, 0.0, 12.0), 60.0) in told.places, "home's own height is measured"


@pytest.mark.parametrize(
    ("make", "key", "expected"),
    [
        (lambda: mission_from_text(glide_text(FIELD), "m.yaml"), "glide.fields.0.up_m", "a height, since"),
        (lambda: over_hills(FIELD.replace("m: 0,", "m: 0, up_m: 0,")), "glide.fields.0.up_m", "left out"),
        (lambda: over_hills(FIELD.replace("1000", "7000")), "glide.fields.0.east_m", "within bounds.east_m"),
    ],
)  # fmt: skip
def test_a_height_is_given_where_no_map_has_it_and_only_there(make, key, expected):
    with pytest.raises(ConfigError) as caught:
        make()
    assert str(caught.value.key) == key
    assert expected in caught.value.expected
