"""When the fences are read, on a clock that the test moves."""

import asyncio
import itertools
from dataclasses import replace
from types import SimpleNamespace

import pytest

from companion.clock import ManualClock
from companion.config import mission_from_text
from companion.errors import TransferError
from companion.flight.monitors.geofences import (
    NAMED_REPEAT_S,
    READING_SHARE,
    REPEAT_BUSY_S,
    REPEAT_MIN_S,
    Geofences,
)
from companion.flight.state.flight_state import StateOwner, first_state
from companion.types.events import Dialect, MissionCurrent
from tests.sim.client import PLAIN


class Link:
    """Stands in for the autopilot; a reading takes ``lasts_s``."""

    def __init__(self, clock):
        self.clock, self.read_s, self.is_exchanging = clock, [], False
        self.current, self.dialect = MissionCurrent(0.0, 1, 2, 0), Dialect.PX4
        self.lasts_s, self.fails = 0.0, False

    async def download_fence(self):
        self.read_s.append(self.clock.now_s())
        self.clock.advance_to(self.clock.now_s() + self.lasts_s)
        if self.fails:
            raise TransferError("fence", "TIMEOUT")
        return ()


@pytest.fixture
def parts():
    clock = ManualClock()
    flight = StateOwner(first_state(mission_from_text(PLAIN, "plain.yaml"), 0.0))
    link = Link(clock)
    fences = Geofences(flight, SimpleNamespace(), link, SimpleNamespace(), clock)
    return SimpleNamespace(clock=clock, link=link, fences=fences)


def looked_at(parts, until_s, every_s=0.2):
    while parts.clock.now_s() < until_s:
        asyncio.run(parts.fences.keep_up())
        parts.clock.advance_to(parts.clock.now_s() + every_s)
    return parts.link.read_s


@pytest.mark.parametrize(
    ("dialect", "again_s"), [(Dialect.PX4, REPEAT_BUSY_S), (Dialect.ARDUPILOT, REPEAT_MIN_S)]
)
def test_a_list_without_a_name_is_read_again_and_again(parts, dialect, again_s):
    """Less often from a PX4, which denies uploads while it is read."""
    parts.link.dialect = dialect
    read_s = looked_at(parts, 10.0, every_s=0.05)
    gaps = [later - earlier for earlier, later in itertools.pairwise(read_s)]
    assert gaps == pytest.approx([again_s] * len(gaps), abs=0.06)
    assert len(gaps) >= 8.0 / again_s


def test_one_with_a_name_is_read_when_the_name_changes(parts):
    parts.link.current = replace(parts.link.current, fence_id=7)
    assert looked_at(parts, 20.0) == [0.0]
    parts.link.current = replace(parts.link.current, fence_id=8)
    assert looked_at(parts, 20.7) == pytest.approx([0.0, 20.0], abs=0.21)
    assert looked_at(parts, 60.0)[2] == pytest.approx(20.0 + NAMED_REPEAT_S, abs=0.41)


def test_a_slow_reading_leaves_the_link_to_others(parts):
    parts.link.lasts_s = 0.5
    read_s = looked_at(parts, 30.0)
    gaps = [later - earlier for earlier, later in itertools.pairwise(read_s)]
    assert min(gaps) >= READING_SHARE * 0.5


def test_nothing_is_read_while_a_mission_is_exchanged(parts):
    parts.link.is_exchanging = True
    assert looked_at(parts, 5.0) == []


def test_a_name_whose_list_could_not_be_read_is_tried_again(parts):
    parts.link.current = replace(parts.link.current, fence_id=7)
    parts.link.fails = True
    assert len(looked_at(parts, 5.0)) in (4, 5), "no storm"
    parts.link.fails = False
    before = len(parts.link.read_s)
    assert len(looked_at(parts, 20.0)) == before + 1


def test_the_first_plan_knows_them(parts):
    asyncio.run(parts.fences.catch_up())
    asyncio.run(parts.fences.catch_up())
    assert parts.link.read_s == [0.0]


def test_the_next_flights_first_plan_knows_what_was_drawn_between(parts):
    asyncio.run(parts.fences.catch_up())
    looked_at(parts, 20.0)
    parts.clock.advance_to(600.0)  # on the ground nobody keeps them up
    asyncio.run(parts.fences.catch_up())
    assert parts.link.read_s[-1] == 600.0
