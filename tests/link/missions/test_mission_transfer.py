"""Transfers over a link that loses, delays, doubles and reorders, to the simulator's mission machines.

Those (``arduplane_transfer`` and ``px4_transfer`` in ``sim.autopilot``) were written apart from what is
tested here, after what real autopilots were measured to do.
"""

import asyncio
import heapq
import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.clock import ManualClock
from companion.errors import TransferError
from companion.link.messages.codec import Codec
from companion.link.missions.autopilot_link import AutopilotLink
from companion.link.missions.mission_transfer import (
    REPEAT_MAX_S,
    REPEAT_MIN_S,
    TRANSFER_TIMEOUT_S,
    MissionDownload,
    RoundTrip,
    Upload,
)
from companion.link.wire.decoded_frame import (
    MissionAck,
    MissionCount,
    MissionItemReceived,
    MissionItemRequest,
)
from companion.link.wire.framing import frames_in
from companion.mission.item_difference import difference
from companion.types.mavlink_enums import MissionResult
from sim.autopilot.arduplane.arduplane_store import MissionStore
from sim.autopilot.arduplane.arduplane_transfer import MissionTransfer
from sim.autopilot.channel import Channel
from sim.autopilot.px4.px4_store import stored
from sim.autopilot.px4.px4_transfer import Px4Transfer
from sim.mission_types import MissionKind
from tests.mission.made import item

STEP_S = 0.02
COUNT, PART = 14, slice(5, 11)
ITEMS = tuple(item(number, is_current=number == 1) for number in range(COUNT))
HIGHER = tuple(replace(entry, altitude_m=700.0) for entry in ITEMS)
GOOD = {"loss": 0.0, "delay_s": 0.0, "jitter_s": 0.0, "doubled": 0.0}


class Wire:
    """One direction of a link: frames get lost, late, or come twice."""

    def __init__(self, random, loss, delay_s, jitter_s, doubled):
        self._random = random
        self._how = loss, delay_s, jitter_s, doubled
        self._waiting, self._order = [], itertools.count()
        self.num_sent = 0

    def put(self, now_s, data):
        loss, delay_s, jitter_s, doubled = self._how
        for frame in frames_in(data):
            self.num_sent += 1
            lost, late, twice = self._random.random(3)
            for _ in range(0 if lost < loss else 1 + (twice < doubled)):
                heapq.heappush(self._waiting, (now_s + delay_s + late * jitter_s, next(self._order), frame))

    def take(self, now_s):
        frames = b""
        while self._waiting and self._waiting[0][0] <= now_s + 1e-9:
            frames += heapq.heappop(self._waiting)[2]
        return frames


class ArduPlane:
    """Its mission machine and list."""

    number = 3

    def __init__(self):
        self.channel = Channel(1, 1)
        self.store = MissionStore(item(0, latitude_e7=0, longitude_e7=0, altitude_m=0.0))
        self.machine = MissionTransfer(self.store, lambda *_: None, lambda: False)

    @property
    def items(self):
        return tuple(self.store.items(MissionKind.MISSION))


class Px4:
    """Its mission machine and list."""

    number = 12
    current_item = 0

    def __init__(self):
        self.channel = Channel(1, 1)
        self.kept = stored([])
        self.num_switches = 0
        self.machine = Px4Transfer(self, lambda *_: None)

    @property
    def items(self):
        return tuple(self.kept.items)

    def stored_list(self, _kind):
        return self.kept

    def switch(self, _kind, new, _current):
        self.kept = new
        self.num_switches += 1

    def forget_reached(self):
        pass


class Bench:
    """A link to a mission machine, on simulated time."""

    def __init__(self, autopilot, seed, **how):
        random = np.random.default_rng(seed)
        self.autopilot = autopilot
        self.clock = ManualClock()
        self.there, self.back = Wire(random, **how), Wire(random, **how)
        self.codec = Codec(1)
        self.link = AutopilotLink(
            self.codec, self.clock, lambda data: self.there.put(self.clock.now_s(), data)
        )
        writer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._hear(bytes(mavlink.MAVLink_heartbeat_message(1, autopilot.number, 217, 10, 4, 3).pack(writer)))

    def _send(self, data):
        self.there.put(self.clock.now_s(), data)

    def _hear(self, data):
        for frame in self.codec.feed(data, self.clock.now_s()):
            self.link.receive(frame)

    async def until_done(self, call, limit_s=120.0):
        """The call's result, and how long it took."""
        task, began_s = asyncio.create_task(call), self.clock.now_s()
        while True:
            for _ in range(6):
                await asyncio.sleep(0)
            if task.done():
                return await task, self.clock.now_s() - began_s
            now = self.clock.now_s() + STEP_S
            assert now - began_s < limit_s, "hangs"
            self.step(now)

    def step(self, now_s):
        channel, machine, now_us = self.autopilot.channel, self.autopilot.machine, round(now_s * 1e6)
        for message in channel.parse(self.there.take(now_s)):
            machine.handle(channel, message, now_us)
        machine.update(now_us)
        self.back.put(now_s, channel.take())
        self.clock.advance_to(now_s)
        self._hear(self.back.take(now_s))


def with_list(bench, items):
    """Put a list into an autopilot."""
    if isinstance(bench.autopilot, Px4):
        bench.autopilot.kept = stored(list(items))
    else:
        for entry in items:
            bench.autopilot.store.put(MissionKind.MISSION, entry)


async def written(autopilot, seed, part=None, **how):
    bench = Bench(autopilot, seed, **how)
    if part is None:
        return bench, *await bench.until_done(bench.link.upload(ITEMS))
    with_list(bench, ITEMS)
    return bench, *await bench.until_done(bench.link.write(HIGHER[part]))


@pytest.mark.parametrize("kind", [ArduPlane, Px4])
def test_without_losses_each_item_is_sent_once(kind):
    bench, _, _ = asyncio.run(written(kind(), 1, **GOOD))
    assert not difference(ITEMS, bench.autopilot.items)
    assert bench.there.num_sent == 1 + COUNT


def test_a_px4_names_what_it_stored():
    bench, opaque_id, _ = asyncio.run(written(Px4(), 1, **GOOD))
    assert opaque_id == bench.autopilot.kept.identity != 0


def test_a_part_alone_is_sent_and_the_rest_stays():
    bench, _, _ = asyncio.run(written(ArduPlane(), 1, PART, **GOOD))
    assert bench.there.num_sent == 1 + len(HIGHER[PART])
    assert not difference((*ITEMS[:5], *HIGHER[PART], *ITEMS[11:]), bench.autopilot.items)


async def test_a_part_behind_the_list_is_refused():
    bench = Bench(ArduPlane(), 1, **GOOD)
    with_list(bench, ITEMS[:4])
    with pytest.raises(TransferError, match="ERROR"):
        await bench.until_done(bench.link.write(ITEMS[8:]))
    assert len(bench.autopilot.items) == 4


BAD_LINKS = {
    "loss": st.floats(0.0, 0.45),
    "delay_s": st.floats(0.0, 0.6),
    "jitter_s": st.floats(0.0, 0.4),
    "doubled": st.floats(0.0, 0.5),
}


@settings(max_examples=120, deadline=None)
@given(st.sampled_from([ArduPlane, Px4]), st.integers(0, 10_000), st.fixed_dictionaries(BAD_LINKS))
@example(ArduPlane, 0, {"loss": 0.2, "delay_s": 0.0, "jitter_s": 0.0, "doubled": 0.0})
@example(Px4, 0, {"loss": 0.2, "delay_s": 0.3, "jitter_s": 0.4, "doubled": 0.3})
def test_what_is_said_to_be_stored_is_stored(kind, seed, how):
    try:
        bench, _, _ = asyncio.run(written(kind(), seed, **how))
    except TransferError as error:
        # Too bad a link, or a last acknowledgement that was lost: then nothing is claimed.
        assert "TIMEOUT" in str(error) or "ERROR" in str(error) or "CANCELLED" in str(error)  # noqa: PT017
        return
    assert not difference(ITEMS, bench.autopilot.items)


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 10_000), st.fixed_dictionaries(BAD_LINKS))
def test_what_is_read_is_what_is_held(seed, how):
    async def body():
        bench = Bench(ArduPlane(), seed, **how)
        with_list(bench, ITEMS)
        try:
            read, _ = await bench.until_done(bench.link.read_back())
        except TransferError as error:
            assert "TIMEOUT" in str(error)  # noqa: PT017
            return
        assert read == tuple(replace(entry, is_current=False) for entry in bench.autopilot.items)

    asyncio.run(body())


@settings(max_examples=60, deadline=None)
@given(st.sampled_from([ArduPlane, Px4]), st.integers(0, 10_000), st.fixed_dictionaries(BAD_LINKS))
def test_the_last_item_never_leaves_without_leave(kind, seed, how):
    async def body():
        bench = Bench(kind(), seed, **how)
        with pytest.raises(TransferError):
            await bench.until_done(bench.link.upload(ITEMS, lambda: False))
        for _ in range(int(12.0 / STEP_S)):
            bench.step(bench.clock.now_s() + STEP_S)
        assert len(bench.autopilot.items) < COUNT

    asyncio.run(body())


@pytest.mark.parametrize("kind", [ArduPlane, Px4])
def test_a_fifth_lost_costs_seconds_not_tens_of_seconds(kind):
    # With questions repeated once a second, as ArduPlane does, fourteen items would take 8 s.
    took, how = [], GOOD | {"loss": 0.2, "delay_s": 0.01}
    for seed in range(40):
        try:
            took.append(asyncio.run(written(kind(), seed, **how))[2])
        except TransferError:
            continue
    assert len(took) >= 25  # the rest lost their last acknowledgement, and are read back
    assert np.median(took) < 2.5


def test_a_reading_asks_for_several_items_at_once():
    async def body(delay_s):
        bench = Bench(ArduPlane(), 1, **(GOOD | {"delay_s": delay_s}))
        with_list(bench, ITEMS)
        return await bench.until_done(bench.link.read_back())

    _, took_s = asyncio.run(body(0.2))
    # Length, then 14 items in windows of 6: four round trips of 0.4 s and steps; one by one it were 6 s.
    assert took_s < 5 * 0.5


def test_an_arduplane_is_sent_several_items_at_once():
    """Written: the opening, then six items in each round trip; one by one, fourteen items took 5.7 s."""
    _, _, took_s = asyncio.run(written(ArduPlane(), 1, **(GOOD | {"delay_s": 0.2})))
    # The opening, then 14 items in windows of 6: four round trips of 0.4 s, and steps of 0.02 s.
    assert took_s < 4 * 0.4 + 10 * STEP_S


def test_unsent_items_of_the_window_are_sent_and_after_a_silence_all_of_it_and_the_next():
    upload = Upload(ITEMS, RoundTrip(), 0.0, window=3)
    upload.due(0.0)
    upload.note_request(MissionItemRequest(0, 0), 0.1)
    assert list(upload.due(0.1)) == [0, 1, 2]
    upload.note_request(MissionItemRequest(2, 0), 0.2)  # It has 0 and 1.
    assert list(upload.due(0.2)) == [3, 4]
    assert list(upload.due(2.0)) == [2, 3, 4, 5]
    upload.note_request(MissionItemRequest(4, 0), 2.1)
    assert list(upload.due(2.1)) == [5, 6]


def test_items_behind_a_lost_one_are_sent_again_once_they_are_refused():
    trip = RoundTrip()
    upload = Upload(ITEMS, trip, 0.0, window=3)
    upload.due(0.0)
    upload.note_request(MissionItemRequest(0, 0), 0.05)
    assert list(upload.due(0.05)) == [0, 1, 2]
    for refused_s in (0.105, 0.106):  # Item 0 was lost; 1 and 2 are refused.
        upload.note_ack(MissionAck(refused_s, MissionResult.INVALID_SEQUENCE, 0, 0), refused_s)
        assert list(upload.due(refused_s)) == ([0, 1, 2] if refused_s == 0.105 else [])


@pytest.mark.parametrize("late", [MissionResult.ERROR, MissionResult.INVALID_SEQUENCE])
def test_a_refusal_of_an_item_of_the_transfer_before_does_not_end_the_next(late):
    """An ArduPlane refuses an item that was sent twice, after the upload is complete (measured)."""
    upload, reading = Upload(ITEMS, RoundTrip(), 0.0), MissionDownload(RoundTrip(), 0.0, 6)
    for transfer in (upload, reading):
        assert transfer.due(0.0) == [-1]
        transfer.note_ack(MissionAck(0.02, late, 0, 0), 0.02)
        assert transfer.failure is None
        assert transfer.due(1.0) == [-1]
        transfer.note_ack(MissionAck(1.1, late, 0, 0), 1.1)  # So is the second opening.
        assert transfer.failure == late.name


def test_an_acknowledgement_from_before_ends_nothing():
    upload = Upload(ITEMS, RoundTrip(), 0.0)
    assert upload.due(0.0) == [-1]
    upload.note_ack(MissionAck(0.1, 0, 0, 0), 0.1)
    assert upload.failure is None
    for number in range(COUNT):
        upload.note_request(MissionItemRequest(number, 0), 0.2)
        assert upload.due(0.2) == [number]
    upload.note_ack(MissionAck(0.3, 0, 0, 77), 0.3)
    assert (upload.failure, upload.opaque_id) == ("", 77)


def test_fences_and_rallies_of_others_are_no_concern():
    upload = Upload(ITEMS, RoundTrip(), 0.0)
    upload.due(0.0)
    upload.note_request(MissionItemRequest(0, 1), 0.1)
    assert upload.due(0.1) == []
    upload.note_ack(MissionAck(0.1, 14, 1, 0), 0.1)
    assert upload.failure is None
    upload.note_ack(MissionAck(0.1, 14, 0, 0), 0.1)
    assert upload.failure == "DENIED"


def test_of_a_reading_the_first_length_of_the_own_list_counts():
    reading = MissionDownload(RoundTrip(), 0.0, 6)
    assert reading.due(0.0) == [-1]
    reading.note_count(MissionCount(9, 1), 0.1)  # The fence's.
    assert reading.due(0.1) == []
    reading.note_count(MissionCount(2, 0), 0.2)
    assert reading.due(0.2) == [0, 1]
    reading.note_count(MissionCount(5, 0), 0.3)  # The answer to a question that was repeated.
    assert reading.due(0.3) == []
    for number in range(2):
        assert reading.failure is None
        reading.note_item(MissionItemReceived(ITEMS[number], 0), 0.4)
    assert (reading.failure, reading.items) == ("", ITEMS[:2])
    reading.note_count(MissionCount(0, 0), 0.5)
    assert reading.items == ITEMS[:2]


def test_a_reading_leaves_out_the_end_of_the_list():
    reading = MissionDownload(RoundTrip(), 0.0, 6, num_left_out=3)
    reading.due(0.0)
    reading.note_count(MissionCount(5, 0), 0.1)
    assert reading.due(0.2) == [0, 1]
    for number in range(2):
        reading.note_item(MissionItemReceived(ITEMS[number], 0), 0.3)
    assert (reading.failure, reading.items) == ("", ITEMS[:2])


def test_a_reading_of_a_list_that_is_shorter_than_what_is_left_out_is_empty():
    reading = MissionDownload(RoundTrip(), 0.0, 6, num_left_out=3)
    reading.due(0.0)
    reading.note_count(MissionCount(2, 0), 0.1)
    assert (reading.failure, reading.items) == ("", ())


def test_a_reading_that_was_given_up_stays_given_up():
    reading = MissionDownload(RoundTrip(), 0.0, 6)
    reading.abandon()
    reading.note_count(MissionCount(0, 0), 0.1)
    assert reading.failure == "ABANDONED"


def test_an_unanswered_item_goes_again_with_the_next():
    upload = Upload(ITEMS, RoundTrip(), 0.0)
    upload.due(0.0)
    upload.note_request(MissionItemRequest(4, 0), 0.1)
    assert upload.due(0.1) == [4]
    assert upload.due(0.15) == []
    assert upload.due(2.0) == [4, 5]
    assert upload.due(0.1 + TRANSFER_TIMEOUT_S + 0.1) == []
    assert upload.failure == "TIMEOUT"


def test_the_time_to_repeat_follows_rfc_6298():
    # First answer R: SRTT = R, RTTVAR = R/2, RTO = SRTT + 4·RTTVAR = 3 R; then α = 1/8, β = 1/4.
    trip = RoundTrip()
    trip.note_answer(0.2)
    assert trip.repeat_s == pytest.approx(0.6)
    trip.note_answer(0.3)  # RTTVAR = 0.75·0.1 + 0.25·|0.2 − 0.3| = 0.1; SRTT = 0.875·0.2 + 0.125·0.3 = 0.2125
    assert trip.repeat_s == pytest.approx(0.2125 + 0.4)


def test_what_the_line_takes_is_known_though_everything_is_repeated():
    """3.5 s there and back: each item is asked for again before the line can have answered."""
    trip = RoundTrip()
    assert trip.shortest_s == 0.0
    upload = Upload(ITEMS, trip, 0.0)
    sent = upload.due(0.0)
    for number in range(3):
        begun_s = 3.5 * number
        for tick in range(1, 7):
            sent += upload.due(begun_s + 0.5 * tick)
        upload.note_request(MissionItemRequest(number, 0), begun_s + 3.5)
        sent += upload.due(begun_s + 3.5)
    assert sent.count(0) > 1
    assert trip.shortest_s == pytest.approx(3.5)
    assert trip.repeat_s < 1.6  # of which answers to what was repeated tell nothing


def test_of_the_last_answers_the_quickest_tells_what_the_line_takes():
    """A lost frame makes an answer late; a line that has become slow is noticed ten answers later."""
    trip = RoundTrip()
    for took_s in (0.1, 1.6, 0.12, 1.5):
        trip.note_first_answer(took_s)
    assert trip.shortest_s == 0.1
    for _ in range(10):
        trip.note_first_answer(2.0)
    assert trip.shortest_s == 2.0


@given(st.lists(st.floats(0.0, 60.0), min_size=1, max_size=40))
def test_the_time_to_repeat_stays_within_its_limits(answers):
    trip = RoundTrip()
    for took_s in answers:
        trip.note_answer(took_s)
        assert REPEAT_MIN_S <= trip.repeat_s <= REPEAT_MAX_S


async def test_a_count_that_came_late_is_cancelled_and_cuts_no_longer_list_off():
    # A PX4 takes a count before any item for a repetition, and overlooks that it is another.
    bench = Bench(Px4(), 1, **GOOD)
    with_list(bench, ITEMS[:6])
    bench.there.put(0.0, bench.codec.mission_opening(0, 6, is_part=False))
    for step in range(1, 20):
        bench.step(step * STEP_S)
    await bench.until_done(bench.link.upload(ITEMS))
    assert not difference(ITEMS, bench.autopilot.items)
