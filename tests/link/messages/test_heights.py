"""What altitudes count from: each kind by hand, in the messages that carry it."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages.heights import Datum, Height, Heights, pressure_altitude
from tests.link.messages.test_track_messages import remote_id, reports, started
from tests.link.pymavlink_frames import adsb, packed

AMSL_M = 684.0  # of the aircraft in tests.link.pymavlink_frames.position
GEOID_M = 19.5


def fix(alt_m=AMSL_M, ellipsoid_m=AMSL_M + GEOID_M, kind=3):
    return packed(
        mavlink.MAVLink_gps_raw_int_message(
            0, kind, 0, 0, round(alt_m * 1e3), 80, 120, 0, 0, 10, round(ellipsoid_m * 1e3)
        )
    )


def pressure(hpa):
    return packed(mavlink.MAVLink_scaled_pressure_message(0, hpa, 0.0, 2_000))


def heard(*frames):
    codec = started()
    for frame in frames:
        codec.feed(frame, 1.0)
    return codec


def test_the_standard_atmosphere_by_its_tables():
    # ICAO Doc 7488: 898.75 hPa at 1000 m, 701.09 hPa at 3000 m.
    assert pressure_altitude(1013.25) == 0.0
    assert pressure_altitude(898.75) == pytest.approx(1000.0, abs=0.5)
    assert pressure_altitude(701.09) == pytest.approx(3000.0, abs=1.0)


def test_the_same_place_told_by_four_sources_is_one_height():
    # On a day of 1003 hPa a pressure altitude is some 85 m too high.
    static = 1013.25 * (1.0 - (AMSL_M + 85.0) / 44_330.8) ** (1.0 / 0.190263)
    codec = heard(fix(), pressure(static))
    told = [
        adsb(altitude_type=1, altitude=round((700.0 + GEOID_M) * 1e3)),
        adsb(altitude_type=0, altitude=785_000, ICAO_address=2),
        remote_id(geodetic=700.0 + GEOID_M),
        remote_id(geodetic=-1_000.0, baro=785.0, identity=b"\4"),
    ]
    for frame in told:
        (report,) = reports(codec, frame)
        assert report.altitude_amsl_m == pytest.approx(700.0, abs=0.1)


def test_until_it_is_known_where_the_geoid_and_the_pressure_are_altitudes_stand_as_they_are_told():
    for frames in ((), (fix(kind=1),), (fix(ellipsoid_m=0.0),), (fix(ellipsoid_m=AMSL_M + 200.0),),
                   (pressure(math.nan),), (pressure(5_000.0),), (pressure(300.0),)):  # fmt: skip
        codec = heard(*frames)
        assert reports(codec, remote_id(geodetic=650.0))[0].altitude_amsl_m == pytest.approx(650.0)
        assert reports(codec, adsb(altitude=650_000))[0].altitude_amsl_m == pytest.approx(650.0)


def test_a_pressure_before_any_own_position_tells_nothing():
    heights = Heights()
    heights.note_pressure(900.0)
    assert heights.above_sea_m(Height(500.0, Datum.PRESSURE)) == 500.0
    assert heights.above_sea_m(Height(500.0, Datum.SEA_LEVEL)) == 500.0


def test_an_altitude_that_no_aircraft_has_is_refused_after_it_was_brought_to_sea_level_too():
    codec = heard(fix(ellipsoid_m=AMSL_M + 80.0))
    assert reports(codec, remote_id(geodetic=-950.0)) == []
    assert codec.counters["refused_track_altitude"] == 1
