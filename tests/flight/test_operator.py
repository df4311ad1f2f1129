"""The operator's mission through a flight, on both autopilots: kept, followed, and given back."""

import re
from dataclasses import replace

import numpy as np
import pytest

from companion.config import mission_from_text
from companion.flight.state.checkpoint import Checkpoint
from companion.flight.state.modes import Mode
from companion.types.events import Dialect
from companion.types.mission import Command, MavFrame, MissionItem
from sim.autopilot.px4.px4_store import stored
from sim.mission_types import MissionKind
from tests.flight.test_app import at, both, switch, when
from tests.sim.client import PLAIN
from tests.support.sitl_harness import FIRST_FLIGHT, SitlHarness

BOTH = pytest.mark.parametrize("dialect", list(Dialect), ids=lambda dialect: dialect.value)
CAMERA = 203
MISSION_MODE = {Dialect.ARDUPILOT: "AUTO", Dialect.PX4: "MISSION"}
FROM_AUTOPILOT = re.sub(r"goals:\n  - \{[^}]*\}", "goals: from_autopilot", PLAIN)
WAYPOINTS = [(500.0, 0.0), (1000.0, 300.0)]


def placed(harness, command, east, north, up=100.0, parameters=(0.0, 0.0, 0.0, None)):
    latitude, longitude = harness.simulator.autopilot.projection.degrees(east, north)
    frame = MavFrame.GLOBAL_RELATIVE_ALT_INT
    return MissionItem(0, command, frame, parameters, round(latitude * 1e7), round(longitude * 1e7), up)


def bare(command, *parameters):
    return MissionItem(0, command, MavFrame.MISSION, (*parameters, 0.0, 0.0, 0.0, 0.0)[:4], 0, 0, 0.0)


def operator_items(harness, places=WAYPOINTS):
    """Takeoff, waypoints with a photo at each, a landing pattern 900 m north."""
    items = [placed(harness, Command.NAV_TAKEOFF, 0.0, 0.0)]
    for place in places:
        items += [placed(harness, Command.NAV_WAYPOINT, *place), bare(CAMERA, 1.0)]
    items.append(bare(Command.DO_LAND_START))
    items.append(placed(harness, Command.NAV_LOITER_TO_ALT, 0.0, 1000.0, 60.0, (1.0, 150.0, 0.0, 1.0)))
    items.append(placed(harness, Command.NAV_LAND, 0.0, 0.0, 0.0))
    return items


def upload(harness, items, current):
    """Put a mission into the autopilot as another uploader's exchange leaves it."""
    autopilot = harness.simulator.autopilot
    if harness.flight.dialect is Dialect.PX4:
        autopilot.switch(MissionKind.MISSION, stored(renumbered(items)), current)
        return
    numbered = renumbered([autopilot.store.mission[0], *items])
    autopilot.store.truncate(MissionKind.MISSION, len(numbered))
    for entry in numbered:
        autopilot.store.put(MissionKind.MISSION, entry)
    autopilot.say(6, "Flight plan received")
    autopilot._set_current(current + 1)


def renumbered(items):
    return tuple(replace(entry, sequence=n) for n, entry in enumerate(items))


def deck_of(text, dialect, items=None):
    harness = SitlHarness(mission_from_text(text, "operator.yaml"), dialect=dialect)
    if items is not None:
        harness.simulator.step(0.02)
        upload(harness, items(harness), 1)
        harness.simulator.step(0.2)
    return harness


def places_of(harness, items):
    projection = harness.simulator.autopilot.projection
    return [
        tuple(round(value) for value in projection.local(e.latitude_e7 * 1e-7, e.longitude_e7 * 1e-7))
        for e in items
        if e.latitude_e7
    ]


@BOTH
def test_the_operators_waypoints_are_flown_to_with_what_is_done_there_and_the_landing_is_flown_on_to(dialect):
    harness = deck_of(FROM_AUTOPILOT, dialect, operator_items)
    autopilot = harness.simulator.autopilot
    commands, photos, do = [], [], autopilot.do

    def note(item):
        do(item)
        if item.command == CAMERA:
            photos.append(autopilot.flight.position)

    def watch(harness):
        if autopilot.current_sequence < len(autopilot.mission_items):
            commands.append(autopilot.mission_items[autopilot.current_sequence].command)

    autopilot.do = note
    harness.fly(90.0, watch)
    assert harness.app.mode is Mode.ARRIVED
    goals = [goal.position_enu_m for goal in harness.app.state.goals]
    np.testing.assert_allclose(goals, [(*place, 100.0) for place in WAYPOINTS], atol=0.1)
    flown = np.array(harness.simulator.truth.path)[:, 1:3]
    for place in WAYPOINTS:
        assert np.linalg.norm(flown - place, axis=1).min() <= 60.0
    assert Command.NAV_LOITER_TO_ALT in commands[-1000:]
    for position, place in zip(photos, WAYPOINTS, strict=True):
        assert np.linalg.norm(np.subtract(position, place)) < 120.0


@BOTH
def test_all_items_of_the_operator_survive_every_swap(dialect):
    three = [*WAYPOINTS, (2000.0, 0.0)]
    harness = deck_of(FROM_AUTOPILOT, dialect, lambda harness: operator_items(harness, three))
    before = places_of(harness, operator_items(harness, three))
    lost = []

    def watch(harness):
        if not set(before) <= set(places_of(harness, harness.simulator.autopilot.mission_items)):
            lost.append(harness.now_s)

    harness.fly(75.0, watch)
    assert harness.app.num_swaps >= 2
    # ArduPlane cuts the list at each upload; the items come back where they were.
    assert lost == [] or dialect is Dialect.ARDUPILOT
    assert set(before) <= set(places_of(harness, harness.simulator.autopilot.mission_items))


def another(harness):
    """A ground station uploads: one waypoint and a landing."""
    items = operator_items(harness, [(900.0, -400.0)])
    upload(harness, items, 1)


@BOTH
def test_another_mission_is_respected_where_the_goals_are_the_files(dialect):
    harness = deck_of(PLAIN, dialect).fly(40.0, at(15.0, another))
    assert harness.app.mode is Mode.YIELDED
    assert harness.changes(after_s=18.0) == []
    assert (900, -400) in places_of(harness, harness.simulator.autopilot.mission_items)
    assert "other mission or item" in harness.texts("suspended")[-1]


@BOTH
def test_another_mission_becomes_the_reference_where_the_goals_are_the_operators(dialect):
    harness = deck_of(FROM_AUTOPILOT, dialect, operator_items).fly(75.0, at(15.0, another))
    assert harness.app.mode is Mode.ARRIVED
    np.testing.assert_allclose(
        [goal.position_enu_m[:2] for goal in harness.app.state.goals], [(900.0, -400.0)], atol=0.1
    )
    flown = np.array(harness.simulator.truth.path)[:, 1:3]
    assert np.linalg.norm(flown - (900.0, -400.0), axis=1).min() <= 60.0


@BOTH
def test_the_pilot_hands_back_by_leaving_the_mode_and_coming_back(dialect):
    mode = MISSION_MODE[dialect]
    harness = deck_of(PLAIN, dialect).fly(
        50.0, both(at(15.0, another), switch(22.0, "LOITER"), switch(24.0, mode))
    )
    assert harness.app.mode is Mode.ACTIVE
    assert harness.changes(18.0, 24.0) == []
    assert harness.changes(after_s=24.0) != []
    assert (900, -400) in places_of(harness, harness.simulator.autopilot.mission_items)


def test_another_list_of_the_same_length_without_a_word_is_found_before_it_is_written_over():
    """ArduPlane names no missions: only reading tells."""
    taken = []

    def change(harness):
        autopilot = harness.simulator.autopilot
        items = autopilot.store.mission
        items[1] = replace(items[1], latitude_e7=items[1].latitude_e7 + 1000)
        taken.append(tuple(items))

    harness = deck_of(FIRST_FLIGHT, Dialect.ARDUPILOT).fly(45.0, at(20.0, change))
    assert harness.app.mode is Mode.YIELDED
    assert tuple(harness.simulator.autopilot.store.mission) == taken[0]


@BOTH
def test_an_item_that_somebody_chooses_is_left_alone(dialect):
    """The landing, by a ground station, without leaving the mode."""

    def land(harness):
        autopilot = harness.simulator.autopilot
        (landing,) = [e.sequence for e in autopilot.mission_items if e.command == Command.DO_LAND_START]
        go = autopilot.go_to if dialect is Dialect.PX4 else autopilot._set_current
        assert go(landing)

    def early(harness):
        autopilot = harness.simulator.autopilot
        go = autopilot.go_to if dialect is Dialect.PX4 else autopilot._set_current
        assert go(2)

    for choose, mode in ((land, Mode.ARRIVED), (early, Mode.YIELDED)):
        harness = deck_of(FROM_AUTOPILOT, dialect, operator_items).fly(40.0, at(12.0, choose))
        assert harness.app.mode is mode
        assert harness.changes(after_s=12.0) == []


# --- restarts


def kill(stamp_s):
    def act(harness):
        harness.is_killed = True

    return at(stamp_s, act)


def ends_well(harness):
    """At the goal, or on the way in a mission of ours; a restarted tracker believes less of the threat."""
    assert not harness.simulator.truth.collision
    if harness.app.mode is not Mode.ARRIVED:
        assert harness.app.mode is Mode.ACTIVE
        first, end = harness.app.state.mission_list.layout.flown_span
        assert first <= harness.simulator.autopilot.current_sequence < end


@pytest.mark.parametrize(
    ("dialect", "stamp_s"),
    [(Dialect.ARDUPILOT, 10.0), (Dialect.PX4, 10.0), (Dialect.ARDUPILOT, 25.0), (Dialect.PX4, 37.0)],
)
def test_killed_in_flight_it_plans_again_within_5_s_and_the_flight_ends_well(dialect, stamp_s, tmp_path):
    lengths, planned = [], []

    def watch(harness):
        lengths.append(len(harness.simulator.autopilot.mission_items))
        if len(harness.apps) == 2 and harness.app.num_plans > 0:
            planned.append(harness.now_s)

    harness = deck_of(FIRST_FLIGHT, dialect)
    harness.checkpoint = Checkpoint(tmp_path / "flight")
    harness.fly(68.0, both(kill(stamp_s), watch))
    assert len(harness.apps) == 2
    assert planned[0] - stamp_s < 5.0
    assert "a mission of ours" in harness.texts("restart")[0]
    ends_well(harness)
    if dialect is Dialect.ARDUPILOT:
        size = harness.app.state.mission_list.layout.size
        assert max(lengths) <= 3 + 2 * size


@pytest.mark.parametrize(
    "dialect", [pytest.param(Dialect.ARDUPILOT, marks=pytest.mark.slow), Dialect.PX4]
)  # MAVSDK is waited for in real time, 8 s
def test_killed_in_an_upload_what_is_flown_stays_whole(dialect):
    kept = []

    def act(harness):
        autopilot = harness.simulator.autopilot
        kept.append(autopilot.flight.steering)
        harness.is_killed = True

    step, killed = when(
        lambda harness: (
            harness.app.num_swaps == 1
            and len(harness.said("MISSION_COUNT")) >= 2
            and harness.said("MISSION_ITEM_INT")[-1][0] > harness.said("MISSION_COUNT")[1][0]
        ),
        act,
    )
    harness = deck_of(FIRST_FLIGHT, dialect).fly(70.0, step)
    assert killed
    ends_well(harness)


@BOTH
def test_goals_reached_before_a_restart_are_not_flown_to_again(dialect, tmp_path):
    text = PLAIN.replace(
        "  - {east_m: 1750, north_m: 750, up_m: 100}",
        "  - {east_m: 500, north_m: 0, up_m: 100}\n  - {east_m: 1500, north_m: 300, up_m: 100}",
    )
    harness = deck_of(text, dialect)
    harness.checkpoint = Checkpoint(tmp_path / "flight")
    harness.fly(75.0, kill(30.0))
    assert "1 goals reached" in harness.texts("restart")[0]
    assert harness.app.mode is Mode.ARRIVED
