from __future__ import annotations

import math

import numpy as np
import pytest

from companion.frames import LocalFrame
from sim.autopilot.autopilot_parameters import Parameters
from sim.projection import FastProjection
from sim.vehicle.control import TICK_S, Circle, Flight, Leg
from sim.vehicle.fdm import FlightDynamics, Start, Weather
from sim.vehicle.sensors import Sensors

FRAME = LocalFrame(-35.363261, 149.165230, 584.0)
PROJECTION = FastProjection(FRAME)
WINDY = Weather(8.0, -6.0, "light")


def flight(speed_m_s: float, weather: Weather, up_m: float = 100.0, seed: int = 1) -> Flight:
    start = Start(0.0, 0.0, up_m, math.radians(90.0), speed_m_s)
    dynamics = FlightDynamics(FRAME, start, weather, seed=seed, projection=PROJECTION)
    return Flight(dynamics, Sensors(np.random.default_rng(seed), TICK_S), Parameters())


def fly(aircraft: Flight, duration_s: float) -> np.ndarray:
    """Rows east, north, up, equivalent airspeed, true airspeed, bank, pitch, course rate."""
    rows = []
    for _ in range(round(duration_s / TICK_S)):
        aircraft.tick()
        state = aircraft.dynamics.state
        rows.append(
            [
                state.east_m,
                state.north_m,
                state.up_m,
                state.equivalent_airspeed_m_s,
                state.true_airspeed_m_s,
                state.bank_rad,
                state.pitch_rad,
                math.atan2(state.velocity_east_m_s, state.velocity_north_m_s),
            ]
        )
    return np.array(rows)


@pytest.mark.parametrize("speed_m_s", [12.5, 25.0, 37.5])
def test_starts_trimmed_and_stays_so_without_control(speed_m_s):
    start = Start(100.0, -50.0, 300.0, 1.0, speed_m_s)
    dynamics = FlightDynamics(FRAME, start, Weather(), seed=1, projection=PROJECTION)
    dynamics.command(0.0, dynamics.trim_elevator_rad, 0.0, dynamics.trim_throttle)
    state = dynamics.run(3 * 120)
    assert state.equivalent_airspeed_m_s == pytest.approx(speed_m_s, abs=0.1)
    assert state.up_m == pytest.approx(300.0, abs=0.5)
    assert abs(state.bank_rad) < 0.01


def test_an_aircraft_that_cannot_be_trimmed_is_an_error(monkeypatch):
    monkeypatch.setattr(
        FlightDynamics, "_residual", lambda _, angles: np.array([1.0 + angles[0] ** 2, angles[1]])
    )
    with pytest.raises(RuntimeError, match="cannot trim the aircraft"):
        FlightDynamics(FRAME, Start(0.0, 0.0, 100.0, 0.0, 25.0), Weather(), seed=1, projection=PROJECTION)


def test_starts_on_the_course_asked_for_whatever_the_wind():
    start = Start(0.0, 0.0, 100.0, math.radians(60.0), 25.0)
    state = FlightDynamics(FRAME, start, WINDY, seed=1, projection=PROJECTION).state
    assert math.atan2(state.velocity_east_m_s, state.velocity_north_m_s) == pytest.approx(start.course_rad)
    assert state.equivalent_airspeed_m_s == pytest.approx(25.0, abs=0.01)
    air_east = state.velocity_east_m_s - WINDY.wind_east_m_s
    air_north = state.velocity_north_m_s - WINDY.wind_north_m_s
    assert math.hypot(air_east, air_north) == pytest.approx(state.true_airspeed_m_s, rel=1e-3)


@pytest.mark.parametrize("speed_m_s", [12.5, 25.0, 37.5])
@pytest.mark.parametrize("turbulence", ["none", "light"])
def test_holds_speed_height_and_leg_in_ten_metres_of_wind(speed_m_s, turbulence):
    aircraft = flight(speed_m_s, Weather(8.0, -6.0, turbulence))
    aircraft.steering = Leg((0.0, 0.0), (90_000.0, 0.0), 100.0, 100.0)
    rows = fly(aircraft, 60.0)[600:]
    slack = 1.0 if turbulence == "light" else 0.0
    assert np.abs(rows[:, 3] - speed_m_s).max() < 0.5 + slack
    assert np.abs(rows[:, 2] - 100.0).max() < 3.0 + slack
    assert np.abs(rows[:, 1]).max() < 4.0 + slack
    assert np.abs(rows[:, 5]).max() < math.radians(6.0)


@pytest.mark.parametrize(("first", "then"), [(25.0, 12.5), (25.0, 37.5)])
def test_reaches_both_ends_of_the_speed_envelope(first, then):
    aircraft = flight(first, Weather())
    aircraft.steering = Leg((0.0, 0.0), (90_000.0, 0.0), 100.0, 100.0)
    aircraft.airspeed_m_s = then
    rows = fly(aircraft, 60.0)
    assert np.abs(rows[-600:, 3] - then).max() < 0.5
    assert rows[:, 3].min() > 11.5
    assert np.abs(rows[-600:, 2] - 100.0).max() < 3.0


def test_turns_within_135_metres_at_37_metres_a_second():
    aircraft = flight(37.0, Weather())
    aircraft.steering = Circle((0.0, -60.0), 60.0, 1, 100.0)  # tighter than it can: flown at full bank
    rows = fly(aircraft, 40.0)[600:]
    rate = np.median(np.diff(np.unwrap(rows[:, 7])) / TICK_S)
    radius = np.median(rows[:, 4]) / rate
    assert 110.0 < radius <= 135.0
    assert np.degrees(rows[:, 5]).max() < 52.0
    assert np.abs(rows[:, 2] - 100.0).max() < 3.0


@pytest.mark.parametrize("direction", [1, -1])
def test_settles_on_a_loiter_circle(direction):
    aircraft = flight(25.0, Weather(2.0, 2.0))
    aircraft.steering = Circle((0.0, -direction * 125.0), 125.0, direction, 100.0)
    rows = fly(aircraft, 90.0)[1800:]
    distance = np.hypot(rows[:, 0], rows[:, 1] + direction * 125.0)
    assert np.abs(distance - 125.0).max() < 8.0
    assert np.sign(rows[:, 5].mean()) == direction


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("aside_m", [5.0, -5.0])
def test_headed_for_the_middle_of_a_circle_it_turns_onto_it(direction, aside_m):
    """ArduPlane's loiter law holds a wrong way round against it only on the way out (``AP_L1_Control``)."""
    aircraft = flight(18.0, Weather())
    aircraft.steering = Circle((130.0, aside_m), 65.0, direction, 100.0)
    rows = fly(aircraft, 40.0)
    distance = np.hypot(rows[:, 0] - 130.0, rows[:, 1] - aside_m)
    assert distance.min() > 30.0
    assert np.abs(distance[-100:] - 65.0).max() < 8.0


@pytest.mark.parametrize("change_m", [60.0, -60.0])
def test_climbs_and_descends_along_a_leg(change_m):
    aircraft = flight(25.0, Weather(), up_m=300.0)
    aircraft.steering = Leg((0.0, 0.0), (500.0, 0.0), 300.0, 300.0 + change_m)
    rows = fly(aircraft, 24.0)
    at_end = rows[np.argmin(np.abs(rows[:, 0] - 500.0))]
    assert at_end[2] == pytest.approx(300.0 + change_m, abs=6.0)
    assert rows[-1, 2] == pytest.approx(300.0 + change_m, abs=3.0)


def test_slow_flight_in_turbulence_does_not_stall():
    aircraft = flight(12.5, Weather(8.0, -6.0, "light"))
    aircraft.steering = Circle((0.0, -60.0), 20.0, 1, 100.0)  # as tight as it can
    rows = fly(aircraft, 60.0)
    assert rows[:, 3].min() > 10.8
    assert np.abs(rows[:, 2] - 100.0).max() < 5.0


def test_fast_projection_is_the_local_frame():
    for east, north in [(0.0, 0.0), (5000.0, 5000.0), (-9000.0, 4000.0)]:
        latitude, longitude, _ = FRAME.global_from_local(east, north, 0.0)
        assert PROJECTION.local(latitude, longitude) == pytest.approx((east, north), abs=0.01)
        assert PROJECTION.degrees(east, north) == pytest.approx((latitude, longitude), abs=1e-7)


def test_estimates_are_about_a_metre_off_and_repeat_with_the_seed():
    state = flight(25.0, Weather()).dynamics.state

    def errors(seed):
        sensors = Sensors(np.random.default_rng(seed), 1.0)
        return np.array([sensors.estimate(state).east_m - state.east_m for _ in range(3000)])

    assert 0.7 < errors(1).std() < 1.4
    assert np.array_equal(errors(1), errors(1))
    assert not np.array_equal(errors(1), errors(2))
