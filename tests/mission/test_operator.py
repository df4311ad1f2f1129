"""The operator's items: found, kept, and told from ours."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.mission.list_layout import (
    SingleListLayout,
    TwoBankLayout,
    bank_items,
    marked,
    new_banks,
    single_list_layout_of,
    two_bank_layout_of,
    with_stable_height,
)
from companion.mission.operator import (
    banks_in,
    goals_of_operator,
    landing_start,
    operator_of,
    shifted_jumps,
    span_in,
    without_banks,
    without_span,
)
from companion.mission.waypoints import mission_part
from companion.types.mission import Command, MavFrame
from sim.autopilot.arduplane.arduplane_store import MissionStore
from sim.mission_types import MissionKind, Verdict
from tests.mission.made import FRAME, item, renumbered, waypoints

HOME_M = 584.0
CAMERA = 203
SIZE = 20


def at(east, north, command=Command.NAV_WAYPOINT, up=100.0, **changes):
    latitude, longitude, altitude = FRAME.global_from_local(east, north, up)
    place = {"latitude_e7": round(latitude * 1e7), "longitude_e7": round(longitude * 1e7)}
    return item(0, command, **place, **{"altitude_m": altitude, **changes})


def bare(command, *parameters):
    filled = (*parameters, 0.0, 0.0, 0.0, 0.0)[:4]
    return item(
        0, command, frame=MavFrame.MISSION, parameters=filled, latitude_e7=0, longitude_e7=0, altitude_m=0.0
    )


HOME = at(0.0, 0.0, up=0.0)
TAKEOFF = at(0.0, 0.0, Command.NAV_TAKEOFF)
ONE, TWO = at(500.0, 0.0), at(900.0, 300.0)
LAND_START = bare(Command.DO_LAND_START)
PATTERN, LAND = at(0.0, 900.0, Command.NAV_LOITER_TO_ALT), at(0.0, 0.0, Command.NAV_LAND, up=0.0)
PHOTO = bare(CAMERA, 1.0)
OPERATOR = renumbered([HOME, TAKEOFF, ONE, PHOTO, TWO, LAND_START, PATTERN, LAND])
PATH = waypoints((100.0, 50.0, 100.0), (400.0, 60.0, 100.0), loiter_radius_m=125.0)
ON_TO_THE_LANDING = replace(PATH, continues_with_operator_items=True)


@pytest.mark.parametrize(
    ("items", "start"),
    [
        ((ONE, TWO), 2),
        ((TAKEOFF, ONE, LAND_START, PATTERN, LAND), 2),
        ((TAKEOFF, ONE, LAND), 1),  # the waypoint before a landing is its approach
        ((TAKEOFF, PATTERN, LAND), 1),
        ((TAKEOFF, bare(CAMERA), LAND), 2),
        ((TAKEOFF, ONE, bare(Command.NAV_RETURN_TO_LAUNCH)), 2),
    ],
)
def test_what_ends_a_mission(items, start):
    assert landing_start(items) == start


def test_everything_behind_the_operators_waypoint_at_the_goal_follows_the_goal():
    operator = operator_of(OPERATOR, FRAME, HOME_M, (510.0, 10.0, 60.0))
    assert operator.tail == 3
    assert operator_of(OPERATOR, FRAME, HOME_M, (5000.0, 0.0, 60.0)).tail == 5
    assert operator_of(OPERATOR, FRAME, HOME_M).has_landing


def test_the_operators_waypoints_are_goals_with_what_is_done_there():
    operator = operator_of(OPERATOR, FRAME, HOME_M, num_home_items=1)
    goals = goals_of_operator(operator, FRAME, HOME_M)
    places = np.array([goal.position_enu_m for goal in goals])
    np.testing.assert_allclose(places, [[500.0, 0.0, 100.0], [900.0, 300.0, 100.0]], atol=0.02)
    assert [[entry.command for entry in goal.actions] for goal in goals] == [[CAMERA], []]


def test_relative_heights_count_from_home_and_unknown_ones_are_no_goals():
    relative = replace(ONE, frame=MavFrame.GLOBAL_RELATIVE_ALT, altitude_m=80.0)
    operator = operator_of((HOME, relative), FRAME, HOME_M, num_home_items=1)
    (goal,) = goals_of_operator(operator, FRAME, HOME_M + 10.0)
    assert goal.position_enu_m[2] == pytest.approx(90.0, abs=0.05)
    assert goals_of_operator(operator, FRAME, None) == ()
    over_terrain = operator_of((HOME, replace(ONE, frame=10)), FRAME, HOME_M, num_home_items=1)
    assert goals_of_operator(over_terrain, FRAME, HOME_M) == ()


def test_a_waypoint_and_a_loiter_at_one_place_are_one_goal():
    twice = (HOME, ONE, replace(ONE, command=Command.NAV_LOITER_UNLIM))
    operator = operator_of(twice, FRAME, HOME_M, num_home_items=1)
    assert len(goals_of_operator(operator, FRAME, HOME_M)) == 1


# --- ours in the list


def bank(number=0, count=2):
    places = [(100.0 * k, 10.0 * number, 100.0) for k in range(count)]
    return bank_items(mission_part(waypoints(*places, loiter_radius_m=125.0), FRAME), SIZE)


@pytest.mark.parametrize("num_operator", [0, 1, 7])
@pytest.mark.parametrize("num_banks", [1, 2])
def test_banks_are_found_again(num_operator, num_banks):
    prefix = [HOME, *OPERATOR[1 : 1 + num_operator]]
    items = renumbered([*prefix, *(entry for n in range(num_banks) for entry in bank(n))])
    assert banks_in(items) == (len(prefix), SIZE)
    assert without_banks(items) == items[: len(prefix)]


def test_an_operators_list_has_no_banks_in_it():
    slow = bare(Command.DO_CHANGE_SPEED, 0.0, 20.0, -1.0)
    loiter = at(0.0, 0.0, Command.NAV_LOITER_UNLIM)
    assert banks_in(OPERATOR) is None
    assert banks_in(renumbered([HOME, ONE, slow, TWO, loiter])) is None  # too short for a bank
    assert span_in(OPERATOR) is None


@pytest.mark.parametrize(("current", "index"), [(8, 0), (27, 0), (28, 1), (47, 1), (2, 1)])
def test_after_a_restart_the_bank_being_flown_is_known_and_the_list_does_not_grow(current, index):
    items = renumbered([*OPERATOR, *bank(0), *bank(1)])
    operator = operator_of(without_banks(items), FRAME, HOME_M)
    layout = two_bank_layout_of(items, operator, current)
    assert isinstance(layout, TwoBankLayout)
    assert (len(layout.prefix), layout.size, layout.flown_index) == (8, SIZE, index)
    mission, _ = layout.with_new(bank(5), 1)
    assert len(mission.items) == len(items)
    first = 8 + SIZE * index
    kept = [(e.command, e.latitude_e7, e.longitude_e7) for e in mission.items[first : first + SIZE]]
    assert kept == [(e.command, e.latitude_e7, e.longitude_e7) for e in items[first : first + SIZE]]


def test_sending_a_list_again_and_again_does_not_let_it_sink():
    """A store that cuts to centimetres in single precision, 50 times over."""
    store = MissionStore(HOME)
    heights = [80.12, 80.13, 684.01, 100.37, -3.07]
    items = renumbered([HOME, *(at(10.0 * n, 0.0, altitude_m=height) for n, height in enumerate(heights))])

    def sent(entries):
        store.truncate(MissionKind.MISSION, len(entries))
        assert {store.put(MissionKind.MISSION, entry) for entry in entries} == {Verdict.ACCEPTED}
        return tuple(store.mission)

    first = read = sent(items)
    for _ in range(50):
        read = sent(with_stable_height(read))
    assert [entry.altitude_m for entry in read] == [entry.altitude_m for entry in first]


def test_the_same_list_sent_as_it_was_read_does_sink():
    """What the test above would notice."""
    store = MissionStore(HOME)
    sunk = set()
    for cm in range(8000, 8100):
        store.truncate(MissionKind.MISSION, 0)
        store.put(MissionKind.MISSION, HOME)
        height = cm / 100.0
        for _ in range(3):
            store.truncate(MissionKind.MISSION, 1)
            store.put(MissionKind.MISSION, replace(ONE, sequence=1, altitude_m=height))
            height = store.mission[1].altitude_m
        if round(height * 100) != cm:
            sunk.add(cm)
    assert sunk


def whole(tail=True):
    kept = OPERATOR[1:] if tail else OPERATOR[1:5]
    operator = operator_of(kept, FRAME, HOME_M)
    return single_list_layout_of(operator)


def test_on_px4_ours_stand_between_the_operators_way_and_landing():
    layout = whole()
    assert isinstance(layout, SingleListLayout)
    mission, after = layout.with_new(layout.items_for(mission_part(PATH, FRAME)), 3)
    commands = [entry.command for entry in mission.items]
    ours = [16, 178, 16, *(17,) * 13]
    assert commands == [22, 16, CAMERA, 16, *ours, 189, 31, 21]
    assert (mission.entry, after.flown_span) == (4, (4, 20))
    assert [entry.sequence for entry in mission.items] == list(range(23))
    again, _ = after.with_new(after.items_for(mission_part(PATH, FRAME)), 4)
    assert again.items == mission.items  # the list does not grow
    assert [entry.sequence for entry in marked(mission, 6) if entry.is_current] == [6]


def test_a_mission_that_reaches_the_goal_runs_on_into_the_landing():
    layout = whole()
    mission, _ = layout.with_new(layout.items_for(mission_part(ON_TO_THE_LANDING, FRAME)), 3)
    assert [entry.command for entry in mission.items][4:] == [16, 178, 16, *(178,) * 13, 189, 31, 21]
    fast = mission_part(replace(ON_TO_THE_LANDING, airspeed_m_s=35.0), FRAME, 25.0)
    mission, _ = layout.with_new(layout.items_for(fast), 3)
    speeds = [entry.parameters[1] for entry in mission.items if entry.command == Command.DO_CHANGE_SPEED]
    assert speeds[0] == pytest.approx(35.0, rel=0.06)  # equivalent airspeed at that height
    assert speeds[1:] == pytest.approx([speeds[0] * 25.0 / 35.0] * 13, abs=0.1)  # into the landing at cruise
    alone = whole(tail=False)
    ours = alone.items_for(mission_part(ON_TO_THE_LANDING, FRAME))
    assert ours[-1].command == Command.NAV_LOITER_UNLIM


@pytest.mark.parametrize("goes_on", [False, True])
def test_on_px4_ours_are_found_again(goes_on):
    layout = whole()
    mission, _ = layout.with_new(
        layout.items_for(mission_part(replace(PATH, continues_with_operator_items=goes_on), FRAME)), 3
    )
    for flown in (4, 7, 12):  # the one that a PX4 marks in a list it tells
        read = marked(mission, flown)
        assert span_in(read) == (4, 20)
        kept = without_span(read)
        assert [entry.command for entry in kept] == [entry.command for entry in OPERATOR[1:]]


@given(st.lists(st.integers(1, 40), min_size=2, max_size=6), st.booleans())
def test_a_px4s_list_keeps_its_length_and_grows_only_where_it_must(lengths, goes_on):
    layout, sizes = whole(), []
    for length in lengths:
        path = waypoints(
            *((100.0 * n, 0.0, 100.0) for n in range(length)), continues_with_operator_items=goes_on
        )
        before = layout.size
        mission, layout = layout.with_new(layout.items_for(mission_part(path, FRAME)), 1)
        sizes.append(len(mission.items))
        needed = length + (3 if goes_on else 2)
        assert layout.size >= needed
        if before:
            assert layout.size == max(before, needed)
        assert span_in(mission.items) == layout.flown_span
    assert sizes == sorted(sizes)


def test_on_ardupilot_a_mission_that_reaches_the_goal_jumps_to_what_follows_it():
    banks = new_banks(OPERATOR, tail=5)
    ours = banks.items_for(mission_part(ON_TO_THE_LANDING, FRAME))
    assert [entry.command for entry in ours[:5]] == [16, 178, 16, Command.DO_JUMP, 17]
    assert ours[3].parameters[:2] == (5.0, -1.0)
    assert len(ours) == banks.size
    without = new_banks(OPERATOR, tail=len(OPERATOR)).items_for(mission_part(ON_TO_THE_LANDING, FRAME))
    assert Command.DO_JUMP not in {entry.command for entry in without}


def test_jumps_still_lead_where_they_led():
    jumps = (bare(Command.DO_JUMP, 2.0, 3.0), bare(Command.DO_JUMP, 5.0, 3.0))
    assert [entry.parameters[0] for entry in shifted_jumps(jumps, 4, 10)] == [2.0, 15.0]


def test_actions_are_carried_out_at_their_waypoint():
    ours = bank_items(mission_part(replace(PATH, actions=((0, (PHOTO,)), (1, (PHOTO, PHOTO)))), FRAME), SIZE)
    assert [entry.command for entry in ours[:7]] == [16, 178, CAMERA, 16, CAMERA, CAMERA, 17]
    assert len(ours) == SIZE
