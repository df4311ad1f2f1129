"""Two banks in one list: the flown one is never touched, whatever becomes of an upload."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.mission import waypoints as builder
from companion.mission.list_layout import bank_items, new_banks
from companion.mission.waypoints import mission_part
from companion.types.mission import Command
from sim.autopilot.arduplane.arduplane_store import MissionStore
from sim.mission_types import MissionKind, Verdict
from tests.mission.made import FRAME, item, renumbered, waypoints

HOME = item(0)
NUM_SWAPS = 10


def bank(size, number, num_waypoints):
    """A bank whose places tell which plan it carries out."""
    positions = [(10.0 * number, 100.0 * k, 100.0) for k in range(num_waypoints)]
    return bank_items(mission_part(waypoints(*positions), FRAME), size)


def place(entry):
    """An item without what its position in the list says."""
    return replace(entry, sequence=0, is_current=False)


def places(items):
    return [place(entry) for entry in items]


lists = st.tuples(st.integers(0, 4), st.lists(st.integers(1, 18), min_size=NUM_SWAPS, max_size=NUM_SWAPS))


@settings(max_examples=40, deadline=None)
@given(lists)
def test_ten_swaps_alternate_and_leave_the_flown_bank_alone(drawn):
    num_operator, counts = drawn
    banks = new_banks(renumbered([HOME, *(item(9),) * num_operator]), size=max(counts) + 3)
    prefix, size, length, entries = banks.prefix, banks.size, 0, []
    for number, count in enumerate(counts):
        new = bank(size, number, count)
        before = banks
        mission, banks = before.with_new(new, number)
        assert [entry.sequence for entry in mission.items] == list(range(len(mission.items)))
        assert len(mission.items) >= length
        assert places(mission.items[: len(prefix)]) == places(prefix)
        index = banks.flown_index
        assert mission.entry == banks.first_of(index) == len(prefix) + size * index
        assert places(mission.items[mission.entry : mission.entry + size]) == places(new)
        assert [entry.sequence for entry in mission.items if entry.is_current] == [mission.entry]
        if before.flown is not None:
            first = before.first_of(before.flown_index)
            assert places(mission.items[first : first + size]) == places(before.flown)
        assert (banks.flown, mission.plan_number) == (new, number)
        entries.append(index)
        length = len(mission.items)
    assert entries == [0, 1] * (NUM_SWAPS // 2)
    assert length == len(prefix) + 2 * size


def test_a_swap_that_was_not_flown_is_made_again_in_the_same_bank():
    banks = new_banks((HOME,))
    _, flown = banks.with_new(bank(banks.size, 0, 3), 0)
    first, _ = flown.with_new(bank(banks.size, 1, 3), 1)
    again, _ = flown.with_new(bank(banks.size, 2, 4), 2)
    assert first.entry == again.entry == 1 + banks.size
    assert first.items[1 : 1 + banks.size] == again.items[1 : 1 + banks.size]


def stored(store):
    return tuple(store.items(MissionKind.MISSION))


def write(store, items, num_items):
    """An upload that ends after so many items: the count cuts the list, items go to their slots."""
    store.truncate(MissionKind.MISSION, len(items))
    for entry in items[:num_items]:
        assert store.put(MissionKind.MISSION, entry) is Verdict.ACCEPTED


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 3), st.integers(1, 18), st.integers(1, 18), st.integers(1, 18))
def test_an_upload_broken_off_at_any_item_leaves_the_flown_bank_whole(num_operator, one, two, three):
    banks = new_banks(renumbered([HOME, *(item(9),) * num_operator]), size=30)
    previous = None
    for number, count in enumerate((one, two, three)):
        mission, after = banks.with_new(bank(banks.size, number, count), number)
        if previous is not None:
            first = banks.first_of(banks.flown_index)
            for num_items in range(len(mission.items) + 1):
                store = MissionStore(HOME)
                write(store, previous.items, len(previous.items))
                whole = stored(store)[first : first + banks.size]
                write(store, mission.items, num_items)
                assert stored(store)[first : first + banks.size] == whole
        previous, banks = mission, after


def test_the_same_property_fails_for_a_list_that_is_overwritten_in_place():
    """Without banks the flown items change under the aircraft: what the test above would notice."""
    banks = new_banks((HOME,))
    old, _ = banks.with_new(bank(banks.size, 0, 5), 0)
    new, _ = banks.with_new(bank(banks.size, 1, 5), 1)
    store = MissionStore(HOME)
    write(store, old.items, len(old.items))
    whole = stored(store)[1 : 1 + banks.size]
    write(store, new.items, 2)
    assert stored(store)[1 : 1 + banks.size] != whole


@pytest.mark.parametrize("num_waypoints", [1, 2, 5])
def test_waypoints_are_found_behind_the_airspeed_item(num_waypoints):
    banks = new_banks((HOME,))
    mission, _ = banks.with_new(bank(banks.size, 0, num_waypoints), 0)
    for number in range(num_waypoints):
        found = mission.items[builder.sequence_of_waypoint(mission, number)]
        assert found.command == Command.NAV_WAYPOINT
        latitude, _, _ = FRAME.global_from_local(0.0, 100.0 * number, 100.0)
        assert found.latitude_e7 == round(latitude * 1e7)
