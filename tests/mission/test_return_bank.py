"""Return banks: the item that a return joins, beside the simulator's own search, and what is recognised."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from companion.frames import LocalFrame
from companion.mission.list_layout import TwoBankLayout, two_bank_layout_of, without_returns
from companion.mission.operator import Operator, banks_in, position_of
from companion.mission.return_bank import (
    NOWHERE,
    RETURN_ITEMS,
    RETURN_WAYPOINTS_MAX,
    blank_bank,
    disarmed,
    followed,
    is_armed,
    joined_item,
    joined_items,
    landing_start,
    num_return_items,
    path_start,
    return_bank,
    start_places,
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
    return return_bank(places, [(0, path_start())], circle(0.0, 0.0), None)


def landings_bank_of(*places, landing=None):
    """A bank for RTL_AUTOLAND 2, of which the first two legs are flown anyway."""
    local = [position_of(place, FRAME, 584.0) for place in places]
    corners = np.array([(0.0, 400.0, 100.0), *local])
    starts = [(number, landing_start(at(*place))) for number, place in start_places(corners, 2)]
    return return_bank(places, starts, circle(0.0, 0.0) if landing is None else None, landing)


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
    assert (is_armed(disarmed(bank, SPEED)), is_armed(bank)) == (False, True)
    here = (300.0, 1100.0, 100.0)
    blank = numbered(HOME, *blank_bank(SPEED), *disarmed(bank, SPEED))
    assert joined_item(blank, FRAME, 584.0, here, PATHS) is None
    items = numbered(HOME, *blank_bank(SPEED), *bank)
    joined = joined_item(items, FRAME, 584.0, here, PATHS)
    flown = followed(items, joined)
    assert flown[-1].command == Command.NAV_LOITER_UNLIM
    assert [item.sequence for item in flown] == list(range(joined, len(items) - 1))


def test_the_way_from_one_bank_to_the_next_is_no_leg():
    """The jump to nowhere ends the search: without it, the leg between the banks would be the closest."""
    far = return_bank((at(5000.0, 5000.0),), [(0, path_start())], circle(6000.0, 6000.0), None)
    here = (2500.0, 2500.0, 100.0)  # on the straight from one circle to the other bank's waypoint
    items = numbered(HOME, *bank_of(*PATH), *far)
    joined = joined_item(items, FRAME, 584.0, here, PATHS)
    assert items[joined].command == Command.NAV_WAYPOINT
    assert joined <= RETURN_ITEMS  # in the first bank
    without = tuple(item for item in items if item.command != NOWHERE.command)
    assert joined_item(numbered(*without), FRAME, 584.0, here, PATHS) > RETURN_ITEMS - 1


def test_a_landing_is_jumped_to_and_ends_the_search():
    touchdown = at(0.0, 0.0, 0.0, Command.NAV_LAND)
    landing = replace(START, command=Command.DO_LAND_START), at(-800.0, 0.0, 60.0), touchdown
    items = numbered(HOME, *landing, *return_bank(PATH, [(0, path_start())], None, 1))
    assert [item.command for item in followed(items, 5)][-3:] == [189, 16, 21]
    assert joined_item(items, FRAME, 584.0, (1000.0, -100.0, 100.0), PATHS) == 7


def test_of_landings_the_closest_is_flown_to_and_a_bank_has_one_for_each_leg_flown_anyway():
    """RTL_AUTOLAND 2: an operator's landing without a place of its own, and a bank behind it."""
    touchdown = at(0.0, 0.0, 0.0, Command.NAV_LAND)
    landing = replace(START, command=LANDINGS), at(-800.0, 0.0, 60.0), touchdown
    items = numbered(HOME, *landing, *landings_bank_of(*PATH, landing=1))
    waypoints = [
        item.sequence for item in items if item.sequence > 3 and item.command == Command.NAV_WAYPOINT
    ]

    def joined(east, north):
        return joined_item(items, FRAME, 584.0, (east, north, 100.0), LANDINGS)

    assert joined(-700.0, 0.0) == 2
    assert joined(0.0, 500.0) == waypoints[0]
    assert joined(0.0, 990.0) == waypoints[0]  # just before the first corner
    assert joined(20.0, 1000.0) == waypoints[1]  # just behind it: not back to it
    assert joined(980.0, 1000.0) == waypoints[1]
    assert joined(1000.0, 980.0) == waypoints[2]  # the first leg of the way back
    assert joined(1000.0, 100.0) == waypoints[2]
    assert [item.command for item in followed(items, waypoints[2])] == [16, 189, 16, 21]


def test_starts_lie_equally_far_before_and_behind_each_corner():
    """Legs of 400, 100 and 300 m, of which two are flown anyway: 50 m about both corners."""
    corners = np.array([(0.0, 0.0, 100.0), (400.0, 0.0, 100.0), (400.0, 100.0, 100.0), (100.0, 100.0, 100.0)])
    found = [(number, tuple(place[:2])) for number, place in start_places(corners, 2)]
    assert found == [(0, (350.0, 0.0)), (1, (400.0, 50.0)), (2, (350.0, 100.0))]
    assert [number for number, _ in start_places(corners, 3)] == [0, 1, 2, 2]
    ((number, place),) = start_places(corners[:2], 1)
    assert (number, *place) == (0, 400.0, 0.0, 100.0)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.floats(60.0, 900.0), st.floats(-0.8, 0.8)), min_size=2, max_size=9), st.data())
def test_from_a_leg_that_is_flown_anyway_the_end_of_that_leg_is_joined(legs, data):
    """Along a path that turns by less than 50 degrees a corner; other legs may come nearer where it folds."""
    course, corners = 0.0, [np.array([0.0, 0.0, 100.0])]
    for length, turn in legs:
        course += turn
        corners.append(corners[-1] + length * np.array([math.cos(course), math.sin(course), 0.0]))
    num_flown = data.draw(st.integers(1, len(legs)))
    leg, share = data.draw(st.integers(0, num_flown - 1)), data.draw(st.floats(0.02, 0.98))
    here = corners[leg] + share * (corners[leg + 1] - corners[leg])
    starts = start_places(np.array(corners), num_flown)
    away = [float(np.linalg.norm(here - place)) for _, place in starts]
    joined = starts[int(np.argmin(away))][0]
    own = min(distance for distance, (number, _) in zip(away, starts, strict=True) if number == leg)
    folds = {number for distance, (number, _) in zip(away, starts, strict=True) if distance < own}
    assert joined == leg or all(abs(number - leg) > 1 for number in folds)


@pytest.mark.parametrize("count", [1, 4, 20, RETURN_WAYPOINTS_MAX])
def test_starts_without_room_are_left_out_from_the_last(count):
    places = [at(100.0 * number, 0.0) for number in range(count)]
    starts = [(number, landing_start(place)) for number, place in enumerate(places) for _ in range(2)]
    bank = return_bank(places, starts, circle(0.0, 0.0), None)
    assert len(bank) == RETURN_ITEMS
    assert [item for item in bank if item.command == Command.NAV_WAYPOINT] == places
    fitting = [item for item in bank if item.command == LANDINGS]
    assert fitting == [start for _, start in starts][: len(fitting)]
    assert len(fitting) == min(2 * count, RETURN_WAYPOINTS_MAX + 1 - count)
    assert bank[-1] == NOWHERE


PLACES = st.tuples(
    st.floats(-3000.0, 3000.0), st.floats(-3000.0, 3000.0), st.sampled_from([60.0, 100.0, 250.0])
)
PIECES = st.one_of(
    PLACES.map(lambda place: at(*place)),
    st.just(START),
    st.just(SPEED),
    st.just(NOWHERE),
    st.just(replace(START, command=LANDINGS)),
    PLACES.map(lambda place: landing_start(at(*place))),
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
    assume(not any(item.command in (Command.DO_JUMP, NOWHERE.command) for item in items))

    def position(item):
        return FRAME.local_from_global(item.latitude_e7 * 1e-7, item.longitude_e7 * 1e-7, item.altitude_m)

    ours, start = joined_item(items, FRAME, 584.0, here, LANDINGS), closest_start(items, position, here)
    placed = [item.sequence for item in items[start or 0 :] if item.command == Command.NAV_WAYPOINT]
    # The simulator flies to a start behind which nothing is; the service takes no such start.
    assert start is None or not placed or ours == placed[0]


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
    returns = (*(first if is_armed_first else disarmed(first, SPEED)), *second)
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
    returns = (*bank_of(*PATH), *blank_bank(SPEED))
    flown = (*WAY, *(circle(900.0, 100.0),) * 17)
    layout = TwoBankLayout(list_with()[:2], 20, flown, 0, None, returns)
    mission, after = layout.with_new(flown, 7)
    assert [item.command for item in mission.items[42:]] == [item.command for item in returns]
    assert (after.flown_index, after.returns, mission.entry) == (1, returns, 22)
