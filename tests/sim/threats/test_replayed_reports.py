"""Recorded reports on the simulated link."""

from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim.simulator import Simulator
from sim.threats.recorded_tracks import RecordedReport
from sim.threats.replayed_reports import ReplayedReports, adsb_message
from tests.sim.client import plain_mission

REPORT = RecordedReport(
    0.0, 0x4B1815, age_s=2.4, latitude_deg=-35.3, longitude_deg=149.1, pressure_altitude_m=900.0,
    geometric_altitude_m=930.0, ground_speed_m_s=60.0, course_deg=271.5, climb_m_s=-3.0,
)  # fmt: skip
PLACE, ALTITUDE, HEADING, VELOCITY, CLIMB = 1, 2, 4, 8, 128


def test_a_report_is_sent_as_it_was_received():
    message = adsb_message(REPORT)
    assert (message.ICAO_address, message.lat, message.lon) == (0x4B1815, -353_000_000, 1_491_000_000)
    assert (message.altitude, message.altitude_type) == (900_000, mavlink.ADSB_ALTITUDE_TYPE_PRESSURE_QNH)
    assert (message.hor_velocity, message.heading, message.ver_velocity) == (6_000, 27_150, -300)
    assert message.tslc == 2
    assert message.flags == PLACE | ALTITUDE | HEADING | VELOCITY | CLIMB


@pytest.mark.parametrize(
    ("missing", "flag"),
    [
        ("latitude_deg", PLACE), ("course_deg", HEADING), ("ground_speed_m_s", VELOCITY),
        ("climb_m_s", CLIMB),
    ],
)  # fmt: skip
def test_what_was_not_received_is_not_said(missing, flag):
    message = adsb_message(replace(REPORT, **{missing: None}))
    assert message.flags == adsb_message(REPORT).flags & ~flag


def test_without_a_pressure_altitude_the_geometric_one_is_sent():
    message = adsb_message(replace(REPORT, pressure_altitude_m=None))
    assert (message.altitude, message.altitude_type) == (930_000, mavlink.ADSB_ALTITUDE_TYPE_GEOMETRIC)
    nothing = replace(REPORT, pressure_altitude_m=None, geometric_altitude_m=None)
    assert not adsb_message(nothing).flags & ALTITUDE


def test_numbers_without_room_in_the_message_are_the_largest_that_it_has():
    message = adsb_message(replace(REPORT, ground_speed_m_s=1_000.0, climb_m_s=-1_000.0, age_s=900.0))
    assert (message.hor_velocity, message.ver_velocity, message.tslc) == (65_535, -32_767, 255)


def test_reports_are_sent_when_they_were_received():
    simulator = Simulator(plain_mission(), seed=1)
    simulator.step(0.02)
    simulator.take_outgoing()
    receiver = ReplayedReports(simulator.autopilot, [(1.5, replace(REPORT, address=2)), (0.5, REPORT)])
    parser = mavlink.MAVLink(None)
    heard = []
    for now_us in (0, 499_999, 500_000, 1_000_000, 1_499_999, 1_500_000, 9_000_000):
        receiver.update(now_us)
        heard += [
            (now_us, message.get_type(), getattr(message, "ICAO_address", None))
            for message in parser.parse_buffer(simulator.take_outgoing()) or []
            if message.get_srcSystem() == 200
        ]
    assert [entry for entry in heard if entry[1] == "ADSB_VEHICLE"] == [
        (500_000, "ADSB_VEHICLE", 0x4B1815), (1_500_000, "ADSB_VEHICLE", 2),
    ]  # fmt: skip
    assert [entry[0] for entry in heard if entry[1] == "HEARTBEAT"] == [0, 1_000_000, 9_000_000]
