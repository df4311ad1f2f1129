"""Intervals by hand, against scipy, and that they hold what they should as often as they say."""

import math

import numpy as np
import pytest
import scipy.stats

from companion.research.evidence.intervals import bootstrap, paired_shares, risk_ratio, runs_to_decide, wilson


@pytest.mark.parametrize(
    ("successes", "runs", "low", "high"),
    [(8, 10, 0.4902, 0.9433), (0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (97, 100, 0.9155, 0.9897)],
)
def test_wilson_as_printed_elsewhere(successes, runs, low, high):
    found = wilson(successes, runs)
    assert found.value == successes / runs
    assert (found.low, found.high) == pytest.approx((low, high), abs=5e-5)


def test_wilson_agrees_with_scipy():
    for successes, runs in ((3, 7), (1, 50), (49, 50)):
        other = scipy.stats.binomtest(successes, runs).proportion_ci(method="wilson")
        assert wilson(successes, runs)[1:] == pytest.approx((other.low, other.high))


def test_of_no_runs_nothing_is_known():
    value, low, high = wilson(0, 0)
    assert math.isnan(value)
    assert (low, high) == (0.0, 1.0)
    with pytest.raises(ValueError, match="no values"):
        bootstrap(np.array([]))


def test_paired_shares_by_hand():
    # 4 of 100 fail with the first alone: (4 - 0)/102, variance (4 + 0 + 1 - 16/102)/102².
    first, second = np.zeros(100), np.zeros(100)
    first[:4] = 1.0
    found = paired_shares(first, second)
    assert found == pytest.approx((0.04, -0.0030717, 0.0815031), abs=1e-6)
    assert not found.excludes_zero
    first[:6] = 1.0  # McNemar: p = 2/2⁶ = 0.03
    assert paired_shares(first, second).excludes_zero
    assert paired_shares(second, first) == pytest.approx(
        [-paired_shares(first, second)[n] for n in (0, 2, 1)]
    )


def test_bootstrap_agrees_with_scipy_and_with_itself():
    values = np.random.default_rng(3).exponential(size=60)
    found = bootstrap(values)
    other = scipy.stats.bootstrap(
        (values,), np.mean, n_resamples=20_000, method="percentile", random_state=np.random.default_rng(4)
    ).confidence_interval
    assert found.value == values.mean()
    assert (found.low, found.high) == pytest.approx((other.low, other.high), abs=0.02)
    assert bootstrap(values) == found
    assert bootstrap(values, np.median).value == np.median(values)


def test_bootstrap_holds_the_mean_about_as_often_as_it_says():
    rng = np.random.default_rng(8)
    found = [bootstrap(rng.normal(5.0, 2.0, size=40)) for _ in range(400)]
    share = np.mean([one.low <= 5.0 <= one.high for one in found])
    assert 0.90 <= share <= 0.98


def test_bootstrap_of_equal_values_is_that_value():
    assert bootstrap(np.full(7, 3.0)) == (3.0, 3.0, 3.0)


def test_runs_to_decide_by_hand():
    # Mean 1 and deviation 2: (1.960 + 0.8416)² · 4 = 31.4.
    assert runs_to_decide(np.array([1.0 - math.sqrt(2.0), 1.0 + math.sqrt(2.0)])) == 32
    assert runs_to_decide(np.array([-1.0, 1.0])) is None


def test_so_many_runs_show_a_difference_four_times_of_five():
    rng = np.random.default_rng(11)
    found = [bootstrap(rng.normal(1.0, 2.0, size=32)).excludes_zero for _ in range(400)]
    assert 0.74 <= np.mean(found) <= 0.88


def test_a_risk_ratio_by_hand():
    # Of 100 encounters 40 would be events; 10 of them and 2 others are events with the service.
    happened, would_happen = np.zeros(100), np.zeros(100)
    would_happen[:40] = 1.0
    happened[30:42] = 1.0
    found = risk_ratio(happened, would_happen)
    assert found.value == 0.3
    # The delta method: var(ln) = 1/12 + 1/40 - 2·10/(12·40).
    half = 1.96 * math.sqrt(1 / 12 + 1 / 40 - 2 * 10 / (12 * 40))
    assert (found.low, found.high) == pytest.approx((0.3 * math.exp(-half), 0.3 * math.exp(half)), abs=0.04)
    assert risk_ratio(happened, would_happen) == found
    assert risk_ratio(would_happen, would_happen) == (1.0, 1.0, 1.0)


def test_a_risk_ratio_of_no_event_has_the_exact_limit():
    would_happen = np.repeat([1.0, 0.0], [50, 150])
    found = risk_ratio(np.zeros(200), would_happen)
    limit = scipy.stats.binomtest(0, 200).proportion_ci(method="exact").high
    assert found == pytest.approx((0.0, 0.0, limit / 0.25))
    value, low, high = risk_ratio(np.zeros(200), np.zeros(200))
    assert math.isnan(value)
    assert (low, high) == (0.0, math.inf)
