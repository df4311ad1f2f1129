"""Aircraft that tell of themselves hunt nobody; one that does so in two ways is one."""

from dataclasses import replace

import numpy as np
import pytest

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
