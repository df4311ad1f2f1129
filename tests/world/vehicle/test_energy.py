"""The model of power: numbers worked by hand, what holds for every aircraft, and a flight integrated anew."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.types.path import Path
from companion.world.vehicle.energy import AIRSPEED_MIN_M_S, PowerModel, level_power_range
from companion.world.vehicle.vehicle_model import VehicleModel

# a·v³ = 250 W and b/v = 150 W at 25 m/s.
MODEL = PowerModel(0.016, 3_750.0, 100.0)
VEHICLE = VehicleModel()
G = 9.80665

COEFFICIENTS = st.tuples(st.floats(1e-4, 1.0), st.floats(1.0, 1e5), st.floats(0.0, 1e4))
models = COEFFICIENTS.map(lambda numbers: PowerModel(*numbers))
airspeeds = st.floats(5.0, 60.0)


def path_of(times, places, speeds, courses=None, climbs=None, wind=(0.0, 0.0)):
    number = len(times)
    zeros = np.zeros(number)
    return Path(
        np.array(times, dtype=float), np.array(places, dtype=float),
        zeros if courses is None else np.array(courses, dtype=float),
        zeros if climbs is None else np.array(climbs, dtype=float),
        np.array(speeds, dtype=float), np.zeros((number, 3, 3)), zeros + 1.0, zeros, wind,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("flight", "power_w"),
    [
        ((25.0,), 400.0),
        ((50.0,), 2_000.0 + 75.0),
        ((25.0, 2.0), 600.0),
        ((25.0, -2.0), 200.0),
        ((25.0, 0.0, math.radians(60.0)), 250.0 + 4.0 * 150.0),  # Load factor 2.
        ((25.0, 0.0, -math.radians(60.0)), 250.0 + 4.0 * 150.0),
        ((25.0, -5.0), 0.0),  # The motor is off, and gives nothing back.
        ((0.0,), 0.016 + 3_750.0),
    ],
)
def test_powers_worked_by_hand(flight, power_w):
    assert MODEL.power_w(*flight) == pytest.approx(power_w)


def test_two_measured_powers_give_the_drags():
    found = PowerModel.from_level_flight((25.0, 400.0), (50.0, 2_075.0), 100.0)
    assert (found.parasite_w_s3_m3, found.induced_w_m_s) == pytest.approx((0.016, 3_750.0))


@given(models, airspeeds, st.floats(1.05, 3.0))
def test_any_two_powers_of_a_model_give_the_model_again(model, airspeed, ratio):
    faster = ratio * airspeed
    powers = [(speed, model.power_w(speed)) for speed in (airspeed, faster)]
    again = PowerModel.from_level_flight(*powers, model.climb_j_m)
    middle = 0.5 * (airspeed + faster)
    assert again.power_w(middle) == pytest.approx(model.power_w(middle), rel=1e-6)
    low, high = level_power_range(*powers[0], faster)
    assert low <= powers[1][1] <= high


@given(st.floats(10.0, 1e4), airspeeds, st.floats(1.05, 3.0), st.floats(0.01, 2.0))
def test_the_range_of_the_second_power_is_what_drags_of_at_least_zero_allow(power, airspeed, ratio, beyond):
    low, high = level_power_range(airspeed, power, ratio * airspeed)
    for wrong in (low / (1.0 + beyond), high * (1.0 + beyond)):
        with pytest.raises(ValueError, match="from zero up"):
            PowerModel.from_level_flight((airspeed, power), (ratio * airspeed, wrong), 0.0)


@pytest.mark.parametrize(
    "numbers", [(-1e-9, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, -1.0), (math.nan, 1.0, 1.0)]
)
def test_numbers_that_no_aircraft_has_are_refused(numbers):
    with pytest.raises(ValueError, match="from zero up"):
        PowerModel(*numbers)
    with pytest.raises(ValueError, match="from zero up"):
        PowerModel(math.inf, 1.0, 1.0)


def test_one_airspeed_tells_no_drags_apart():
    with pytest.raises(ValueError, match="two different airspeeds"):
        PowerModel.from_level_flight((25.0, 400.0), (25.0, 400.0), 0.0)


@given(models, airspeeds, st.floats(0.1, 30.0))
def test_faster_than_best_endurance_more_is_more_and_slower_less_is_more(model, airspeed, more):
    best = (model.induced_w_m_s / (3.0 * model.parasite_w_s3_m3)) ** 0.25
    slower, faster = sorted((airspeed, airspeed + more))
    if slower >= best:
        assert model.power_w(faster) > model.power_w(slower)
    if slower >= AIRSPEED_MIN_M_S and faster <= best:
        assert model.power_w(faster) < model.power_w(slower)
    assert model.power_w(airspeed) >= model.power_w(best) * (1.0 - 1e-12)


@given(
    models, airspeeds, st.floats(-20.0, 20.0), st.floats(0.0, 20.0), st.floats(0.0, 1.2), st.floats(0.0, 1.2)
)
def test_climbing_and_banking_more_never_takes_less(model, airspeed, climb, more, bank, further):
    power = model.power_w(airspeed, climb, bank)
    assert power >= 0.0
    assert model.power_w(airspeed, climb + more, bank) >= power
    assert model.power_w(airspeed, climb, -bank - further) >= power


def test_a_straight_level_path_takes_its_power_times_its_time():
    path = path_of([0.0, 4.0, 10.0], [(0, 0, 50), (0, 100, 50), (0, 250, 50)], [25.0] * 3)
    assert MODEL.energy_j(path) == pytest.approx(4_000.0)
    assert MODEL.energy_j(path.until(0)) == 0.0


def test_a_climb_and_a_gain_of_speed_are_paid_once():
    climb = path_of([0.0, 10.0], [(0, 0, 50), (0, 250, 70)], [25.0, 25.0])
    assert MODEL.energy_j(climb) == pytest.approx(4_000.0 + 2_000.0)
    faster = path_of([0.0, 10.0], [(0, 0, 50), (0, 250, 50)], [20.0, 30.0])
    gained_m = (30.0**2 - 20.0**2) / (2.0 * G)
    assert MODEL.energy_j(faster) == pytest.approx(4_000.0 + 100.0 * gained_m)


def test_a_steep_descent_gives_nothing_back():
    down = path_of([0.0, 10.0, 20.0], [(0, 0, 200), (0, 250, 50), (0, 500, 50)], [25.0] * 3)
    assert MODEL.energy_j(down) == pytest.approx(4_000.0)


@given(
    airspeed=st.floats(14.0, 36.0), radius=st.floats(80.0, 500.0), climb=st.floats(-1.0, 3.0),
    wind=st.floats(0.0, 8.0), wind_to=st.floats(0.0, 2.0 * math.pi), clockwise=st.booleans(),
)  # fmt: skip
def test_a_circle_through_the_air_takes_what_its_forces_say(
    airspeed, radius, climb, wind, wind_to, clockwise
):
    """The oracle knows nothing of headings or banks: it differentiates the motion through the air twice."""
    step = 0.05
    times = np.arange(0.0, 20.0, step)
    turn = (1.0 if clockwise else -1.0) * airspeed / radius
    heading = 0.3 + turn * times
    blowing = (wind * math.sin(wind_to), wind * math.cos(wind_to))
    velocity = np.column_stack(
        [airspeed * np.sin(heading) + blowing[0], airspeed * np.cos(heading) + blowing[1]]
    )
    flat = np.column_stack(
        [
            -airspeed / turn * np.cos(heading) + blowing[0] * times,
            airspeed / turn * np.sin(heading) + blowing[1] * times,
        ]
    )
    places = np.column_stack([flat, 100.0 + climb * times])
    courses = np.arctan2(velocity[:, 0], velocity[:, 1]) % (2.0 * math.pi)
    path = path_of(times, places, np.full(len(times), airspeed), courses, wind=blowing)
    through_air = flat - np.outer(times, blowing)
    moving = np.gradient(through_air, step, axis=0)
    speeding = np.gradient(moving, step, axis=0)
    sideways = np.abs(moving[:, 0] * speeding[:, 1] - moving[:, 1] * speeding[:, 0]) / airspeed
    lift_per_weight_squared = 1.0 + (sideways[4:-4].mean() / G) ** 2
    power = 0.016 * airspeed**3 + 3_750.0 / airspeed * lift_per_weight_squared + 100.0 * climb
    assert MODEL.energy_j(path) == pytest.approx(max(power, 0.0) * (times[-1] - times[0]), rel=2e-3, abs=1.0)


def test_a_course_that_passes_north_is_no_turn():
    courses = [0.05, 2.0 * math.pi - 0.05]
    path = path_of([0.0, 10.0], [(0, 0, 50), (0, 250, 50)], [25.0, 25.0], courses)
    assert MODEL.energy_j(path) == pytest.approx(4_000.0, rel=1e-3)


def test_a_corner_counts_as_the_steepest_bank_and_no_more():
    path = path_of([0.0, 1e-6], [(0, 0, 50), (0, 0, 50)], [25.0, 25.0], [0.0, 1.0])
    assert 0.0 < MODEL.energy_j(path) < 0.01


@pytest.mark.parametrize(
    ("end", "wind", "energy_j"),
    [
        ((1_000.0, 0.0, 100.0), (0.0, 0.0), 400.0 * 40.0),
        ((1_000.0, 0.0, 100.0), (5.0, 0.0), 400.0 * 1_000.0 / 30.0),
        ((1_000.0, 0.0, 100.0), (-5.0, 0.0), 400.0 * 50.0),
        ((1_000.0, 0.0, 100.0), (0.0, 15.0), 400.0 * 50.0),  # A 3-4-5 triangle: 20 m/s are made good.
        ((0.0, 0.0, 100.0), (0.0, 0.0), 0.0),
        # Straight up by 100 m, in a climb of 10 degrees: 23.04 s at 4.34 m/s.
        ((0.0, 0.0, 200.0), (0.0, 0.0), 400.0 * 100.0 / (25.0 * math.sin(math.radians(10.0))) + 10_000.0),
        # A descent that gives back more than its flight takes.
        ((400.0, 0.0, -1_000.0), (0.0, 0.0), 0.0),
    ],
)
def test_straight_legs_worked_by_hand(end, wind, energy_j):
    assert MODEL.leg_energy_j((0.0, 0.0, 100.0), end, VEHICLE, wind) == pytest.approx(energy_j, rel=1e-9)


@given(st.floats(-3_000.0, 3_000.0), st.floats(-3_000.0, 3_000.0), st.floats(-8.0, 8.0), st.floats(-8.0, 8.0))
def test_wind_never_helps_there_and_back(east, north, wind_east, wind_north):
    here, there = (0.0, 0.0, 100.0), (east, north, 100.0)

    def both_ways(wind):
        legs = (MODEL.leg_energy_j(*leg, VEHICLE, wind) for leg in ((here, there), (there, here)))
        return sum(legs)

    assert both_ways((wind_east, wind_north)) >= both_ways((0.0, 0.0)) * (1.0 - 1e-9)


@given(st.floats(0.0, 60.0))
def test_a_slope_that_can_be_flown_costs_its_height_and_little_more(up):
    """The longest detour of a slope of ten degrees is 1.5 percent of the way."""
    climbed = MODEL.leg_energy_j((0.0, 0.0, 0.0), (600.0, 0.0, up), VEHICLE, (0.0, 0.0))
    level = 400.0 * 600.0 / 25.0
    assert level + 100.0 * up <= climbed * (1.0 + 1e-9)
    assert climbed <= 1.016 * level + 100.0 * up


def test_a_faster_cruise_is_another_power():
    fast = replace(VEHICLE, airspeed_cruise_m_s=50.0)
    assert MODEL.leg_energy_j((0.0, 0.0, 0.0), (1_000.0, 0.0, 0.0), fast, (0.0, 0.0)) == pytest.approx(
        2_075.0 * 20.0
    )
