"""A clock that others move wakes who is due, in order; the wall clock is the computer's."""

import asyncio
import itertools
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.clock import ManualClock, WallClock


async def settle():
    for _ in range(3):
        await asyncio.sleep(0)


def test_it_shows_what_it_was_set_to():
    clock = ManualClock(5.0)
    assert clock.now_s() == 5.0
    assert clock.advance_to(7.5) == 0
    assert clock.now_s() == 7.5


def test_it_never_goes_back():
    clock = ManualClock(5.0)
    with pytest.raises(ValueError, match=r"back from 5\.0 s to 4\.9 s"):
        clock.advance_to(4.9)
    assert clock.now_s() == 5.0
    clock.advance_to(5.0)


def test_an_instant_that_has_come_is_not_waited_for_but_others_get_their_turn():
    async def run():
        clock, turns = ManualClock(5.0), []
        other = asyncio.create_task(settle())
        other.add_done_callback(lambda _: turns.append("other"))
        await clock.sleep_until(5.0)
        await clock.sleep_until(1.0)
        await settle()
        return turns

    assert asyncio.run(run()) == ["other"]


async def test_nobody_wakes_early():
    clock = ManualClock()
    assert not clock.is_awaited
    task = asyncio.create_task(clock.sleep_until(1.0))
    await settle()
    assert clock.is_awaited
    assert clock.advance_to(0.999) == 0
    await settle()
    assert not task.done()
    assert clock.advance_to(1.0) == 1
    assert not clock.is_awaited
    await settle()
    assert task.done()


@given(st.lists(st.integers(1, 20), min_size=1, max_size=12))
def test_all_who_are_due_wake_in_the_order_of_their_instants(instants):
    async def run():
        clock, woken = ManualClock(), []

        async def sleeper(number, instant):
            await clock.sleep_until(float(instant))
            woken.append((instant, number))

        tasks = [asyncio.create_task(sleeper(n, instant)) for n, instant in enumerate(instants)]
        await settle()
        counted = clock.advance_to(10.0)
        await settle()
        due = sorted((instant, n) for n, instant in enumerate(instants) if instant <= 10)
        assert woken == due
        assert counted == len(due)
        clock.advance_to(20.0)
        await asyncio.gather(*tasks)
        assert woken == sorted((instant, n) for n, instant in enumerate(instants))

    asyncio.run(run())


async def test_who_gave_up_is_not_woken():
    clock = ManualClock()
    tasks = [asyncio.create_task(clock.sleep_until(1.0)) for _ in range(2)]
    await settle()
    tasks[0].cancel()
    await settle()
    assert clock.advance_to(2.0) == 1
    await tasks[1]


def test_the_wall_clock_is_monotonic_time():
    clock = WallClock()
    before, shown, after = time.monotonic(), clock.now_s(), time.monotonic()
    assert before <= shown <= after
    readings = [clock.now_s() for _ in range(100)]
    assert all(a <= b for a, b in itertools.pairwise(readings))


def test_the_wall_clock_sleeps_to_the_instant(monkeypatch):
    slept = []

    async def sleep(seconds):
        slept.append(seconds)

    monkeypatch.setattr("companion.clock.time.monotonic", lambda: 100.0)
    monkeypatch.setattr("companion.clock.asyncio.sleep", sleep)
    clock = WallClock()
    asyncio.run(clock.sleep_until(101.5))
    asyncio.run(clock.sleep_until(99.0))
    assert slept == [1.5, 0.0]
