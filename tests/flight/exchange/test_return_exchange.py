"""The exchange of a return path, ended after every single message: there is always a whole one to join."""

import asyncio
from dataclasses import replace

import pytest

from companion.clock import ManualClock
from companion.config import load_mission
from companion.errors import TransferError
from companion.flight.exchange.consent import NobodyAsked
from companion.flight.exchange.return_exchange import STOPPED, ReturnExchange
from companion.flight.exchange.swap_protocol import SwapParts
from companion.flight.state.flight_state import StateOwner, first_state
from companion.flight.state.list_state import after_adopted
from companion.mission.list_layout import TwoBankLayout
from companion.mission.operator import Operator
from companion.mission.return_bank import RETURN_ITEMS, followed, is_armed, joined_item
from companion.types.mission import Command
from tests.mission.test_return_bank import (
    FRAME,
    SPEED,
    WAY,
    at,
    bank_of,
    circle,
    landings_bank_of,
    numbered,
)
from tests.sim.client import CONFIGS

HERE = (300.0, 1100.0, 100.0)
OLD, NEW = bank_of(at(0.0, 1000.0), at(1000.0, 1000.0)), bank_of(at(0.0, 1100.0), at(2000.0, 1100.0))
THIRD = bank_of(at(0.0, 1200.0), at(2000.0, 1200.0), at(2000.0, 0.0))
FLOWN = (*WAY, *(circle(900.0, 100.0),) * 17)
MISSION = load_mission(CONFIGS / "first-flight.yaml")


class List:
    """An ArduPlane's list behind a link that dies after so many items."""

    def __init__(self, items, dies_after=10_000):
        self.items, self.left, self.written = list(items), dies_after, 0

    def _put(self, item):
        if self.left == 0:
            raise TransferError("write", "link dead")
        self.left -= 1
        self.written += 1
        if item.sequence == len(self.items):
            self.items.append(item)
        else:
            self.items[item.sequence] = item

    async def write(self, items):
        for item in items:
            self._put(item)

    async def upload(self, items, *, gives_way):
        assert gives_way
        assert sum(item.is_current for item in items) == 1
        for item in items:
            self._put(replace(item, is_current=False))

    async def read_back(self, *, gives_way):
        assert gives_way
        if self.left == 0:
            raise TransferError("download", "link dead")
        return tuple(self.items)


def made(dies_after=10_000):
    """An exchange over a list with both banks of missions."""
    items = numbered(at(0.0, 0.0, 0.0), at(50.0, 50.0), *FLOWN, *FLOWN)
    link, flight = List(items, dies_after), StateOwner(first_state(MISSION, 0.0))
    layout = TwoBankLayout(items[:2], 20, FLOWN, 0, None)
    flight.apply_to_list(after_adopted, items, layout, Operator(items[:2], 2, 1), None)
    return ReturnExchange(SwapParts(flight, link, None, ManualClock(), NobodyAsked())), link, flight


def store(exchange, bank):
    return asyncio.run(exchange.store(bank, SPEED))


def joined(link, start=Command.DO_RETURN_PATH_START):
    """Waypoints and circle of the return path that would be joined; None without one."""
    number = joined_item(link.items, FRAME, 584.0, HERE, start)
    if number is None:
        return None
    return [
        (item.latitude_e7, item.longitude_e7) for item in followed(link.items, number) if item.command < 100
    ]


def way_of(bank):
    """What a return from here flies of a bank that is whole."""
    placed = [item for item in bank if item.command < 100]
    return [(item.latitude_e7, item.longitude_e7) for item in placed[1:]]


def test_the_first_return_path_makes_room_for_both_banks():
    exchange, link, flight = made()
    assert store(exchange, OLD) == ""
    assert len(link.items) == 42 + 2 * RETURN_ITEMS
    assert [item.sequence for item in link.items] == list(range(len(link.items)))
    assert joined(link) == way_of(OLD)
    assert flight.listed.stored == tuple(link.items)
    assert (flight.listed.is_mixed, flight.listed.num_read) == (False, len(link.items))


def test_the_second_takes_its_place_and_the_missions_stay():
    exchange, link, flight = made()
    store(exchange, OLD)
    before = link.items[:42]
    assert store(exchange, NEW) == ""
    assert joined(link) == way_of(NEW)
    assert link.items[:42] == before
    assert sum(item.command == Command.DO_RETURN_PATH_START for item in link.items) == 1
    assert flight.listed.stored == tuple(link.items)


LANDINGS = [
    landings_bank_of(at(0.0, north), at(1000.0, north), at(1000.0, 0.0)) for north in (1000.0, 1100.0)
]


def test_where_landings_are_looked_for_each_leg_has_one_and_the_other_bank_has_none():
    exchange, link, _ = made()
    for bank in LANDINGS:
        assert store(exchange, bank) == ""
        assert joined(link) is None
        places = [(item.latitude_e7, item.longitude_e7) for item in bank if item.command < 100]
        assert joined(link, Command.DO_LAND_START) == places[1:]
        assert [item.command for item in link.items if item.command == Command.DO_LAND_START] == [189] * 4


@pytest.mark.parametrize("died_after", range(140))
def test_wherever_it_ends_each_landing_start_leads_to_a_whole_path(died_after):
    exchange, link, _ = made(num_written(LANDINGS[:1]) + died_after)
    assert store(exchange, LANDINGS[0]) == ""
    store(exchange, LANDINGS[1])
    ends = [
        [(item.latitude_e7, item.longitude_e7) for item in bank if item.command < 100] for bank in LANDINGS
    ]
    starts = [item.sequence for item in link.items if item.command == Command.DO_LAND_START]
    for start in starts:
        way = [(i.latitude_e7, i.longitude_e7) for i in followed(link.items, start) if i.command < 100]
        assert any(way == whole[-len(way) :] for whole in ends)
    assert starts


def test_a_write_that_fails_after_it_was_carried_out_is_not_relied_on():
    """The acknowledgement of the parts that arm a bank is lost: the next exchange disarms it all the same."""
    exchange, link, _ = made()
    store(exchange, OLD)
    write = link.write

    async def lost(items):
        await write(items)
        if is_armed(items):
            raise TransferError("write", "no acknowledgement")

    link.write = lost
    assert "no acknowledgement" in store(exchange, NEW)
    link.write, at_once = write, []

    async def watched(items):
        await write(items)
        banks = link.items[42:], link.items[42 + RETURN_ITEMS :]
        at_once.append([way_of(bank[:RETURN_ITEMS]) for bank in banks if is_armed(bank[:RETURN_ITEMS])])

    link.write = watched
    assert store(exchange, THIRD) == ""
    assert joined(link) == way_of(THIRD)
    assert all(way in (way_of(OLD), way_of(NEW), way_of(THIRD)) for ways in at_once for way in ways)


def num_written(banks):
    exchange, link, _ = made()
    for bank in banks:
        store(exchange, bank)
    return link.written


@pytest.mark.parametrize("died_after", range(num_written((OLD,)), num_written((OLD, NEW)) + 1))
def test_wherever_the_exchange_ends_a_whole_return_path_is_joined(died_after):
    exchange, link, _ = made(died_after)
    assert store(exchange, OLD) == ""
    store(exchange, NEW)
    assert joined(link) in (way_of(OLD), way_of(NEW))


@pytest.mark.parametrize("died_after", range(0, num_written((OLD,)), 3))
def test_before_the_first_is_whole_there_is_none_and_the_missions_stay(died_after):
    exchange, link, flight = made(died_after)
    assert "link dead" in store(exchange, OLD)
    assert joined(link) is None
    assert [item.command for item in link.items[2:42]] == [item.command for item in (*FLOWN, *FLOWN)]
    assert not flight.listed.is_exchanging


def test_after_a_broken_exchange_the_next_one_succeeds():
    exchange, link, _ = made(num_written((OLD,)) + 11)
    store(exchange, OLD)
    store(exchange, NEW)
    link.left = 10_000
    assert store(exchange, NEW) == ""
    assert joined(link) == way_of(NEW)


def test_told_to_stop_it_ends_between_two_parts():
    exchange, link, _ = made()
    store(exchange, OLD)
    write, parts = link.write, []

    async def counted(items):
        parts.append(len(items))
        if len(parts) == 3:
            exchange.stop()
        await write(items)

    link.write = counted
    assert store(exchange, NEW) == STOPPED
    assert parts == [3, 4, 4]  # the airspeed at the front is there already
    assert joined(link) == way_of(OLD)
    assert sum(map(is_armed, (link.items[42:], link.items[42 + RETURN_ITEMS :]))) == 1


def test_a_bank_that_reads_back_differently_is_not_armed():
    exchange, link, _ = made()
    store(exchange, OLD)
    read_back = link.read_back

    async def damaged(*, gives_way):
        read = list(await read_back(gives_way=gives_way))
        place = 42 + RETURN_ITEMS + 1
        read[place] = replace(read[place], latitude_e7=read[place].latitude_e7 + 100)
        return tuple(read)

    link.read_back = damaged
    assert store(exchange, NEW) != ""
    assert joined(link) == way_of(OLD)
