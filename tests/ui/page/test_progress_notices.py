"""What is heard between two rows of the recording, told to who looks on: at once, and not too often."""

import itertools
import json

import pytest

from companion.config import mission_from_text
from companion.flight.tasks.progress_notices import POSITIONS_HZ, TRACKS_HZ
from companion.recording import mcap_schema as channels
from companion.recording.recorder import TRACK
from companion.ui.page.feed import Feed
from tests.support.sitl_harness import FIRST_FLIGHT, SitlHarness
from tests.tracking.reports import report

UNTIL_S, FLOODED_S = 12.0, 8.0


def flown(*, is_watched=True, flood=0, identity="icao:00F100", more=""):
    """A flight, and what was told of it: (when, topic, message, whether it was written down)."""
    harness, told = SitlHarness(mission_from_text(FIRST_FLIGHT + more, "first-flight.yaml")), []

    def add_viewer(topic, data):
        told.append((harness.now_s, topic, json.loads(data), False))

    def listen(topic, _now_s, _message, data):
        told.append((harness.now_s, topic, json.loads(data), True))

    harness.recorder.listen(listen, add_viewer if is_watched else None)

    def step(harness):
        if harness.now_s >= FLOODED_S:
            for number in range(flood):
                vehicle = report(harness.now_s, 800.0 + 0.1 * number, 300.0, identity=identity)
                harness.app._take(vehicle, harness.now_s)

    harness.fly(UNTIL_S, step)
    return harness, told


@pytest.fixture(scope="module")
def watched():
    return flown()


def test_each_position_is_told_as_it_is_heard(watched):
    """The autopilot tells its place ten times a second, the recording has five rows."""
    _, told = watched
    places = [
        (at, message["stamp_s"], is_written)
        for at, topic, message, is_written in told
        if topic == channels.OWNSHIP and at > 5.0
    ]
    progress_notices = [at for at, _, is_written in places if not is_written]
    assert len(progress_notices) == pytest.approx(POSITIONS_HZ * (UNTIL_S - 5.0), abs=2)
    assert max(later - earlier for earlier, later in itertools.pairwise(progress_notices)) < 0.15
    assert all(stamp_s == pytest.approx(at, abs=0.03) for at, stamp_s, _ in places), "moved on to now"


def test_a_vehicle_is_told_as_it_is_heard_and_the_next_row_says_the_same(watched):
    harness, told = watched
    heard = [(at, message["track"]) for at, topic, message, _ in told if topic == TRACK]
    assert heard
    assert {track["identity"] for _, track in heard} == {
        track.identity for track in harness.app.world_model.tracker.tracks(UNTIL_S)
    }
    row_s, row = next(
        (at, message["tracks"])
        for at, topic, message, _ in told
        if topic == channels.TRACKS and at > heard[0][0]
    )
    last = next(track for at, track in reversed(heard) if at <= row_s)
    assert [track["identity"] for track in row] == [last["identity"]]
    assert row[0]["position_enu_m"] == pytest.approx(last["position_enu_m"], abs=0.5)


def test_nothing_hangs_on_it(watched):
    """The same flight with nobody looking: the same rows, plans and decisions."""
    _, told = watched
    _, alone = flown(is_watched=False)
    assert all(is_written for *_, is_written in alone)
    kept = [entry for entry in told if entry[3]]
    assert [entry[:2] for entry in alone] == [entry[:2] for entry in kept]
    rows = [message for _, topic, message, _ in kept if topic in (channels.OWNSHIP, channels.TRACKS)]
    assert rows == [message for _, topic, message, _ in alone if topic in (channels.OWNSHIP, channels.TRACKS)]


def test_a_flood_is_told_no_more_often_than_it_can_be_looked_at():
    _, told = flown(flood=4)  # two hundred reports a second
    progress_notices = [at for at, topic, *_ in told if topic == TRACK and at >= FLOODED_S]
    assert len(progress_notices) <= TRACKS_HZ * (UNTIL_S - FLOODED_S + 1.0)
    assert len(progress_notices) >= 0.9 * TRACKS_HZ * (UNTIL_S - FLOODED_S)


def test_the_feed_passes_it_on_and_keeps_it_for_nobody():
    feed, woken = Feed(), []
    feed.wake_by(lambda: woken.append(1))
    feed.notice(TRACK, b'{"stamp_s":1.0}')
    assert woken == [1]
    assert feed.news() == ([b'/track {"stamp_s":1.0}'], False)
    assert not [line for line in feed.snapshot() if line.startswith(b"/track")]


def test_a_member_of_a_team_is_not_told_as_a_vehicle_that_was_detected():
    _, told = flown(flood=1, identity="system:2", more="team: {members: [1, 2]}\n")
    tracks = [message["track"]["identity"] for _, topic, message, _ in told if topic == TRACK]
    assert "system:2" not in tracks
    rows = [
        message["tracks"] for at, topic, message, _ in told if topic == channels.TRACKS and at > FLOODED_S
    ]
    assert any(row["identity"] == "system:2" and row["flies_on"] for tracks in rows for row in tracks)
