"""The glide with the engine stopped: by hand, by its properties, and against a numerical integration."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from companion.world.vehicle.glide import GlideModel, glide_to, heading_of

MODEL = GlideModel(ratio=10.0, airspeed_m_s=20.0, turn_radius_m=80.0)
STILL = (0.0, 0.0)
angles = st.floats(-math.pi, math.pi)
winds = st.tuples(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0))
places = st.tuples(st.floats(-3_000.0, 3_000.0), st.floats(-3_000.0, 3_000.0))


def test_the_sink_by_hand():
    """20 m/s at 10 to 1 is 2 m/s; in the turn n² = 1 + (400 / (9.80665 · 80))² = 1.260, half induced."""
    assert MODEL.sink_m_s == pytest.approx(2.0)
    sideways = 400.0 / (9.80665 * 80.0)
    assert MODEL.turn_sink_m_s == pytest.approx(2.0 * (1.0 + 0.5 * sideways**2))


def test_in_still_air_the_reach_is_the_ratio_times_the_height():
    assert MODEL.reach_m(130.0, 1.0, STILL) == pytest.approx(1_300.0)
    assert MODEL.reach_m(-5.0, 1.0, STILL) == 0.0


def test_the_reach_in_wind_by_hand():
    """100 m take 50 s. Downwind at 26 m/s 1300 m, upwind at 14 m/s 700 m, across at sqrt(400 - 36) m/s."""
    north = (0.0, 6.0)
    assert MODEL.reach_m(100.0, 0.0, north) == pytest.approx(1_300.0)
    assert MODEL.reach_m(100.0, math.pi, north) == pytest.approx(700.0)
    assert MODEL.reach_m(100.0, 0.5 * math.pi, north) == pytest.approx(50.0 * math.sqrt(364.0))


def test_a_place_straight_ahead_takes_no_turn():
    found = glide_to(MODEL, (0.0, 0.0, 200.0), 0.0, (0.0, 1_000.0), STILL)
    assert found.turned_rad == pytest.approx(0.0, abs=1e-6)
    assert found.lost_m == pytest.approx(100.0)
    assert found.arrival_up_m == pytest.approx(100.0)


def test_a_quarter_turn_by_hand():
    """North, then east: the circle's quarter is 125.66 m, then 920 m are left to a place at 1000 E, 80 N."""
    found = glide_to(MODEL, (0.0, 0.0, 300.0), 0.0, (1_000.0, 80.0), STILL)
    assert found.turned_rad == pytest.approx(0.5 * math.pi)
    assert found.turn_s == pytest.approx(0.5 * math.pi * 80.0 / 20.0)
    assert found.straight_s == pytest.approx(46.0)
    assert found.lost_m == pytest.approx(0.5 * math.pi * 4.0 * MODEL.turn_sink_m_s + 92.0)


def test_upwind_by_hand():
    """1400 m against 6 m/s at 14 m/s over the ground: 100 s, 200 m of height."""
    found = glide_to(MODEL, (0.0, 0.0, 500.0), 0.0, (0.0, 1_400.0), (0.0, -6.0))
    assert found.duration_s == pytest.approx(100.0, abs=1e-3)
    assert found.lost_m == pytest.approx(200.0, abs=1e-2)


def test_a_place_in_the_circle_of_one_turn_is_reached_by_the_other():
    """A place beside the aircraft lies in one of its circles, and the turn the other way leads there."""
    found = glide_to(MODEL, (0.0, 0.0, 300.0), 0.0, (80.0, 0.0), STILL)
    assert found.turned_rad < -math.pi


@pytest.mark.parametrize("wind", [(0.0, 20.0), (25.0, 0.0), (-20.0, -20.0)])
def test_against_a_wind_as_fast_as_the_glide_nothing_is_reached(wind):
    against = (-1_000.0 * wind[0], -1_000.0 * wind[1])
    assert glide_to(MODEL, (0.0, 0.0, 300.0), 0.3, against, wind) is None


@pytest.mark.parametrize(
    "numbers", [(0.0, 20.0, 80.0), (10.0, -1.0, 80.0), (10.0, 20.0, math.nan), (math.inf, 1.0, 1.0)]
)
def test_a_glide_of_impossible_numbers_is_refused(numbers):
    with pytest.raises(ValueError, match="finite and above 0"):
        GlideModel(*numbers)


def integrated(found, step_s=0.01):
    """The end of a glide, by the midpoint rule, from its turn and its durations alone."""
    east, north, up = found.begin_enu_m
    heading, model, wind = found.heading_rad, found.model, found.wind_enu_m_s
    side = math.copysign(1.0, found.turned_rad)
    for span_s, rate, sink in (
        (found.turn_s, side * model.airspeed_m_s / model.turn_radius_m, model.turn_sink_m_s),
        (found.straight_s, 0.0, model.sink_m_s),
    ):
        num = math.ceil(span_s / step_s)
        for _ in range(num):
            step = span_s / num
            middle = heading + 0.5 * rate * step
            east += step * (model.airspeed_m_s * math.sin(middle) + wind[0])
            north += step * (model.airspeed_m_s * math.cos(middle) + wind[1])
            heading += rate * step
            up -= sink * step
    return east, north, up


@given(heading=angles, place=places, wind=winds)
def test_an_integration_of_the_glide_ends_at_the_place(heading, place, wind):
    found = glide_to(MODEL, (10.0, -20.0, 400.0), heading, place, wind)
    assume(found is not None)
    east, north, up = integrated(found, 0.2)
    assert (east, north) == pytest.approx(place, abs=0.5)
    assert up == pytest.approx(found.arrival_up_m, abs=1e-6)
    track = found.track()
    assert track[0] == pytest.approx((10.0, -20.0, 400.0))
    assert track[-1] == pytest.approx((*place, found.arrival_up_m), abs=0.01)
    assert (np.diff(track[:, 2]) <= 1e-9).all()


@given(heading=angles, place=places, wind=winds)
def test_what_is_lost_does_not_depend_on_the_height(heading, place, wind):
    low, high = (glide_to(MODEL, (0.0, 0.0, up), heading, place, wind) for up in (50.0, 300.0))
    assume(low is not None)
    assert high.arrival_up_m - low.arrival_up_m == pytest.approx(250.0)


@given(heading=angles, place=places, wind=winds)
def test_wind_shifts_the_place(heading, place, wind):
    """A glide in wind is one in still air to where the place is, seen from the air, at the arrival."""
    assume(math.hypot(*place) > 4.0 * MODEL.turn_radius_m)  # Nearer, a turn may just begin to contain it.
    found = glide_to(MODEL, (0.0, 0.0, 300.0), heading, place, wind)
    assume(found is not None)
    moved = tuple(value - air * found.duration_s for value, air in zip(place, wind, strict=True))
    still = glide_to(MODEL, (0.0, 0.0, 300.0), heading, moved, STILL)
    assert still.lost_m <= found.lost_m + 0.01
    assert still.track()[-1, :2] == pytest.approx(moved, abs=0.01)


def test_an_aircraft_that_points_at_the_place_flies_no_circle():
    """It lacks a small turn to one side, which in wind depends on the time of arrival."""
    draw = np.random.default_rng(1)
    for _ in range(500):
        course, away, error = (
            draw.uniform(-math.pi, math.pi),
            draw.uniform(400.0, 3_000.0),
            draw.normal(0.0, 0.01),
        )
        wind = tuple(draw.uniform(-4.0, 4.0, 2).tolist())
        place = away * math.sin(course), away * math.cos(course)
        found = glide_to(MODEL, (0.0, 0.0, 500.0), heading_of(course, 20.0, wind) + error, place, wind)
        assert abs(found.turned_rad) < 0.2, (course, away, error, wind)


@given(height=st.floats(0.0, 500.0), more=st.floats(0.0, 500.0), course=angles, wind=winds)
def test_from_higher_it_reaches_farther(height, more, course, wind):
    assert MODEL.reach_m(height + more, course, wind) >= MODEL.reach_m(height, course, wind)


@given(course=angles, wind=winds)
def test_the_heading_and_the_wind_make_the_course(course, wind):
    heading = heading_of(course, 20.0, wind)
    east = 20.0 * math.sin(heading) + wind[0]
    north = 20.0 * math.cos(heading) + wind[1]
    assert math.remainder(math.atan2(east, north) - course, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
