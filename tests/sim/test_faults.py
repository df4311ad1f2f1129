from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim.faults import FaultyLink, LinkFaults
from sim.simulator import Simulator
from tests.sim.client import Client, plain_mission, route

ITEMS = route((600.0, 0.0), (900.0, 200.0), (1200.0, 0.0))


def client_over(faults: LinkFaults, seed: int = 1) -> Client:
    client = Client(Simulator(plain_mission(), seed=1))
    client.simulator = link = FaultyLink(client.simulator, faults, seed=seed)
    link.autopilot = link.simulator.autopilot
    client._send, client._take = link.receive, link.take_outgoing
    return client


def test_a_good_link_changes_nothing():
    client = client_over(LinkFaults())
    assert client.upload(ITEMS) == 0
    assert len(client.download()) == 4


def test_lost_bytes_are_asked_for_again():
    client = client_over(LinkFaults(loss=0.2), seed=2)
    client.count(len(ITEMS))
    assert client.answer(ITEMS) in (0, None, 13)
    assert len(client.simulator.autopilot.mission_items) == 4


@pytest.mark.parametrize("faults", [LinkFaults(corruption=0.3), LinkFaults(duplication=0.5)])
def test_corrupted_and_doubled_bytes_do_no_harm(faults):
    client = client_over(faults)
    client.upload(ITEMS)
    client.step(10.0)
    assert client.simulator.autopilot.mode == "AUTO"


def test_on_a_serial_line_each_frame_waits_for_those_before_it():
    """A heartbeat has 21 bytes; at 2,100 bytes a second each takes 10 ms."""
    link = FaultyLink(Simulator(plain_mission(), seed=1), LinkFaults(bytes_per_s=2100.0), seed=1)
    sender = mavlink.MAVLink(None)
    frames = [mavlink.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3).pack(sender) for _ in range(3)]
    assert {len(frame) for frame in frames} == {21}
    arrived = []
    link.simulator.receive = lambda _: arrived.append(round(link.now_s, 3))
    link.receive(b"".join(frames))
    for _ in range(4):
        link.step(0.01)
    assert arrived == [0.01, 0.02, 0.03]


def test_a_delay_is_kept():
    client = client_over(LinkFaults(delay_s=0.3))
    client.count(2)
    client.step(0.25)
    assert len(client.simulator.autopilot.mission_items) == 3
    client.step(0.4)
    assert client.all("MISSION_REQUEST")


def test_a_link_that_is_down_passes_nothing_and_what_was_under_way_is_lost():
    client = client_over(LinkFaults(delay_s=0.1))
    client.count(2)
    client.simulator.is_up = False
    client.clear()
    client.step(5.0)
    assert not client.log
    client.simulator.is_up = True
    client.step(3.0)
    assert client.all("HEARTBEAT")
    assert len(client.simulator.autopilot.mission_items) == 3


def test_a_reboot_in_flight_keeps_mission_and_mode_and_forgets_rates():
    client = Client(Simulator(plain_mission(), seed=1))
    client.upload(ITEMS)
    client.set_current(2)
    client.stream(33, 10.0)
    client.step(20.0)
    client.simulator.reboot()
    client.clear()
    client.step(5.0)
    positions = client.all("GLOBAL_POSITION_INT")
    assert len(positions) == pytest.approx(5, abs=1)
    assert positions[-1].time_boot_ms < 6000
    assert client.simulator.autopilot.mode == "AUTO"
    assert client.simulator.autopilot.current_sequence == 2
    assert len(client.download()) == 4
