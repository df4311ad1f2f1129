"""Steering, step by step: where legs and circles pull to, and when a target counts as reached."""

import math

import numpy as np
import pytest

from companion.kernels.aircraft.steering import (
    SteeringLaw,
    circle_acceleration,
    fly_targets,
    leg_acceleration,
    moved,
)
from companion.kernels.arrays import FollowedGround
from companion.world.vehicle.guidance import NO_FOLLOWED_GROUND

LAW = SteeringLaw(
    17.0, 0.75, math.radians(50.0), 1.0, 0.5, 1.0, 50.0, 1e6, False, 5.0, 5.0, 0.0, 0.0, 0.0, 0.0
)
BEGIN, END = np.array([0.0, 0.0, 100.0]), np.array([0.0, 1000.0, 130.0])
CIRCLE = np.array([0.0, 0.0, 100.0, 125.0])


def start():
    return np.array([0.0, 0.0, 100.0, 0.0, 0.0, 25.0])


def ground_along(north_m, heights_m, *, look_ahead_m=0.0, climb_m_s=2.5):
    """Ground that changes to the north only, with nodes 50 m apart."""
    north = np.arange(-500.0, 3000.0, 50.0)
    up = np.tile(np.interp(north, north_m, heights_m), (20, 1))
    return FollowedGround(up, np.array([-500.0, -500.0, 50.0]), 100.0, look_ahead_m, climb_m_s)


@pytest.mark.parametrize(
    ("place", "sign"), [((0.0, 500.0), 0), ((20.0, 500.0), -1), ((-20.0, 500.0), 1), ((-300.0, 500.0), 1)]
)
def test_legs_pull_back_to_their_line(place, sign):
    pull = leg_acceleration(*place, 0.0, 25.0, BEGIN, END, LAW)
    assert pull == pytest.approx(0.0, abs=1e-9) if sign == 0 else sign * pull > 0.1


def test_a_leg_far_ahead_is_begun_at_its_start_and_one_overshot_is_turned_back_to():
    assert leg_acceleration(0.0, -500.0, 25.0, 0.0, BEGIN, END, LAW) < 0.0  # eastwards, the start is left
    past = leg_acceleration(30.0, 1200.0, 0.0, 25.0, BEGIN, END, LAW)
    assert past < leg_acceleration(30.0, 900.0, 0.0, 25.0, BEGIN, END, LAW) < 0.0


def test_a_leg_without_length_is_flown_to():
    assert leg_acceleration(-100.0, 0.0, 0.0, 25.0, BEGIN, BEGIN, LAW) > 1.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_on_the_circle_its_own_acceleration_is_asked_for(side):
    circle = CIRCLE * (1.0, 1.0, 1.0, side)
    assert circle_acceleration(-125.0, 0.0, 0.0, side * 25.0, circle, LAW) == pytest.approx(side * 5.0)
    # Flown the wrong way round it is turned to the side where the right one lies.
    assert side * circle_acceleration(-125.0, 0.0, 0.0, -side * 25.0, circle, LAW) > 0.0
    # From afar the centre is steered for.
    assert circle_acceleration(-900.0, 0.0, 25.0, 0.0, circle, LAW) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_straight_out_of_the_middle_it_turns_away_so_as_to_come_onto_the_circle_along_it(side):
    # 75 m within the circle at 10 m/s outwards, by the spring and damper of ArduPilot's L1 loiter: the
    # frequency is 2π/17, the spring pulls by 75 m times its square, the damper by 2 · 0.75 · 10 m/s times it.
    circle, frequency = CIRCLE * (1.0, 1.0, 1.0, side), 2.0 * math.pi / 17.0
    expected = -75.0 * frequency**2 + 15.0 * frequency
    assert expected == pytest.approx(-4.70, abs=0.01)
    assert side * circle_acceleration(0.0, 50.0, 0.0, 10.0, circle, LAW) == pytest.approx(expected)


def test_a_step_rolls_no_faster_than_allowed_and_the_wind_carries():
    state = np.array([0.0, 0.0, 100.0, 0.0, 0.0, 20.0])
    moved(state, (3.0, 0.0), 9.0, LAW)
    assert state[4] == pytest.approx(0.05)
    assert state[1] == pytest.approx(1.0, rel=1e-3)
    assert state[0] == pytest.approx(0.15, abs=0.01)
    assert state[2] == 100.0


def test_targets_are_counted_and_the_circle_ends_them():
    places = np.array([[0.0, 0.0, 100.0], [0.0, 300.0, 110.0], [300.0, 600.0, 110.0]])
    rows = np.empty((161, 7))
    fly_targets(
        start(), (0.0, 0.0), places,
        np.array([600.0, 600.0, 120.0, 100.0]), LAW, NO_FOLLOWED_GROUND, 5, rows,
    )  # fmt: skip
    assert sorted(set(rows[:, 6])) == [0.0, 1.0, 2.0]
    assert (np.diff(rows[:, 6]) >= 0.0).all()
    switch = rows[np.argmax(rows[:, 6] == 1.0)]
    assert math.hypot(switch[0], switch[1] - 300.0) == pytest.approx(50.0, abs=7.0)
    assert rows[-1, 2] == pytest.approx(120.0, abs=0.1)


def test_without_a_circle_the_last_leg_goes_on():
    rows = np.empty((81, 7))
    places = np.array([[0.0, 0.0, 100.0], [0.0, 200.0, 100.0]])
    fly_targets(start(), (0.0, 0.0), places, np.zeros(4), LAW, NO_FOLLOWED_GROUND, 5, rows)
    assert rows[-1, 1] == pytest.approx(500.0, abs=1e-6)
    assert rows[-1, 6] == 1.0


@pytest.mark.parametrize(
    ("turn_deg", "acceptance", "before_m"),
    [
        (90.0, 50.0, 50.0),
        (120.0, 50.0, 50.0),
        (-45.0, 50.0, 25.0),
        (30.0, 60.0, 20.0),
        (0.0, 50.0, 0.0),
        (45.0, 200.0, 50.7),  # at most the L1 distance, 0.75 * 17 * 25 / pi = 101.5 m
    ],
)
def test_an_arduplane_waits_with_a_turn_the_longer_the_lesser_it_is(turn_deg, acceptance, before_m):
    """``AP_L1_Control::turn_distance``: the distance of a right angle, in proportion to the turn."""
    turn = math.radians(turn_deg)
    after = (900.0 * math.sin(turn), 500.0 + 900.0 * math.cos(turn), 100.0)
    law = LAW._replace(waits_for_turns=True, acceptance=acceptance)
    rows = np.empty((500, 7))
    places = np.array([[0.0, 0.0, 100.0], [0.0, 500.0, 100.0], after])
    fly_targets(start(), (0.0, 0.0), places, np.zeros(4), law, NO_FOLLOWED_GROUND, 1, rows)
    first = np.argmax(rows[:, 6] >= 1.0)
    assert 500.0 - rows[first, 1] == pytest.approx(before_m, abs=2.6)


def test_a_waypoint_that_is_abeam_when_it_comes_next_is_flown_to_from_there():
    law, rows = LAW._replace(waits_for_turns=True), np.empty((500, 7))
    places = np.array([[0.0, north, 100.0] for north in (0.0, 500.0, 470.0, 1500.0)])
    fly_targets(start(), (0.0, 0.0), places, np.zeros(4), law, NO_FOLLOWED_GROUND, 1, rows)
    reached = [rows[np.argmax(rows[:, 6] >= number), 1] for number in (1.0, 2.0)]
    assert reached == pytest.approx([450.0, 470.0], abs=2.6)


def test_before_a_circle_the_turn_is_that_to_its_centre():
    law, rows = LAW._replace(waits_for_turns=True), np.empty((500, 7))
    places, circle = (
        np.array([[0.0, 0.0, 100.0], [0.0, 500.0, 100.0]]),
        np.array([200.0, 700.0, 100.0, 125.0]),
    )
    fly_targets(start(), (0.0, 0.0), places, circle, law, NO_FOLLOWED_GROUND, 1, rows)
    assert 500.0 - rows[np.argmax(rows[:, 6] >= 1.0), 1] == pytest.approx(25.0, abs=2.6)


def test_a_waypoint_missed_in_height_is_not_reached():
    law = LAW._replace(height_acceptance=10.0, climb_rate_max=0.5)
    rows = np.empty((161, 7))
    places = np.array([[0.0, 0.0, 100.0], [0.0, 200.0, 150.0], [500.0, 200.0, 150.0]])
    fly_targets(start(), (0.0, 0.0), places, np.zeros(4), law, NO_FOLLOWED_GROUND, 5, rows)
    assert rows[:, 6].max() == 0.0


@pytest.mark.parametrize(
    ("change_m", "climb_slope_min", "descent_slope_min", "after_m"),
    [
        (10.0, 0.0, 0.0, 102.5),
        (10.0, 15.0, 0.0, 110.0),
        (10.0, 0.0, 15.0, 102.5),
        (-10.0, 15.0, 0.0, 97.5),
        (-10.0, 0.0, 15.0, 90.0),
        (-10.0, 0.0, math.inf, 90.0),
        (16.0, 15.0, 15.0, 104.0),
        (16.0, math.inf, 15.0, 116.0),
    ],
)
def test_a_slight_change_of_height_is_made_at_once(change_m, climb_slope_min, descent_slope_min, after_m):
    """A leg of 1 km; 10 s at 25 m/s is a quarter of it, in which 16 m are climbed at 5 m/s."""
    law = LAW._replace(climb_slope_min=climb_slope_min, descent_slope_min=descent_slope_min)
    rows = flown(
        NO_FOLLOWED_GROUND, [[0.0, 0.0, 100.0], [0.0, 1000.0, 100.0 + change_m]], law=law, num_rows=41
    )
    assert rows[-1, 2] == pytest.approx(after_m, abs=0.1)


def test_a_commanded_airspeed_is_taken_up_behind_the_first_target():
    """From 25 m/s at 0.5 m/s² to 30 m/s in ten seconds, which begin 50 m before the first target."""
    places = np.array([[0.0, 0.0, 100.0], [0.0, 300.0, 100.0], [0.0, 2000.0, 100.0]])
    law, rows = LAW._replace(airspeed=30.0, acceleration=0.5), np.empty((101, 7))
    fly_targets(start(), (0.0, 0.0), places, np.zeros(4), law, NO_FOLLOWED_GROUND, 5, rows)
    speeds = np.diff(rows[:, 1]) / 0.25
    assert speeds[:40] == pytest.approx(25.0)
    assert speeds[60] == pytest.approx(25.0 + 0.5 * (15.125 - 10.0), abs=0.05)
    assert speeds[-1] == pytest.approx(30.0)


def flown(ground, places, *, circle=None, num_rows=161, law=LAW):
    rows = np.empty((num_rows, 7))
    circle = np.zeros(4) if circle is None else circle
    fly_targets(start(), (0.0, 0.0), np.array(places), circle, law, ground, 5, rows)
    return rows


def test_heights_over_ground_follow_the_ground_between_targets():
    """A hill 60 m high in the middle of a leg between two targets 100 and 130 m over flat ground."""
    ground = ground_along([0.0, 400.0, 500.0, 600.0], [0.0, 0.0, 60.0, 0.0])
    law = LAW._replace(climb_rate_max=50.0, sink_rate_max=50.0)
    rows = flown(ground, [[0.0, 0.0, 100.0], [0.0, 1000.0, 130.0]], law=law)
    hill = np.interp(rows[:, 1], [0.0, 400.0, 500.0, 600.0], [0.0, 0.0, 60.0, 0.0])
    assert rows[:, 2] == pytest.approx(100.0 + 0.03 * np.minimum(rows[:, 1], 1000.0) + hill, abs=1.0)


def test_a_target_on_a_hill_is_as_high_over_ground_as_one_in_the_valley():
    """The ground rises by 100 m over 1 km, and so do the targets: 100 m over ground all along."""
    ground = ground_along([0.0, 1000.0], [0.0, 100.0])
    rows = flown(ground, [[0.0, 0.0, 100.0], [0.0, 1000.0, 200.0]])
    assert rows[:, 2] - 0.1 * np.minimum(rows[:, 1], 1000.0) == pytest.approx(100.0, abs=0.2)


def test_a_steep_rise_is_climbed_for_ahead_by_the_autopilots_look_ahead():
    """From flat ground, at 25 m/s and 2.5 m/s of climb: ground 100 m higher at 500 m adds 100 - 50 m."""
    places = [[0.0, 0.0, 100.0], [0.0, 1000.0, 200.0]]
    for look_ahead, added in ((0.0, 0.0), (450.0, 50.0), (2000.0, 50.0)):
        ground = ground_along([0.0, 400.0, 500.0], [0.0, 0.0, 100.0], look_ahead_m=look_ahead)
        rows = flown(ground, places, num_rows=2, law=LAW._replace(climb_rate_max=1e3))
        assert rows[1, 2] == pytest.approx(100.0 + added, abs=0.1)


@pytest.mark.parametrize(("down_m", "share"), [(10.0, 1.0), (20.0, 0.5)])
def test_over_ground_a_slight_descent_is_made_at_once(down_m, share):
    law = LAW._replace(descent_slope_min=15.0, sink_rate_max=1e3)
    rows = flown(ground_along([0.0], [7.0]), [[0.0, 0.0, 100.0], [0.0, 1000.0, 100.0 - down_m]], law=law)
    middle = rows[np.argmin(np.abs(rows[:, 1] - 500.0))]
    assert middle[2] == pytest.approx(100.0 - share * down_m, abs=0.2)


def test_a_circle_behind_targets_over_ground_is_level():
    ground = ground_along([0.0, 2000.0], [0.0, 200.0])
    law = LAW._replace(climb_rate_max=50.0, sink_rate_max=50.0)
    circle = np.array([0.0, 400.0, 150.0, 125.0])
    rows = flown(ground, [[0.0, 0.0, 100.0], [0.0, 400.0, 150.0]], circle=circle, law=law, num_rows=400)
    round_it = rows[300:]
    assert round_it[:, 2] == pytest.approx(150.0, abs=0.1)
