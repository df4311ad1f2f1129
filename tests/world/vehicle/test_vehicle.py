"""The vehicle in kernel form, and the LQG tables."""

import numpy as np
import pytest

from companion.world.vehicle.lqg import NUM_PARTICLES, regulator_gains, uncertainty_tables, with_gusts
from tests.support.worlds import VEHICLE, tables


def test_limits_carry_every_value_over():
    bounds = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    limits = VEHICLE.limits(3, bounds, 12.0, 0.5)
    assert (limits.v_min, limits.v_max, limits.v_cruise, limits.a_max) == (12.5, 37.5, 25.0, 0.5)
    assert (limits.r_min, limits.straight_min, limits.pitch_rate_max) == (125.0, 125.0, 0.1)
    assert (limits.climb_max, limits.descent_max) == pytest.approx((np.radians(10.0), np.radians(10.0)))
    assert (limits.margin, limits.tau, limits.dimension) == (12.0, 0.5, 3)
    assert tuple(limits.bounds) == bounds


def test_tables_hold_the_gain_of_each_entry():
    tables = uncertainty_tables(VEHICLE, 1.0, 3, num_speeds=3, num_rates=3, num_climbs=3)
    speeds, rates, climbs = (axis[0] + axis[1] * np.arange(3) for axis in tables.axes)
    assert speeds == pytest.approx([12.5, 25.0, 37.5])
    assert rates == pytest.approx([-0.3, 0.0, 0.3])
    assert climbs == pytest.approx(np.radians([-10.0, 0.0, 10.0]))
    assert tables.gains[2, 0, 1] == pytest.approx(
        regulator_gains(np.array([[37.5, -0.3, 0.0]]), VEHICLE, 1.0)[0], abs=1e-9
    )
    assert tables.gains.flags.c_contiguous


def test_noise_is_given_as_variances_and_the_plane_has_no_climb_noise():
    flat, space = tables(2), tables(3)
    assert space.process == pytest.approx([0.09, 0.0004, 0.0001])
    assert flat.process == pytest.approx([0.09, 0.0004, 0.0])
    assert space.measurement == pytest.approx([4.0, 4.0, 4.0, np.radians(2.0) ** 2, np.radians(1.0) ** 2])


def test_particles_are_the_same_for_every_planner_and_centred():
    first, second = tables(2), tables(3)
    assert np.array_equal(first.normals, second.normals)
    assert first.normals.shape == (NUM_PARTICLES, 3)
    assert first.normals.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    assert first.normals.std(axis=0) == pytest.approx(np.ones(3), abs=0.3)


def test_wind_makes_turns_wider_and_slopes_flatter_by_hand():
    # 25 + 1.1·10 = 36 m/s banked by 40 degrees: 36² / (9.80665·tan 40°) = 157.5 m.
    assert VEHICLE.turn_radius_in(10.0) == pytest.approx(157.5, abs=0.05)
    assert VEHICLE.turn_radius_in(5.0) == 125.0  # 113 m would do
    assert VEHICLE.turn_radius_in(0.0) == 125.0
    # 25·sin 10° = 4.341 m/s of climb over 24.620 + 11 m/s: 6.95 degrees.
    assert VEHICLE.slope_in(np.radians(10.0), 10.0, 25.0) == pytest.approx(np.radians(6.949), abs=1e-5)
    # 18·sin 10° = 3.126 m/s of climb over 17.727 + 11 m/s: 6.21 degrees. Above cruise it is that at cruise.
    assert VEHICLE.slope_in(np.radians(10.0), 10.0, 18.0) == pytest.approx(np.radians(6.210), abs=1e-5)
    assert VEHICLE.slope_in(np.radians(10.0), 10.0, 36.0) == pytest.approx(np.radians(6.949), abs=1e-5)
    assert VEHICLE.slope_in(0.17, 0.0, 25.0) == 0.17


def test_gusts_add_to_the_process_noise_by_hand():
    # 0.14·10 m/s with a time constant of 260 m / 25 m/s: (1.4 m/s)²·2/10.4 s = 0.3769 m²/s⁴ a step of 1 s.
    gusty = with_gusts(tables(3), VEHICLE, 10.0, 1.0)
    assert gusty.process - tables(3).process == pytest.approx([0.37692, 0.000603, 0.000603], abs=1e-5)
    assert with_gusts(tables(2), VEHICLE, 10.0, 1.0).process[2] == 0.0
    assert with_gusts(tables(3), VEHICLE, 0.0, 1.0).process == pytest.approx(tables(3).process)
