"""What the simulator reports of a vehicle, read by the service's own decoder."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim.threats.reports import ADSB, REMOTE_ID, UTM, Measured
from tests.link.messages.test_track_messages import reports, started
from tests.link.pymavlink_frames import packed

SEEN = Measured(
    3, "helicopter", mavlink.ADSB_EMITTER_TYPE_ROTOCRAFT, -35.3612345, 149.1654321, 652.3, (30.2, -40.1, 2.6)
)


def decoded(source, system=200):
    (report,) = reports(started(), packed(source.message(SEEN), system))
    return report


@pytest.mark.parametrize(
    ("source", "identity", "speed_step", "course_step_deg", "height_step"),
    [
        (ADSB, "icao:D70004", 0.01, 0.01, 0.001), (UTM, "utm:00d70004" + 28 * "0", 0.02, 0.02, 0.001),
        (REMOTE_ID, "rid:00d70004", 0.25, 1.0, 0.5),
    ],
    ids=["adsb", "utm", "remote_id"],
)  # fmt: skip
def test_what_is_reported_is_what_was_measured_to_the_messages_steps(
    source, identity, speed_step, course_step_deg, height_step
):
    report = decoded(source)
    assert report.identity.startswith(identity.rstrip("0"))
    assert (report.latitude_deg, report.longitude_deg) == pytest.approx((-35.3612345, 149.1654321), abs=1e-7)
    assert report.altitude_amsl_m == pytest.approx(652.3, abs=0.51 * height_step)
    east, north, up = report.velocity_enu_m_s
    assert math.hypot(east, north) == pytest.approx(math.hypot(30.2, 40.1), abs=0.51 * speed_step)
    course = math.degrees(math.atan2(30.2, -40.1))
    assert math.degrees(math.atan2(east, north)) == pytest.approx(course, abs=0.51 * course_step_deg)
    assert up == pytest.approx(2.6, abs=0.26 if source is REMOTE_ID else 0.01)


def test_the_deviations_that_are_reported_are_those_of_the_errors():
    """Of Remote ID the classes are 10 m, 10 m and 1 m/s, within which 95 % of the errors lie."""
    utm, remote_id = decoded(UTM), decoded(REMOTE_ID)
    assert (utm.position_std_m, utm.altitude_std_m, utm.velocity_std_m_s) == pytest.approx((4.0, 5.0, 0.4))
    stated = (remote_id.position_std_m, remote_id.altitude_std_m, remote_id.velocity_std_m_s)
    assert stated == pytest.approx((10.0 / 2.4477, 10.0 / 1.96, 1.0 / 2.4477))
    errors = (REMOTE_ID.position_std_m, REMOTE_ID.height_std_m, REMOTE_ID.velocity_std_m_s)
    assert errors == pytest.approx(stated, rel=0.05)
