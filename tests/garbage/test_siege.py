"""A short siege of the service; ``make garbage`` lays one of an hour."""

import pytest

from tests.garbage.hostile import LAYOUTS, NUMBER_OF, READ, Hostile
from tests.garbage.siege import Siege


@pytest.fixture(scope="module")
def siege():
    return Siege(seed=2).run(20.0)


def test_no_exception_leaves_the_service(siege):
    assert siege.exceptions == {}, siege.first_trace
    assert siege.duration_s == pytest.approx(20.0)


def test_a_heartbeat_of_ours_leaves_in_every_second(siege):
    assert siege.heartbeats_missed == 0
    assert 19 <= len(siege.heartbeats_s) <= 21


def test_missed_heartbeats_are_counted():
    silent = Siege()
    silent.duration_s = 10.0
    silent.heartbeats_s = [1.0, 2.0, 3.0, 5.05, 6.0, 7.0, 9.0]
    assert silent.heartbeats_missed == 2  # of the seconds 1 to 9, those that begin at 4 and 8


def test_what_is_hostile_is_dropped_under_its_reason(siege):
    link, tracker = siege.app.codec.counters, siege.app.picture.tracker.counters
    for reason in ("bad_checksum", "setup_signing", "refused_track_position", "unknown_message"):
        assert link[reason] > 100, reason
    assert link["accepted"] > 10_000
    assert tracker["crowded"] > 1_000


def test_no_more_vehicles_are_followed_than_can_be(siege):
    assert len(siege.hostile.identities) > 5_000
    assert len(siege.app.picture.tracker) == 64


def test_the_aircraft_is_still_followed(siege):
    assert siege.app.hears_autopilot
    assert siege.app.codec.vehicle_system_id == 1


def test_the_same_seed_makes_the_same_traffic():
    assert Hostile(5).messages(500) == Hostile(5).messages(500)
    assert Hostile(5).messages(500) != Hostile(6).messages(500)


def test_every_kind_that_is_read_has_a_layout():
    assert all(LAYOUTS[NUMBER_OF[kind]] for kind in READ)
