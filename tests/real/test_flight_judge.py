"""The judge of flights beside real autopilots, before flights made up for it."""

import json
from datetime import UTC, datetime

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.real.flight_judge import FlightJudge
from tests.real.rig.autopilots import ARDUPLANE
from tests.real.rig.course import Course
from tests.real.rig.relay import Tlog

BEGUN_S = 1_000_000.0
WALL = (4500.0, 2150.0, 150.0)  # in wall_a_east
CLEAR, GOAL = (4750.0, 900.0, 150.0), (4700.0, 3900.0, 200.0)


class Recording:
    """A flight's folder, written as a flight writes it."""

    def __init__(self, folder):
        self.course = Course(1.0, "near", {"vehicle": ARDUPLANE.vehicle})
        self.folder = folder
        (folder / "mission.yaml").write_text(self.course.text, encoding="utf-8")
        self._link = mavlink.MAVLink(None)
        self.tlogs = {name: Tlog(folder / f"{name}.tlog") for name in ("operator", "service")}

    def say(self, at_s, message, name="operator", component=1):
        self._link.srcSystem, self._link.srcComponent = 1, component
        self.tlogs[name].write(message.pack(self._link), BEGUN_S + at_s)

    def wire(self, place):
        latitude, longitude, altitude = self.course.frame.global_from_local(*place)
        return round(1e7 * latitude), round(1e7 * longitude), altitude

    def hold(self, places):
        """The service uploads waypoints, a circle at the last, and the autopilot accepts them."""
        self.say(1.0, mavlink.MAVLink_mission_count_message(1, 1, len(places)), "service", 195)
        for number, place in enumerate(places):
            command = 17 if number == len(places) - 1 else 16
            self.say(1.1, mavlink.MAVLink_mission_item_int_message(
                1, 1, number, 0, command, 0, 1, 0, 0, 125.0, 0, *self.wire(place)
            ), "service", 195)  # fmt: skip
        self.say(1.2, mavlink.MAVLink_mission_ack_message(1, 195, 0), "service")

    def fly(self, places, target, current=1):
        """Tell places a second apart, and where to it is steered."""
        for second, (east, north, up) in enumerate(places, start=4):
            latitude, longitude, altitude = self.wire((east, north, up))
            self.say(second, mavlink.MAVLink_heartbeat_message(1, 3, 128, 10, 4, 3))
            self.say(second, mavlink.MAVLink_position_target_global_int_message(
                0, 5, 0, *self.wire(target), 0, 0, 0, 0, 0, 0, 0, 0
            ))  # fmt: skip
            self.say(second, mavlink.MAVLink_mission_current_message(current))
            self.say(second, mavlink.MAVLink_global_position_int_message(
                0, latitude, longitude, round(1e3 * altitude), 0, 2200, 0, 0, 0
            ))  # fmt: skip

    def judged(self, places, ends="disarmed", scenario="1", others=()):
        for tlog in self.tlogs.values():
            tlog.close()
        stamps = [datetime.fromtimestamp(BEGUN_S + at_s, UTC).isoformat() for at_s in (1.0, 2.0)]
        entries = [("mode", "mode: planning (AUTO)"), ("swap", "swap: first plan")]
        lines = [
            json.dumps({"time": time, "level": "info", "decision": kind, "message": text})
            for time, (kind, text) in zip(stamps, entries, strict=True)
        ]
        (self.folder / "service-1.log").write_text("\n".join(lines), encoding="utf-8")
        path = [[BEGUN_S + second, *place] for second, place in enumerate(places, start=4)]
        events = [{"stamp_s": BEGUN_S, "what": "armed"}, {"stamp_s": BEGUN_S + 60.0, "what": ends}]
        events += [{"stamp_s": BEGUN_S + at_s, "what": what} for at_s, what in others]
        flight = {"kind": "arduplane", "scenario": scenario, "seed": 1, "commit": "", "fault": "",
                  "events": events, "texts": [], "path": path}  # fmt: skip
        (self.folder / "flight.json").write_text(json.dumps(flight), encoding="utf-8")
        return FlightJudge(self.folder).row()


@pytest.fixture
def recording(tmp_path):
    return Recording(tmp_path)


def test_a_sound_flight_passes(recording):
    places = [CLEAR, (4750.0, 922.0, 150.0), GOAL]
    recording.hold([CLEAR, (4750.0, 1300.0, 150.0), (4780.0, 1600.0, 150.0)])
    recording.fly(places, (4750.0, 1300.0, 150.0))
    row = recording.judged(places)
    assert row["verdict"] == "ok"
    assert row["judged"] == len(places)
    assert (row["uploads"], row["takeover_s"], row["entered_s"]) == (1, 1.0, 1.0)


def test_an_obstacle_touched_is_seen(recording):
    row = recording.judged([CLEAR, WALL, GOAL])
    assert row["clearance_m"] == 0.0
    assert row["faults"][0] == "touched wall_a_east"


def test_a_mission_held_into_a_wall_is_seen(recording):
    recording.hold([CLEAR, (4750.0, 1900.0, 150.0), (4750.0, 2600.0, 150.0)])
    recording.fly([CLEAR, (4750.0, 922.0, 150.0)], (4750.0, 1900.0, 150.0))
    row = recording.judged([CLEAR, GOAL])
    assert row["violations"] == row["judged"] == 2
    assert "wall_a_east" in row["first_violations"][0][1]


def test_one_that_stands_still_has_landed_armed_or_not(recording):
    row = recording.judged([CLEAR, GOAL, *25 * [(4810.0, 1700.0, 0.1)]], ends="standing")
    assert row["landed"]
    assert row["verdict"] == "ok"
    on_and_on = [(4810.0 + second, 1700.0, 50.0) for second in range(25)]
    assert not recording.judged([CLEAR, GOAL, *on_and_on], ends="standing")["landed"]


def test_a_flight_that_ends_in_the_air_is_seen(recording):
    row = recording.judged([CLEAR, CLEAR], ends="end")
    assert row["faults"] == ["did not land", "goal not reached"]


@pytest.mark.parametrize(("returns_s", "faults"), [(1.0, []), (10.0, ["the return followed no path"])])
def test_a_return_that_does_not_fly_the_mission_again_is_seen(recording, returns_s, faults):
    """The mission is flown until 6 s: a return from 1 s on joins its path, one from 10 s on does not."""
    places = [CLEAR, (4750.0, 922.0, 150.0), (4750.0, 944.0, 150.0)]
    recording.hold([CLEAR, (4750.0, 1300.0, 150.0), (4780.0, 1600.0, 150.0)])
    recording.fly(places, (4750.0, 1300.0, 150.0))
    row = recording.judged(places, scenario="13", others=[(returns_s, "return")])
    assert row["faults"] == faults
