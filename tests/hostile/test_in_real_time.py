"""Attacks flown in the computer's own time on loopback; ``make garbage`` floods for ten minutes."""

import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.hostile.garbage import PATTERNS, faults_of, flooded
from tests.hostile.real_time import Bench
from tests.link.pymavlink_frames import heartbeat
from tests.link.wire.test_signing import HEARTBEAT, KEY, NOW, theirs

pytestmark = pytest.mark.slow  # half a minute each, of the computer's time
PX4_MISSION = 4 << 24 | 4 << 16


@pytest.fixture
def bench(tmp_path):
    with Bench(tmp_path / "flights") as made:
        yield made


def kinds(bench):
    bench.stop()
    return [kind for kind, _ in bench.decisions()]


def test_four_kilobytes_a_second_of_crafted_bytes_cost_nothing(bench):
    """And a burst of 200 kB: once 36 s without a heartbeat, and SIGTERM unheard."""
    attacker, whole = bench.attacker(), (PATTERNS["headers of MAVLink 1"] * 400)[:1_000]
    until = time.monotonic() + 15.0
    for number in range(60):
        if number == 30:
            for _ in range(200):
                attacker.send(whole)
        attacker.send(whole)
        time.sleep(0.25)
    assert max(bench.heard.gaps_s(bench.begun_s, until)) < 1.5
    assert "swap" in kinds(bench)
    assert bench.exit_code == 0


def test_a_datagram_of_one_byte_takes_no_channel(bench):
    attacker = bench.attacker()
    for second in range(12):
        attacker.send(b"\xfd")
        bench.until(second + 1.0)
    assert max(bench.heard.gaps_s(bench.begun_s + 1.0, bench.begun_s + 12.0)) < 1.5
    assert "swap" in kinds(bench)


def test_nobody_but_a_station_sets_parameters(bench):
    """700 a second, valid ones, from a stranger: once the loop stood for 9 s."""
    attacker, writer = bench.attacker(), mavlink.MAVLink(None, srcSystem=66, srcComponent=1)
    frames = [
        bytes(mavlink.MAVLink_param_set_message(1, 195, b"SRRT_ENABLE", float(n % 2), 9).pack(writer))
        for n in range(100)
    ]
    until = time.monotonic() + 10.0
    while time.monotonic() < until:
        for frame in frames:
            attacker.send(frame)
        time.sleep(1.0 / 7.0)
    assert max(bench.heard.gaps_s(bench.begun_s, until)) < 1.5
    told = kinds(bench)
    assert "parameters" not in told
    assert "link" in told
    assert "swap" in told


def test_heartbeats_of_a_px4_change_no_dialect(bench):
    """From a stranger's address they are not heard at all."""
    attacker = bench.attacker()
    for tick in range(60):
        attacker.send(heartbeat(autopilot=12, custom_mode=PX4_MISSION))
        bench.until(0.2 * tick)
    told = kinds(bench)
    assert "suspended" not in told
    assert "swap" in told
    assert "link" in told


def test_a_short_flood_of_every_kind(tmp_path):
    found = flooded(tmp_path, 90.0)
    assert faults_of(found) == []


def test_the_first_to_be_heard_is_not_the_vehicle_for_ever(tmp_path):
    """A few heartbeats of another system, before the aircraft is switched on."""

    def first(attacker):
        for _ in range(4):
            attacker.send(heartbeat(system=77))
            time.sleep(0.3)

    with Bench(tmp_path / "flights", before=first) as bench:
        bench.until(12.0)
        assert "swap" in kinds(bench)


@pytest.mark.parametrize("strange", [2**48 - 3, 10 * 365 * 86_400 * 100_000 + NOW])
def test_one_signed_frame_with_a_strange_time_ends_nothing(tmp_path, strange):
    """By a holder of the key: the latest time there is, or ten years ahead."""
    with Bench(tmp_path / "flights", key=KEY) as bench:
        attacker = bench.attacker()
        for second in range(12):
            for system in (1, 255):
                attacker.send(theirs(HEARTBEAT, time=strange + second, system=system))
            bench.until(second + 1.0)
        assert max(bench.heard.gaps_s(bench.begun_s + 1.0, bench.begun_s + 12.0)) < 1.5
        assert "swap" in kinds(bench)
