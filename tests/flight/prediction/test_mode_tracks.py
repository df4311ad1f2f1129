"""What is flown next in each flight mode, beside the simulator, and what is met on it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.flight.prediction.mode_tracks import AHEAD_S, ModeTracks, mode_tracks, state_on
from companion.flight.prediction.obstacle_ahead import obstacle_ahead
from companion.flight.prediction.return_path import STEP_S
from companion.flight.state.flight_state import after_heartbeat, after_target_reported
from companion.types.events import Dialect, Heartbeat, Motion, SteeringTarget
from sim.simulator import Simulator
from tests.flight.construction.test_cycle import BLOCK, state
from tests.flight.prediction.test_return_path import ARDUPLANE, BOTH, PX4, made
from tests.sim.client import plain_mission
from tests.world.vehicle.test_guidance import state_of

MODES = {Motion.CIRCLE: "LOITER", Motion.RETURN: "RTL", Motion.STEERED: "FBWA"}


def in_mode(motion, target=None, *, dialect=Dialect.ARDUPILOT, extra=""):
    flown = made(ARDUPLANE if dialect is Dialect.ARDUPILOT else PX4, extra=extra)
    beat = Heartbeat(2.0, 1, 1, dialect, MODES[motion], is_mission_mode=False, is_armed=True, motion=motion)
    flown = after_heartbeat(flown, beat)
    if target is not None:
        latitude, longitude, altitude = flown.mission.frame.global_from_local(*target)
        flown = after_target_reported(flown, SteeringTarget(2.5, latitude, longitude, altitude))
    return flown


HERE = state(east=1000.0, north=0.0, up=100.0)  # flying east at 25 m/s


def test_a_pilot_steers_on_round_or_straight():
    turning = replace(HERE, bank_rad=math.radians(30.0))
    tracks = mode_tracks(in_mode(Motion.STEERED), turning, None)
    assert tracks.is_steered
    round_, straight = tracks.positions_enu_m
    assert len(straight) == AHEAD_S / STEP_S + 1
    np.testing.assert_allclose(straight[-1], (1000.0 + 25.0 * AHEAD_S, 0.0, 100.0), atol=0.01)
    radius = 25.0**2 / (9.80665 * math.tan(math.radians(30.0)))  # 110.4 m, to the right
    np.testing.assert_allclose(np.hypot(round_[:, 0] - 1000.0, round_[:, 1] + radius), radius, atol=0.01)


def test_a_circle_is_flown_about_the_reported_target():
    tracks = mode_tracks(in_mode(Motion.CIRCLE, (1500.0, 0.0, 100.0)), HERE, None, ahead_s=90.0)
    assert not tracks.is_steered
    away = np.hypot(tracks.positions_enu_m[0][-60:, 0] - 1500.0, tracks.positions_enu_m[0][-60:, 1])
    assert 125.0 - 5.0 <= away.min() <= away.max() <= 1.15 * 125.0 + 5.0


def test_without_a_target_a_circle_is_not_known_and_the_turn_goes_on():
    assert mode_tracks(in_mode(Motion.CIRCLE), HERE, None).is_steered


def test_another_mode_forgets_the_target():
    circling = in_mode(Motion.CIRCLE, (1500.0, 0.0, 100.0))
    beat = Heartbeat(3.0, 1, 1, Dialect.ARDUPILOT, "FBWA", is_mission_mode=False, is_armed=True)
    assert after_heartbeat(circling, beat).target_enu_m is None


def test_an_arduplane_returns_to_its_target_and_sinks_along_the_way():
    """Half of 400 m of height are lost on half of the way of 4,000 m."""
    high = state(east=4000.0, north=0.0, up=500.0)
    west = replace(high, course_rad=1.5 * math.pi)
    tracks = mode_tracks(in_mode(Motion.RETURN, (0.0, 0.0, 100.0)), west, None, ahead_s=80.0)
    track = tracks.positions_enu_m[0]
    half = int(np.argmin(np.abs(track[:, 0] - 2000.0)))
    assert track[half, 2] == pytest.approx(300.0, abs=5.0)


@BOTH
@pytest.mark.parametrize("motion", [Motion.CIRCLE, Motion.RETURN])
def test_the_simulator_flies_what_is_predicted(dialect, motion):
    """The reported target and the mode are all that is known; 20 s later the aircraft is within 25 m."""
    simulator = Simulator(plain_mission(), seed=1, dialect=dialect)
    simulator.step(20.0)
    simulator.set_mode(MODES[motion])
    simulator.step(1.0)
    target = simulator.autopilot.telemetry.target
    begins = state_of(simulator)
    tracks = mode_tracks(in_mode(motion, target, dialect=dialect), begins, None)
    simulator.step(AHEAD_S)
    flown = simulator.autopilot.flight.estimate
    ends = [track[-1] for track in tracks.positions_enu_m]
    assert min(math.dist(end, (flown.east_m, flown.north_m, flown.up_m)) for end in ends) < 25.0


@settings(max_examples=80, deadline=None)
@given(st.floats(60.0, 400.0), st.floats(0.0, 2.0 * math.pi), st.booleans())
def test_the_state_on_a_circle_has_its_course_and_bank(radius, at, is_right):
    """A coordinated turn: tan(bank) = v²/gr, as in Beard and McLain (9.14)."""
    side, speed = (1.0 if is_right else -1.0), 25.0
    angles = at + side * speed / radius * STEP_S * np.arange(9)
    track = np.column_stack([radius * np.sin(angles), radius * np.cos(angles), np.full(9, 100.0)])
    found = state_on(track, 4, HERE)
    assert math.tan(found.bank_rad) == pytest.approx(side * speed**2 / (9.80665 * radius), rel=0.03)
    course = (angles[4] + side * 0.5 * math.pi) % (2.0 * math.pi)
    assert abs((found.course_rad - course + math.pi) % (2.0 * math.pi) - math.pi) < 0.02
    assert found.stamp_s == pytest.approx(HERE.stamp_s + 4 * STEP_S)


def test_a_track_too_short_for_a_course_leaves_the_state():
    assert state_on(np.zeros((2, 3)), 1, HERE) is HERE


# --- what is met


def straight_to(east, north, seconds=20.0):
    share = np.linspace(0.0, 1.0, round(seconds / STEP_S) + 1)[:, None]
    return np.array([[1000.0, 0.0, 100.0]]) + share * np.array([[east - 1000.0, north, 0.0]])


WALL = BLOCK.format("wall", 1300, -200, 1320, 200)


def met(tracks, *, is_steered, extra=WALL):
    return obstacle_ahead(
        in_mode(Motion.STEERED, extra="obstacles:\n" + extra), HERE, ModeTracks(tuple(tracks), is_steered)
    )


def test_what_is_met_is_named_with_its_time_and_the_ways_out():
    """The wall begins 300 m ahead, and 7.5 m are kept from it: 292.5 m at 25 m/s are 11.7 s."""
    found = met([straight_to(1500.0, 0.0)], is_steered=False)
    assert found.name == "wall"
    assert found.after_s == pytest.approx(11.7, abs=STEP_S)
    assert found.escapes == ("turn left", "turn right")
    assert found.advice == "turn"


def test_one_of_the_ways_that_the_autopilot_may_take_is_enough():
    aside = straight_to(1200.0, 450.0)
    assert met([straight_to(1500.0, 0.0), aside], is_steered=False) is not None
    assert met([straight_to(1500.0, 0.0), aside], is_steered=True) is None
    assert met([aside], is_steered=False) is None


def test_over_a_low_wall_the_way_out_is_to_climb():
    lane = BLOCK.format("left", 1000, 60, 2000, 90) + BLOCK.format("right", 1000, -90, 2000, -60)
    low = BLOCK.format("low", 1300, -60, 1320, 60).replace("top_m: 300", "top_m: 110")
    found = met([straight_to(1500.0, 0.0)], is_steered=True, extra=lane + low)
    assert found.escapes == ("climb",)


def test_where_nothing_helps_that_is_said():
    lane = BLOCK.format("left", 1000, 60, 2000, 90) + BLOCK.format("right", 1000, -90, 2000, -60)
    found = met(
        [straight_to(1500.0, 0.0)], is_steered=True, extra=lane + BLOCK.format("end", 1300, -60, 1320, 60)
    )
    assert found.advice == "no way out is clear"
