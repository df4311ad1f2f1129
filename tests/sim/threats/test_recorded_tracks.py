"""Recordings of ADS-B in both forms, and what is said of a file that is wrong."""

import pytest

from companion.errors import ConfigError
from sim.threats.recorded_tracks import recorded_from_text

# As Flight.to_csv of traffic writes it; the rows are made up.
TRAFFIC = """timestamp,icao24,call,latitude,longitude,altitude,groundspeed,track,vertical_rate,last_position
2026-01-01 00:00:02+00:00,4b1815,TST1,46.5,7.25,10000.0,100.0,90.0,-600.0,2026-01-01 00:00:00.500000+00:00
2026-01-01 00:00:01+00:00,4b1815,TST1,,,10025.0,,,,
2026-01-01 00:00:01,a3c6bd,TST2,-35.0,149.0,nan,0,0,0,NaT
"""
# As the OpenSky Network's state vectors are written.
OPENSKY = """time,icao24,lat,lon,velocity,heading,vertrate,onground,baroaltitude,geoaltitude,lastposupdate
1767225602,4b1815,46.5,7.25,51.44,90.0,-3.048,false,3048.0,3100.0,1767225600.5
"""


def test_a_table_of_traffic_is_read_in_our_units_and_in_the_order_of_time():
    tracks = recorded_from_text(TRAFFIC, "a.csv")
    assert list(tracks) == [0x4B1815, 0xA3C6BD]
    first, second = tracks[0x4B1815]
    assert (first.stamp_s, second.stamp_s) == (1767225601.0, 1767225602.0)
    assert (first.latitude_deg, first.ground_speed_m_s, first.climb_m_s) == (None, None, None)
    assert first.pressure_altitude_m == pytest.approx(10025 * 0.3048)
    assert (second.latitude_deg, second.longitude_deg, second.course_deg) == (46.5, 7.25, 90.0)
    assert second.ground_speed_m_s == pytest.approx(51.4444, abs=1e-4)
    assert second.climb_m_s == pytest.approx(-3.048)
    assert (first.age_s, second.age_s) == (0.0, 1.5)
    (other,) = tracks[0xA3C6BD]
    assert (other.stamp_s, other.pressure_altitude_m, other.ground_speed_m_s) == (1767225601.0, None, 0.0)


def test_state_vectors_of_opensky_say_the_same():
    ((report,),) = recorded_from_text(OPENSKY, "b.csv").values()
    (_, other) = recorded_from_text(TRAFFIC, "a.csv")[0x4B1815]
    assert (report.stamp_s, report.age_s) == (other.stamp_s, other.age_s)
    assert report.pressure_altitude_m == pytest.approx(other.pressure_altitude_m)
    assert report.geometric_altitude_m == 3100.0
    assert report.climb_m_s == pytest.approx(other.climb_m_s)


@pytest.mark.parametrize(
    ("right", "wrong", "told"),
    [
        ("latitude", "breite", r"c\.csv:1: columns: got timestamp,.* expected timestamp, icao24, latitude"),
        ("46.5", "north", r"c\.csv:2: latitude: got north; expected at most 90 to either side of 0"),
        ("46.5", "91", r"c\.csv:2: latitude: got 91; expected at most 90"),
        ("10000.0", "high", r"c\.csv:2: altitude: got high; expected a number"),
        ("10000.0", "inf", r"c\.csv:2: altitude: got inf; expected a number"),
        ("4b1815,TST1,,", "xyz,TST1,,", r"c\.csv:3: icao24: got xyz; expected an ICAO address"),
        ("a3c6bd", "1a3c6bd", r"c\.csv:4: icao24: got 1a3c6bd; expected an ICAO address"),
        ("2026-01-01 00:00:01,", "yesterday,", r"c\.csv:4: timestamp: got yesterday; expected seconds"),
        ("2026-01-01 00:00:01,", ",", r"c\.csv:4: timestamp: got nothing; expected a time"),
        ("NaT", "NaT,1", r"c\.csv:4: line: got 11 fields; expected 10 fields, as in the header"),
    ],
)
def test_the_first_thing_wrong_with_a_file_is_named(right, wrong, told):
    assert right in TRAFFIC
    with pytest.raises(ConfigError, match=told):
        recorded_from_text(TRAFFIC.replace(right, wrong, 1), "c.csv")


@pytest.mark.parametrize("text", ["", TRAFFIC.splitlines()[0] + "\n\n"])
def test_a_file_without_reports_is_refused(text):
    with pytest.raises(ConfigError, match="expected"):
        recorded_from_text(text, "d.csv")
