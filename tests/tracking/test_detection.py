"""Reports that contradict the ones before, as recordings of ADS-B have them."""

import pytest

from companion.tracking.detection import CLIMB_MAX_M_S, ClimbEstimate
from companion.tracking.tracker import Tracker
from companion.types.events import Emitter
from tests.tracking.reports import FRAME, report


def tracker():
    return Tracker(FRAME, seed=7)


def hear(target, stamp_s, east_m, north_m=0.0, up_m=300.0, velocity=(50.0, 0.0, 0.0), now_s=None):
    told = report(stamp_s, east_m, north_m, up_m=up_m, velocity=velocity, emitter=Emitter.AIR)
    target.observe(told, stamp_s if now_s is None else now_s)


def flown(seconds=10, **keywords):
    """A tracker that has heard an aircraft which flies east at 50 m/s."""
    target = tracker()
    for stamp in range(seconds):
        hear(target, float(stamp), 50.0 * stamp, **keywords)
    return target


def up_of(target, now_s):
    (track,) = target.tracks(now_s)
    return track.position_enu_m[2]


def test_a_leap_in_height_is_refused_until_three_reports_agree():
    target = flown()
    hear(target, 10.0, 500.0, up_m=900.0)
    assert target.counters["teleporting"] == 1
    assert up_of(target, 10.0) == pytest.approx(300.0, abs=5.0)
    hear(target, 11.0, 550.0, up_m=900.0)
    assert up_of(target, 11.0) == pytest.approx(300.0, abs=5.0)
    hear(target, 12.0, 600.0, up_m=900.0)
    assert target.counters["restarted"] == 1
    assert up_of(target, 12.0) == pytest.approx(900.0, abs=5.0)


def test_a_steep_climb_is_no_leap():
    target = tracker()
    for stamp in range(10):
        hear(target, float(stamp), 50.0 * stamp, up_m=300.0 + 50.0 * stamp, velocity=(50.0, 0.0, 50.0))
    assert target.counters == {"initiated": 1, "applied": 9}


def test_an_aircraft_that_is_seen_seldom_and_turns_is_followed():
    # A glider of one recording flies a half circle in 15 s, which no filter of constant velocity expects.
    target = tracker()
    hear(target, 0.0, 0.0, velocity=(0.0, 30.0, 0.0))
    hear(target, 5.0, 0.0, 150.0, velocity=(0.0, 30.0, 0.0))
    hear(target, 20.0, 286.0, 150.0, velocity=(0.0, -30.0, 0.0))
    (track,) = target.tracks(20.0)
    assert track.position_enu_m[:2] == pytest.approx((286.0, 150.0), abs=10.0)
    assert track.velocity_enu_m_s[:2] == pytest.approx((0.0, -30.0), abs=3.0)
    assert target.counters["teleporting"] == 0


def test_farther_than_it_can_have_flown_it_is_not_followed():
    target = tracker()
    hear(target, 0.0, 0.0, velocity=(0.0, 30.0, 0.0))
    hear(target, 5.0, 0.0, 150.0, velocity=(0.0, 30.0, 0.0))
    hear(target, 20.0, 1_000.0, 150.0, velocity=(0.0, -30.0, 0.0))
    assert target.counters["teleporting"] == 1


@pytest.mark.parametrize("velocity", [(50.0, 0.0, 0.0), None])
def test_a_leap_that_is_sent_again_and_again_is_still_one_report(velocity):
    target = flown()
    for age in range(9):
        # The same position with a growing age, which a receiver rounds to seconds.
        hear(target, 10.0 + 0.2 * (age % 2), 9_000.0, velocity=velocity, now_s=10.5 + age)
    assert target.counters["teleporting"] == 1
    assert target.counters["duplicate"] == 8
    assert target.counters["restarted"] == 0


def test_a_place_of_before_without_an_age_does_not_stop_what_flies():
    target = flown()
    for stamp in range(10, 20):
        hear(target, float(stamp), 450.0)
    (track,) = target.tracks(19.0)
    assert track.position_enu_m[0] == pytest.approx(950.0, abs=30.0)
    assert target.counters["duplicate"] == 10


@pytest.mark.parametrize(
    "velocity", [(0.0, 0.0, 0.0), (0.0, 50.0, 0.0), (-150.0, 0.0, 0.0), (0.0, 160.0, 0.0)]
)
def test_an_aircraft_whose_velocity_is_wrong_is_followed_by_its_positions(velocity):
    target = tracker()
    for stamp in range(0, 60, 5):
        hear(target, float(stamp), 150.0 * stamp, velocity=velocity)
    (track,) = target.tracks(55.0)
    assert track.position_enu_m[0] == pytest.approx(150.0 * 55.0, abs=60.0)
    assert track.velocity_enu_m_s[:2] == pytest.approx((150.0, 0.0), abs=25.0)


def test_a_climb_that_nobody_reports_is_seen_in_the_altitudes():
    target = tracker()
    for stamp in range(10):
        hear(target, float(stamp), 50.0 * stamp, up_m=300.0 + 10.0 * stamp, velocity=None)
    assert up_of(target, 14.0) == pytest.approx(440.0, abs=3.0)


def heights(rate_m_s, reported_m_s, seconds=10):
    estimate = ClimbEstimate()
    for stamp in range(seconds):
        estimate.observe(float(stamp), rate_m_s * stamp, reported_m_s)
    return estimate.rate_m_s


@pytest.mark.parametrize(
    ("rate", "reported", "told"),
    [
        (3.0, 4.0, 4.0),
        (0.0, 15.0, 15.0),  # It begins to climb.
        (0.0, 50.0, 0.0),
        (-5.0, 165.0, -5.0),  # The largest that ADS-B can say, in recordings of aircraft that descend.
        (-5.0, None, -5.0),
    ],
)
def test_a_reported_climb_counts_unless_the_altitudes_contradict(rate, reported, told):
    assert heights(rate, reported) == pytest.approx(told)


def test_before_the_altitudes_say_anything_a_possible_climb_is_believed():
    assert heights(0.0, 20.0, seconds=1) == 20.0
    assert heights(0.0, CLIMB_MAX_M_S + 1.0, seconds=1) == 0.0
    assert heights(0.0, None, seconds=1) == 0.0


def test_one_wrong_altitude_hardly_changes_the_climb():
    estimate = ClimbEstimate()
    for stamp in range(12):
        estimate.observe(float(stamp), 100.0 if stamp == 6 else 2.0 * stamp, None)
    assert estimate.rate_m_s == pytest.approx(2.0, abs=0.5)


def test_altitudes_of_long_ago_say_nothing_of_the_climb():
    estimate = ClimbEstimate()
    for stamp in range(40):
        estimate.observe(float(stamp), 10.0 * min(stamp, 20), None)
    assert estimate.rate_m_s == pytest.approx(0.0)


def test_a_track_that_starts_again_without_a_velocity_has_that_of_its_positions():
    target = flown()
    for stamp in (10.0, 11.0, 12.0):
        hear(target, stamp, 5_000.0, 200.0 * (stamp - 10.0), velocity=None)
    assert target.counters["restarted"] == 1
    (track,) = target.tracks(12.0)
    assert track.velocity_enu_m_s[:2] == pytest.approx((0.0, 200.0), abs=5.0)


def test_a_turn_is_followed_at_once_even_if_the_reported_course_is_wrong():
    # Recordings that were resampled have courses between 359° and 1°, which are 180°.
    target = tracker()
    for stamp in range(0, 25, 5):
        hear(target, float(stamp), 0.0, 80.0 * stamp, velocity=(80.0, 0.0, 0.0))
    refused = target.counters["teleporting"]
    hear(target, 25.0, -300.0, 1_800.0, velocity=(80.0, 0.0, 0.0))
    assert target.counters["teleporting"] == refused
    (track,) = target.tracks(25.0)
    assert track.position_enu_m[:2] == pytest.approx((-300.0, 1_800.0), abs=10.0)
    assert track.velocity_enu_m_s[:2] == pytest.approx((-60.0, 40.0), abs=5.0)
