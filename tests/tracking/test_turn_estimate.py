"""The turn rate of an aircraft, beside filterpy's estimator of interacting multiple models."""

import math

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter

from companion.tracking.turn_estimate import (
    ACCELERATION_STD_M_S2,
    KEPT_S,
    RATES_RAD_S,
    VELOCITY_STD_M_S,
    TurnEstimate,
    first_shares,
)

SPEED_M_S = 50.0


def velocities(rates_deg_s, seed, noise_m_s=1.0):
    """Velocities at 1 Hz of an aircraft that turns by these angles from one to the next."""
    courses = np.cumsum(np.radians(rates_deg_s))
    straight = SPEED_M_S * np.column_stack([np.cos(courses), np.sin(courses)])
    return straight + noise_m_s * np.random.default_rng(seed).standard_normal(straight.shape)


def rates_of(seen):
    """What is estimated after each velocity [deg/s]."""
    estimate, found = TurnEstimate(), []
    for stamp, velocity in enumerate(seen):
        estimate.observe(float(stamp), velocity)
        found.append(math.degrees(estimate.rate_rad_s))
    return np.array(found)


@pytest.mark.parametrize("seed", range(3))
def test_it_is_filterpys_estimate(seed):
    seen = velocities([0.0] * 10 + [3.0] * 10, seed)
    count, stays = len(RATES_RAD_S), math.exp(-1.0 / KEPT_S)
    models = []
    for rate in RATES_RAD_S:
        model = KalmanFilter(dim_x=2, dim_z=2)
        model.F = np.array([[np.cos(rate), -np.sin(rate)], [np.sin(rate), np.cos(rate)]])
        model.H, model.x = np.eye(2), seen[0].copy()
        model.R = model.P = VELOCITY_STD_M_S**2 * np.eye(2)
        model.Q = ACCELERATION_STD_M_S2**2 * np.eye(2)
        models.append(model)
    goes_over = stays * np.eye(count) + (1.0 - stays) / count
    theirs = IMMEstimator(models, first_shares(), goes_over)
    expected = [0.0]
    for velocity in seen[1:]:
        theirs.predict()
        theirs.update(velocity)
        expected.append(math.degrees(theirs.mu @ RATES_RAD_S))
    assert rates_of(seen) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_what_flies_straight_is_not_foreseen_to_turn(seed):
    # 0.3°/s for the 30 s that are foreseen bend the way by 9°.
    assert np.abs(rates_of(velocities([0.0] * 60, seed))[5:]).mean() < 0.15


def test_the_first_two_velocities_make_no_turn():
    """Noise of 1 m/s turns the course by 1.6° from one velocity to the next, as a turn of 1.6°/s would."""
    first = [np.abs(rates_of(velocities([0.0] * 5, seed))).max() for seed in range(200)]
    assert np.quantile(first, 0.95) < 0.5
    assert first_shares().sum() == pytest.approx(1.0)


@pytest.mark.parametrize("rate", [-3.0, 3.0])
def test_an_aircraft_that_turns_from_the_first_report_on_is_known_to_turn_after_six(rate):
    assert rates_of(velocities([rate] * 10, 1))[6:].mean() == pytest.approx(rate, rel=0.25)


@pytest.mark.parametrize("rate", [-3.0, 2.5, 4.0])
def test_a_turn_is_known_after_four_reports(rate):
    found = rates_of(velocities([0.0] * 20 + [rate] * 20, 1))
    assert found[23:].mean() == pytest.approx(rate, rel=0.25)
    assert found[23] == pytest.approx(rate, rel=0.4)


def test_a_jump_that_no_aircraft_flies_is_no_turn():
    seen = np.concatenate([np.tile([0.0, SPEED_M_S], (10, 1)), np.tile([-SPEED_M_S, 0.0], (10, 1))])
    assert np.abs(rates_of(seen)).max() < 0.1


def test_an_older_velocity_and_one_after_a_long_silence_say_nothing():
    estimate = TurnEstimate()
    for stamp, velocity in enumerate(velocities([3.0] * 10, 2)):
        estimate.observe(float(stamp), velocity)
    before = estimate.rate_rad_s
    estimate.observe(5.0, np.array([0.0, -SPEED_M_S]))
    assert estimate.rate_rad_s == before
    estimate.observe(100.0, np.array([0.0, SPEED_M_S]))
    assert estimate.rate_rad_s == pytest.approx(0.0)
