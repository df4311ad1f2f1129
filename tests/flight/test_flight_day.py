"""Flying days from power-on to landing, in the orders in which operators really do things."""

import itertools
import math
import re

import numpy as np
import pytest

from companion.config import mission_from_text
from companion.flight.state.modes import Mode
from companion.types.events import Dialect
from companion.types.mission import Command
from tests.flight.test_app import at, both, when
from tests.flight.test_operator import BOTH, MISSION_MODE, bare, placed, upload
from tests.sim.client import PLAIN
from tests.support.sitl_harness import SitlHarness

TAKEOFF_M, GOAL, RUNWAY = 60.0, (1750.0, 750.0), (950.0, 1350.0)
FLIGHT_S = 200.0
FIRST = {Dialect.ARDUPILOT: 1, Dialect.PX4: 0}  # sequence of the list's first item
PILOTS_MODE = {Dialect.ARDUPILOT: "FBWA", Dialect.PX4: "STABILIZED"}


def operator_items(harness, extra=(), goal=GOAL):
    """Take-off, a waypoint at the goal, and a landing behind it."""
    pattern = goal[0], goal[1] + 600.0
    return [
        placed(harness, Command.NAV_TAKEOFF, 0.0, 0.0, TAKEOFF_M),
        *extra,
        placed(harness, Command.NAV_WAYPOINT, *goal),
        bare(Command.DO_LAND_START),
        placed(harness, Command.NAV_LOITER_TO_ALT, *pattern, 40.0, (1.0, 150.0, 0.0, 1.0)),
        placed(harness, Command.NAV_LAND, pattern[0] - 800.0, pattern[1], 0.0),
    ]


def uploaded(stamp_s, *extra, goal=GOAL):
    def act(harness):
        items = operator_items(harness, [placed(harness, *item) for item in extra], goal)
        upload(harness, items, 0)

    return at(stamp_s, act)


def off(stamp_s):
    """The operator selects the mission mode and arms."""

    def go(harness):
        harness.simulator.set_mode(MISSION_MODE[harness.flight.dialect])
        harness.simulator.autopilot.arm()

    return at(stamp_s, go)


def day(dialect, until_s, *steps, takeover="", text=PLAIN):
    mission = mission_from_text(text + takeover, "day.yaml")
    return SitlHarness(mission, dialect=dialect, on_ground=True).fly(until_s, both(*steps))


def modes(harness):
    return [(entry.stamp_s, entry.text.rpartition(" (")[0]) for entry in harness.recorder.decisions
            if entry.kind in ("mode", "suspended", "arrived")]  # fmt: skip


def taken_over_s(harness):
    return next(stamp for stamp, text in modes(harness) if text == Mode.ACTIVE.value)


def first_swap_s(harness):
    return next(entry.stamp_s for entry in harness.recorder.decisions if entry.kind == "swap")


def has_landed_at(harness, place):
    autopilot = harness.simulator.autopilot
    assert not autopilot.is_armed
    assert autopilot.flight.is_standing
    assert math.dist(autopilot.flight.position, place) < 150.0


def passed(harness, place):
    path = np.array(harness.simulator.truth.path)[:, 1:3]
    return np.linalg.norm(path - place, axis=1).min() <= 60.0


@pytest.fixture(scope="module", params=list(Dialect), ids=lambda dialect: dialect.value)
def plain_day(request):
    """The service at boot, the mission uploaded on the ground, and off."""
    heights = []

    def watch(harness):
        heights.append((harness.now_s, harness.simulator.autopilot.flight.estimate.up_m))

    harness = day(request.param, FLIGHT_S, uploaded(5.0), off(12.0), watch)
    harness.heights = dict(heights)
    return harness


def test_the_service_at_boot_flies_to_the_goal_and_the_operators_items_to_the_ground(plain_day):
    assert [text for _, text in modes(plain_day)] == [
        Mode.STANDBY.value, Mode.DEPARTING.value, Mode.ACTIVE.value, "at the last goal", Mode.STANDBY.value,
    ]  # fmt: skip
    assert passed(plain_day, GOAL)
    has_landed_at(plain_day, RUNWAY)
    assert plain_day.texts("landed") == ["the flight is over"]


def test_the_take_off_is_the_operators(plain_day):
    over_s = taken_over_s(plain_day)
    assert plain_day.changes(before_s=over_s) == []
    height = min(plain_day.heights.items(), key=lambda entry: abs(entry[0] - over_s))[1]
    assert height >= TAKEOFF_M - 5.0


def test_the_first_plan_is_ready_by_then(plain_day):
    over_s = taken_over_s(plain_day)
    ready = [entry for entry in plain_day.recorder.decisions if entry.kind == "ready"]
    assert ready[0].stamp_s < over_s
    assert ready[0].text.startswith("first plan, ")
    assert first_swap_s(plain_day) - over_s < 6.0


def test_what_was_uploaded_is_answered_on_the_ground(plain_day):
    returns = "flies straight home"  # RTL_AUTOLAND 0, and RTL_TYPE 0
    texts = [entry for entry in plain_day.recorder.decisions if 5.0 < entry.stamp_s < 8.0]
    assert [(entry.kind, entry.text) for entry in texts] == [
        ("mission", "5 items, 1 goal, 1.9 km"),
        ("takeover", "after item 1"),
        ("mission", "landing from item 3 (DO_LAND_START)"),
        ("return", returns),
    ]
    said = [message.text for stamp, message in plain_day.said("STATUSTEXT") if 5.0 < stamp < 8.0]
    assert said == [
        "Mission read: 5 items, 1 goal, 1.9 km",
        "Planner takes over after item 1",
        "After the goal landing from item 3 (DO_LAND_START)",
        f"RTL here {returns}",
    ]


def test_before_that_nothing_is_in_it(plain_day):
    assert plain_day.texts("fault") == ["no mission in the autopilot"]


def test_no_words_are_repeated_within_half_a_minute(plain_day):
    said = [(message.text, stamp) for stamp, message in plain_day.said("STATUSTEXT")]
    for text in {text for text, _ in said}:
        stamps = [stamp for same, stamp in said if same == text]
        assert all(b - a >= 30.0 for a, b in itertools.pairwise(stamps)), text


@BOTH
def test_a_change_of_mind_on_the_ground_is_read_and_answered_each_time(dialect):
    harness = day(
        dialect, 75.0, uploaded(5.0), uploaded(9.0, (Command.NAV_WAYPOINT, 500.0, 0.0)), uploaded(13.0),
        off(18.0),
    )  # fmt: skip
    counts = [text.partition(" ")[0] for text in harness.texts("mission") if "items" in text]
    assert counts == ["5", "6", "5"]
    assert harness.texts("suspended") == []
    assert harness.app.mode is Mode.ACTIVE
    assert harness.app.num_swaps >= 1


@BOTH
def test_what_is_wrong_with_a_list_is_said_on_the_ground(dialect):
    wall = "obstacles:\n  - {name: wall, polygon_enu_m: [[700, -50], [760, -50], [760, 50], [700, 50]], "
    wall += "base_m: 0, top_m: 300}\ntakeover: {when: item, item: 2}\n"
    harness = SitlHarness(mission_from_text(PLAIN + wall, "day.yaml"), dialect=dialect, on_ground=True)
    harness.fly(12.0, uploaded(5.0, (Command.NAV_WAYPOINT, 1200.0, 0.0)))
    assert "after item 2" in harness.texts("takeover")
    assert "to item 2: 0 m from wall" in harness.texts("fault")


@BOTH
@pytest.mark.parametrize(("north_m", "is_in_the_way"), [(1350, True), (1600, False)])
def test_an_obstacle_before_the_touchdown_is_said_on_the_ground(dialect, north_m, is_in_the_way):
    """The landing leads from (1750, 1350), 40 m up, to (950, 1350) on the ground."""
    south, north = north_m - 40, north_m + 40
    corners = f"[[1300, {south}], [1340, {south}], [1340, {north}], [1300, {north}]]"
    hangar = f"obstacles:\n  - {{name: hangar, polygon_enu_m: {corners}, base_m: 0, top_m: 60}}\n"
    harness = SitlHarness(mission_from_text(PLAIN + hangar, "day.yaml"), dialect=dialect, on_ground=True)
    harness.fly(9.0, uploaded(5.0))
    assert ("to item 5: 0 m from hangar" in harness.texts("fault")) is is_in_the_way


@pytest.mark.parametrize(
    ("takeover", "extra", "is_due"),
    [
        ("takeover: {when: item, item: 2}", (Command.NAV_WAYPOINT, 900.0, 0.0), lambda p: p[0] > 780.0),
        ("takeover: {when: height, up_m: 80}", (Command.NAV_WAYPOINT, 900.0, 0.0), lambda p: p[2] > 75.0),
        (
            "takeover: {when: holding}",
            (Command.NAV_LOITER_UNLIM, 900.0, 0.0, 100.0, (0.0, 0.0, 140.0, None)),
            lambda p: math.hypot(p[0] - 900.0, p[1]) < 215.0,
        ),
    ],
    ids=["item", "height", "holding"],
)
@BOTH
def test_the_mission_file_says_from_when_on_the_service_flies(dialect, takeover, extra, is_due):
    track = []

    def watch(harness):
        estimate = harness.simulator.autopilot.flight.estimate
        track.append((harness.now_s, (estimate.east_m, estimate.north_m, estimate.up_m)))

    harness = day(dialect, 110.0, uploaded(5.0, extra), off(10.0), watch, takeover=takeover)
    over_s = taken_over_s(harness)
    assert is_due(min(track, key=lambda entry: abs(entry[0] - over_s))[1])
    assert harness.changes(before_s=over_s) == []
    assert first_swap_s(harness) - over_s < 8.0
    assert passed(harness, GOAL) or harness.app.mode is Mode.ACTIVE


@BOTH
def test_an_aborted_take_off_and_a_switch_on_the_ground_suspend_nothing(dialect):
    def disarmed(harness):
        harness.simulator.autopilot._disarm()

    harness = day(dialect, 60.0, uploaded(5.0), off(10.0), at(11.0, disarmed), off(16.0))
    assert harness.texts("suspended") == []
    assert harness.app.mode is Mode.ACTIVE
    assert harness.app.num_swaps >= 1


@BOTH
def test_a_mission_changed_in_the_climb_is_the_operators_still(dialect):
    harness = day(
        dialect, 70.0, uploaded(5.0), off(10.0), uploaded(16.0, (Command.NAV_WAYPOINT, 600.0, 50.0))
    )
    assert harness.texts("suspended") == []
    assert any(text.startswith("6 items") for text in harness.texts("mission"))
    assert harness.app.num_swaps >= 1


@BOTH
def test_a_pilot_who_flies_the_climb_himself_hands_over_afterwards(dialect):
    mode = MISSION_MODE[dialect]
    harness = day(
        dialect, 75.0, uploaded(5.0), off(10.0),
        at(16.0, lambda h: h.simulator.set_mode(PILOTS_MODE[dialect])),
        at(22.0, lambda h: h.simulator.set_mode(mode)),
    )  # fmt: skip
    assert harness.changes(before_s=22.0) == []
    assert harness.texts("suspended") == []
    assert harness.app.num_swaps >= 1


@BOTH
def test_two_flights_a_day_without_a_restart(dialect):
    """The second begins where the first landed, with the list as it was left: ours are in it still."""
    step, done = when(lambda harness: harness.texts("landed") != [], lambda harness: None)

    def again(harness):
        if done and harness.now_s > done[0] + 5.0 and not harness.simulator.autopilot.is_armed:
            off(0.0)(harness)

    harness = day(dialect, 290.0, uploaded(5.0), off(12.0), step, again)
    over = [stamp for stamp, text in modes(harness) if text == Mode.ACTIVE.value]
    assert len(over) == 2
    assert harness.changes(after_s=done[0], before_s=over[1]) == []
    assert [stamp for stamp, text in modes(harness) if text == "at the last goal"] != []
    assert any(entry.kind == "swap" and entry.stamp_s > over[1] for entry in harness.recorder.decisions)


def test_another_mission_of_as_many_items_is_seen_though_nobody_tells():
    """An ArduPlane 4.6 tells the end of an upload on that link alone, and its missions have no names."""
    other = (1500.0, -600.0)

    def in_silence(harness):
        autopilot = harness.simulator.autopilot
        say, autopilot.say = autopilot.say, lambda severity, text: None
        upload(harness, operator_items(harness, goal=other), 0)
        autopilot.say = say

    text = re.sub(r"goals:\n  - \{[^}]*\}", "goals: from_autopilot", PLAIN)
    for stamp_s in (8.0, 11.5, 20.0):  # on the ground, just before arming, in the climb
        harness = day(Dialect.ARDUPILOT, 60.0, uploaded(2.0), at(stamp_s, in_silence), off(12.0), text=text)
        assert harness.texts("suspended") == []
        assert [goal.position_enu_m[:2] for goal in harness.app.state.goals] == [
            pytest.approx(other, abs=0.1)
        ]
        assert harness.app.num_swaps >= 1
