from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from companion.tracking.particle_filter import (
    FilterSettings,
    ParticleFilter,
    UpdateResult,
    process_noise,
    transition,
)

SETTINGS = FilterSettings(acceleration_std_m_s2=1.0, velocity_std_m_s=1.0)


def started(stamp_s=0.0, position=(0.0, 0.0), std=5.0, velocity=(10.0, 0.0), seed=1, settings=SETTINGS):
    return ParticleFilter(
        stamp_s=stamp_s,
        position_m=np.array(position),
        position_std_m=std,
        velocity_m_s=None if velocity is None else np.array(velocity),
        speed_max_m_s=25.0,
        settings=settings,
        generator=np.random.default_rng(seed),
    )


def kalman_step(mean, covariance, elapsed_s, position, std, acceleration_std=1.0):
    """The exact answer for this linear, Gaussian problem, written out apart from the filter."""
    f = np.kron(np.eye(2), [[1.0, elapsed_s], [0.0, 1.0]])
    q = acceleration_std**2 * np.kron(
        np.eye(2), [[elapsed_s**3 / 3, elapsed_s**2 / 2], [elapsed_s**2 / 2, elapsed_s]]
    )
    h = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]])
    mean, covariance = f @ mean, f @ covariance @ f.T + q
    gain = covariance @ h.T @ np.linalg.inv(h @ covariance @ h.T + std**2 * np.eye(2))
    return mean + gain @ (position - h @ mean), (np.eye(4) - gain @ h) @ covariance


def test_process_noise_by_hand():
    # σ = 2, τ = 3 s: 4·27/3 = 36 m², 4·9/2 = 18 m²/s, 4·3 = 12 m²/s².
    noise = process_noise(3.0, 2.0)
    assert noise[:2, :2] == pytest.approx(np.array([[36.0, 18.0], [18.0, 12.0]]))
    assert noise[:2, 2:] == pytest.approx(np.zeros((2, 2)))


def test_after_the_papers_step_the_velocity_variance_is_the_papers():
    assert process_noise(1.0, 3.0)[1, 1] == pytest.approx(9.0)


@given(st.floats(0.01, 30.0), st.floats(0.01, 30.0))
def test_steps_add_up(first_s, second_s):
    step = transition(second_s)
    in_two = step @ process_noise(first_s, 1.5) @ step.T + process_noise(second_s, 1.5)
    assert in_two == pytest.approx(process_noise(first_s + second_s, 1.5), rel=1e-9)


def test_retrodiction_undoes_the_transition():
    assert transition(-2.0) @ transition(2.0) == pytest.approx(np.eye(4))
    assert process_noise(-2.0, 1.0)[0, 1] == pytest.approx(-process_noise(2.0, 1.0)[0, 1])
    assert np.linalg.eigvalsh(process_noise(-2.0, 1.0)).min() > 0.0


def test_a_missing_observation_coasts_with_growing_spread():
    cloud = started()
    mean, covariance = cloud.moments(20.0)
    expected = transition(20.0) @ cloud.mean
    assert mean == pytest.approx(expected)
    assert mean[0] == pytest.approx(200.0, abs=5.0)
    # 25 + 20² + 20³/3 = 3,092 m², of 500 particles.
    assert covariance[0, 0] == pytest.approx(3092.0, rel=0.15)
    assert cloud.moments(40.0)[1][0, 0] > covariance[0, 0]


def test_asking_for_moments_changes_nothing():
    cloud, other = started(), started()
    cloud.moments(50.0)
    for each in (cloud, other):
        each.observe(1.0, np.array([10.0, 0.0]), 5.0)
    assert np.array_equal(cloud.mean, other.mean)


def test_the_velocity_is_unknown_up_to_the_speed_limit_when_none_is_reported():
    cloud = started(velocity=None, settings=FilterSettings(num_particles=4000))
    # A disc of radius 25 m/s, evenly filled, has a variance of 25²/4 along each axis.
    assert cloud.mean[[1, 3]] == pytest.approx([0.0, 0.0], abs=1.0)
    assert np.diag(cloud.covariance)[[1, 3]] == pytest.approx([156.25, 156.25], rel=0.1)


def test_it_agrees_with_the_kalman_filter_at_irregular_times():
    many = FilterSettings(num_particles=4000, acceleration_std_m_s2=1.0, velocity_std_m_s=1.0)
    cloud = started(settings=many)
    mean, covariance = np.array([0.0, 10.0, 0.0, 0.0]), np.diag([25.0, 1.0, 25.0, 1.0])
    stamp = 0.0
    for elapsed, position in (
        (0.4, (6, 1)),
        (3.0, (30, -4)),
        (0.1, (38, 0)),
        (9.0, (110, 25)),
        (1.0, (125, 30)),
    ):
        stamp += elapsed
        observed = np.array(position, dtype=float)
        mean, covariance = kalman_step(mean, covariance, elapsed, observed, 5.0)
        assert cloud.observe(stamp, observed, 5.0) is UpdateResult.APPLIED
    assert cloud.mean == pytest.approx(mean, abs=0.8)
    assert np.diag(cloud.covariance) == pytest.approx(np.diag(covariance), rel=0.2)


def test_a_sharp_sighting_after_a_long_gap_keeps_an_honest_spread():
    cloud = started(std=5.0)
    mean, covariance = kalman_step(
        np.array([0.0, 10.0, 0.0, 0.0]), np.diag([25.0, 1.0, 25.0, 1.0]), 60.0, np.array([700.0, 90.0]), 1.0
    )
    cloud.observe(60.0, np.array([700.0, 90.0]), 1.0)
    assert np.diag(cloud.covariance) == pytest.approx(np.diag(covariance), rel=0.5)
    assert cloud.mean == pytest.approx(mean, abs=4.0)


def test_where_few_particles_carry_the_weight_the_moments_are_updated():
    cloud = started(std=500.0)
    cloud.observe(0.0, np.array([900.0, -900.0]), 0.5)
    assert cloud.mean[[0, 2]] == pytest.approx([900.0, -900.0], abs=0.5)
    assert np.sqrt(np.diag(cloud.covariance)[[0, 2]]) == pytest.approx([0.5, 0.5], rel=0.3)


def test_a_reported_velocity_is_used_or_not():
    with_velocity, without = started(velocity=None), started(velocity=None)
    with_velocity.observe(0.1, np.array([1.0, 0.0]), 5.0, np.array([10.0, 0.0]))
    without.observe(0.1, np.array([1.0, 0.0]), 5.0)
    assert with_velocity.mean[1] == pytest.approx(10.0, abs=1.0)
    assert without.covariance[1, 1] > 20.0 * with_velocity.covariance[1, 1]
    deaf = started(velocity=None, settings=FilterSettings(use_reported_velocity=False))
    deaf.observe(0.1, np.array([1.0, 0.0]), 5.0, np.array([10.0, 0.0]))
    assert deaf.covariance[1, 1] > 20.0 * with_velocity.covariance[1, 1]


def test_a_late_sighting_is_weighed_where_the_vehicle_was():
    cloud = started()
    cloud.observe(4.0, np.array([40.0, 0.0]), 5.0)
    before = cloud.covariance[0, 0]
    assert cloud.observe(3.0, np.array([30.0, 0.0]), 5.0) is UpdateResult.APPLIED_LATE
    assert cloud.stamp_s == 4.0
    assert cloud.mean[0] == pytest.approx(40.0, abs=3.0)
    assert cloud.covariance[0, 0] < before


def test_late_sightings_lead_to_nearly_the_same_as_timely_ones():
    detections = [(t, np.array([10.0 * t + e, -e])) for t, e in ((1, 2), (2, -3), (3, 1), (4, 4), (5, -2))]
    timely, late = started(), started()
    for stamp, place in detections:
        timely.observe(float(stamp), place, 5.0)
    for index in (0, 2, 1, 4, 3):
        late.observe(float(detections[index][0]), detections[index][1], 5.0)
    assert late.stamp_s == timely.stamp_s
    assert late.mean == pytest.approx(timely.mean, abs=2.0)


def test_a_sighting_too_late_changes_nothing():
    cloud = started(stamp_s=100.0)
    before = cloud.mean
    assert cloud.observe(94.9, np.array([0.0, 0.0]), 5.0) is UpdateResult.TOO_LATE
    assert np.array_equal(cloud.mean, before)


def test_equal_seeds_give_equal_clouds_and_leave_the_common_generator_alone():
    np.random.seed(3)  # noqa: NPY002
    expected = np.random.random(4)  # noqa: NPY002
    np.random.seed(3)  # noqa: NPY002
    clouds = [started(seed=5), started(seed=5), started(seed=6)]
    for cloud in clouds:
        cloud.observe(1.0, np.array([11.0, 2.0]), 5.0)
    assert np.array_equal(clouds[0].mean, clouds[1].mean)
    assert not np.array_equal(clouds[0].mean, clouds[2].mean)
    assert np.array_equal(np.random.random(4), expected)  # noqa: NPY002


@pytest.mark.parametrize("reports_velocity", [False, True])
def test_the_spread_is_consistent_with_the_errors(reports_velocity):
    """NEES (Bar-Shalom 5.4.2): over 60 flights its mean lies in the 99.9 % interval of chi-square."""
    rng = np.random.default_rng(20)
    num, last = 60, []
    for flight in range(num):
        truth = np.array([0.0, 10.0, 0.0, 0.0])
        first = truth[[0, 2]] + 5.0 * rng.standard_normal(2)
        cloud = started(position=first, velocity=truth[[1, 3]] + rng.standard_normal(2), seed=flight)
        stamp = 0.0
        for _ in range(12):
            elapsed = float(rng.choice([0.2, 1.0, 1.0, 4.0]))
            stamp += elapsed
            noise = np.linalg.cholesky(process_noise(elapsed, 1.0))
            truth = transition(elapsed) @ truth + noise @ rng.standard_normal(4)
            velocity = truth[[1, 3]] + rng.standard_normal(2) if reports_velocity else None
            cloud.observe(stamp, truth[[0, 2]] + 5.0 * rng.standard_normal(2), 5.0, velocity)
        error = cloud.mean - truth
        last.append(error @ np.linalg.solve(cloud.covariance, error))
    low, high = chi2.ppf([0.0005, 0.9995], 4 * num) / num
    assert low < np.mean(last) < high


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match="8 particles"):
        FilterSettings(num_particles=4)
    with pytest.raises(ValueError, match="positive"):
        FilterSettings(velocity_std_m_s=0.0)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.floats(-6.0, 60.0),
            st.floats(-1e5, 1e5),
            st.floats(-1e5, 1e5),
            st.floats(0.5, 1e4),
            st.none() | st.tuples(st.floats(-300.0, 300.0), st.floats(-300.0, 300.0)),
        ),
        max_size=8,
    )
)
def test_whatever_is_sighted_the_moments_stay_a_distribution(detections):
    cloud = started(settings=FilterSettings(num_particles=64))
    for after, east, north, std, velocity in detections:
        cloud.observe(
            cloud.stamp_s + after,
            np.array([east, north]),
            std,
            None if velocity is None else np.array(velocity),
        )
    mean, covariance = cloud.moments(cloud.stamp_s + 10.0)
    assert np.isfinite(mean).all()
    assert np.array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() >= -1e-9 * np.trace(covariance)
