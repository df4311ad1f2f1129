"""A short session of the service; ``make hostile`` lays one of an hour."""

import pytest

from tests.hostile.hostile_hour import HostileSession
from tests.hostile.messages import LAYOUTS, NUMBER_OF, READ, Hostile


@pytest.fixture(scope="module")
def session():
    return HostileSession(seed=2).run(20.0)


def test_no_exception_leaves_the_service(session):
    assert session.exceptions == {}, session.first_trace
    assert session.duration_s == pytest.approx(20.0)


def test_a_heartbeat_of_ours_leaves_in_every_second(session):
    assert session.heartbeats_missed == 0
    assert 19 <= len(session.heartbeats_s) <= 21


def test_missed_heartbeats_are_counted():
    silent = HostileSession()
    silent.duration_s = 10.0
    silent.heartbeats_s = [1.0, 2.0, 3.0, 5.05, 6.0, 7.0, 9.0]
    assert silent.heartbeats_missed == 2  # of the seconds 1 to 9, those that begin at 4 and 8


def test_what_is_hostile_is_dropped_under_its_reason(session):
    link, tracker = session.app.link.codec.counters, session.app.world_model.tracker.counters
    for reason in ("bad_checksum", "setup_signing", "refused_track_position", "unknown_message"):
        assert link[reason] > 100, reason
    assert link["accepted"] > 10_000
    assert link["total_limited"] > 1_000  # of strangers' messages, before they are looked into
    assert tracker["crowded"] > 100


def test_no_more_vehicles_are_followed_than_can_be(session):
    assert len(session.hostile.identities) > 5_000
    assert len(session.app.world_model.tracker) == 64


def test_the_aircraft_is_still_followed(session):
    assert session.app.receives_autopilot
    assert session.app.link.codec.vehicle_system_id == 1


def test_the_same_seed_makes_the_same_traffic():
    assert Hostile(5).messages(500) == Hostile(5).messages(500)
    assert Hostile(5).messages(500) != Hostile(6).messages(500)


def test_every_kind_that_is_read_has_a_layout():
    assert all(LAYOUTS[NUMBER_OF[kind]] for kind in READ)
