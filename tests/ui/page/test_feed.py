"""What a viewer is told on connection, and afterwards; whatever the server does, what waits is bounded."""

import json

import pytest

from companion.recording import mcap_schema as channels
from companion.ui.page.feed import HISTORY_MAX, NEWS_MAX, Feed
from tests.ui.page.flown import Told, ownship


def parsed(lines):
    """Topics, and what they say."""
    found = [line.partition(b" ") for line in lines]
    return [(topic.decode(), json.loads(data)) for topic, _, data in found]


def told_on(feed):
    return parsed(feed.snapshot())


@pytest.fixture
def feed():
    return Feed()


def test_news_are_the_recorders_own_messages(feed):
    told = Told(feed.tell)
    topics = []
    feed.news()
    told.fly(1)
    lines, is_lost = feed.news()
    assert not is_lost
    topics = [topic for topic, _ in parsed(lines)]
    assert topics[:4] == ["/snapshot", "/plan", "/trees", "/swap"]
    assert topics[4:8] == ["/decision", "/ownship", "/tracks", "/threat"]
    assert "/location" not in topics, "the same place once more"
    assert feed.news() == ([], False), "told once"


def test_the_world_is_made_of_the_mission_file_in_the_servers_thread(feed):
    Told(feed.tell)
    assert feed.world is None, "not in the flight's"
    [(topic, world), *_], _ = parsed(feed.news()[0]), None
    assert topic == "/world"
    assert (world["name"], world["dimension"], world["sensing_horizon_m"]) == ("made-up", 3, 600.0)
    assert [wall["name"] for wall in world["obstacles"]] == ["wall", "hut"]
    assert world["obstacles"][0]["top_m"] == 300.0
    assert world["radars"][0]["max_threat_radius_m"] == 800.0
    assert world["goals"] == [[1900.0, 750.0, 120.0, pytest.approx(60.0)]]


def test_a_mission_file_that_cannot_be_read_is_told(feed):
    feed.tell(channels.MISSION, 0.0, {"mission_file": "name: [", "name": "x"}, b"{}")
    [(topic, world)] = parsed(feed.news()[0])
    assert topic == "/world"
    assert "error" in world


def test_who_comes_later_learns_the_flight_so_far(feed):
    told = Told(feed.tell)
    told.fly(20)
    feed.news()
    lines = told_on(feed)
    assert [topic for topic, _ in lines[:3]] == ["/reset", "/world", "/history"]
    rows = lines[2][1]["rows"]
    assert [row[0] for row in rows] == pytest.approx([float(second) for second in range(20)])
    assert rows[3][1:] == [175.0, 750.0, 120.0, 25.0, 0.0], "five metres a fifth of a second"
    last = dict(lines)
    assert last["/swap"]["waypoints_enu_m"][1] == [900.0, 1000.0, 120.0]
    assert last["/decision"]["text"] == "first plan, cost 100.0; item 3 of 5"
    assert last["/ownship"]["stamp_s"] == pytest.approx(19.8)
    assert last["/plan"]["covariances_m2"][0] == [9.0, 0.0, 4.0, 1.0]
    assert len(last["/trees"]["tree_parents"]) == 51


def test_the_plan_that_is_flown_is_told_beside_the_last_one(feed):
    told = Told(feed.tell)
    told.plan(1, 0.0)
    told.swap(1, 0.5)
    for number in range(2, 30):
        told.plan(number, 10.0 * number, first_s=500.0, flown_first_s=400.0)
    plans = [message for topic, message in told_on(feed) if topic == "/plan"]
    assert [message["number"] for message in plans if "path" in message] == [1, 29]
    briefs = [message for message in plans if "path" not in message]
    assert len(briefs) == 29
    assert briefs[0]["pursuit"]["first_s"] is None, "never"
    assert briefs[-1]["flown_pursuit"]["first_s"] == 400.0


def test_fences_are_told_however_long_ago_they_were_read(feed):
    told = Told(feed.tell)
    told.plan(1, 0.0)
    told.plan(2, 10.0)
    snapshots = [message for topic, message in told_on(feed) if topic == "/snapshot"]
    assert [("obstacles" in message) for message in snapshots] == [True, False]


def test_another_flight_begins_anew(feed):
    Told(feed.tell).fly(3)
    feed.news()
    feed.begin_flight()
    assert parsed(feed.news()[0]) == [("/reset", {})]
    assert [topic for topic, _ in told_on(feed)] == ["/reset", "/history"]


def test_a_long_flight_takes_no_more_room(feed):
    told = Told(feed.tell)
    for second in range(3 * HISTORY_MAX):
        told.recorder.state(float(second), ownship(float(second)), (), 0.0)
    rows = dict(told_on(feed))["/history"]["rows"]
    assert HISTORY_MAX / 2 <= len(rows) <= HISTORY_MAX
    assert rows[-1][0] >= 3 * HISTORY_MAX - 10
    stamps = [row[0] for row in rows]
    assert stamps == sorted(stamps)


def test_a_server_that_takes_nothing_costs_a_bounded_number_of_lines(feed):
    told = Told(feed.tell)
    for tick in range(NEWS_MAX):
        told.state(0.2 * tick)
    assert len(feed._news) <= NEWS_MAX
    lines, is_lost = feed.news()
    assert is_lost, "viewers have to begin anew"
    assert not [topic for topic, _ in parsed(lines) if topic != "/world"]
    told.state(1e4)
    assert not feed.news()[1]


def test_it_wakes_the_server(feed):
    woken = []
    feed.wake_by(lambda: woken.append(1))
    Told(feed.tell).state(1.0)
    assert len(woken) == 4, "begin, ownship, tracks, threat"
