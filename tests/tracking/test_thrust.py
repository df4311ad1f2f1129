"""Missing thrust: energies worked by hand, gusts that are none, and engines that report their speed."""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.tracking.thrust import ThrustMonitor
from companion.types.events import AirData, EngineSpeed, GlobalPosition

RATE_HZ = 5.0


def height(stamp_s, up_m):
    return GlobalPosition(stamp_s, stamp_s, -35.0, 149.0, up_m, up_m, (20.0, 0.0, 0.0))


def fed(rows):
    """A monitor that was given rows of time, height, airspeed, throttle."""
    monitor = ThrustMonitor()
    for stamp, up, airspeed, throttle in rows:
        monitor.observe(height(stamp, up))
        monitor.observe(AirData(stamp, airspeed, airspeed, throttle))
    return monitor


def level(until_s, throttle=0.5, up=120.0, airspeed=24.0, from_s=0.0):
    count = round((until_s - from_s) * RATE_HZ)
    return [(from_s + k / RATE_HZ, up, airspeed, throttle) for k in range(count)]


def sinking(from_s, until_s, sink, throttle, up=120.0, airspeed=24.0):
    rows = level(until_s, throttle, up, airspeed, from_s)
    return [(stamp, up - sink * (stamp - from_s), speed, share) for stamp, up, speed, share in rows]


def told_s(rows, throttle_max=1.0, sink=None):
    """When the fault is first told; None if never."""
    monitor = ThrustMonitor()
    for stamp, up, airspeed, throttle in rows:
        monitor.observe(height(stamp, up))
        monitor.observe(AirData(stamp, airspeed, airspeed, throttle))
        if monitor.fault(stamp, throttle_max, sink):
            return stamp
    return None


def test_level_flight_has_thrust():
    assert told_s(level(60.0)) is None


def test_sinking_with_an_open_throttle_is_told_within_three_seconds():
    """2 m/s are lost: the slope of 2 s of samples passes 1 m/s after 1.2 s, and lasts for 1 s more."""
    stamp = told_s(level(20.0) + sinking(20.0, 30.0, 2.0, 1.0))
    assert 21.0 <= stamp <= 23.4


def test_slowing_down_in_level_flight_is_a_loss_too():
    """24 to 14 m/s in 5 s: (24² − 14²) / 2g = 19.4 m in 5 s, 3.9 m/s."""
    rows = [(20.0 + k / RATE_HZ, 120.0, 24.0 - 2.0 * k / RATE_HZ, 0.5) for k in range(25)]
    assert told_s(level(20.0) + rows) is not None


def test_a_descent_with_less_throttle_is_none():
    assert told_s(level(20.0) + sinking(20.0, 40.0, 3.0, 0.1)) is None


def test_a_descent_with_less_throttle_than_its_mean_before_is_none():
    """As a real ArduPlane's return began: a throttle that opens in turns and closes between, then a descent.

    A half of the time 0.5, the other 0.3: 0.4 in the mean, and 0.35 is 0.05 less than that.
    """
    turns = [(stamp, up, airspeed, 0.5 if int(stamp) % 2 else 0.3) for stamp, up, airspeed, _ in level(20.0)]
    assert told_s(turns + sinking(20.0, 40.0, 4.5, 0.35)) is None
    assert told_s(turns + sinking(20.0, 40.0, 4.5, 0.4)) is not None


def test_a_loss_with_the_throttle_as_before_is_told():
    assert 21.5 <= told_s(level(20.0) + sinking(20.0, 30.0, 2.8, 0.5)) <= 24.5


def test_a_smaller_loss_is_told_when_the_throttle_rises():
    """0.3 more throttle is 1.2 m/s that are missing, so that 1.6 m/s count like 2.8 of 2."""
    assert told_s(level(20.0, throttle=0.2) + sinking(20.0, 30.0, 1.6, 0.2)) is None
    assert 21.5 <= told_s(level(20.0, throttle=0.2) + sinking(20.0, 30.0, 1.6, 0.5)) <= 24.5


def test_height_that_is_held_in_rising_air_is_missed_where_the_throttle_added_much_before():
    """A share of 0.12 makes up for 1.7 m/s: 0.3 more adds at least 0.7 · 1.7 / 0.12 · 0.3 = 3.0 m/s."""
    rows = level(20.0, throttle=0.12) + sinking(20.0, 40.0, 0.2, 0.42)
    assert told_s(rows) is None
    assert told_s(rows, sink=0.1) is None
    assert 21.5 <= told_s(rows, sink=1.7) <= 24.5


def test_more_throttle_that_holds_a_higher_airspeed_is_none():
    rows = level(20.0, throttle=0.12) + sinking(20.0, 40.0, 0.2, 0.42, airspeed=26.0)
    assert told_s(rows, sink=1.7) is None


def test_a_fast_descent_with_the_throttle_of_slow_level_flight_is_none():
    """At 36 m/s drag takes up to 24 / 5 · (1.5³ − 1) = 11.4 m/s more than at 24 m/s; no more is told."""
    for sink, is_told in ((7.0, False), (13.0, False), (14.0, True)):
        rows = level(20.0, throttle=0.25) + sinking(20.0, 24.0, sink, 0.25, airspeed=36.0)
        assert (told_s(rows) is not None) is is_told


def test_a_loss_that_begins_with_less_throttle_is_none():
    """The throttle is closed for 1.4 s; as much height is lost for 1.6 s more while the thrust comes back."""
    closed, opened = sinking(20.0, 21.4, 3.0, 0.1), sinking(21.4, 23.0, 3.0, 0.2, up=120.0 - 3.0 * 1.4)
    assert told_s(level(20.0, throttle=0.2) + closed + opened + level(30.0, 0.2, 111.0, from_s=23.0)) is None


def test_an_idle_throttle_gives_no_thrust_and_is_no_fault():
    assert told_s(level(20.0, throttle=0.05) + sinking(20.0, 30.0, 3.0, 0.05)) is None


def test_open_is_what_the_autopilot_may_command():
    rows = level(20.0) + sinking(20.0, 30.0, 1.5, 0.62)
    assert told_s(rows) is None
    assert told_s(rows, throttle_max=0.7) is not None


def test_in_gusts_a_loss_has_to_be_larger():
    gusts = [
        (k / RATE_HZ, 120.0, 24.0 + 1.5 * math.sin(2.0 * math.pi * k / 15.0), 0.5)
        for k in range(round(60 * RATE_HZ))
    ]
    assert told_s(gusts) is None


def test_an_engine_that_ran_and_stands_still_is_told_after_a_second():
    monitor = fed(level(10.0))
    monitor.observe(EngineSpeed(9.0, "RPM", 5_000.0))
    monitor.observe(EngineSpeed(10.0, "RPM", 0.0))
    assert monitor.fault(10.9) == ""
    assert monitor.fault(11.0) == "the engine stands still"
    monitor.observe(EngineSpeed(12.0, "RPM", 5_000.0))
    assert monitor.fault(14.0) == ""


def test_an_engine_that_never_reported_a_speed_is_not_still():
    monitor = fed(level(10.0))
    monitor.observe(EngineSpeed(9.0, "ESC_TELEMETRY_1_TO_4", 0.0))
    assert monitor.fault(20.0) == ""


def test_a_motor_may_stand_still_at_idle():
    monitor = fed(level(10.0, throttle=0.0))
    monitor.observe(EngineSpeed(8.0, "RPM", 5_000.0))
    monitor.observe(EngineSpeed(9.0, "RPM", 0.0))
    assert monitor.fault(11.0) == ""


def test_a_motor_that_is_asked_for_thrust_has_a_second_to_run():
    monitor = fed([*level(10.0, throttle=0.1), *level(12.4, from_s=10.0)])
    monitor.observe(EngineSpeed(7.0, "RPM", 5_000.0))
    for stamp in (8.0, 9.5, 10.9):
        monitor.observe(EngineSpeed(stamp, "RPM", 0.0))
        assert monitor.fault(12.0) == ""
    monitor.observe(EngineSpeed(11.0, "RPM", 0.0))
    assert monitor.fault(12.0) == "the engine stands still"


@pytest.mark.parametrize(
    ("turned_at", "asked", "told"),
    [
        (0.2, 0.22, "the engine stands still"),
        (0.5, 0.22, ""),
        (0.05, 0.1, ""),
        (0.05, 0.2, "the engine stands still"),
    ],
)
def test_a_motor_is_idle_below_the_throttle_at_which_it_was_seen_to_turn(turned_at, asked, told):
    """Below 0.15 it always may stand still, and it always turns above 0.3."""
    monitor = fed(level(10.0, throttle=turned_at))
    monitor.observe(EngineSpeed(10.0, "RPM", 2_000.0))
    for stamp, up, airspeed, throttle in level(15.0, asked, from_s=10.0):
        monitor.observe(height(stamp, up))
        monitor.observe(AirData(stamp, airspeed, airspeed, throttle))
        monitor.observe(EngineSpeed(stamp, "RPM", 0.0))
    assert monitor.fault(14.8) == told


def gusty(until_s, seed, from_s=0.0, sink=0.0, throttle=0.5):
    """Rows with gusts of some 2 s, along and up, and a height that is lost evenly as well."""
    draw, along, upward, lifted, rows = random.Random(seed), 0.0, 0.0, 0.0, []
    for stamp, up, airspeed, share in level(until_s, throttle, from_s=from_s):
        along += draw.gauss(0.0, 0.35) - 0.1 * along
        upward += draw.gauss(0.0, 0.4) - 0.1 * upward
        lifted += upward / RATE_HZ
        rows.append((stamp, up + lifted - sink * (stamp - from_s), airspeed + along, share))
    return rows


@pytest.mark.parametrize("seed", range(8))
def test_in_strong_gusts_nothing_is_told_for_five_minutes(seed):
    assert told_s(gusty(300.0, seed)) is None


@pytest.mark.parametrize("seed", range(8))
def test_in_strong_gusts_a_large_loss_is_told(seed):
    assert told_s(gusty(80.0, seed) + gusty(92.0, seed, from_s=80.0, sink=9.0, throttle=1.0)) is not None


def test_energy_that_rises_shows_thrust():
    climbing = [(stamp, up + 2.0 * stamp, speed, share) for stamp, up, speed, share in level(10.0)]
    assert fed(climbing).gains(9.9)
    assert not fed(level(10.0) + sinking(10.0, 14.0, 2.0, 1.0)).gains(13.9)
    assert not fed(climbing).gains(15.0)  # too old
    idle = [(stamp, up, airspeed, 0.1) for stamp, up, airspeed, _ in climbing]
    assert not fed(idle).gains(9.9)  # the air rises


def test_a_flight_that_was_forgotten_begins_again():
    monitor = fed(level(20.0) + sinking(20.0, 26.0, 3.0, 1.0))
    assert monitor.fault(25.8) == ""  # it has to last for a second of looks
    assert monitor.fault(26.8) != ""
    monitor.forget()
    assert monitor.fault(27.0) == ""


@settings(max_examples=60, deadline=None)
@given(st.floats(1.6, 8.0), st.floats(12.0, 35.0))
def test_the_faster_it_sinks_the_sooner_it_is_told(sink, airspeed):
    def rows(rate):
        return level(20.0, airspeed=airspeed) + sinking(20.0, 40.0, rate, 1.0, airspeed=airspeed)

    slow, fast = told_s(rows(sink)), told_s(rows(1.5 * sink))
    assert slow is not None
    assert fast is not None
    assert fast <= slow


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.floats(0.0, 500.0), st.floats(0.0, 60.0), st.floats(0.0, 1.0)), max_size=60))
def test_any_telemetry_is_taken(rows):
    monitor = ThrustMonitor()
    for number, (up, airspeed, throttle) in enumerate(rows):
        monitor.observe(AirData(0.2 * number, airspeed, airspeed, throttle))
        monitor.observe(height(0.2 * number, up))
        assert isinstance(monitor.fault(0.2 * number), str)
        assert monitor.gains(0.2 * number) in (True, False)


def test_the_rate_is_the_slope_of_the_energy():
    monitor = fed(sinking(0.0, 6.0, 2.5, 1.0))
    assert monitor._rate(5.8).energy_m_s == pytest.approx(-2.5)
