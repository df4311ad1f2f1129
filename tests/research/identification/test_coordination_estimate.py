"""How well turns are coordinated is found again: by hand, in turns made for it, and in real recordings."""

import math

import numpy as np
import pytest

from companion.frames import true_airspeed, wrapped_angle
from companion.research.identification.coordination_estimate import TURNS_MIN, coordination_key
from companion.research.identification.turn_samples import TurnListener
from companion.types.events import AirData, Attitude, GlobalPosition
from tests.link.messages.test_codec import replayed

HEIGHT_M, EQUIVALENT_M_S = 1500.0, 23.0
TRUE_M_S = true_airspeed(EQUIVALENT_M_S, HEIGHT_M)


def position(stamp_s):
    return GlobalPosition(stamp_s, stamp_s, 36.4, -76.5, HEIGHT_M, 100.0, (0.0, 25.0, 0.0))


def listened(turns, *, pause_s=5.0, rate_hz=10, air_every=1):
    """A listener after turns of (bank [deg], duration [s], share), with level flight between them."""
    listener, time_s, yaw, steps = TurnListener(), 0.0, 3.0, 0
    for bank_deg, duration_s, share in turns:
        for bank, lasts_s in ((math.radians(bank_deg), duration_s), (0.0, pause_s)):
            for _ in range(round(lasts_s * rate_hz)):
                time_s, steps = time_s + 1.0 / rate_hz, steps + 1
                yaw += share * 9.80665 * math.tan(bank) / TRUE_M_S / rate_hz
                if steps % air_every == 0:
                    listener.note(AirData(time_s, EQUIVALENT_M_S, 25.0, 0.5))
                    listener.note(position(time_s))
                listener.note(Attitude(time_s, bank, 0.0, wrapped_angle(yaw)))
    return listener


def test_turns_without_noise_are_exact():
    turns = [(30.0, 5.0, 0.7), (-25.0, 6.0, 0.7), (40.0, 3.0, 0.7), (-20.0, 4.0, 0.7), (35.0, 4.0, 0.7)]
    key = coordination_key(listened(turns).turns)
    assert key.value == pytest.approx(0.7, abs=1e-6)
    assert (key.low, key.high) == pytest.approx((0.7, 0.7), abs=1e-6)
    assert key.note == "5 turns, 22 s"


def test_the_estimate_and_its_interval_by_hand():
    """Sums of turns 1·s and of squares s = 1, 2, 2, 2, 1, with shares 0.6, 0.7, 0.8, 0.7, 0.9."""
    squares, shares = np.array([1.0, 2.0, 2.0, 2.0, 1.0]), np.array([0.6, 0.7, 0.8, 0.7, 0.9])
    key = coordination_key([np.array([10.0, s * share, s]) for s, share in zip(squares, shares, strict=True)])
    # 5.9 / 8 = 0.7375; residuals -0.1375, -0.075, 0.125, -0.075, 0.1625; their squares sum to 0.0722.
    assert key.value == pytest.approx(0.7375)
    assert key.high - key.value == pytest.approx(1.96 * math.sqrt(0.0721875 * 5 / 4) / 8.0, rel=1e-3)


def test_the_intervals_hold_the_truth_about_as_often_as_they_say():
    """With twenty turns of even weight the interval by normal quantiles holds it in 93 to 95 %."""
    rng, hits, num = np.random.default_rng(1), 0, 400
    for _ in range(num):
        squares = rng.uniform(0.5, 2.0, 20)
        turned = squares * (0.8 + 0.1 * rng.standard_normal(20))
        key = coordination_key([np.array([5.0, t, s]) for t, s in zip(turned, squares, strict=True)])
        hits += key.low <= 0.8 <= key.high
    assert 0.90 < hits / num < 0.98


def test_a_share_beyond_the_keys_range_is_said():
    key = coordination_key(listened([(30.0, 5.0, 1.06)] * TURNS_MIN).turns)
    assert key.value == 1.0
    assert "1.06 was measured" in key.note


def test_too_few_turns_say_what_is_needed():
    key = coordination_key(listened([(30.0, 5.0, 0.7)] * (TURNS_MIN - 1)).turns)
    assert key.value is None
    assert "4 turns" in key.note
    assert "5 are needed" in key.note


def test_a_long_turn_counts_as_several():
    assert [round(turn[0]) for turn in listened([(30.0, 25.0, 0.7)]).turns] == [10, 10, 5]


def test_turns_without_a_recent_airspeed_do_not_count():
    assert listened([(30.0, 5.0, 0.7)] * 5, air_every=40).turns
    listener = TurnListener()
    for step in range(100):
        listener.note(Attitude(0.1 * step, 0.5, 0.0, 0.02 * step))
    listener.note(AirData(0.0, 23.0, 25.0, 0.5))
    listener.note(position(0.0))
    for step in range(100, 200):
        listener.note(Attitude(0.1 * step, 0.5, 0.0, 0.02 * step))
    assert listener.turns == []


def test_a_real_arduplane_slips():
    """Fitted to all attitudes and airspeeds of the recording at once, it is 0.73."""
    listener = TurnListener()
    for event in replayed("arduplane-4.7dev-replace.tlog")[1]:
        listener.note(event)
    key = coordination_key(listener.turns)
    assert 0.70 < key.low < 0.73 < key.high < 0.76
