"""Aircraft that tell of themselves hunt nobody; one that does so in two ways is one."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter

from companion.tracking.track import TrackSettings
from companion.tracking.tracker import Tracker
from companion.types.events import Emitter
from companion.types.threat import DynamicThreat
from tests.tracking.reports import FRAME, report

NAMED = DynamicThreat("named", (0.0, 0.0, 0.0), 25.0, 400.0, 20.0, identity="icao:00ABCD")


def seen(target, identity, times, *, east=0.0, north=0.0, speed=60.0, emitter=Emitter.AIR, noise=None):
    for stamp in times:
        aside = (0.0, 0.0) if noise is None else 5.0 * noise.standard_normal(2)
        sighting = report(
            float(stamp), east + speed * stamp + aside[0], north + aside[1], velocity=(speed, 0.0, 0.0)
        )
        target.observe(replace(sighting, identity=identity, emitter=emitter), float(stamp))


@pytest.mark.parametrize(
    ("identity", "emitter", "flies_on"),
    [
        ("icao:00ABCE", Emitter.AIR, True), ("callsign:DLH1", Emitter.AIR, True),
        ("rid:0102", Emitter.AIR, True),
        ("utm:0102", Emitter.AIR, True), ("system:42", Emitter.AIR, False),
        ("icao:00ABCE", Emitter.GROUND, False),
        ("icao:00ABCD", Emitter.AIR, False),
    ],
)  # fmt: skip
def test_who_hunts_nobody(identity, emitter, flies_on):
    target = Tracker(FRAME, (NAMED,), seed=7)
    seen(target, identity, range(5), emitter=emitter)
    (track,) = target.tracks(5.0)
    assert track.flies_on is flies_on
    assert (track.max_threat_radius_m == 610.0) is flies_on


def test_what_flies_on_straight_is_foreseen_far_better_than_what_may_turn_at_once():
    spreads = {}
    for identity in ("icao:00ABCE", "system:42"):
        target = Tracker(FRAME, (), seed=7)
        seen(target, identity, range(30), noise=np.random.default_rng(1))
        (track,) = target.tracks(39.0)  # ten seconds after it was seen last
        spreads[identity] = np.sqrt(track.covariance[0, 0])
        assert track.position_enu_m[0] == pytest.approx(60.0 * 39.0, abs=3.0 * spreads[identity])
    assert spreads["icao:00ABCE"] < 0.4 * spreads["system:42"]


def followed_by_kalman(times, sightings, at_s, stds, acceleration_std):
    """filterpy's filter of the constant velocity model: position and velocity along one axis, both seen."""
    model = KalmanFilter(dim_x=2, dim_z=2)
    model.x, model.P = np.array(sightings[0]), np.diag(np.square(stds))
    model.H, model.R = np.eye(2), np.diag(np.square(stds))
    for elapsed_s, sighting in [
        *zip(np.diff(times), sightings[1:], strict=True), (at_s - times[-1], None)
    ]:  # fmt: skip
        noise = Q_continuous_white_noise(2, dt=elapsed_s, spectral_density=acceleration_std**2)
        model.predict(F=np.array([[1.0, elapsed_s], [0.0, 1.0]]), Q=noise)
        if sighting is not None:
            model.update(np.array(sighting))
    return model.x, model.P


def test_it_is_followed_as_the_kalman_filter_of_constant_velocity_follows_it():
    times, settings = np.array([0.0, 1.0, 2.5, 3.0, 7.0, 8.0, 9.0, 15.0]), TrackSettings()
    target, aside = Tracker(FRAME, (), seed=7), 5.0 * np.random.default_rng(1).standard_normal(len(times))
    for stamp, off in zip(times, aside, strict=True):
        sighting = report(stamp, 60.0 * stamp + off, 0.0, velocity=(60.0, 0.0, 0.0), std=5.0)
        target.observe(replace(sighting, identity="icao:00ABCE", emitter=Emitter.AIR), stamp)
    (track,) = target.tracks(25.0)
    sightings = [(60.0 * stamp + off, 60.0) for stamp, off in zip(times, aside, strict=True)]
    stds = (5.0, settings.filter.velocity_std_m_s)
    mean, covariance = followed_by_kalman(times, sightings, 25.0, stds, settings.steady_acceleration_std_m_s2)
    spread = np.sqrt(np.diag(covariance))
    assert track.position_enu_m[0] == pytest.approx(mean[0], abs=0.1 * spread[0])
    assert track.velocity_enu_m_s[0] == pytest.approx(mean[1], abs=0.1 * spread[1])
    assert np.asarray(track.covariance)[:2, :2] == pytest.approx(covariance, rel=0.05)


def test_one_aircraft_by_adsb_and_remote_id_is_one_track():
    target, noise = Tracker(FRAME, (), seed=7), np.random.default_rng(2)
    for second in range(30):
        seen(target, "icao:00ABCE", [second], noise=noise)
        seen(target, "rid:0102", [second + 0.3], noise=noise)
    (track,) = target.tracks(30.0)
    assert track.identity == "icao:00ABCE"
    assert track.observed_s == pytest.approx(29.3)  # what the other says counts as well
    assert target.counters["same_as_another"] == 1
    for second in range(30, 60):
        seen(target, "icao:00ABCE", [second], noise=noise)
        seen(target, "rid:0102", [second + 0.3], north=900.0, noise=noise)  # it was another's, after all
    assert sorted(state.identity for state in target.tracks(60.0)) == ["icao:00ABCE", "rid:0102"]


@pytest.mark.parametrize(("north", "speed"), [(150.0, 60.0), (0.0, 40.0)], ids=["beside", "slower"])
def test_two_aircraft_stay_two(north, speed):
    target, noise = Tracker(FRAME, (), seed=7), np.random.default_rng(3)
    for second in range(40):
        seen(target, "icao:00ABCE", [second], noise=noise)
        seen(target, "rid:0102", [second + 0.3], north=north, speed=speed, noise=noise)
    assert len(target.tracks(40.0)) == 2


def test_two_that_tell_in_the_same_way_are_never_one():
    target = Tracker(FRAME, (), seed=7)
    for second in range(40):
        seen(target, "icao:00ABCE", [second])
        seen(target, "icao:00ABCF", [second + 0.3])
    assert len(target.tracks(40.0)) == 2


def with_next(stamp_s, east_m, there_m, **stds):
    """A report of an aircraft that flies east at 60 m/s and names the point it flies to next."""
    sighting = report(
        stamp_s, east_m, velocity=(60.0, 0.0, 0.0), emitter=Emitter.AIR, identity="utm:01", up_m=100.0
    )
    return replace(sighting, next_point=FRAME.global_from_local(*there_m), **stds)


def test_an_aircraft_that_names_its_next_point_is_foreseen_there():
    """From (0, 0) it needs 20 s for 1,200 m to the north, and flies on north, level."""
    target = Tracker(FRAME, (), seed=7)
    target.observe(with_next(10.0, 0.0, (0.0, 1200.0, 160.0)), 10.0)
    (track,) = target.tracks(10.0)
    speed = np.hypot(*track.velocity_enu_m_s[:2])
    arrival_s = 10.0 + 1200.0 / speed
    places = track.places_enu_m(np.array([10.0, arrival_s, arrival_s + 10.0]))
    expected = [[0.0, 0.0, 100.0], [0.0, 1200.0, 160.0], [0.0, 1200.0 + 10.0 * speed, 160.0]]
    assert places == pytest.approx(np.array(expected), abs=12.0)  # 8 m is known of where it is.
    assert not track.keeps_route


@pytest.mark.parametrize("there", [(3.0, 0.0, 100.0), (90_000.0, 0.0, 100.0), (200_000.0, 0.0, 100.0)])
def test_a_next_point_that_says_nothing_is_left_out(there):
    """It is there; it needs 25 minutes to it; it lies beyond the frame."""
    target = Tracker(FRAME, (), seed=7)
    target.observe(with_next(10.0, 0.0, there), 10.0)
    assert target.tracks(10.0)[0].route is None


def test_reported_deviations_are_used_down_to_the_smallest_that_is_believed():
    spreads, heights = [], []
    for velocity_std, altitude_std in ((5.0, 30.0), (0.5, 3.0), (1e-3, 1e-3)):
        target = Tracker(FRAME, (), seed=7)
        for stamp in range(10):
            target.observe(
                with_next(float(stamp), 60.0 * stamp, (0.0, 0.0, 0.0), position_std_m=50.0,
                          velocity_std_m_s=velocity_std, altitude_std_m=altitude_std), float(stamp),
            )  # fmt: skip
        (track,) = target.tracks(9.0)
        spreads.append(np.sqrt(track.covariance[1, 1]))
        heights.append(track.height_std_m)
    assert spreads[0] > 1.5 * spreads[1] > spreads[2]
    assert heights == [30.0, 3.0, 1.0]
