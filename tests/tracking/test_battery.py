"""What is left and how fast it falls, from reports whose truth is known."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.tracking.battery import MAX_AGE_S, BatteryEstimator
from companion.types.events import BatteryReported


def report(stamp_s, remaining=None, consumed_wh=None):
    return BatteryReported(stamp_s, remaining, consumed_wh, 22.2)


def flown(power_w, expected_w, seconds, *, capacity_wh=200.0, percent=False, share=True, period_s=2.0):
    """An estimator after a flight at a power, with the reports of an ArduPlane, or with shares alone."""
    estimator = BatteryEstimator(capacity_wh)
    for tick in range(int(seconds / period_s) + 1):
        now = tick * period_s
        used = power_w * now / 3_600.0
        whole = math.floor(100.0 * (1.0 - used / capacity_wh)) / 100.0
        estimator.note_expected(now, expected_w)
        estimator.observe(report(now, whole if share else None, None if percent else used))
    return estimator


def test_the_share_counts_before_what_was_consumed():
    estimator = BatteryEstimator(200.0)
    estimator.observe(report(0.0, 0.5, 20.0))  # It was not full at the start.
    assert estimator.left_wh(0.0) == pytest.approx(100.0)


def test_without_a_share_what_was_consumed_is_taken_off_the_capacity():
    estimator = BatteryEstimator(200.0)
    estimator.observe(report(0.0, None, 20.0))
    assert estimator.left_wh(0.0) == pytest.approx(180.0)
    estimator.observe(report(1.0, None, 300.0))
    assert estimator.left_wh(1.0) == 0.0


def test_nothing_is_known_before_a_report_or_long_after_the_last():
    estimator = BatteryEstimator(200.0)
    assert (estimator.left_wh(0.0), estimator.power_w(0.0), estimator.ratio(0.0)) == (None, None, None)
    estimator = flown(360.0, 360.0, 100.0)
    assert estimator.left_wh(100.0 + MAX_AGE_S) is not None
    late = 101.0 + MAX_AGE_S
    assert (estimator.left_wh(late), estimator.power_w(late), estimator.ratio(late)) == (None, None, None)


def test_a_battery_that_falls_almost_twice_as_fast_is_told_so():
    estimator = flown(1.9 * 400.0, 400.0, 120.0)
    assert estimator.power_w(120.0) == pytest.approx(760.0)
    assert estimator.ratio(120.0) == pytest.approx(1.9)


def test_the_rate_is_that_of_the_last_minute():
    estimator, used = BatteryEstimator(200.0), 0.0
    for now in range(0, 601, 2):
        estimator.note_expected(float(now), 400.0)
        estimator.observe(report(float(now), None, used))
        used += (400.0 if now < 500 else 800.0) * 2.0 / 3_600.0
    assert estimator.power_w(600.0) == pytest.approx(800.0)
    assert estimator.ratio(600.0) == pytest.approx(2.0)


def test_half_a_minute_is_too_short():
    assert flown(400.0, 400.0, 28.0).ratio(28.0) is None
    assert flown(400.0, 400.0, 30.0).ratio(30.0) is not None


def test_whole_percents_tell_the_rate_after_five_of_them():
    estimator = flown(720.0, 360.0, 600.0, percent=True)
    assert estimator.ratio(600.0) == pytest.approx(2.0, rel=0.2)
    assert flown(720.0, 360.0, 40.0, percent=True).ratio(40.0) is None


def test_an_aircraft_that_was_to_take_nothing_has_no_ratio():
    assert flown(400.0, 0.0, 120.0).ratio(120.0) is None
    assert flown(400.0, 0.0, 120.0).power_w(120.0) == pytest.approx(400.0)


def test_a_changed_battery_begins_anew():
    estimator = flown(400.0, 400.0, 120.0)
    estimator.observe(report(122.0, 1.0, 0.0))
    assert estimator.left_wh(122.0) == pytest.approx(200.0)
    assert estimator.power_w(122.0) is None


def test_a_monitor_that_counts_from_zero_again_begins_anew():
    estimator = flown(400.0, 400.0, 40.0, share=False)
    estimator.observe(report(42.0, None, 0.0))
    assert estimator.power_w(42.0) is None


def test_a_share_that_rises_by_a_percent_is_the_same_battery():
    """The voltage recovers when the motor slows down."""
    estimator = flown(720.0, 360.0, 600.0, percent=True)
    estimator.observe(report(602.0, estimator.left_wh(600.0) / 200.0 + 0.01))
    assert estimator.ratio(602.0) == pytest.approx(2.0, rel=0.4)


def test_a_late_report_is_ignored():
    estimator = BatteryEstimator(200.0)
    estimator.observe(report(10.0, 0.5))
    estimator.observe(report(9.0, 0.9))
    assert estimator.left_wh(10.0) == pytest.approx(100.0)


@given(
    power=st.floats(50.0, 2_000.0), expected=st.floats(50.0, 2_000.0), seconds=st.floats(31.0, 400.0),
    period=st.floats(0.2, 5.0),
)  # fmt: skip
def test_the_ratio_is_that_of_the_powers(power, expected, seconds, period):
    now = math.floor(seconds / period) * period
    estimator = flown(power, expected, seconds, share=False, capacity_wh=1e4, period_s=period)
    ratio = estimator.ratio(now)
    assert ratio is None or ratio == pytest.approx(power / expected, rel=1e-6)
    assert (ratio is None) == (now < 30.0)


def after(*stretches, percent=False):
    """An estimator after stretches of flight: seconds, measured power and expected power [W]."""
    estimator, used_wh, now = BatteryEstimator(200.0), 0.0, 0
    estimator.observe(report(0.0, 1.0, None if percent else 0.0))
    for seconds, power_w, expected_w in stretches:
        estimator.note_expected(float(now), expected_w)
        for _ in range(0, seconds, 2):
            now += 2
            used_wh += power_w / 1_800.0
            share = math.ceil(100.0 - 0.5 * used_wh) / 100.0
            estimator.observe(report(float(now), share, None if percent else used_wh))
    return estimator, float(now)


def test_the_ratio_since_the_take_off_is_that_of_all_the_energy():
    """60 s at twice and 120 s at once the expected 400 W: 240/180."""
    estimator, now = after((60, 800.0, 400.0), (120, 400.0, 400.0))
    assert estimator.ratio(now) == pytest.approx(1.0)
    assert estimator.long_ratio(now) == pytest.approx(240.0 / 180.0)


def test_what_was_used_on_the_ground_does_not_count():
    estimator, now = after((600, 50.0, 0.0), (120, 400.0, 400.0))
    assert estimator.long_ratio(now) == pytest.approx(1.0)


def test_from_shares_it_is_known_as_soon_as_that_of_the_last_minute():
    estimator, now = after((30, 400.0, 400.0), percent=True)
    assert estimator.long_ratio(now) is None
    estimator, now = after((300, 800.0, 400.0), percent=True)
    assert estimator.long_ratio(now) == pytest.approx(2.0, rel=0.1)


def test_it_forgets_what_is_older_than_a_quarter_of_an_hour():
    estimator, now = after((1_200, 800.0, 400.0), (900, 400.0, 400.0))
    assert estimator.long_ratio(now) == pytest.approx(1.0, abs=0.01)


@given(st.lists(st.tuples(st.integers(30, 200), st.floats(0.5, 3.0)), min_size=1, max_size=4))
def test_it_lies_between_the_least_and_the_greatest(stretches):
    estimator, now = after(*((2 * (seconds // 2), 400.0 * ratio, 400.0) for seconds, ratio in stretches))
    ratios = [ratio for _, ratio in stretches]
    assert min(ratios) - 1e-6 <= estimator.long_ratio(now) <= max(ratios) + 1e-6
