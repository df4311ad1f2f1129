"""Bytes by address, and the budgets that they draw on."""

from collections import Counter

import pytest

from companion.link.messages.codec import _EXTRAS, _LENGTHS_MAX
from companion.link.wire.incoming import ADDRESSES_MAX, Incoming
from companion.link.wire.source_limits import KNOWN_MAX, SOURCES_MAX, SourceLimits
from companion.token_bucket import TokenBucket
from tests.link.pymavlink_frames import heartbeat

VEHICLE = ("10.0.0.1", 14_550)
WHOLE = heartbeat()


def incoming():
    return Incoming(_EXTRAS, Counter(), _LENGTHS_MAX)


def test_a_bucket_by_hand():
    """Two a second, a burst of four: 4 at once, then 2 after a second, then 1 after half of one."""
    bucket = TokenBucket(2.0, 4.0)
    assert [bucket.takes(10.0) for _ in range(5)] == [True] * 4 + [False]
    assert [bucket.takes(11.0) for _ in range(3)] == [True, True, False]
    assert [bucket.takes(11.5) for _ in range(2)] == [True, False]
    assert not bucket.takes(1.0)  # a clock set back gives nothing
    assert not bucket.takes(11.9, 2.0)
    bucket.owe(3.0)
    assert [bucket.has_any(now) for now in (12.0, 13.0, 13.2)] == [False, False, True]


def test_what_strangers_send_leaves_the_vehicles_budget_alone():
    """A megabyte a second for ten seconds: a tenth of it is looked at, and every frame of the vehicle."""
    cut, heard, looked_at = incoming(), 0, 0
    for tick in range(1_000):
        now = 0.01 * tick
        before = cut._counters["flooded_bytes"]
        cut.frames(b"\xfe" * 10_000, now, ("10.0.0.9", tick % 60_000), is_peer=False)
        looked_at += 10_000 - (cut._counters["flooded_bytes"] - before)
        heard += len(cut.frames(WHOLE, now, VEHICLE, is_peer=True))
    assert heard == 1_000
    assert looked_at == pytest.approx(100_000.0 * 12.0, rel=0.05)  # and the burst
    assert len(cut._framers) <= ADDRESSES_MAX


def test_a_line_that_floods_is_looked_at_for_a_while_and_again_later():
    cut = incoming()
    assert len(cut.frames(WHOLE, 0.0, None, is_peer=True)) == 1
    for _ in range(100):
        cut.frames(bytes(10_000), 0.1, None, is_peer=True)
    assert cut._counters["flooded_bytes"] > 400_000
    assert cut.frames(WHOLE * 3, 2.5, None, is_peer=True)[-1].raw == WHOLE


def test_fifty_thousand_sources_get_a_share_and_not_each_their_own():
    """Two hundred a second of each were let through, so ten million of all."""
    limits = SourceLimits(200.0)
    taken = 0
    for number in range(50_000):
        taken += limits.refusal(number % 251 + 1, number // 251 % 250 + 2, number / 50_000) == ""
    assert taken <= 500.0 * (1.0 + 2.0) + 1
    assert len(limits._buckets) <= SOURCES_MAX
    assert len(limits._known) <= KNOWN_MAX


def test_a_source_that_was_there_before_keeps_its_share_in_a_flood():
    limits, heard = SourceLimits(200.0), 0
    for second in range(30):
        heard += limits.refusal(42, 1, float(second)) == ""
        for number in range(2_000 if second >= 15 else 0):
            limits.refusal(number % 200 + 50, second + 2, second + 1e-4 * number)
    assert heard == 30


def test_one_who_fell_silent_makes_room_for_another_to_be_known():
    limits = SourceLimits(200.0)
    for system in range(1, KNOWN_MAX + 1):
        limits.refusal(system, 1, 0.0)
    limits.refusal(99, 1, 30.0)
    assert (99, 1) not in limits._known
    limits.refusal(99, 1, 61.0)
    assert (99, 1) in limits._known
    assert len(limits._known) == KNOWN_MAX


def test_frames_under_the_vehicles_ids_have_a_budget_too():
    limits = SourceLimits(200.0)
    taken = sum(limits.refusal(1, 1, 0.0, is_vehicle=True) == "" for _ in range(10_000))
    assert taken == 4_000
    assert limits.refusal(1, 1, 0.0, is_vehicle=True) == "vehicle_rate_limited"
    assert limits.refusal(2, 1, 0.0) == ""
