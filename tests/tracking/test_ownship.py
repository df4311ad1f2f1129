from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.frames import LocalFrame, equivalent_airspeed
from companion.tracking.ownship import OwnshipEstimator, OwnshipSettings, predicted
from companion.types.events import (
    AirData,
    Attitude,
    EstimatorAccuracy,
    EstimatorHealth,
    GlobalPosition,
    Rebooted,
    WindEstimate,
)
from companion.types.state import Ownship

FRAME = LocalFrame(latitude_deg=-35.363261, longitude_deg=149.165230, altitude_amsl_m=584.0)


def position(stamp_s=10.0, east_m=100.0, north_m=200.0, up_m=50.0, velocity=(0.0, 20.0, 0.0)):
    latitude, longitude, altitude = FRAME.global_from_local(east_m, north_m, up_m)
    return GlobalPosition(stamp_s, stamp_s, latitude, longitude, altitude, up_m, velocity)


@pytest.fixture
def estimator():
    return OwnshipEstimator(FRAME)


def test_nothing_is_known_before_a_position(estimator):
    estimator.observe(Attitude(1.0, 0.1, 0.0, 0.0))
    assert estimator.state(1.0) is None


def test_the_position_is_moved_on_by_its_velocity(estimator):
    estimator.observe(position(velocity=(3.0, 20.0, -2.0)))
    state = estimator.state(10.5)
    assert state.position_enu_m == pytest.approx((101.5, 210.0, 49.0), abs=1e-3)
    assert state.stamp_s == 10.5
    assert state.course_rad == pytest.approx(math.atan2(3.0, 20.0))
    assert state.flight_path_angle_rad == pytest.approx(math.atan2(-2.0, math.hypot(3.0, 20.0)))


def test_a_stale_position_is_none(estimator):
    estimator.observe(position())
    state = estimator.state(11.5)
    assert state.position_enu_m[1] == pytest.approx(230.0, abs=1e-3)
    assert state.stamp_s == 11.5
    assert estimator.state(11.6) is None
    estimator.observe(position(12.0, north_m=240.0))
    assert estimator.state(12.0) is not None
    assert estimator.received_s() == {
        "position": 12.0, "attitude": -math.inf, "airspeed": -math.inf, "wind": -math.inf
    }  # fmt: skip


def test_an_instant_before_the_position_does_not_move_it_back(estimator):
    estimator.observe(position())
    assert estimator.state(9.0).stamp_s == 10.0


def test_airspeed_not_heard_is_ground_velocity_less_wind(estimator):
    estimator.observe(position(velocity=(0.0, 20.0, 0.0)))
    estimator.observe(WindEstimate(10.0, 0.0, -5.0))  # headwind: air moves south
    assert estimator.state(10.0).airspeed_m_s == pytest.approx(25.0)
    estimator.observe(AirData(10.0, 24.0, 20.0))
    # 24 m/s of equivalent airspeed at 634 m: 24 / sqrt(0.9405)
    assert estimator.state(10.0).airspeed_m_s == pytest.approx(24.747, abs=1e-3)
    estimator.observe(position(14.0, velocity=(0.0, 20.0, 0.0)))
    assert estimator.state(14.0).airspeed_m_s == pytest.approx(25.0), "VFR_HUD has grown old"


def test_the_rest_comes_from_its_own_messages(estimator):
    estimator.observe(position())
    assert estimator.state(10.0).position_std_m == (2.0, 3.0)
    estimator.observe(Attitude(10.0, 0.3, 0.0, 1.0))
    estimator.observe(EstimatorAccuracy(10.0, 1.5, 2.5))
    estimator.observe(Rebooted(10.0))
    state = estimator.state(10.1)
    assert state.bank_rad == 0.3
    assert state.position_std_m == (1.5, 2.5)
    estimator.observe(position(20.0))
    assert estimator.state(20.0).bank_rad == 0.0, "an old bank is no bank"


def test_a_bank_that_is_not_heard_is_that_of_the_turn(estimator):
    """25 m/s round 125 m: 0.2 rad/s, tan(bank) = 25²/(125·9.80665)."""
    for step in range(3):
        course = 0.2 * 0.5 * step
        east, north = 125.0 * (1.0 - math.cos(course)), 125.0 * math.sin(course)
        velocity = (25.0 * math.sin(course), 25.0 * math.cos(course), 0.0)
        estimator.observe(position(10.0 + 0.5 * step, east, north, velocity=velocity))
    bank = estimator.state(11.0).bank_rad
    assert bank == pytest.approx(math.atan(25.0**2 / (125.0 * 9.80665)), abs=1e-6)


def test_wind_that_is_not_told_is_worked_out(estimator):
    """Pointing north at 25 m/s through the air, moving north at 20 and east at 3: air moves (3, −5)."""
    for step in range(1200):
        now = 10.0 + 0.1 * step
        estimator.observe(AirData(now, equivalent_airspeed(25.0, 634.0), 20.0))
        estimator.observe(Attitude(now, 0.0, 0.0, 0.0))
        estimator.observe(position(now, north_m=2.0 * step, east_m=0.3 * step, velocity=(3.0, 20.0, 0.0)))
    assert estimator.state(now).wind_enu_m_s == pytest.approx((3.0, -5.0), abs=1e-9)
    estimator.observe(WindEstimate(now, 1.0, 1.0))
    assert estimator.state(now).wind_enu_m_s == (1.0, 1.0), "the autopilot's own, where it tells"


@pytest.mark.parametrize(("messages", "wind"), [("", (0.0, 0.0)), ("wind", (2.0, 1.0))])
def test_without_air_data_the_last_wind_told_is_the_wind(estimator, messages, wind):
    if messages:
        estimator.observe(WindEstimate(10.0, 2.0, 1.0))
    estimator.observe(position(100.0))
    assert estimator.state(100.0).wind_enu_m_s == wind


def jumping(*jumps_m, every_s=0.2, speed=25.0):
    """Positions of an aircraft flying north; at each step displaced to the east by what is given [m]."""
    return [
        position(10.0 + every_s * n, east_m=jump, north_m=speed * every_s * n, velocity=(0.0, speed, 0.0))
        for n, jump in enumerate(jumps_m)
    ]


def test_a_jump_is_a_loss_until_it_has_gone_on(estimator):
    for event in jumping(*[0.0] * 10, *[40.0] * 160):
        estimator.observe(event)
        is_after = event.stamp_s >= 12.0 - 1e-9
        is_confirmed = event.stamp_s >= 42.0 - 1e-9
        assert (estimator.state(event.stamp_s) is None) is (is_after and not is_confirmed), event.stamp_s
        assert estimator.doubt(event.stamp_s) == (
            "it jumped by 40 m" if is_after and not is_confirmed else ""
        )


def test_a_jump_back_is_believed_at_once(estimator):
    for event in jumping(*[0.0] * 10, *[40.0] * 20):
        estimator.observe(event)
    assert estimator.state(event.stamp_s) is None
    back = jumping(*[0.0] * 31)[-1]
    estimator.observe(back)
    assert estimator.state(back.stamp_s) is not None


def test_a_correction_of_a_few_metres_is_none(estimator):
    for event in jumping(0.0, 0.0, 8.0, 0.0, -8.0, 0.0):
        estimator.observe(event)
        assert estimator.state(event.stamp_s) is not None


@given(st.floats(0.05, 2.0), st.floats(-0.3, 0.3), st.floats(10.0, 40.0), st.floats(0.0, 2.0 * math.pi))
def test_no_turn_is_a_jump(every_s, rate_rad_s, speed, course_rad):
    estimator, east, north = OwnshipEstimator(FRAME), 0.0, 0.0
    for n in range(40):
        course = course_rad + rate_rad_s * every_s * n
        velocity = (speed * math.sin(course), speed * math.cos(course), 0.0)
        estimator.observe(position(every_s * n, east, north, velocity=velocity))
        assert estimator.doubt(every_s * n) == ""
        half = 0.5 * rate_rad_s * every_s
        chord = speed * every_s * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
        east, north = east + chord * math.sin(course + half), north + chord * math.cos(course + half)


def test_what_the_estimator_says_of_itself_is_believed(estimator):
    estimator.observe(EstimatorHealth(10.0, "EKF_STATUS_REPORT", "GPS glitch"))
    estimator.observe(EstimatorHealth(10.0, "GPS_RAW_INT", ""))
    estimator.observe(position(10.5))
    assert estimator.state(10.5) is None
    assert estimator.doubt(10.5) == "GPS glitch"
    estimator.observe(position(13.5))
    assert estimator.state(13.5) is not None, "three seconds without a word of it"


def test_at_rest_the_course_is_the_yaw(estimator):
    estimator.observe(position(velocity=(0.1, 0.0, 0.0)))
    estimator.observe(Attitude(10.0, 0.0, 0.0, -1.0))
    assert estimator.state(10.0).course_rad == pytest.approx(2.0 * math.pi - 1.0)


def test_events_out_of_order_and_not_finite_are_counted_and_dropped(estimator):
    estimator.observe(position(stamp_s=10.0))
    estimator.observe(position(stamp_s=9.0, east_m=999.0))
    estimator.observe(position(stamp_s=11.0, velocity=(math.nan, 0.0, 0.0)))
    estimator.observe(AirData(11.0, math.inf, 1.0))
    assert estimator.state(10.0).position_enu_m[0] == pytest.approx(100.0, abs=1e-3)
    assert estimator.counters == {"out_of_order": 1, "not_finite": 2}


def test_negative_settings_are_refused():
    with pytest.raises(ValueError, match="from zero"):
        OwnshipSettings(position_max_age_s=-1.0)


def state(bank_rad=0.0, wind=(0.0, 0.0), course_rad=0.0, ground_speed_m_s=25.0, climb_rad=0.0):
    return Ownship(
        0.0, (0.0, 0.0, 100.0), course_rad, climb_rad, 25.0, ground_speed_m_s, wind, bank_rad=bank_rad
    )


def test_straight_flight_is_predicted_straight():
    ahead = predicted(state(course_rad=math.pi / 2, climb_rad=math.atan(0.1)), 2.0)
    assert ahead.position_enu_m == pytest.approx((50.0, 0.0, 105.0))
    assert ahead.stamp_s == 2.0


def test_a_quarter_turn_to_the_right():
    # At 25 m/s and 125 m radius (the paper's aircraft) tan(bank) = v²/(g·r) = 0.50986.
    bank = math.atan(25.0**2 / (9.80665 * 125.0))
    ahead = predicted(state(bank_rad=bank), 0.5 * math.pi * 125.0 / 25.0)
    assert ahead.position_enu_m[:2] == pytest.approx((125.0, 125.0))
    assert ahead.course_rad == pytest.approx(math.pi / 2)


def test_the_wind_carries_the_circle_along():
    bank, wind = math.atan(25.0**2 / (9.80665 * 125.0)), (5.0, 0.0)
    round_s = 2.0 * math.pi * 125.0 / 25.0
    start = state(
        bank_rad=bank, wind=wind, ground_speed_m_s=math.hypot(5.0, 25.0), course_rad=math.atan2(5.0, 25.0)
    )
    ahead = predicted(start, round_s)
    assert ahead.position_enu_m[:2] == pytest.approx((5.0 * round_s, 0.0), abs=1e-9)
    assert ahead.course_rad == pytest.approx(start.course_rad)


@pytest.mark.parametrize("wind", [0.0, 5e-324, 1e-200, 0.9])
def test_banked_in_air_that_hardly_moves_it_drifts_straight_on(wind):
    ahead = predicted(state(1.0, (wind, 0.0), course_rad=0.0, ground_speed_m_s=0.0), 5.0)
    assert ahead.position_enu_m == pytest.approx((0.0, 0.0, 100.0), abs=1e-12)


@given(
    st.floats(-1.5, 1.5),
    st.floats(0.0, 6.28),
    st.floats(0.0, 40.0),
    st.floats(-15.0, 15.0),
    st.floats(0.0, 5.0),
)
def test_a_prediction_is_finite_and_as_long_as_the_speeds_allow(bank, course, speed, wind, ahead_s):
    start = state(bank, (wind, 0.0), course, speed)
    ahead = predicted(start, ahead_s)
    moved = math.dist(ahead.position_enu_m, start.position_enu_m)
    assert math.isfinite(moved)
    assert moved <= (speed + 2.0 * abs(wind)) * ahead_s + 1e-6
    assert 0.0 <= ahead.course_rad < 2.0 * math.pi + 1e-12
