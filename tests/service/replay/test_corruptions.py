"""Recordings cut, flipped, duplicated and shuffled replay without a fault, and losses are counted."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import load_mission
from companion.link.wire.tlog import read_tlog
from companion.recording.reader import GAP_MAX_S, load_recording
from tests.link.pymavlink_frames import adsb, heartbeat, packed, position
from tests.service.replay.corruptions import DATA, KINDS, RECORDINGS, damaged, lost, mission_for, replayed
from tests.service.replay.test_references import part_of
from tests.sim.client import CONFIGS

FEW, MANY = 2, 1000
UTC_S = 1.795e9


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", RECORDINGS)
@pytest.mark.thorough
def test_a_few_corruptions_of_a_part(name, kind, tmp_path):
    part = part_of(name.removesuffix(".tlog"), tmp_path / "part.tlog").read_bytes()
    mission, num_lost = mission_for(name), 0
    for seed in range(FEW):
        result = replayed(damaged(part, kind, np.random.default_rng(seed)), mission, tmp_path)
        num_lost += bool(lost(result))
        assert result.counters.get("accepted", 0) > 0
    assert num_lost >= FEW - 1  # a cut may fall between two frames


@pytest.mark.slow  # an hour: make test-long
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", RECORDINGS)
def test_many_corruptions_of_the_whole(name, kind, tmp_path):
    data, mission = (DATA / name).read_bytes(), mission_for(name)
    for seed in range(MANY // len(KINDS)):
        replayed(damaged(data, kind, np.random.default_rng(seed)), mission, tmp_path)


def test_what_is_flipped_is_counted_by_reason(tmp_path):
    part = part_of("arduplane-4.7dev-replace", tmp_path / "part.tlog").read_bytes()
    data = bytearray(part)
    for place in range(1_000, len(data), 5_000):
        data[place] ^= 0xFF
    result = replayed(bytes(data), mission_for("arduplane-4.7dev-replace.tlog"), tmp_path)
    counts = lost(result)
    assert counts["bad_checksum"] + counts["skipped_bytes"] + counts["wrong_stamps"] >= 5


# --- what other logs have in them


def log(tmp_path, *entries):
    """A log of stamps [s] and frames."""
    file = tmp_path / "made.tlog"
    file.write_bytes(b"".join(round(1e6 * stamp).to_bytes(8, "big") + raw for stamp, raw in entries))
    return file


def replay(file):
    return replayed(file.read_bytes(), load_mission(CONFIGS / "first-flight.yaml"), file.parent)


def test_an_empty_log_and_one_without_an_autopilot(tmp_path):
    assert replay(log(tmp_path)).decisions == []
    assert replay(log(tmp_path, *((UTC_S + n, adsb()) for n in range(5)))).decisions == []


def test_several_systems_and_mavlink_1_on_one_link(tmp_path):
    old = packed(mavlink.MAVLink_heartbeat_message(
        1, 3, 217, 10, 4, 3), version=1)  # fmt: skip
    entries = []
    for n in range(20):
        now = UTC_S + 0.5 * n
        entries += [(now, old), (now, heartbeat(7)), (now, position(1_000 + 500 * n)), (now, adsb())]
        entries += [(now, position(1_000 + 500 * n, system=7))]
    result = replay(log(tmp_path, *entries))
    assert result.counters["accepted"] >= 95
    assert result.decisions[0].kind == "mode"


def times(file):
    return [heard.at_us * 1e-6 for heard in load_recording(file).frames]


def test_one_wrong_stamp_is_put_right_by_its_neighbours(tmp_path):
    stamps = [0.0, 1.0, 2.0, 9_999.0, 3.0, 4.0]
    file = log(tmp_path, *((UTC_S + stamp, heartbeat()) for stamp in stamps))
    assert times(file) == pytest.approx([0.0, 1.0, 2.0, 2.0, 3.0, 4.0])
    assert load_recording(file).counters["wrong_stamps"] == 1


@pytest.mark.parametrize("jump_s", [-1_000.0, 5_000.0, 1e6])
def test_a_clock_that_is_set_goes_on_from_there(tmp_path, jump_s):
    stamps = [0.0, 1.0, 2.0, *(jump_s + stamp for stamp in (3.0, 4.0, 5.0))]
    file = log(tmp_path, *((UTC_S + stamp, heartbeat()) for stamp in stamps))
    assert times(file) == pytest.approx([0.0, 1.0, 2.0, 2.0, 3.0, 4.0])
    assert load_recording(file).counters["clock_jumps"] == 1


def test_a_pause_of_the_link_is_no_jump(tmp_path):
    stamps = [0.0, 1.0, GAP_MAX_S - 1.0]
    file = log(tmp_path, *((UTC_S + stamp, heartbeat()) for stamp in stamps))
    assert times(file) == pytest.approx(stamps)


def test_a_log_of_a_computer_whose_clock_was_never_set(tmp_path):
    file = log(tmp_path, *((stamp, heartbeat()) for stamp in (5.0, 6.0, 7.0)))
    assert times(file) == pytest.approx([0.0, 1.0, 2.0])


def test_messages_that_no_dialect_knows_are_passed_over():
    recording = load_recording(DATA / "px4-1.17dev-replace.tlog")
    numbers = {heard.frame.message_id for heard in recording.frames}
    assert {380, 410, 411} <= numbers
    assert len(recording.frames) == len(list(read_tlog(DATA / "px4-1.17dev-replace.tlog")))
