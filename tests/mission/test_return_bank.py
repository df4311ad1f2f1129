"""Return banks: the item that a return joins, beside the simulator's own search, and what is recognised."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from companion.frames import LocalFrame
from companion.mission.list_layout import TwoBankLayout, two_bank_layout_of, without_returns
from companion.mission.operator import Operator, banks_in
from companion.mission.return_bank import (
    NOWHERE,
    RETURN_ITEMS,
    armed,
    blank_bank,
    followed,
    is_armed,
    joined_item,
    joined_items,
    num_return_items,
    return_bank,
)
from companion.types.mission import Command, MavFrame, MissionItem
from sim.autopilot.arduplane.return_leg import closest_leg, closest_start

FRAME = LocalFrame(-35.363261, 149.165230, 584.0)
NOTHING = (0.0, 0.0, 0.0, 0.0)
PATHS, LANDINGS = Command.DO_RETURN_PATH_START, Command.DO_LAND_START
SPEED = MissionItem(0, Command.DO_CHANGE_SPEED, MavFrame.MISSION, (0.0, 24.0, -1.0, 0.0), 0, 0, 0.0)


def at(east, north, up=100.0, command=Command.NAV_WAYPOINT, parameters=NOTHING):
    latitude, longitude, altitude = FRAME.global_from_local(east, north, up)
    return MissionItem(
        0, command, MavFrame.GLOBAL, parameters, round(latitude * 1e7), round(longitude * 1e7), altitude
    )


def circle(east, north):
    return at(east, north, command=Command.NAV_LOITER_UNLIM, parameters=(0.0, 0.0, 100.0, 0.0))


def numbered(*items):
    return tuple(replace(item, sequence=number) for number, item in enumerate(items))


HOME = at(0.0, 0.0, 0.0)
START = MissionItem(0, Command.DO_RETURN_PATH_START, MavFrame.MISSION, NOTHING, 0, 0, 0.0)
PATH = (at(0.0, 1000.0), at(1000.0, 1000.0), at(1000.0, 0.0))


def bank_of(*places):
    return return_bank(places, circle(0.0, 0.0), None, speed=SPEED)


@pytest.mark.parametrize(
    ("place", "joined"),
    [
        ((0.0, 1200.0), 2),  # before the first waypoint, which is a point, not a leg
        ((300.0, 1100.0), 3),  # beside the first leg: on to its end
        ((1040.0, 500.0), 4),  # beside the second
        ((600.0, 100.0), 5),  # beside the way to the circle
    ],
)
def test_the_end_of_the_closest_leg_is_flown_to(place, joined):
    items = numbered(HOME, START, *PATH, circle(0.0, 0.0))
    assert joined_item(items, FRAME, 584.0, (*place, 100.0), PATHS) == joined


def test_height_counts_too():
    low, high = (at(0.0, 0.0), at(1000.0, 0.0)), (at(0.0, 300.0, 400.0), at(1000.0, 300.0, 400.0))
    items = numbered(HOME, START, *low, NOWHERE, START, *high)
    assert joined_item(items, FRAME, 584.0, (500.0, 150.0, 150.0), PATHS) == 3
    assert joined_item(items, FRAME, 584.0, (500.0, 150.0, 390.0), PATHS) == 7


def test_without_a_start_there_is_no_return_path():
    assert (
        joined_item(numbered(HOME, *PATH, circle(0.0, 0.0)), FRAME, 584.0, (0.0, 0.0, 100.0), PATHS) is None
    )


def test_a_bank_that_is_not_armed_is_not_joined_and_one_that_is_leads_to_its_circle():
    bank = bank_of(*PATH)
    assert len(bank) == RETURN_ITEMS
    assert (is_armed(bank), is_armed(armed(bank, PATHS))) == (False, True)
    here = (300.0, 1100.0, 100.0)
    assert joined_item(numbered(HOME, *blank_bank(SPEED), *bank), FRAME, 584.0, here, PATHS) is None
    items = numbered(HOME, *blank_bank(SPEED), *armed(bank, PATHS))
    joined = joined_item(items, FRAME, 584.0, here, PATHS)
    flown = followed(items, joined)
    assert flown[-1].command == Command.NAV_LOITER_UNLIM
    assert [item.sequence for item in flown] == list(range(joined, len(items) - 1))


def test_the_way_from_one_bank_to_the_next_is_no_leg():
    """The jump to nowhere ends the search: without it, the leg between the banks would be the closest."""
    far = return_bank((at(5000.0, 5000.0),), circle(6000.0, 6000.0), None, speed=SPEED)
    here = (2500.0, 2500.0, 100.0)  # on the straight from one circle to the other bank's waypoint
    items = numbered(HOME, *armed(bank_of(*PATH), PATHS), *armed(far, PATHS))
    joined = joined_item(items, FRAME, 584.0, here, PATHS)
    assert items[joined].command == Command.NAV_WAYPOINT
    assert joined <= RETURN_ITEMS  # in the first bank
    without = tuple(item for item in items if item.command != NOWHERE.command)
    assert joined_item(numbered(*without), FRAME, 584.0, here, PATHS) > RETURN_ITEMS - 1


def test_a_landing_is_jumped_to_and_ends_the_search():
    touchdown = at(0.0, 0.0, 0.0, Command.NAV_LAND)
    landing = replace(START, command=Command.DO_LAND_START), at(-800.0, 0.0, 60.0), touchdown
    bank = return_bank(PATH, None, 1, speed=SPEED)
    items = numbered(HOME, *landing, *armed(bank, PATHS))
    assert [item.command for item in followed(items, 5)][-3:] == [189, 16, 21]
    assert joined_item(items, FRAME, 584.0, (1000.0, -100.0, 100.0), PATHS) == 7


def test_the_closest_landing_sequence_is_flown_to_at_its_first_waypoint():
    """RTL_AUTOLAND 2: an operator's landing without a place of its own, and a bank behind it."""
    touchdown = at(0.0, 0.0, 0.0, Command.NAV_LAND)
    landing = replace(START, command=LANDINGS), at(-800.0, 0.0, 60.0), touchdown
    items = numbered(HOME, *landing, *armed(return_bank(PATH, None, 1, speed=SPEED), LANDINGS))
    assert joined_item(items, FRAME, 584.0, (-700.0, 0.0, 100.0), LANDINGS) == 2
    assert joined_item(items, FRAME, 584.0, (300.0, 900.0, 100.0), LANDINGS) == 5
    assert joined_item(items, FRAME, 584.0, (1000.0, 100.0, 100.0), LANDINGS) == 5  # not the closest leg
    assert [item.command for item in followed(items, 5)] == [16, 16, 16, 189, 16, 21]


def test_an_armed_bank_has_the_place_of_its_first_waypoint_only_where_landings_are_looked_for():
    bank = bank_of(*PATH)
    first = armed(bank, LANDINGS)[0]
    assert (first.latitude_e7, first.longitude_e7) == (PATH[0].latitude_e7, PATH[0].longitude_e7)
    assert armed(bank, PATHS)[0] == START
    assert is_armed(armed(bank, LANDINGS))
    assert armed(bank, LANDINGS)[1:] == bank[1:]


PLACES = st.tuples(
    st.floats(-3000.0, 3000.0), st.floats(-3000.0, 3000.0), st.sampled_from([60.0, 100.0, 250.0])
)
PIECES = st.one_of(
    PLACES.map(lambda place: at(*place)),
    st.just(START),
    st.just(SPEED),
    st.just(NOWHERE),
    st.just(replace(START, command=Command.DO_LAND_START)),
    st.integers(1, 30).map(
        lambda target: MissionItem(
            0, Command.DO_JUMP, MavFrame.MISSION, (float(target), -1.0, 0.0, 0.0), 0, 0, 0.0
        )
    ),
)


@settings(max_examples=300, deadline=None)
@given(st.lists(PIECES, min_size=1, max_size=25), PLACES)
def test_the_simulator_joins_the_same_item(pieces, here):
    """Two searches that share no code agree on lists of any items, as long as no jump leads round."""
    items = numbered(HOME, *pieces)
    starts = [item.sequence for item in items if item.command == Command.DO_RETURN_PATH_START]
    assume(not any(_goes_round(items, start) for start in starts))

    def position(item):
        return FRAME.local_from_global(item.latitude_e7 * 1e-7, item.longitude_e7 * 1e-7, item.altitude_m)

    ours, theirs = joined_item(items, FRAME, 584.0, here, PATHS), closest_leg(items, position, here)
    if ours != theirs:  # equally near to within rounding
        near = [_distance_to(items, position, here, end) for end in (ours, theirs)]
        assert near[0] == pytest.approx(near[1], abs=1e-6)


@settings(max_examples=100, deadline=None)
@given(st.lists(PIECES, min_size=1, max_size=25), st.lists(PLACES, min_size=1, max_size=5))
def test_each_of_several_places_joins_the_item_that_it_joins_alone(pieces, places):
    items = numbered(HOME, *pieces)
    together = joined_items(items, FRAME, 584.0, np.array(places), PATHS)
    assert [int(joined) or None for joined in together] == [
        joined_item(items, FRAME, 584.0, place, PATHS) for place in places
    ]


@settings(max_examples=200, deadline=None)
@given(st.lists(PIECES, min_size=1, max_size=25), PLACES)
def test_the_simulator_flies_to_the_same_landing_sequence(pieces, here):
    items = numbered(HOME, *pieces)
    starts = [item.sequence for item in items if item.command == LANDINGS]
    assume(not any(item.command in (Command.DO_JUMP, NOWHERE.command) for item in items))

    def position(item):
        return FRAME.local_from_global(item.latitude_e7 * 1e-7, item.longitude_e7 * 1e-7, item.altitude_m)

    ours, theirs = joined_item(items, FRAME, 584.0, here, LANDINGS), closest_start(items, position, here)
    assert (ours is None) == (theirs is None)
    if theirs is not None:
        ends = [
            next(item for item in items[start:] if item.command == Command.NAV_WAYPOINT)
            for start in (theirs, max(start for start in starts if start < ours))
        ]
        assert math.dist(position(ends[0]), here) == pytest.approx(math.dist(position(ends[1]), here))


def _goes_round(items, start):
    """Whether jumps lead back to an item that was passed before."""
    seen, sequence = set(), start
    while 0 < sequence < len(items):
        if sequence in seen:
            return True
        seen.add(sequence)
        item = items[sequence]
        if item.command in (Command.DO_JUMP_TAG, Command.DO_LAND_START):
            return False
        sequence = int(item.parameters[0]) if item.command == Command.DO_JUMP else sequence + 1
    return False


def _distance_to(items, position, here, end):
    """Smallest distance to a leg that ends at an item, or to the item, over all return paths."""
    found = [math.dist(here, position(items[end]))]
    for start in items:
        if start.command != Command.DO_RETURN_PATH_START:
            continue
        before = None
        for item in followed(items, start.sequence):
            if item.command == Command.NAV_WAYPOINT:
                if item.sequence == end and before is not None:
                    found.append(_from_leg(here, before, position(item)))
                before = position(item)
    return min(found)


def _from_leg(here, begin, end):
    steps = [tuple(a + k / 4000 * (b - a) for a, b in zip(begin, end, strict=True)) for k in range(4001)]
    return min(math.dist(here, step) for step in steps)


# --- what is recognised again

WAY = (at(100.0, 100.0), SPEED, at(900.0, 100.0))


def list_with(*returns):
    bank = (*WAY, *(circle(900.0, 100.0),) * 17)
    return numbered(HOME, at(50.0, 50.0), *bank, *bank, *returns)


@pytest.mark.parametrize("is_armed_first", [True, False])
def test_after_a_restart_the_banks_are_found_before_the_return_banks(is_armed_first):
    first, second = bank_of(*PATH), blank_bank(SPEED)
    returns = (*(armed(first, PATHS) if is_armed_first else first), *second)
    read = list_with(*returns)
    assert num_return_items(read) == 2 * RETURN_ITEMS
    assert banks_in(without_returns(read)) == (2, 20)
    layout = two_bank_layout_of(read, Operator(read[:2], 2, 1), 4)
    assert layout.flown_span == (2, 22)
    assert layout.return_span == (42, 42 + 2 * RETURN_ITEMS)
    assert [item.command for item in layout.returns] == [item.command for item in returns]


@pytest.mark.parametrize("count", [1, 5, RETURN_ITEMS, RETURN_ITEMS + 3, 2 * RETURN_ITEMS - 1])
def test_blank_banks_that_were_broken_off_are_recognised(count):
    read = list_with(*(*blank_bank(SPEED), *blank_bank(SPEED))[:count])
    assert num_return_items(read) == count
    assert banks_in(without_returns(read)) == (2, 20)
    assert two_bank_layout_of(read, Operator(read[:2], 2, 1), 4).returns == ()


def test_a_list_without_return_banks_has_none():
    assert num_return_items(list_with()) == 0
    assert num_return_items(()) == 0


def test_a_new_mission_leaves_the_return_banks_where_they_are():
    returns = (*armed(bank_of(*PATH), PATHS), *blank_bank(SPEED))
    flown = (*WAY, *(circle(900.0, 100.0),) * 17)
    layout = TwoBankLayout(list_with()[:2], 20, flown, 0, None, returns)
    mission, after = layout.with_new(flown, 7)
    assert [item.command for item in mission.items[42:]] == [item.command for item in returns]
    assert (after.flown_index, after.returns, mission.entry) == (1, returns, 22)
