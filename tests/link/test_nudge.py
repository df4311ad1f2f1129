"""Items that are lost on the way are sent again, through MAVSDK itself."""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.errors import TransferError
from companion.link.nudge import PATIENCE_S, REPEAT_S, Nudge
from tests.link.fake_autopilot import FakeAutopilot
from tests.link.test_autopilot import bench, mission, run, until


def test_a_question_is_told_again_every_half_second_until_patience_ends():
    nudge = Nudge()
    assert nudge.due(0.0) is None
    nudge.note_question(b"5?", 10.0)
    times = [10.0 + 0.1 * n for n in range(100)]
    told = [now for now in times if nudge.due(now) == b"5?"]
    assert told[0] == pytest.approx(10.0 + REPEAT_S)
    assert told[-1] <= 10.0 + PATIENCE_S
    assert len(told) == pytest.approx(PATIENCE_S / REPEAT_S, abs=1)


def test_a_new_question_begins_anew():
    nudge = Nudge()
    nudge.note_question(b"5?", 0.0)
    nudge.note_question(b"6?", 6.9)
    assert nudge.due(7.0) is None
    assert nudge.due(7.4) == b"6?"


def test_only_a_repeated_item_is_noise():
    nudge = Nudge()
    assert not nudge.is_noise(13)
    nudge.note_question(b"0?", 0.0)
    assert nudge.is_noise(13)
    assert not any(nudge.is_noise(result) for result in (0, 1, 3, 4, 14, 15))


class Forgetful(FakeAutopilot):
    """Loses the first copy of every third item, and never asks for it again."""

    def __init__(self, **settings):
        super().__init__(**settings)
        self.lost = set()

    def on_mission_item_int(self, message):
        if message.seq % 3 == 1 and message.seq not in self.lost:
            self.lost.add(message.seq)
            return []
        return super().on_mission_item_int(message)


class Strict(FakeAutopilot):
    """Says so, as ArduPlane does, when an item comes twice; loses every fourth question."""

    def on_mission_item_int(self, message):
        if message.seq != len(self.incoming):
            again = [self._request(len(self.incoming))]
            return [mavlink.MAVLink_mission_ack_message(1, 195, 13, 0), *again]
        replies = super().on_mission_item_int(message)
        return [] if message.seq % 4 == 2 and len(self.incoming) < self.expected else replies


@pytest.mark.parametrize("kind", [Forgetful, Strict])
def test_lost_items_and_questions_are_made_good(kind):
    async def body():
        autopilot = kind()
        async with bench(autopilot) as made:
            await made.link.upload(mission())
            assert [item.seq for item in autopilot.items] == list(range(14))

    run(body())


def test_the_last_item_is_held_back_however_often_it_is_asked_for():
    async def body():
        autopilot = FakeAutopilot(autopilot=12, request_id=51)
        async with bench(autopilot) as made:
            with pytest.raises(TransferError):
                await made.link.upload(mission(), lambda: False)
            assert len(autopilot.incoming) == 13
            assert autopilot.items == []
            assert made.link.counters["withdrawn"] >= 1
            await until(lambda: any(m.get_type() == "MISSION_ACK" for m in autopilot.heard))
            await asyncio.sleep(0.05)
            await made.link.upload(mission(), lambda: True)
            assert len(autopilot.items) == 14

    run(body())
