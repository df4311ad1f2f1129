"""Missions to and from a small autopilot in the same process, by MAVSDK and by our own transfers."""

import asyncio
import math
from contextlib import asynccontextmanager
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.clock import ManualClock, WallClock
from companion.errors import NoAutopilotError, TransferError
from companion.link.messages.codec import Codec
from companion.link.missions.autopilot_link import AutopilotLink
from companion.types.mission import Command, MavFrame, MissionItem
from tests.link.missions.fake_autopilot import FakeAutopilot
from tests.link.pymavlink_frames import packed


def mission(count=14, current=1):
    return tuple(
        MissionItem(
            sequence=index,
            command=Command.NAV_WAYPOINT,
            frame=MavFrame.GLOBAL_RELATIVE_ALT,
            parameters=(0.0, 30.0, None, None),
            latitude_e7=-353_632_610 + 1_000 * index,
            longitude_e7=1_491_652_300,
            altitude_m=100.5,
            is_current=index == current,
        )
        for index in range(count)
    )


class Bench:
    """A link whose bytes reach the autopilot in the next round of the loop."""

    def __init__(self, autopilot, *, clock=None, timeout_s=20.0):
        self.autopilot = autopilot
        self.codec = Codec(1)
        self.pending = []
        self.sent = []
        self.link = AutopilotLink(
            self.codec,
            clock or WallClock(),
            self.send,
            timeout_s=timeout_s,
        )
        reader = self.link._mavsdk
        count = reader._count
        reader._count = lambda change: (count(change), self.pending.append(reader._pending_calls))

    def send(self, data):
        self.sent.append(data)
        for reply in self.autopilot.receive(data):
            asyncio.get_running_loop().call_soon(self.hear, reply)

    def hear(self, data):
        for frame in self.codec.feed(data, 0.0):
            self.link.receive(frame)


@asynccontextmanager
async def bench(autopilot, **settings):
    made = Bench(autopilot, **settings)
    made.hear(autopilot.heartbeat())
    try:
        yield made
    finally:
        await made.link.close()


async def until(condition):
    while not condition():  # noqa: ASYNC110 the answer comes from MAVSDK's thread
        await asyncio.sleep(0.001)


@pytest.mark.parametrize("request_id", [40, 51])
async def test_what_is_uploaded_is_read_back(request_id):
    autopilot = FakeAutopilot(request_id=request_id)
    async with bench(autopilot) as made:
        await made.link.upload(mission())
        assert [item.seq for item in autopilot.items] == list(range(14))
        assert math.isnan(autopilot.items[3].param4)
        autopilot.current = 1
        assert await made.link.download() == mission()
        assert made.link._mavsdk._pending_calls == 0


async def test_calls_under_way_are_told():
    async with bench(FakeAutopilot()) as made:
        await made.link.upload(mission())
        assert made.pending == []  # no call of MAVSDK's
        await made.link.download()
        assert made.pending == [1, 0, 1, 0]  # finding the autopilot, then the transfer


async def test_nothing_but_the_mission_protocol_leaves():
    autopilot = FakeAutopilot()
    async with bench(autopilot) as made:
        await made.link.upload(mission())
        await made.link.download()
        kinds = {message.get_type() for message in autopilot.heard}
        assert kinds == {
            "MISSION_COUNT",
            "MISSION_ITEM_INT",
            "MISSION_REQUEST_LIST",
            "MISSION_REQUEST_INT",
            "MISSION_ACK",
        }
        assert {message.get_srcSystem() for message in autopilot.heard} == {1}
        assert {message.get_srcComponent() for message in autopilot.heard} == {195}
        numbers = [message.get_seq() for message in autopilot.heard]
        assert numbers == list(range(len(numbers)))


@pytest.mark.parametrize(("ack", "reason"), [(1, "ERROR"), (4, "NO_SPACE"), (14, "DENIED")])
async def test_refused_upload(ack, reason):
    async with bench(FakeAutopilot(ack=ack)) as made:
        with pytest.raises(TransferError, match=reason):
            await made.link.upload(mission())


async def passing(clock, until_s):
    """Let simulated time pass."""
    while clock.now_s() < until_s:
        for _ in range(10):
            await asyncio.sleep(0)
        clock.advance_to(clock.now_s() + 0.1)


@pytest.mark.parametrize("silent_after", [0, 5])
async def test_silence_ends_in_an_error_and_the_next_upload_works(silent_after):
    autopilot, clock = FakeAutopilot(silent_after=silent_after), ManualClock()
    async with bench(autopilot, clock=clock) as made:
        task = asyncio.create_task(made.link.upload(mission()))
        await passing(clock, 9.0)
        with pytest.raises(TransferError, match="upload: TIMEOUT"):
            await task
        autopilot.silent_after = None
        await made.link.upload(mission())
        assert len(autopilot.items) == 14


class Mute(FakeAutopilot):
    """Tells three items of its list, and then no more."""

    def on_mission_request_int(self, message):
        return super().on_mission_request_int(message) if message.seq < 3 else []


async def test_a_transfer_that_lasts_too_long_is_given_up_and_the_next_works():
    autopilot = Mute()
    async with bench(autopilot, timeout_s=0.2) as made:
        await made.link.upload(mission())
        with pytest.raises(TransferError, match=r"download: not finished after 0\.2 s"):
            await made.link.download()
        assert made.link._mavsdk._pending_calls == 0
        autopilot.on_mission_request_int = super(Mute, autopilot).on_mission_request_int
        assert len(await made.link.download()) == 14


@pytest.mark.parametrize(("dialect", "may_complete"), [(12, True), (12, False), (3, False)])
async def test_a_cancelled_upload_is_cancelled_at_the_autopilot(dialect, may_complete):
    autopilot = FakeAutopilot(silent_after=3, autopilot=dialect)
    async with bench(autopilot) as made:
        made.link.complete_while(lambda: may_complete)
        task = asyncio.create_task(made.link.upload(mission()))
        await until(lambda: len(autopilot.incoming) >= 3)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await until(lambda: autopilot.heard[-1].get_type() == "MISSION_ACK")
        assert autopilot.heard[-1].type == 15
        autopilot.silent_after = None
        await made.link.upload(mission())
        assert len(autopilot.items) == 14


async def test_an_arduplane_receives_the_rest_of_a_cancelled_upload_if_that_is_allowed():
    """Else it would deny the next transfer for 8 s."""
    autopilot, clock = FakeAutopilot(silent_after=3), ManualClock()
    async with bench(autopilot, clock=clock) as made:
        made.link.complete_while(lambda: True)
        task = asyncio.create_task(made.link.upload(mission()))
        await until(lambda: len(autopilot.incoming) >= 3)
        task.cancel()
        autopilot.silent_after = None
        await passing(clock, 1.5)  # An item is sent again after a second.
        with pytest.raises(asyncio.CancelledError):
            await task
        assert len(autopilot.items) == 14
        assert not any(message.get_type() == "MISSION_ACK" for message in autopilot.heard)


@pytest.mark.parametrize(("allowed_until_s", "ends_s"), [(99.0, 3.0), (2.0, 2.0)])
async def test_the_rest_is_sent_for_two_seconds_and_no_longer_than_is_allowed(allowed_until_s, ends_s):
    """The autopilot is silent; the pilot takes over, or does not."""
    autopilot, clock = FakeAutopilot(silent_after=3), ManualClock()
    async with bench(autopilot, clock=clock) as made:
        made.link.complete_while(lambda: clock.now_s() < allowed_until_s)
        task = asyncio.create_task(made.link.upload(mission()))
        await passing(clock, 1.0)
        task.cancel()
        await passing(clock, ends_s - 0.15)
        assert not task.done()
        await passing(clock, ends_s + 0.3)
        assert task.cancelled()


async def test_closing_ends_the_call_under_way():
    autopilot = Mute()
    async with bench(autopilot) as made:
        await made.link.upload(mission())
        task = asyncio.create_task(made.link.download())
        await until(lambda: autopilot.heard[-1].get_type() == "MISSION_REQUEST_INT")
        await made.link.close()
        with pytest.raises(TransferError, match="download: the link was closed"):
            await task
        autopilot.on_mission_request_int = super(Mute, autopilot).on_mission_request_int
        await made.link.download()


async def test_cancelling_while_the_autopilot_is_looked_for():
    async with bench(FakeAutopilot()) as made:
        task = asyncio.create_task(made.link.download())
        await asyncio.sleep(0)
        assert made.link._mavsdk._pending_calls == 1
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert made.link._mavsdk._pending_calls == 0
        assert await made.link.download() == ()


async def test_a_part_of_a_list_is_overwritten_and_the_whole_read_back():
    autopilot = FakeAutopilot()
    async with bench(autopilot) as made:
        await made.link.upload(mission())
        higher = tuple(replace(item, altitude_m=200.0) for item in mission()[5:9])
        await made.link.write(higher)
        autopilot.current = 1
        read = await made.link.read_back()
        assert read == (*mission()[:5], *higher, *mission()[9:])
        kinds = [message.get_type() for message in autopilot.heard]
        assert kinds.count("MISSION_COUNT") == 1
        assert kinds.count("MISSION_WRITE_PARTIAL_LIST") == 1
        assert kinds.count("MISSION_ITEM_INT") == 14 + 4


class Lossy(FakeAutopilot):
    """Loses every seventh frame in and every fifth answer but the last, and says some answers twice."""

    count = 0

    def receive(self, data):
        self.count += 1
        if self.count % 7 == 3:
            return []
        replies = super().receive(data)
        is_last = len(self.incoming) == self.expected
        return [] if self.count % 5 == 2 and not is_last else replies * (1 + (self.count % 4 == 1))


async def test_losses_and_repetitions_are_survived():
    async with bench(Lossy(request_id=51)) as made:

        async def repeat():
            while True:
                await asyncio.sleep(0.02)
                made.hear(made.autopilot.repeat())

        repeating = asyncio.create_task(repeat())
        await made.link.upload(mission())
        repeating.cancel()
        assert len(made.autopilot.items) == 14
        made.autopilot.current = 1
        assert await made.link.download() == mission()
        assert await made.link.read_back() == mission()


async def test_calls_at_the_same_time_take_turns():
    async with bench(FakeAutopilot()) as made:
        await made.link.upload(mission())
        made.autopilot.current = 1
        first, second = await asyncio.gather(made.link.download(), made.link.download())
        assert first == second == mission()
        assert max(made.pending) == 1


@pytest.mark.parametrize(
    ("items", "reason"),
    [
        (mission(current=99), "not exactly one item is current"),
        (mission()[1:], "not numbered from 0"),
        ((), "not exactly one item is current"),
    ],
)
async def test_lists_that_must_not_be_sent(items, reason):
    async with bench(FakeAutopilot()) as made:
        with pytest.raises(TransferError, match=reason):
            await made.link.upload(items)
        assert made.sent == []


def fence_item(sequence, mission_type):
    return mavlink.MAVLink_mission_item_int_message(
        1, 195, sequence, 3, 5004, 0, 1, 80.0, 0.0, 0.0, 0.0, -353_632_610, 1_491_652_300 + sequence, 0.0,
        mission_type,
    )  # fmt: skip


@pytest.mark.parametrize("autopilot", [3, 12])
async def test_a_fence_is_read(autopilot):
    async with bench(FakeAutopilot(autopilot=autopilot)) as made:
        asked = []
        made.autopilot.on_mission_request_list = lambda m: [
            mavlink.MAVLink_mission_count_message(1, 195, 3, m.mission_type)
        ]

        def item(message):
            asked.append((message.seq, message.mission_type))
            return [fence_item(message.seq, message.mission_type)]

        made.autopilot.on_mission_request_int = item
        items = await made.link.download_fence()
        assert [entry.command for entry in items] == [5004] * 3
        assert [entry.longitude_e7 for entry in items] == [1_491_652_300 + n for n in range(3)]
        assert asked == [(n, mavlink.MAV_MISSION_TYPE_FENCE) for n in range(3)]
        ack = made.autopilot.heard[-1]
        assert (ack.get_type(), ack.type, ack.mission_type) == ("MISSION_ACK", 0, 1)


@pytest.mark.parametrize("autopilot", [3, 12])
async def test_the_reading_of_a_fence_gives_way(autopilot):
    """One that hangs holds nothing up; a PX4 is told, or it would be busy for five seconds."""
    async with bench(FakeAutopilot(autopilot=autopilot)) as made:
        made.autopilot.on_mission_request_list = lambda message: []
        reading = asyncio.create_task(made.link.download_fence())
        await asyncio.sleep(0.01)
        await made.link.upload(mission())
        with pytest.raises(TransferError, match="fence: ABANDONED"):
            await reading
        cancelled = [
            message.mission_type
            for message in made.autopilot.heard
            if message.get_type() == "MISSION_ACK" and message.type == 15
        ]
        assert cancelled == ([1] if autopilot == 12 else [])


async def test_silence_ends_a_download():
    async with bench(FakeAutopilot()) as made:
        made.autopilot.on_mission_request_list = lambda message: []
        with pytest.raises(TransferError, match="download: TIMEOUT"):
            await made.link.download()
        assert [message.get_type() for message in made.autopilot.heard] == ["MISSION_REQUEST_LIST"] * 5


async def test_others_do_not_answer_for_the_autopilot():
    clock = ManualClock()
    async with bench(FakeAutopilot(), clock=clock) as made:
        made.autopilot.on_command_long = lambda message: []
        task = asyncio.create_task(made.link.set_current(1))
        await asyncio.sleep(0)
        made.hear(packed(mavlink.MAVLink_command_ack_message(224, 0), component=191))
        made.hear(packed(mavlink.MAVLink_command_ack_message(176, 0)))
        made.hear(packed(mavlink.MAVLink_command_ack_message(224, 5)))
        await asyncio.sleep(0)
        assert not task.done()
        made.hear(packed(mavlink.MAVLink_command_ack_message(224, 0)))
        await task
        assert clock.now_s() == 0.0


async def test_an_empty_autopilot_has_an_empty_mission():
    async with bench(FakeAutopilot()) as made:
        assert await made.link.download() == ()


@pytest.mark.parametrize("autopilot", [3, 12], ids=["ardupilot", "px4"])
async def test_set_current(autopilot):
    request_id = 40 if autopilot == 3 else 51
    async with bench(FakeAutopilot(autopilot=autopilot, request_id=request_id)) as made:
        await made.link.upload(mission())
        await made.link.set_current(7)
        assert made.autopilot.current == 7
        sent = made.autopilot.heard[-1].get_type()
        assert sent == ("COMMAND_LONG" if autopilot == 3 else "MISSION_SET_CURRENT")


async def test_set_current_refused():
    async with bench(FakeAutopilot()) as made:
        await made.link.upload(mission())
        with pytest.raises(TransferError, match="set_current: DENIED"):
            await made.link.set_current(99)


@pytest.mark.parametrize("autopilot", [3, 12])
async def test_set_current_unanswered_is_tried_again_for_four_and_a_half_seconds_by_our_clock(autopilot):
    clock = ManualClock()
    async with bench(FakeAutopilot(autopilot=autopilot), clock=clock) as made:
        made.autopilot.on_command_long = lambda message: []
        task = asyncio.create_task(made.link.set_current(99))
        await passing(clock, 4.4)
        assert not task.done()
        await passing(clock, 4.7)
        with pytest.raises(TransferError, match="set_current: no answer"):
            await task
        assert len(made.sent) == 6  # 0.8 s apart, as long as no round trip is known


@pytest.mark.parametrize("autopilot", [3, 12])
async def test_set_current_is_not_tried_again_once_the_item_is_passed(autopilot):
    clock = ManualClock()
    async with bench(FakeAutopilot(autopilot=autopilot), clock=clock) as made:
        made.autopilot.on_command_long = made.autopilot.on_mission_set_current = lambda message: []
        ahead = [True, False]
        task = asyncio.create_task(made.link.set_current(1, lambda: ahead.pop(0)))
        await passing(clock, 5.0)
        with pytest.raises(TransferError):
            await task
        assert len(made.sent) == 2


async def test_the_new_item_itself_answers_where_the_acknowledgement_is_lost():
    async with bench(FakeAutopilot(), clock=ManualClock()) as made:
        await made.link.upload(mission())
        made.autopilot.on_command_long = lambda message: []
        task = asyncio.create_task(made.link.set_current(5))
        await asyncio.sleep(0)
        made.autopilot.current = 4
        made.hear(made.autopilot.mission_current())
        await asyncio.sleep(0)
        assert not task.done()
        made.autopilot.current = 5
        made.hear(made.autopilot.mission_current())
        await task


async def test_the_last_item_is_held_back_however_often_it_is_asked_for():
    autopilot = FakeAutopilot(autopilot=12, request_id=51)
    async with bench(autopilot) as made:
        with pytest.raises(TransferError, match="WITHDRAWN"):
            await made.link.upload(mission(), lambda: False)
        assert len(autopilot.incoming) == 13
        assert autopilot.items == []
        assert made.link.counters["withdrawn"] == 1
        assert autopilot.heard[-1].get_type() == "MISSION_ACK"
        assert autopilot.heard[-1].type == 15
        await made.link.upload(mission(), lambda: True)
        assert len(autopilot.items) == 14


async def test_modes():
    autopilot = FakeAutopilot()
    async with bench(autopilot) as made:
        with pytest.raises(TransferError, match="set_mode: UNSUPPORTED"):
            await made.link.set_mode("RTL")
        assert (autopilot.heard[-1].command, autopilot.heard[-1].param1) == (176, 1.0)
        assert autopilot.heard[-1].param2 == 11.0
        with pytest.raises(TransferError, match="set_mode: no mode DANCE"):
            await made.link.set_mode("DANCE")


async def test_without_an_autopilot():
    made = Bench(FakeAutopilot())
    for call in (made.link.upload(mission()), made.link.download(), made.link.set_current(1)):
        with pytest.raises(NoAutopilotError):
            await call
    await made.link.close()
