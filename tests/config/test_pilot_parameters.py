"""Parameters of component 195, with pymavlink as the ground station."""

import json
import math
import os
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import mission_from_text
from companion.config.parameters.pilot_parameters import ENABLE, TABLE, Parameters
from companion.link.messages.codec import Codec
from companion.link.messages.component import answer
from tests.support.sitl_harness import FIRST_FLIGHT, SitlHarness

MISSION = mission_from_text(FIRST_FLIGHT, "first-flight.yaml")
NAMES = [entry.name for entry in TABLE]
STATION = (255, 190)


class Station:
    """A ground station's end of the protocol."""

    def __init__(self, file=None):
        self.changes = []
        self.parameters = Parameters(MISSION, file)
        self.parameters.listen(lambda name, _: self.changes.append(name))
        self.codec = Codec(1)
        self._ours = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._theirs = mavlink.MAVLink(None)

    def ask(self, message):
        replies = b"".join(
            answer(frame, self.codec, self.parameters)
            for frame in self.codec.feed(message.pack(self._ours), 1.0)
        )
        return self._theirs.parse_buffer(replies) or []

    def set(self, name, value, kind=mavlink.MAV_PARAM_TYPE_REAL32):
        return self.ask(mavlink.MAVLink_param_set_message(1, 195, name.encode(), value, kind))

    def read(self, name="", index=-1):
        return self.ask(mavlink.MAVLink_param_request_read_message(1, 195, name.encode(), index))


@pytest.mark.parametrize(("system", "component"), [(1, 195), (1, 0), (0, 0)])
def test_all_are_listed_with_their_numbers(system, component):
    values = Station().ask(mavlink.MAVLink_param_request_list_message(system, component))
    assert [value.param_id for value in values] == NAMES == sorted(NAMES)
    assert [value.param_index for value in values] == list(range(len(NAMES)))
    assert {value.param_count for value in values} == {len(NAMES)}
    assert {value.param_type for value in values} == {mavlink.MAV_PARAM_TYPE_REAL32}
    assert {(value.get_srcSystem(), value.get_srcComponent()) for value in values} == {(1, 195)}
    assert all(len(name) <= 16 for name in NAMES)


@pytest.mark.parametrize(("system", "component"), [(1, 1), (2, 195), (1, 196)])
def test_what_is_asked_of_others_is_left_alone(system, component):
    station = Station()
    assert station.ask(mavlink.MAVLink_param_request_list_message(system, component)) == []
    set_message = mavlink.MAVLink_param_set_message(system, component, b"SRRT_ENABLE", 0.0, 9)
    assert station.ask(set_message) == []
    assert station.parameters.is_replanning


@pytest.mark.parametrize("index", range(len(NAMES)))
def test_each_is_read_by_its_name_and_by_its_number(index):
    station = Station()
    by_name, by_number = station.read(NAMES[index]), station.read(index=index)
    assert by_name[0].to_dict() == by_number[0].to_dict()
    assert by_name[0].param_id == NAMES[index]
    key = TABLE[index].key
    expected = getattr(MISSION.planning, key) if key else 1.0
    assert by_name[0].param_value == pytest.approx(expected)


@pytest.mark.parametrize(
    ("name", "value"),
    [(ENABLE, 0.0), ("SRRT_HORIZON", 20.0), ("SRRT_SWAP_GAIN", 0.1), ("SRRT_SWAP_MARG", 1.5),
     ("SRRT_THREAT_MAX", 0.35)],
)  # fmt: skip
def test_a_value_that_is_set_is_told_counts_and_outlives_a_restart(tmp_path, name, value):
    station = Station(tmp_path / "state" / "parameters.json")
    told = station.set(name, value)
    assert [(entry.param_id, entry.param_value) for entry in told] == [(name, pytest.approx(value))]
    assert station.changes == [name]
    station.parameters.keep()
    again = Station(tmp_path / "state" / "parameters.json")
    assert again.parameters.value(name) == value
    key = {entry.name: entry.key for entry in TABLE}[name]
    if key:
        assert getattr(again.parameters.mission().planning, key) == value
    else:
        assert not again.parameters.is_replanning


@pytest.mark.parametrize(
    ("name", "value"),
    [(ENABLE, 2.0), (ENABLE, math.nan), ("SRRT_HORIZON", 0.0), ("SRRT_HORIZON", 2.9), ("SRRT_HORIZON", 81.0),
     ("SRRT_SWAP_GAIN", 1.5), ("SRRT_SWAP_GAIN", -0.1), ("SRRT_SWAP_MARG", 14.5), ("SRRT_THREAT_MAX", 0.0),
     ("SRRT_THREAT_MAX", math.inf), ("SRRT_THREAT_MAX", math.nan)],
)  # fmt: skip
def test_out_of_range_the_old_value_is_told_and_why(tmp_path, name, value):
    station = Station(tmp_path / "parameters.json")
    before = station.parameters.value(name)
    kept, *said = station.set(name, value)
    assert (kept.param_id, kept.param_value) == (name, pytest.approx(before))
    assert {chunk.get_type() for chunk in said} == {"STATUSTEXT"}
    assert "".join(chunk.text for chunk in said).startswith(f"{name} stays {before:g}: ")
    assert station.changes == []
    assert station.codec.counters["refused_parameter"] == 1
    assert not (tmp_path / "parameters.json").exists()


@pytest.mark.parametrize(
    ("name", "value", "bound"),
    [("SRRT_SWAP_GAIN", 1.5, "at most 1"), ("SRRT_SWAP_GAIN", -0.1, "at least 0"),
     ("SRRT_THREAT_MAX", 0.0, "more than 0"), ("SRRT_THREAT_MAX", math.nan, "a finite number"),
     (ENABLE, 2.0, "0 or 1")],
)  # fmt: skip
def test_the_bound_has_room_in_the_answer(name, value, bound):
    _, said = Station().set(name, value)
    assert said.text.endswith(f": {bound}")


@pytest.mark.parametrize("kind", [kind for kind in range(12) if kind != mavlink.MAV_PARAM_TYPE_REAL32])
def test_another_type_is_refused(kind):
    station = Station()
    three = struct.unpack("<f", struct.pack("<I", 3))[0]
    for value in (three, 3.0):
        kept, said = station.set("SRRT_SWAP_MARG", value, kind)
        assert kept.param_value == pytest.approx(MISSION.planning.swap_margin_s)
        assert said.text.endswith("not sent as REAL32")
    assert station.parameters.values_set == {}


def test_what_there_is_not_is_counted_and_not_answered():
    station = Station()
    assert station.read("SRRT_NONE") == station.read(index=99) == station.set("WP_RADIUS", 1.0) == []
    assert station.codec.counters["refused_parameter"] == 3


@given(name=st.binary(max_size=16), bits=st.integers(0, 2**32 - 1), index=st.integers(-(2**15), 2**15 - 1))
def test_nothing_that_is_sent_raises_or_breaks_the_mission(name, bits, index):
    station = Station()
    value = struct.unpack("<f", struct.pack("<I", bits))[0]
    for text in (name, *[entry.encode() for entry in NAMES]):
        station.ask(mavlink.MAVLink_param_set_message(1, 195, text, value, bits % 12))
        station.ask(mavlink.MAVLink_param_request_read_message(1, 195, text, index))
    mission = station.parameters.mission()
    assert mission.planning.planning_budget_s < mission.planning.time_horizon_s
    assert 0.0 < mission.planning.threat_level_max <= 1.0


@pytest.mark.parametrize(
    "text", ["", "[]", '{"SRRT_HORIZON": "long"}', '{"SRRT_HORIZON": -4}', '{"X": 1}', "\0"]
)
def test_a_damaged_file_leaves_the_mission_files_values(tmp_path, text):
    file = tmp_path / "parameters.json"
    file.write_text(text, encoding="utf-8")
    assert Parameters(MISSION, file).mission() == MISSION


STRANGE = ["", "[]", "[" * 100_000, '{"SRRT_ENABLE": 1' + "0" * 400 + "}", '{"A": "x"}', " " * 200_000 + "{}"]


@pytest.mark.parametrize("text", STRANGE, ids=["nothing", "list", "deep", "digits", "words", "large"])
def test_a_file_that_cannot_be_read_is_set_aside_and_told_once(tmp_path, text, caplog):
    file = tmp_path / "parameters.json"
    file.write_text(text, encoding="utf-8")
    parameters = Parameters(MISSION, file)
    assert parameters.values_set == {}
    assert (tmp_path / "parameters.json.damaged").read_text() == text
    assert caplog.text.count("parameters.json.damaged") == 1
    assert parameters.set("SRRT_HORIZON", 30.0, STATION) == ""
    parameters.keep()
    assert Parameters(MISSION, file).values_set == {"SRRT_HORIZON": 30.0}


def test_neither_a_pipe_nor_a_link_is_taken_for_parameters(tmp_path, caplog):
    os.mkfifo(tmp_path / "pipe.json")
    (tmp_path / "sound.json").write_text('{"SRRT_HORIZON": 30.0}')
    (tmp_path / "link.json").symlink_to(tmp_path / "sound.json")
    for name in ("pipe.json", "link.json"):
        assert Parameters(MISSION, tmp_path / name).values_set == {}
        assert f"{name}.damaged" in caplog.text


def test_another_mission_file_keeps_what_fits_it(tmp_path):
    parameters = Parameters(MISSION, tmp_path / "parameters.json")
    assert parameters.set("SRRT_HORIZON", 30.0, STATION) == ""
    assert parameters.set("SRRT_THREAT_MAX", 0.5, STATION) == ""
    parameters.keep()
    shorter = mission_from_text(
        FIRST_FLIGHT.replace("total_planning_time_s: 80", "total_planning_time_s: 20"), "m"
    )
    planning = parameters.set_mission(shorter).planning
    assert (planning.time_horizon_s, planning.threat_level_max) == (15, 0.5)
    assert json.loads((tmp_path / "parameters.json").read_text()) == {
        "SRRT_HORIZON": 30.0, "SRRT_THREAT_MAX": 0.5,
    }  # fmt: skip


def test_replanning_is_switched_off_and_on_in_flight():
    marks = {}

    def send(harness, value):
        message = mavlink.MAVLink_param_set_message(1, 195, ENABLE.encode(), value, 9)
        harness.app.link.receive(message.pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190)))

    def on_step(harness):
        for stamp_s, value in ((6.0, 0.0), (20.0, 1.0)):
            if harness.now_s >= stamp_s and stamp_s not in marks:
                marks[stamp_s] = harness.now_s
                send(harness, value)

    harness = SitlHarness(
        mission_from_text(FIRST_FLIGHT.replace("time_horizon_s: 15", "time_horizon_s: 5"), "m")
    )
    harness.fly(28.0, on_step)
    plans = [decision.stamp_s for decision in harness.recorder.decisions if decision.plan_ms is not None]
    assert any(stamp < 6.0 for stamp in plans)
    assert [stamp for stamp in plans if 8.0 < stamp < 20.0] == []
    assert any(stamp > 20.0 for stamp in plans)
    assert any("SRRT_ENABLE is 0" in text for text in harness.texts("parameters"))
