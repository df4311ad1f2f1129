"""What the autopilots of the two recordings flew and held, and what is overheard of other transfers."""

import itertools
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages.codec import Codec
from companion.link.missions.mission_items import item_from_payload
from companion.link.missions.mission_sniffer import MissionSniffer
from companion.link.wire.framing import raw_frame
from companion.link.wire.tlog import read_tlog
from companion.types.events import Dialect, Heartbeat, MissionCurrent, TrackReport
from tests.link.pymavlink_frames import packed
from tests.service.replay.corruptions import DATA

TAKEOFF, WAYPOINT, LOITER, LAND_START, LOITER_TO_ALT, LAND = 22, 16, 17, 189, 31, 21
COMPANION = (1, 195)


class Heard:
    """A recording, listened to from its beginning to its end."""

    def __init__(self, name, dialect):
        self.sniffer = MissionSniffer()
        self.sniffer.dialect = dialect
        self.held, self.modes, self.current, self.tracks, self.acks = [], [], [], [], []
        codec, start_s = Codec(1), None
        for entry in read_tlog(DATA / name):
            start_s = entry.time_s if start_s is None else start_s
            frame, now = raw_frame(entry.raw), entry.time_s - start_s
            self.sniffer.feed(frame, 1, now)
            self._note(self.held, now, self.sniffer.items)
            if frame.message_id == 47 and (frame.system_id, frame.component_id) == (1, 1):
                payload = frame.payload.ljust(8, b"\0")
                self.acks.append((now, payload[2], int.from_bytes(payload[4:8], "little")))
            for event in (event for frame in codec.feed(entry.raw, now) for event in frame.events):
                if isinstance(event, Heartbeat):
                    self._note(self.modes, now, (event.mode, event.is_armed))
                elif isinstance(event, MissionCurrent):
                    told = event.sequence, event.total, event.mission_id, event.state
                    self._note(self.current, now, told)
                elif isinstance(event, TrackReport):
                    self.tracks.append(event)

    @staticmethod
    def _note(rows, now, value):
        if not rows or rows[-1][1] != value:
            rows.append((now, value))

    def held_at(self, instant_s):
        return [items for now, items in self.held if now <= instant_s][-1]

    def sequence_at(self, instant_s):
        return [told[0] for now, told in self.current if now <= instant_s][-1]


@pytest.fixture(scope="module")
def arduplane():
    return Heard("arduplane-4.7dev-replace.tlog", Dialect.ARDUPILOT)


@pytest.fixture(scope="module")
def px4():
    return Heard("px4-1.17dev-replace.tlog", Dialect.PX4)


def commands(items):
    return [None if item is None else item.command for item in items]


def same_places(one, other):
    places = [
        [entry and (entry.latitude_e7, entry.longitude_e7) for entry in items] for items in (one, other)
    ]
    return [a == b for a, b in zip(*places, strict=True)]


# --- ArduPlane


def test_arduplane_flies_in_auto_from_arming_to_the_end(arduplane):
    assert [mode for _, mode in arduplane.modes] == [
        ("INITIALISING", False), ("MANUAL", False), ("AUTO", False), ("AUTO", True),
    ]  # fmt: skip
    assert [told[0] for _, told in arduplane.current] == [0, 1, 2, 3, 3, 4, 5, 6, 7]


def test_arduplane_holds_the_first_mission_once_it_is_acknowledged(arduplane):
    first = arduplane.sniffer.uploads[0]
    assert (len(first.items), first.client, first.is_accepted) == (7, COMPANION, True)
    assert commands(arduplane.held_at(60.0)) == [WAYPOINT, TAKEOFF, *[WAYPOINT] * 5]
    assert arduplane.held_at(60.0) == arduplane.held_at(23.0)


def test_arduplane_holds_a_mix_after_an_upload_broken_off_at_item_4(arduplane):
    before, mix = arduplane.held_at(68.0), arduplane.held_at(76.0)
    assert commands(mix) == [WAYPOINT, TAKEOFF, *[WAYPOINT] * 5, None]  # as long as announced
    assert same_places(before, mix[:7]) == [True, True, True, False, True, True, True]
    [(ended, _, _)] = [ack for ack in arduplane.acks if ack[1] == 15]
    assert ended == pytest.approx(76.4, abs=0.1)  # 8 s after the last word
    assert arduplane.sniffer.num_broken == 1
    assert arduplane.sequence_at(76.3) == 3  # flown on all the while


def test_arduplane_is_repaired_by_the_old_mission(arduplane):
    repaired = arduplane.held_at(76.6)
    assert repaired == arduplane.held_at(60.0)
    assert [ack[1] for ack in arduplane.acks] == [0, 15, 0, 0]


def test_arduplane_takes_a_whole_replacement_in_auto_and_flies_it_from_item_3(arduplane):
    after = arduplane.held_at(280.0)
    assert commands(after) == [WAYPOINT, TAKEOFF, *[WAYPOINT] * 5, LOITER]
    assert same_places(arduplane.held_at(76.6), after[:7]) == [True, True, True, *[False] * 4]
    assert arduplane.held_at(77.0) == after
    accepted = [ack[0] for ack in arduplane.acks][-1]
    totals = {told[1]: now for now, told in reversed(arduplane.current)}
    assert totals[7] - accepted < 0.1  # DO_SET_MISSION_CURRENT shows in the next MISSION_CURRENT
    assert all(told[2] == 0 for _, told in arduplane.current)  # it names no missions
    reached = [now for now, told in arduplane.current if told[0] >= 4]
    assert [round(now) for now in reached] == [116, 139, 170, 215]


def test_arduplane_hears_of_a_ground_vehicle_from_another_system(arduplane):
    assert {report.source for report in arduplane.tracks} == {"ADSB_VEHICLE 200/156"}
    assert {report.identity for report in arduplane.tracks} == {"icao:D70001"}


# --- PX4


def test_px4_flies_in_mission_mode_from_arming_to_the_end(px4):
    assert [mode for _, mode in px4.modes] == [("LOITER", False), ("MISSION", True)]
    assert [told[0] for _, told in px4.current] == [0, 0, 0, 1, 2, 2, 3, 4]


def test_px4_holds_the_old_mission_whole_while_an_upload_is_broken_off(px4):
    first = px4.held_at(72.0)
    assert commands(first) == [TAKEOFF, *[WAYPOINT] * 4, LAND_START, LOITER_TO_ALT, LAND]
    assert px4.held_at(93.0) == first
    assert px4.sniffer.num_broken == 1
    assert [ack for ack in px4.acks if 72.0 < ack[0] < 93.0] == []  # it says nothing of it


def test_px4_switches_over_with_the_acknowledgement_and_names_what_it_flies(px4):
    names = [name for _, result, name in px4.acks if result == 0]
    assert names == [966021795, 190762406, 190762406]
    told = {name for _, (_, _, name, _) in px4.current}
    assert told == {0, *names}
    after = px4.held_at(100.0)
    assert same_places(px4.held_at(72.0), after) == [True, True, False, False, False, True, True, True]
    marked = [item.sequence for item in px4.sniffer.uploads[1].items if item.is_current]
    assert marked == [2]
    assert px4.sequence_at(95.0) == 2


def test_px4_accepts_the_same_again_and_ignores_its_flag(px4):
    again = px4.sniffer.uploads[2]
    marked = [item.sequence for item in again.items if item.is_current]
    assert again.is_accepted
    assert marked != [2]
    assert px4.held_at(120.0) == px4.held_at(100.0)
    assert px4.sequence_at(117.0) == 2  # ten seconds later


def test_px4_goes_where_mission_set_current_sends_it(px4):
    asked = 117.6
    assert px4.sequence_at(asked) == 2
    [first] = [now for now, told in px4.current if told[0] == 3]
    assert asked < first < asked + 1.1  # with the next MISSION_CURRENT
    assert px4.current[-1][1] == (4, 8, 190762406, 3)


def test_px4s_echo_of_the_companions_own_tracks_is_one_vehicle(px4):
    assert {report.identity for report in px4.tracks} == {"icao:D70001"}
    assert {report.source for report in px4.tracks} == {"ADSB_VEHICLE 1/1"}


# --- what else is overheard


def fed(sniffer, *messages):
    for number, (message, system, component) in enumerate(messages):
        sniffer.feed(raw_frame(packed(message, system, component)), 1, float(number))
    return sniffer


def item(sequence, x=1, current=0):
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, sequence, 3, 16, current, 1, 0, 0, 0, float("nan"), x, 2, 100.0, 0
    )


def test_a_part_of_the_list_is_overwritten():
    sniffer = MissionSniffer()
    count, ack = (
        mavlink.MAVLink_mission_count_message(1, 1, 4),
        mavlink.MAVLink_mission_ack_message(255, 190, 0),
    )
    station = (255, 190)
    fed(sniffer, (count, *station), *((item(n, 10 + n), *station) for n in range(4)), (ack, 1, 1))
    part = mavlink.MAVLink_mission_write_partial_list_message(1, 1, 2, 3)
    fed(sniffer, (part, *station), (item(2, 77), *station), (item(3, 78), *station), (ack, 1, 1))
    assert [entry.latitude_e7 for entry in sniffer.settled] == [10, 11, 77, 78]
    assert [len(upload.items) for upload in sniffer.uploads] == [4, 2]
    assert all(upload.is_accepted for upload in sniffer.uploads)


def test_a_list_that_is_read_is_held():
    sniffer = MissionSniffer()
    count = mavlink.MAVLink_mission_count_message(1, 195, 2)
    told = [mavlink.MAVLink_mission_item_int_message(
        1, 195, n, 3, 16, 0, 1, 0, 0, 0, 0, 5 + n, 2, 100.0, 0) for n in range(2)]  # fmt: skip
    fed(sniffer, (count, 1, 1), *((message, 1, 1) for message in told))
    assert [entry.latitude_e7 for entry in sniffer.settled] == [5, 6]
    assert sniffer.uploads == []


def test_other_vehicles_and_fences_are_left_alone():
    sniffer = MissionSniffer()
    fed(
        sniffer,
        (mavlink.MAVLink_mission_count_message(2, 1, 3), 255, 190),
        (mavlink.MAVLink_mission_count_message(1, 1, 3, 1), 255, 190),
    )
    assert sniffer.items is None


def test_an_item_in_degrees_is_the_same_item():
    old = mavlink.MAVLink_mission_item_message(
        1, 1, 5, 3, 16, 1, 1, 1, 2, 3, float("nan"), -35.5, 149.25, 80.0
    )
    frame = raw_frame(packed(old))
    found, kind = item_from_payload(frame.message_id, frame.payload)
    assert kind == 0
    assert (found.sequence, found.latitude_e7, found.longitude_e7) == (5, -355_000_000, 1_492_500_000)
    assert found.parameters == (1.0, 2.0, 3.0, None)
    assert found.is_current


@given(st.lists(st.tuples(st.sampled_from([38, 39, 44, 45, 47, 73]), st.binary(max_size=40),
                          st.sampled_from([(1, 1), (1, 195), (255, 190)])), max_size=30))  # fmt: skip
def test_nothing_that_is_heard_raises(frames):
    sniffer = MissionSniffer()
    for (number, payload, (system, component)), dialect in zip(
        frames, itertools.cycle([None, Dialect.ARDUPILOT, Dialect.PX4]), strict=False
    ):
        sniffer.dialect = dialect
        header = struct.pack("<BBBBBBB", 0xFD, len(payload), 0, 0, 0, system, component)
        sniffer.feed(raw_frame(header + number.to_bytes(3, "little") + payload + b"\0\0"), 1, 0.0)
