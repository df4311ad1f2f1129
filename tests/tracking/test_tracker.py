from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.tracking.threat_assigner import (
    REMEMBERED_MAX,
    ThreatAssigner,
    VehicleClass,
    VehicleClassSettings,
)
from companion.tracking.track import TrackSettings, chi_square_quantile
from companion.tracking.tracker import Tracker, TrackerSettings, _is_same
from companion.types.events import Emitter
from companion.types.threat import DynamicThreat, TrackState
from tests.tracking.reports import FRAME, report

PURSUER = DynamicThreat("pursuer", (0.0, 0.0, 0.0), 25.0, 400.0, 20.0)
PARKED = DynamicThreat("launcher", (1000.0, 0.0, 0.0), 0.0, 600.0, 15.0)


def tracker(*threats, **changes):
    return Tracker(FRAME, threats or (PURSUER,), replace(TrackerSettings(), **changes), seed=7)


def drive(target, times, speed=10.0, **keywords):
    for stamp in times:
        target.observe(report(float(stamp), speed * stamp, 0.0, **keywords), float(stamp))


def test_the_gate_of_two_dimensions_has_a_closed_form():
    assert chi_square_quantile(0.99) == pytest.approx(9.2103, abs=1e-4)  # any table of chi-square


def test_99_of_100_pairs_of_tracks_of_one_aircraft_are_taken_for_one():
    # Of four degrees of freedom any table has 13.277. Each covariance is 50 of everything, their sum 100.
    def at(east_m, up_m=100.0):
        place, moving = (east_m, 0.0, up_m), (30.0, 0.0, 0.0)
        return TrackState(
            0.0, "icao:1", place, moving, 50.0 * np.eye(4), 60.0, 250.0, 15.0, True, 0.0, flies_on=True
        )

    limit_m = math.sqrt(13.277 * 100.0)
    assert _is_same(at(0.0), at(0.99 * limit_m))
    assert not _is_same(at(0.0), at(1.01 * limit_m))
    assert _is_same(at(0.0), at(0.0, up_m=199.0))
    assert not _is_same(at(0.0), at(0.0, up_m=201.0))


def test_the_fastest_that_ads_b_says_of_a_subsonic_aircraft_is_followed():
    target = tracker()
    drive(target, range(10), speed=525.0, velocity=(525.0, 0.0, 0.0))  # 1,021.5 kt are 525.5 m/s.
    (track,) = target.tracks(9.0)
    assert track.velocity_enu_m_s[0] == pytest.approx(525.0, abs=5.0)


def test_a_track_is_initiated_and_followed():
    target = tracker()
    drive(target, range(20))
    (track,) = target.tracks(19.5)
    assert track.identity == "icao:00ABCD"
    assert track.stamp_s == 19.5
    assert track.observed_s == 19.0
    assert track.position_enu_m[:2] == pytest.approx((195.0, 0.0), abs=8.0)
    assert track.velocity_enu_m_s == pytest.approx((10.0, 0.0, 0.0), abs=4.0)
    assert (track.speed_max_m_s, track.max_threat_radius_m, track.turn_radius_m) == (25.0, 400.0, 20.0)
    assert not track.is_airborne
    assert target.counters == {"initiated": 1, "applied": 19}


def test_a_vehicle_faster_than_configured_is_believed():
    target = tracker(replace(PURSUER, speed_m_s=5.0))
    drive(target, range(15), speed=12.0, velocity=(12.0, 0.0, 0.0))
    assert target.tracks(14.0)[0].speed_max_m_s == pytest.approx(12.0, abs=3.0)


def test_tracks_coast_with_growing_spread_and_age_out():
    target = tracker()
    drive(target, range(5))
    early, late = target.tracks(10.0)[0], target.tracks(60.0)[0]
    assert np.trace(late.covariance) > np.trace(early.covariance)
    assert late.observed_s == 4.0
    assert target.tracks(64.1) == ()
    assert target.counters["aged_out"] == 1


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"stamp_s": 3.0}, "future"),
        ({"stamp_s": math.nan}, "not_finite"),
        ({"latitude_deg": math.nan}, "not_finite"),
        ({"altitude_amsl_m": math.inf}, "not_finite"),
        ({"velocity_enu_m_s": (math.nan, 0.0, 0.0)}, "not_finite"),
        ({"position_std_m": math.nan}, "not_finite"),
        ({"latitude_deg": 91.0}, "out_of_range"),
        ({"longitude_deg": 181.0}, "out_of_range"),
        ({"latitude_deg": 10.0}, "out_of_range"),
        ({"altitude_amsl_m": 90_000.0}, "out_of_range"),
        ({"velocity_enu_m_s": (527.0, 0.0, 0.0)}, "out_of_range"),
        ({"stamp_s": -70.0}, "old"),
    ],
)
def test_reports_that_cannot_be_true_are_dropped_and_counted(changes, reason):
    target = tracker()
    target.observe(replace(report(0.0), **changes), 0.0)
    assert target.tracks(0.0) == ()
    assert target.counters == {reason: 1}


def test_a_teleporting_report_is_dropped_and_the_track_goes_on():
    target = tracker()
    drive(target, range(10))
    target.observe(report(10.0, 5000.0, 5000.0), 10.0)
    target.observe(report(11.0, 110.0, 0.0), 11.0)
    assert target.counters["teleporting"] == 1
    assert target.tracks(11.0)[0].position_enu_m[:2] == pytest.approx((110.0, 0.0), abs=10.0)


def test_a_track_proven_wrong_starts_over():
    target = tracker()
    drive(target, range(10))
    for stamp in (10.0, 11.0, 12.0):
        target.observe(report(stamp, 5000.0 + 10.0 * stamp, 0.0), stamp)
    assert target.counters["teleporting"] == 2
    assert target.counters["restarted"] == 1
    track = target.tracks(12.0)[0]
    assert track.position_enu_m[0] == pytest.approx(5120.0, abs=10.0)
    assert track.max_threat_radius_m == 400.0, "it is the same vehicle still"


def test_scattered_outliers_never_take_a_track_over():
    target = tracker()
    drive(target, range(10))
    for stamp in range(10, 20):
        target.observe(report(float(stamp), 20_000.0 * (-1) ** stamp, 3000.0 * stamp), float(stamp))
    assert target.counters["teleporting"] == 10
    assert target.counters["restarted"] == 0
    assert abs(target.tracks(20.0)[0].position_enu_m[0] - 200.0) < 60.0


def test_copies_are_counted_once():
    target = tracker()
    drive(target, range(10), velocity=(10.0, 0.0, 0.0))
    before = target.tracks(9.5)[0]
    target.observe(report(9.0, 90.0, 0.0, velocity=(10.0, 0.0, 0.0)), 9.5)
    target.observe(report(9.5, 90.0, 0.0, velocity=(10.0, 0.0, 0.0)), 9.5)  # a repeat stamped anew
    assert target.counters["duplicate"] == 2
    assert target.tracks(9.5)[0].position_enu_m == before.position_enu_m


def test_late_reports_are_used_while_they_say_something():
    target = tracker()
    drive(target, range(10))
    target.observe(report(7.5, 75.0, 0.0), 9.2)
    target.observe(report(2.0, 21.0, 0.0), 9.2)
    assert target.counters["applied_late"] == 1
    assert target.counters["too_late"] == 1
    assert target.tracks(9.2)[0].observed_s == 9.0


@pytest.mark.parametrize("reports_velocity", [False, True])
def test_a_parked_vehicle_stays_parked_through_an_hour_of_noise(reports_velocity):
    target = tracker(PARKED)
    rng = np.random.default_rng(2)
    for stamp in range(0, 3600, 4):
        east, north, speed_east, speed_north = rng.standard_normal(4)
        velocity = (float(speed_east), float(speed_north), 0.0) if reports_velocity else None
        target.observe(
            report(float(stamp), 1000.0 + 8.0 * east, 8.0 * north, velocity=velocity), float(stamp)
        )
        if stamp % 20 == 0:
            (track,) = target.tracks(float(stamp) + 1.0)
            assert track.speed_max_m_s == 0.0
            assert track.velocity_enu_m_s == (0.0, 0.0, 0.0)
            assert track.max_threat_radius_m == 600.0
    assert target.counters["restarted"] == 0


def test_a_parked_vehicle_that_drives_off_is_a_mover_within_seconds():
    target = tracker(PARKED)
    rng = np.random.default_rng(3)
    for stamp in range(60):
        gone = max(0.0, 10.0 * (stamp - 45))
        east, north = 1000.0 + gone + 5.0 * rng.standard_normal(), 5.0 * rng.standard_normal()
        target.observe(report(float(stamp), east, north, std=5.0), float(stamp))
        if stamp == 45:
            assert target.tracks(45.0)[0].speed_max_m_s == 0.0
    track = target.tracks(59.0)[0]
    assert track.speed_max_m_s == pytest.approx(10.0, abs=4.0)
    assert track.velocity_enu_m_s[0] == pytest.approx(10.0, abs=4.0)


def test_a_parked_vehicle_that_is_found_elsewhere_is_a_mover():
    target = tracker(PARKED)
    for stamp in range(20):
        target.observe(report(float(stamp), 1000.0 + 0.1 * stamp, 0.0), float(stamp))
    for stamp in range(20, 26):
        target.observe(report(float(stamp), 500.0 + 30.0 * stamp, 400.0), float(stamp))
    assert target.counters["restarted"] == 1
    assert target.tracks(25.0)[0].speed_max_m_s > 10.0


def test_a_vehicle_cannot_have_come_from_anywhere_after_a_gap():
    target = tracker()
    drive(target, range(10))
    target.observe(report(39.0, 4000.0, 0.0), 39.0)  # 3.9 km in 30 s
    assert target.counters["teleporting"] == 1
    target.observe(report(40.0, 400.0, 0.0), 40.0)
    assert target.counters["teleporting"] == 1


def test_acceleration_noise_follows_the_kind():
    noise = TrackSettings().acceleration_std
    kinds = [VehicleClass(None, speed, 250.0, 15.0) for speed in (0.0, 20.0, 100.0)]
    assert [noise(kind) for kind in kinds] == [3.0, 10.0, 12.0]
    assert noise(replace(kinds[2], flies_on=True)) == 2.0


def test_vehicles_become_the_nearest_kind_of_the_mission_file():
    target = tracker(PURSUER, PARKED)
    target.observe(report(0.0, 990.0, 5.0, identity="a"), 0.0)
    target.observe(report(0.0, 995.0, 5.0, identity="b"), 0.0)
    target.observe(report(0.0, 0.0, 5.0, identity="c"), 0.0)
    a, b, c = target.tracks(0.0)
    assert (a.max_threat_radius_m, a.speed_max_m_s) == (600.0, 0.0)
    assert (b.max_threat_radius_m, b.speed_max_m_s) == (600.0, 25.0)  # one stands there, so this one moves
    assert (c.max_threat_radius_m, c.speed_max_m_s) == (400.0, 25.0)


def test_a_vehicle_that_comes_back_is_what_it_was():
    target = tracker(PURSUER, PARKED)
    target.observe(report(0.0, 0.0, 0.0, identity="vehicle"), 0.0)
    target.observe(report(100.0, 990.0, 0.0, identity="vehicle"), 100.0)
    assert target.counters["aged_out"] == 1
    assert target.tracks(100.0)[0].max_threat_radius_m == 400.0


def test_airborne_vehicles_are_of_a_kind_only_near_its_start():
    target = tracker()
    target.observe(report(0.0, 3000.0, 0.0, identity="far", emitter=Emitter.AIR, up_m=300.0), 0.0)
    target.observe(
        report(0.0, 100.0, 0.0, identity="near", emitter=Emitter.AIR, velocity=(1.0, 2.0, 3.0)), 0.0
    )
    far, near = target.tracks(0.0)
    assert far.is_airborne
    assert far.speed_max_m_s == VehicleClassSettings().air.speed_m_s
    assert far.position_enu_m[2] == pytest.approx(300.0, abs=0.01)
    assert near.max_threat_radius_m == 400.0
    assert near.velocity_enu_m_s[2] == 3.0


def test_with_too_many_vehicles_the_near_and_the_fresh_are_followed():
    target = tracker(num_tracks_max=2)
    target.note_ownship(1000.0, 0.0)
    target.observe(report(0.0, 900.0, identity="stale"), 0.0)
    target.observe(report(20.0, 5000.0, identity="far"), 20.0)
    target.observe(report(20.0, 1200.0, identity="near"), 20.0)
    assert [track.identity for track in target.tracks(20.0)] == ["far", "near"]
    target.observe(report(20.0, 1100.0, identity="nearer"), 20.0)
    target.observe(report(20.0, 9000.0, identity="farther"), 20.0)
    assert [track.identity for track in target.tracks(20.0)] == ["near", "nearer"]
    assert target.counters["evicted"] == 2
    assert target.counters["crowded"] == 1
    assert len(target) == 2


def test_estimates_do_not_depend_on_whom_else_is_seen():
    alone, together, shuffled = tracker(), tracker(), tracker()
    drive(alone, range(10))
    for stamp in range(10):
        both = [report(float(stamp), 10.0 * stamp), report(float(stamp), 5000.0, identity="icao:000001")]
        for each in both:
            together.observe(each, float(stamp))
        for each in both[::-1] if stamp else both:  # who starts first is of the pursuer's kind
            shuffled.observe(each, float(stamp))
    (expected,) = alone.tracks(10.0)
    for states in (together.tracks(10.0), shuffled.tracks(10.0)):
        assert [state.identity for state in states] == ["icao:000001", "icao:00ABCD"]
        assert states[1].position_enu_m == expected.position_enu_m
        assert np.array_equal(states[1].covariance, expected.covariance)


def test_asking_often_changes_nothing():
    often, once = tracker(), tracker()
    for stamp in range(10):
        drive(often, [stamp])
        often.tracks(stamp + 0.5)
    drive(once, range(10))
    assert often.tracks(10.0)[0].position_enu_m == once.tracks(10.0)[0].position_enu_m


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match="one track"):
        TrackerSettings(num_tracks_max=0)
    with pytest.raises(ValueError, match="exact"):
        TrackerSettings(position_std_min_m=0.0)
    with pytest.raises(ValueError, match="between 0 and 1"):
        TrackSettings(gate_probability=1.0)
    with pytest.raises(ValueError, match="least"):
        TrackSettings(moving_detections=0)
    with pytest.raises(ValueError, match="below the largest"):
        TrackSettings(acceleration_std_min_m_s2=20.0)
    with pytest.raises(ValueError, match="no number"):
        VehicleClassSettings(ground=VehicleClass(1, 1.0, 1.0, 1.0))


numbers = st.floats(allow_nan=True, allow_infinity=True)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.floats(-10.0, 200.0) | numbers,
            st.floats(-3e4, 3e4),
            st.floats(-3e4, 3e4),
            st.none() | st.tuples(st.floats(-300.0, 300.0), st.floats(-300.0, 300.0), numbers),
            st.none() | st.floats(0.0, 1e6) | numbers,
            st.sampled_from(["a", "b"]),
        ),
        max_size=10,
    )
)
def test_whatever_is_reported_tracks_stay_finite(rows):
    target = tracker(PURSUER, PARKED)
    for index, (stamp, east, north, velocity, std, identity) in enumerate(rows):
        entry = report(0.0, east, north, identity=identity, velocity=velocity, std=std)
        target.observe(replace(entry, stamp_s=stamp), 20.0 * index)
    for track in target.tracks(20.0 * len(rows)):
        assert np.isfinite([*track.position_enu_m, *track.velocity_enu_m_s, track.speed_max_m_s]).all()
        assert np.array_equal(track.covariance, track.covariance.T)
        assert np.linalg.eigvalsh(track.covariance).min() >= -1e-9 * np.trace(track.covariance)
    assert sum(target.counters[key] for key in target.counters if key not in ("aged_out", "evicted")) == len(
        rows
    )


def test_former_kinds_are_remembered_up_to_a_number():
    register = ThreatAssigner((PURSUER, PARKED), VehicleClassSettings())
    for number in range(REMEMBERED_MAX + 1):
        register.assigned(str(number), 0.0, 0.0, is_airborne=False)
        register.release(str(number))
    # Near the launcher, but what was the pursuer before is that again; the first is forgotten.
    assert register.assigned("1", 1000.0, 0.0, is_airborne=False).number == 0
    assert register.assigned("0", 1000.0, 0.0, is_airborne=False).number == 1


# --- who is taken for whom, and who gives way to whom


def test_who_comes_first_takes_nothing_away():
    """A fake far away, then the pursuer at its place: both are what the file says, or more."""
    register = ThreatAssigner((PURSUER, PARKED), VehicleClassSettings())
    fake = register.assigned("fake", 5000.0, 5000.0, is_airborne=False)
    true = register.assigned("true", 10.0, 0.0, is_airborne=False)
    second = register.assigned("second", 20.0, 0.0, is_airborne=False)
    assert (
        (true.number, true.max_threat_radius_m) == (second.number, second.max_threat_radius_m) == (0, 400.0)
    )
    assert fake.number is None
    assert fake.speed_m_s >= 25.0


def test_a_threat_far_from_its_start_can_do_what_the_file_says_and_what_a_stranger_can():
    fast = DynamicThreat("fast", (0.0, 0.0, 0.0), 33.0, 100.0, 20.0)
    kind = ThreatAssigner((fast,), VehicleClassSettings()).assigned("x", 4000.0, 0.0, is_airborne=False)
    assert (kind.speed_m_s, kind.max_threat_radius_m, kind.turn_radius_m) == (33.0, 250.0, 15.0)


def test_only_at_its_place_is_a_vehicle_taken_for_one_that_does_not_move():
    register = ThreatAssigner((PARKED,), VehicleClassSettings())
    assert register.assigned("near", 1250.0, 0.0, is_airborne=False).is_stationary
    assert register.assigned("far", 1350.0, 0.0, is_airborne=False) == VehicleClassSettings().ground


def test_what_is_named_by_identity_or_sender_is_nobody_else():
    named = replace(PURSUER, identity="icao:00ABCD")
    register = ThreatAssigner((named,), VehicleClassSettings())
    assert register.assigned("icao:00ABCE", 0.0, 0.0, is_airborne=False) == VehicleClassSettings().ground
    assert register.assigned("icao:00ABCD", 9000.0, 0.0, is_airborne=True).number == 0
    register = ThreatAssigner((replace(PURSUER, system_id=42),), VehicleClassSettings())
    assert register.assigned("a", 0.0, 0.0, is_airborne=False, system_id=43).number is None
    assert register.assigned("b", 0.0, 0.0, is_airborne=False, system_id=42).number == 0


def fakes(target, number, place_m, sender, *, first=0, now_s=0.0):
    for index in range(first, first + number):
        entry = report(now_s, *place_m(index), identity=f"icao:F{index:05d}")
        target.observe(replace(entry, source=f"ADSB_VEHICLE {sender}"), now_s)


def test_fakes_behind_do_not_crowd_out_a_vehicle_ahead():
    """70 within 300 m behind an aircraft that flies east at 25 m/s, and a true one 800 m ahead."""
    for senders in (("200/156",), ("200/156", "9/1")):
        target = tracker()
        target.note_ownship(0.0, 0.0, (25.0, 0.0))
        fakes(target, 70, lambda index: (-100.0 - 2.0 * index, 50.0), "200/156")
        target.observe(replace(report(1.0, 800.0), source=f"ADSB_VEHICLE {senders[-1]}"), 1.0)
        assert "icao:00ABCD" in {track.identity for track in target.tracks(1.0)}
        assert len(target) == 64


def test_fakes_of_one_sender_leave_room_for_those_of_another():
    """64 right ahead of the aircraft, all more dangerous than what another sender sees."""
    target = tracker()
    target.note_ownship(0.0, 0.0, (25.0, 0.0))
    fakes(target, 64, lambda index: (300.0 + index, 0.0), "66/1")
    for index in range(40):
        entry = report(1.0, 2000.0 + 10.0 * index, identity=f"icao:A{index:05d}")
        target.observe(replace(entry, source="ADSB_VEHICLE 200/156"), 1.0)
    kept = [track.identity for track in target.tracks(1.0)]
    assert sum(identity.startswith("icao:A") for identity in kept) == 32
    # And none of another sender's is lost to more of the first one's.
    fakes(target, 40, lambda index: (290.0, 0.0), "66/1", first=100, now_s=2.0)
    kept = [track.identity for track in target.tracks(2.0)]
    assert sum(identity.startswith("icao:A") for identity in kept) == 32


def test_what_the_mission_file_names_keeps_its_place():
    target = tracker(PURSUER)
    target.note_ownship(6000.0, 0.0, (25.0, 0.0))  # flies away from it
    target.observe(report(0.0, 0.0), 0.0)
    fakes(target, 500, lambda index: (6300.0 + index, 0.0), "66/1")
    assert "icao:00ABCD" in {track.identity for track in target.tracks(0.0)}


def test_who_is_followed_gives_way_to_what_is_clearly_more_dangerous_only():
    """At 1,000 m, closing at 50 m/s, 15 s; a newcomer needs less than 12 s, 850 m, or be within 800 m."""
    target = tracker(num_tracks_max=2)
    target.note_ownship(0.0, 0.0, (25.0, 0.0))
    for name, east in (("near", 500.0), ("followed", 1000.0), ("hardly", 900.0), ("clearly", 790.0)):
        target.observe(report(0.0, east, identity=name), 0.0)
    assert [track.identity for track in target.tracks(0.0)] == ["clearly", "near"]
    assert target.counters["crowded"] == 1


def test_one_who_finds_no_place_is_not_taken_for_what_stands_there():
    """Beside the launcher, but nobody follows it; the true one comes when there is room again."""
    target = tracker(PARKED, num_tracks_max=2)
    target.note_ownship(0.0, 0.0)
    fakes(target, 2, lambda index: (300.0 + index, 0.0), "66/1")
    target.observe(replace(report(0.0, 1010.0, identity="fake"), source="ADSB_VEHICLE 66/1"), 0.0)
    assert target.counters["crowded"] == 1
    target.observe(report(70.0, 1000.0), 70.0)  # the others have aged out
    (launcher,) = target.tracks(70.0)
    assert (launcher.identity, launcher.speed_max_m_s) == ("icao:00ABCD", 0.0)
