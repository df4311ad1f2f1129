"""The radio of a team: who receives what, when, and what is lost."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import load_mission
from companion.link.messages.codec import Codec
from sim.simulator import Simulator
from sim.team.simulated_radio import Radio
from tests.sim.client import CONFIGS

MISSION = load_mission(CONFIGS / "first-flight.yaml").model_copy(update={"dynamic_threats": ()})


def flown(num=2, duration_s=20.0, **settings):
    """What each service receives of the others' team messages, one of which is sent each second."""
    simulators = [Simulator(MISSION, seed=number, system_id=number) for number in range(1, num + 1)]
    radio = Radio(simulators, **settings)
    codecs = [Codec(number) for number in range(1, num + 1)]
    parsers = [mavlink.MAVLink(None) for _ in simulators]
    received = [[] for _ in simulators]
    for step in range(round(duration_s / 0.1)):
        now_s = 0.1 * (step + 1)
        for number, simulator in enumerate(simulators):
            simulator.step(0.1)
            if step % 10 == 0:
                simulator.receive(codecs[number].heartbeat())
                simulator.receive(codecs[number].team_message(bytes([number, step // 10])))
            for message in parsers[number].parse_buffer(simulator.take_outgoing()) or ():
                if message.get_type() == "TUNNEL":
                    received[number].append((round(now_s, 1), message.get_srcSystem(), message.payload[1]))
                elif message.get_type() == "GLOBAL_POSITION_INT" and message.get_srcSystem() != number + 1:
                    received[number].append((round(now_s, 1), message.get_srcSystem(), None))
        radio.step(now_s)
    return received, radio


def test_everybody_receives_the_messages_and_positions_of_all_others_late_by_the_delay():
    received, radio = flown(num=3, delay_s=1.0)
    for number, found in enumerate(received, 1):
        for other in {1, 2, 3} - {number}:
            told = [(at, count) for at, sender, count in found if sender == other and count is not None]
            assert [count for _, count in told] == sorted(count for _, count in told)
            assert len(told) >= 18
            late = [at - 0.1 - count for at, count in told]
            assert min(late) >= 0.5 - 1e-6
            assert max(late) <= 1.2 + 1e-6  # and a step of the simulator on either side
            assert len([1 for _, sender, count in found if sender == other and count is None]) >= 15
        assert not [1 for _, sender, _ in found if sender == number]
    # 12 bytes of MAVLink 2, 5 of TUNNEL and 2 of ours; zeros at the end are left out.
    assert radio.bytes_sent == pytest.approx([20 * (12 + 5 + 2)] * 3, abs=3)


@pytest.mark.parametrize(("loss", "least", "most"), [(0.5, 60, 140), (1.0, 0, 0)])
def test_the_stated_share_is_lost(loss, least, most):
    received, _ = flown(duration_s=100.0, loss=loss)  # 100 messages each way
    assert least <= sum(count is not None for found in received for _, _, count in found) <= most


def test_nobody_beyond_the_range_receives_anything():
    assert flown(range_m=1e-3)[0] == [[], []]
    assert flown(range_m=1e5)[0][0]


def test_a_radio_with_the_same_seed_loses_the_same():
    assert flown(loss=0.3, seed=5)[0] == flown(loss=0.3, seed=5)[0]
    assert np.any(flown(loss=0.3, seed=5)[0][0] != flown(loss=0.3, seed=6)[0][0])
