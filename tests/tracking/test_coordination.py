"""Estimates of how well turns are coordinated: by hand, and of recorded flights."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config import mission_from_text
from companion.frames import wrapped_angle
from companion.tracking.ownship import CoordinationEstimate, OwnshipEstimator
from companion.types.events import Attitude
from tests.link.messages.test_codec import replayed
from tests.sim.client import PLAIN

AIRSPEED_M_S = 25.0


def flown(share, bank_deg, duration_s, *, begin_s=0.0, step_s=0.2, estimate=None):
    """An estimate after a turn at a share of the rate of a coordinated one."""
    estimate, bank = estimate or CoordinationEstimate(), math.radians(bank_deg)
    rate = share * 9.80665 * math.tan(bank) / AIRSPEED_M_S
    for k in range(round(duration_s / step_s) + 1):
        attitude = Attitude(begin_s + k * step_s, bank, 0.0, wrapped_angle(2.5 + k * step_s * rate))
        estimate.note(attitude, AIRSPEED_M_S)
    return estimate


def test_before_a_turn_it_is_coordinated():
    assert CoordinationEstimate().share == 1.0
    assert CoordinationEstimate(0.7).share == pytest.approx(0.7)
    assert flown(0.7, 10.0, 60.0).share == 1.0  # Less bank says little.


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_turn_by_hand(side):
    """10 s with 25 degrees count as much as what is expected before: the mean of 0.7 and 1."""
    assert flown(0.7, 25.0 * side, 10.0).share == pytest.approx(0.85, abs=0.01)
    assert flown(0.7, 25.0 * side, 90.0).share == pytest.approx(0.74, abs=0.01)


def test_what_was_flown_long_ago_counts_less():
    """Loads change: after 240 s of other turns the first count e to the power of -2."""
    before = flown(0.7, 35.0, 120.0)
    assert before.share == pytest.approx(0.71, abs=0.01)
    assert flown(0.9, 35.0, 240.0, begin_s=1000.0, estimate=before).share == pytest.approx(0.89, abs=0.01)


def test_an_aircraft_that_stands_on_a_slope_does_not_turn():
    estimate = CoordinationEstimate()
    for k in range(1000):
        estimate.note(Attitude(0.2 * k, math.radians(20.0), 0.0, 1.0), 3.0)
    assert estimate.share == 1.0


def test_gaps_and_changes_of_side_do_not_count():
    assert flown(0.7, 30.0, 60.0, step_s=2.0).share == 1.0
    estimate = CoordinationEstimate()
    for k in range(100):
        estimate.note(Attitude(0.2 * k, math.radians(30.0 * (-1) ** k), 0.0, 0.0), AIRSPEED_M_S)
    assert estimate.share == 1.0


@given(st.lists(st.tuples(*[st.floats(-4.0, 4.0)] * 3), max_size=30), st.floats(0.0, 100.0))
def test_it_is_always_believable(attitudes, airspeed_m_s):
    estimate = CoordinationEstimate()
    for number, (bank, pitch, yaw) in enumerate(attitudes):
        estimate.note(Attitude(0.1 * number, bank, pitch, yaw), airspeed_m_s)
    assert 0.5 <= estimate.share <= 1.0


@pytest.mark.parametrize(
    ("recording", "least", "most"),
    [("arduplane-4.7dev-replace.tlog", 0.7, 0.8), ("px4-1.17dev-replace.tlog", 0.93, 1.0)],
)
def test_real_autopilots(recording, least, most):
    """Fitted to all attitudes and airspeeds of the recordings at once, it is 0.73 and 0.95."""
    estimator = OwnshipEstimator(mission_from_text(PLAIN, "plain.yaml").frame)
    for event in replayed(recording)[1]:
        estimator.observe(event)
    assert least < estimator._coordination.share < most
