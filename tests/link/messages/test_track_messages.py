"""Sightings of other vehicles."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages.codec import Codec
from companion.link.messages.track_messages import ECHO_IDENTITIES_MAX
from companion.types.events import Emitter, TrackReport
from tests.link.pymavlink_frames import adsb, heartbeat, packed, position

LAT, LON = -353_600_000, 1_491_600_000


def started(**settings):
    codec = Codec(1, **settings)
    codec.feed(heartbeat() + position(), 0.0)
    codec.counters.clear()
    return codec


def reports(codec, data, stamp_s=10.0):
    found = [event for frame in codec.feed(data, stamp_s) for event in frame.events]
    return [event for event in found if isinstance(event, TrackReport)]


def test_adsb():
    (report,) = reports(started(), adsb())
    assert report == TrackReport(
        stamp_s=9.0,  # a second old
        source="ADSB_VEHICLE 200/156",
        identity="icao:D70001",
        emitter=Emitter.GROUND,
        latitude_deg=pytest.approx(-35.36),
        longitude_deg=pytest.approx(149.16),
        altitude_amsl_m=pytest.approx(600.0),
        velocity_enu_m_s=pytest.approx((10.0, 0.0, 0.0), abs=1e-9),
        position_std_m=None,
    )


@pytest.mark.parametrize(
    ("emitter", "expected"),
    [(0, Emitter.AIR), (14, Emitter.AIR), (17, Emitter.GROUND), (18, Emitter.GROUND), (19, Emitter.GROUND)],
)
def test_adsb_emitters(emitter, expected):
    assert reports(started(), adsb(emitter_type=emitter))[0].emitter is expected


def test_adsb_climb_is_that_of_aircraft_only():
    (report,) = reports(started(), adsb(emitter_type=14, ver_velocity=250))
    assert report.velocity_enu_m_s[2] == 2.5


@pytest.mark.parametrize(
    "changes",
    [{"flags": 0x07}, {"flags": 0x0B}, {"hor_velocity": 65_535}],
    ids=["speed", "course", "unknown"],
)
def test_adsb_velocity_that_is_not_known(changes):
    assert reports(started(), adsb(**changes))[0].velocity_enu_m_s is None


def test_adsb_of_a_parked_vehicle_needs_no_course():
    assert reports(started(), adsb(flags=0x0B, hor_velocity=0))[0].velocity_enu_m_s == (0.0, 0.0, 0.0)


def test_adsb_ground_vehicle_without_altitude_stands_on_the_ground():
    (report,) = reports(started(), adsb(flags=0x0D))
    assert report.altitude_amsl_m == pytest.approx(584.0)
    assert reports(started(), adsb(flags=0x0D, emitter_type=1)) == []


def test_adsb_without_address_goes_by_its_callsign():
    assert reports(started(), adsb(ICAO_address=0))[0].identity == "callsign:CAR1"


def test_what_the_autopilot_repeats_is_seen_once():
    codec = started()
    assert len(reports(codec, adsb(), 10.0)) == 1
    assert reports(codec, adsb(system=1, component=1), 10.1) == []
    assert codec.counters["refused_track_echo"] == 1


def test_a_receiver_wired_to_the_autopilot_is_believed():
    codec = started()
    assert len(reports(codec, adsb(system=1, component=1), 10.0)) == 1
    assert len(reports(codec, adsb(system=1, component=156), 10.1)) == 1


def test_the_autopilot_is_believed_again_when_the_other_source_is_silent():
    codec = started()
    reports(codec, adsb(), 10.0)
    assert len(reports(codec, adsb(system=1, component=1), 25.0)) == 1


def test_sources_that_are_not_listed():
    codec = started(track_sources=[42])
    assert reports(codec, adsb()) == []
    assert reports(codec, adsb(system=1, component=1)) == []
    assert codec.counters["refused_track_unlisted"] == 2
    assert len(reports(codec, position(system=42))) == 1


def test_position_of_another_system():
    (report,) = reports(started(), position(system=42))
    assert (report.identity, report.emitter, report.source) == (
        "system:42",
        Emitter.AIR,
        "GLOBAL_POSITION_INT 42/1",
    )
    assert report.velocity_enu_m_s == pytest.approx((20.0, 1.0, 0.5))


def test_a_rover_is_a_ground_vehicle():
    codec = started()
    codec.feed(heartbeat(system=42, kind=10), 1.0)
    codec.feed(heartbeat(system=42, component=191, kind=18, autopilot=8), 1.0)
    assert reports(codec, position(system=42))[0].emitter is Emitter.GROUND


def utm(system=42, *, flags=0xFF, **changes):
    fields = {
        "lat": LAT,
        "lon": LON,
        "alt": 650_000,
        "h_acc": 2_500,
        "vx": 100,
        "vy": 200,
        "vz": -300,
        "v_acc": 0,
        "vel_acc": 0,
        "next": (0, 0, 0),
    } | changes
    return packed(
        mavlink.MAVLink_utm_global_position_message(
            0,
            bytes(range(1, 19)),
            fields["lat"],
            fields["lon"],
            fields["alt"],
            0,
            fields["vx"],
            fields["vy"],
            fields["vz"],
            fields["h_acc"],
            fields["v_acc"],
            fields["vel_acc"],
            *fields["next"],
            0,
            3,
            flags,
        ),
        system,
    )


def test_utm():
    (report,) = reports(started(), utm())
    assert report.identity == "utm:" + bytes(range(1, 19)).hex()
    assert report.velocity_enu_m_s == pytest.approx((2.0, 1.0, 3.0))
    assert report.position_std_m == pytest.approx(2.5)
    assert reports(started(), utm(flags=0x0C))[0].identity == "system:42"
    assert reports(started(), utm(flags=0x0C))[0].velocity_enu_m_s is None
    assert reports(started(), utm(h_acc=0))[0].position_std_m is None


def test_utm_says_where_it_flies_next_and_how_sure_it_is():
    there = (LAT + 50_000, LON - 20_000, 700_000)
    (report,) = reports(started(), utm(next=there, v_acc=4_000, vel_acc=70))
    assert report.next_point[:2] == pytest.approx((LAT * 1e-7 + 5e-3, LON * 1e-7 - 2e-3))
    assert report.next_point[2] - report.altitude_amsl_m == pytest.approx(50.0)  # both over the ellipsoid
    assert (report.altitude_std_m, report.velocity_std_m_s) == pytest.approx((4.0, 0.7))
    (silent,) = reports(started(), utm(flags=0x7F, next=there))
    assert (silent.next_point, silent.altitude_std_m, silent.velocity_std_m_s) == (None, None, None)


@pytest.mark.parametrize(
    "there", [(910_000_000, LON, 0), (LAT, LON, 2**31 - 1)], ids=["latitude", "altitude"]
)
def test_utm_with_an_impossible_next_waypoint_is_where_it_is(there):
    (report,) = reports(started(), utm(next=there))
    assert report.next_point is None
    assert report.latitude_deg == pytest.approx(LAT * 1e-7)


@pytest.mark.parametrize("flags", [0xFB, 0xF7])
def test_utm_without_a_place(flags):
    assert reports(started(), utm(flags=flags)) == []


def test_the_own_position_in_other_words_is_no_track():
    codec = started()
    assert reports(codec, utm(system=1)) == []
    assert reports(codec, remote_id(identity=b"")) == []
    assert not [name for name in codec.counters if name.startswith("refused")]


def follow(**changes):
    fields = {"capabilities": 3, "velocity": [1.0, 2.0, -3.0], "covariance": [4.0, 5.0, 0.0]} | changes
    message = mavlink.MAVLink_follow_target_message(
        0,
        fields["capabilities"],
        LAT,
        LON,
        650.0,
        fields["velocity"],
        [0.0] * 3,
        [1.0, 0.0, 0.0, 0.0],
        [0.0] * 3,
        fields["covariance"],
        0,
    )
    return packed(message, 43)


def test_follow_target():
    (report,) = reports(started(), follow())
    assert (report.identity, report.position_std_m) == ("system:43", 4.0)
    assert report.velocity_enu_m_s == (2.0, 1.0, 3.0)
    assert reports(started(), follow(capabilities=1))[0].velocity_enu_m_s is None
    assert reports(started(), follow(covariance=[0.0] * 3))[0].position_std_m is None
    assert reports(started(), follow(covariance=[math.nan] * 3)) == []


def vessel(**changes):
    fields = {"mmsi": 503_123_456, "flags": 0x07, "velocity": 500} | changes
    return packed(
        mavlink.MAVLink_ais_vessel_message(
            fields["mmsi"],
            LAT,
            LON,
            18_000,
            18_000,
            fields["velocity"],
            0,
            0,
            0,
            0,
            0,
            0,
            0,
            b"",
            b"",
            3,
            fields["flags"],
        ),
        44,
    )


def test_vessels():
    (report,) = reports(started(), vessel())
    assert (report.identity, report.emitter, report.stamp_s) == ("mmsi:503123456", Emitter.GROUND, 7.0)
    assert report.velocity_enu_m_s == pytest.approx((0.0, -5.0, 0.0), abs=1e-9)
    assert report.position_std_m == pytest.approx(10.0 / 2.4477)
    assert reports(started(), vessel(flags=0))[0].velocity_enu_m_s is None
    assert reports(started(), vessel(mmsi=0)) == []


def remote_id(*, identity=b"\x01\x02\x03", **changes):
    fields = {
        "direction": 9_000,
        "speed": 1_000,
        "climb": 100,
        "geodetic": 650.0,
        "accuracy": 10,
        "baro": -1_000.0,
        "up_accuracy": 0,
        "speed_accuracy": 0,
    } | changes
    return packed(
        mavlink.MAVLink_open_drone_id_location_message(
            0,
            0,
            list(identity.ljust(20, b"\0")),
            2,
            fields["direction"],
            fields["speed"],
            fields["climb"],
            LAT,
            LON,
            fields["baro"],
            fields["geodetic"],
            0,
            0.0,
            fields["accuracy"],
            fields["up_accuracy"],
            0,
            fields["speed_accuracy"],
            0.0,
            0,
        ),
        45,
    )


def test_remote_id():
    (report,) = reports(started(), remote_id())
    assert (report.identity, report.emitter) == ("rid:010203", Emitter.AIR)
    assert report.velocity_enu_m_s == pytest.approx((10.0, 0.0, 1.0), abs=1e-9)
    assert report.position_std_m == pytest.approx(10.0 / 2.4477)
    assert reports(started(), remote_id(direction=36_100))[0].velocity_enu_m_s is None
    assert reports(started(), remote_id(speed=25_500))[0].velocity_enu_m_s is None
    assert reports(started(), remote_id(climb=6_300))[0].velocity_enu_m_s[2] == 0.0
    assert reports(started(), remote_id(accuracy=200))[0].position_std_m is None
    assert reports(started(), remote_id(geodetic=-1_000.0)) == []


def test_each_accuracy_of_remote_id_is_a_distance_within_which_95_of_100_errors_lie():
    # By the descriptions of MAV_ODID_HOR_ACC in common.xml: nautical miles down to 0.05, then metres.
    bounds_m = [1852.0 * miles for miles in (10, 4, 2, 1, 0.5, 0.3, 0.1, 0.05)] + [30.0, 10.0, 3.0, 1.0]
    for accuracy, bound_m in enumerate(bounds_m, 1):
        (report,) = reports(started(), remote_id(accuracy=accuracy))
        assert report.position_std_m == pytest.approx(bound_m / 2.4477)
    assert reports(started(), remote_id(accuracy=0))[0].position_std_m is None


def test_accuracies_of_height_and_speed_of_remote_id_likewise():
    """By MAV_ODID_VER_ACC and MAV_ODID_SPEED_ACC; the class of height is that of the geodetic altitude."""
    for accuracy, bound_m in enumerate((150.0, 45.0, 25.0, 10.0, 3.0, 1.0), 1):
        (report,) = reports(started(), remote_id(up_accuracy=accuracy))
        assert report.altitude_std_m == pytest.approx(bound_m / 1.96)
    for accuracy, bound_m_s in enumerate((10.0, 3.0, 1.0, 0.3), 1):
        (report,) = reports(started(), remote_id(speed_accuracy=accuracy))
        assert report.velocity_std_m_s == pytest.approx(bound_m_s / 2.4477)
    (report,) = reports(started(), remote_id(up_accuracy=200, speed_accuracy=200))
    assert (report.altitude_std_m, report.velocity_std_m_s) == (None, None)
    (barometric,) = reports(started(), remote_id(geodetic=-1_000.0, baro=650.0, up_accuracy=4))
    assert barometric.altitude_std_m is None


def test_the_memory_for_echoes_stays_small():
    codec = started()
    for number in range(1, 1_200):
        codec.feed(adsb(ICAO_address=number), float(number))
    assert len(codec._tracks._seen_elsewhere_s) <= 1_001


def test_the_memory_for_echoes_has_a_limit_in_a_flood():
    codec = started()
    for number in range(1, ECHO_IDENTITIES_MAX + 100):
        codec.feed(adsb(ICAO_address=number), 10.0 + number * 5e-4)  # more at once is not looked at
    assert len(codec._tracks._seen_elsewhere_s) == ECHO_IDENTITIES_MAX
    newest = ECHO_IDENTITIES_MAX + 99
    assert reports(codec, adsb(system=1, component=1, ICAO_address=newest), 15.1) == []
    assert len(reports(codec, adsb(system=1, component=1, ICAO_address=1), 15.1)) == 1  # forgotten


def test_before_the_own_vehicle_is_known_none_is_taken_for_another():
    codec = Codec()
    assert reports(codec, heartbeat() + position(), 9.0) == []
    codec.feed(heartbeat(), 10.0)
    assert reports(codec, position(2_000)) == []
    assert len(reports(codec, position(3_000, system=42))) == 1
