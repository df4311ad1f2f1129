"""What the way home costs and when to turn back: numbers worked by hand, and what holds for every margin."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.flight.prediction.energy_ahead import (
    EnergyNow,
    affords,
    energy_at_ends_wh,
    energy_outlook,
    track_energy_j,
    until_once_round,
    way_home_j,
    zero_of,
)
from companion.types.mission import Command, MavFrame, MissionItem
from companion.world.vehicle.energy import PowerModel
from tests.flight.construction.test_cycle import OPEN, begun, flying, state, straight
from tests.flight.prediction.test_return_path import ARDUPLANE, made, with_landing

# 400 W at 25 m/s, of which 250 W are parasite drag; 100 J for each metre of climb.
MODEL = PowerModel(0.016, 3_750.0, 100.0)
# 0.016 * 37.5 ** 3 + 3750 / 37.5 = 943.75 W.
SECTION = (
    "energy: {power_cruise_w: 400, power_max_airspeed_w: 943.75, climb_energy_j_m: 100, capacity_wh: 100, "
    "reserve_wh: 10}\n"
)
# A path's 25 m/s are true airspeed. At 684 m, the height of these paths, the standard atmosphere has 1.1467
# of 1.225 kg/m3 (ISO 2533), so that 24.19 m/s are commanded.
PATH_WH_S = MODEL.power_w(25.0 * math.sqrt(1.1467 / 1.225)) / 3_600.0
UNKNOWN = replace(ARDUPLANE, return_kind=None)  # The autopilot's way home is not known.


def line(length_m, rows=41, up_m=(100.0, 100.0)):
    """Straight east."""
    east = np.linspace(0.0, length_m, rows)
    return np.column_stack([east, np.zeros(rows), np.linspace(*up_m, rows)])


def circle(turns, radius_m=125.0, rows_a_turn=63):
    """Round a centre at (0, radius), from the origin on eastward."""
    angle = np.linspace(0.0, 2.0 * math.pi * turns, round(turns * rows_a_turn) + 1)
    return np.column_stack([radius_m * np.sin(angle), radius_m * (1.0 - np.cos(angle)), 100.0 + 0.0 * angle])


@pytest.mark.parametrize(
    ("length_m", "wind", "up_m", "energy_j"),
    [
        (1_000.0, (0.0, 0.0), (100.0, 100.0), 40.0 * 400.0),
        (1_000.0, (-5.0, 0.0), (100.0, 100.0), 50.0 * 400.0),
        (1_000.0, (0.0, 15.0), (100.0, 100.0), 50.0 * 400.0),  # Of 25 m/s across the wind 20 are left.
        (1_000.0, (0.0, 0.0), (100.0, 150.0), 40.0 * 400.0 + 50.0 * 100.0),
        (1_000.0, (0.0, 0.0), (150.0, 100.0), 40.0 * 400.0 - 50.0 * 100.0),
        (0.0, (0.0, 0.0), (100.0, 100.0), 0.0),
    ],
)
def test_a_straight_way_by_hand(length_m, wind, up_m, energy_j):
    found = track_energy_j(MODEL, line(length_m, up_m=up_m), 25.0, wind)
    assert found == pytest.approx(energy_j, rel=2e-3)


def test_a_round_costs_the_load_of_its_bank():
    """25² / 125 / g is the tangent of the bank: 27 degrees, and 150 W of lift-induced power become 189."""
    seconds, tangent = 2.0 * math.pi * 125.0 / 25.0, 5.0 / 9.80665
    expected = seconds * (250.0 + 150.0 * (1.0 + tangent**2))
    assert track_energy_j(MODEL, circle(1.0), 25.0, (0.0, 0.0)) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("turns", [2.2, 3.0, 4.7])
def test_only_one_round_of_the_last_circle_counts(turns):
    way = line(2_000.0, 161)
    track = np.vstack([way, circle(turns)[1:] + np.array([2_000.0, 0.0, 0.0])])
    found = until_once_round(track)
    # The circle's radius and its tolerance are reached up to a third of the radius before it begins.
    assert len(way) + 58 <= len(found) <= len(way) + 68
    np.testing.assert_array_equal(found, track[: len(found)])


@pytest.mark.parametrize("track", [line(100.0), circle(0.8), line(100.0)[:2], circle(2.0)[::-1][:40]])
def test_a_way_without_a_circle_at_its_end_counts_wholly(track):
    assert len(until_once_round(track)) == len(track)


# --- when to turn back


@pytest.mark.parametrize(
    ("margins", "zero_s"),
    [
        ([5.0, 3.0, 1.0], math.inf),
        ([5.0, 3.0, -1.0], 17.5),
        ([5.0, 0.0, -5.0], 10.0),
        ([-1.0, 3.0, 5.0], 0.0),
        ([1.0, -1.0, 5.0], 5.0),
    ],
)
def test_the_zero_of_a_margin_by_hand(margins, zero_s):
    assert zero_of([0.0, 10.0, 20.0], margins) == pytest.approx(zero_s)


@given(st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=30), st.floats(0.0, 50.0))
def test_the_zero_lies_between_a_margin_and_none_and_less_energy_never_makes_it_later(margins, less):
    times = [10.0 * number for number in range(len(margins))]
    zero = zero_of(times, margins)
    assert all(margin > 0.0 for at, margin in zip(times, margins, strict=True) if at < zero)
    assert math.isfinite(zero) == any(margin <= 0.0 for margin in margins)
    assert zero_of(times, [margin - less for margin in margins]) <= zero + 1e-9


def flight(settings=UNKNOWN, **battery):
    """East from home for 60 s, at 25 m/s."""
    return flying(made(settings, extra=SECTION), straight()), EnergyNow(**battery)


def test_without_a_known_return_home_is_the_straight_way_times_1_3():
    """1000 m at 25 m/s and 400 W are 16 kJ."""
    found = way_home_j(flight(left_wh=50.0)[0], state(east=1_000.0), MODEL)
    assert found == pytest.approx(1.3 * 16_000.0, rel=1e-6)


def test_the_flown_return_costs_its_turn_its_way_and_one_round():
    """1000 m, half a turn and one round of some 840 m in thin air; 16 J a metre and the load of the turns."""
    found = way_home_j(flight(ARDUPLANE, left_wh=50.0)[0], state(east=1_000.0), MODEL)
    assert found == pytest.approx(16.0 * (1_000.0 + 0.5 * 785.0 + 840.0), rel=0.12)


@pytest.mark.parametrize(
    ("now", "is_enough"),
    [
        (EnergyNow(39.0), True),
        (EnergyNow(33.0), False),
        (EnergyNow(57.0, 2.0), False),
        (EnergyNow(68.0, 2.0), True),
    ],
)
def test_a_return_path_of_a_list_is_afforded_with_the_reserve(now, is_enough):
    """5000 m at 16 J/m and one round of some 840 m with its load are 26 Wh; the reserve is 10 Wh."""
    flown = flying(made(replace(ARDUPLANE, return_kind=4.0), extra=SECTION), straight())
    frame = flown.mission.frame
    items, start = [], Command.DO_RETURN_PATH_START
    commands = Command.NAV_WAYPOINT, start, Command.NAV_WAYPOINT, Command.NAV_LOITER_UNLIM
    for command, east in zip(commands, (0.0, 0.0, 600.0, 5_500.0), strict=True):
        latitude, longitude, altitude = frame.global_from_local(east, 0.0, 100.0)
        whole = round(1e7 * latitude), round(1e7 * longitude)
        items.append(MissionItem(len(items), command, MavFrame.GLOBAL, (0.0,) * 4, *whole, altitude))
    assert affords(flown, state(east=500.0), items, now) is is_enough
    assert affords(flown, state(east=500.0), items[2:], now)  # Without a return path nothing is known.
    assert affords(made(ARDUPLANE), state(east=500.0), items, now)  # Without the section neither.


def test_the_time_to_turn_back_by_hand():
    """Outbound costs 0.106 Wh a second, and home 1.3/9 Wh more for each.

    From 500 m east home costs 1.3 * 8000 / 3600 Wh; of 20 Wh left 10 are the reserve.
    """
    flown, now = flight(left_wh=20.0)
    outlook = energy_outlook(flown, state(east=500.0), None, now)
    assert outlook.home_wh == pytest.approx(2.889, abs=0.001)
    assert outlook.margin_wh == pytest.approx(7.111, abs=0.001)
    assert outlook.turn_back_in_s == pytest.approx(7.111 / (PATH_WH_S + 1.3 / 9.0), abs=0.01)
    # 40 s are left of the path, 1500 m from home.
    assert outlook.at_end_wh == pytest.approx(20.0 - 40.0 * PATH_WH_S, abs=0.001)
    assert outlook.at_home_wh == pytest.approx(20.0 - 40.0 * PATH_WH_S - 1.3 * 60.0 / 9.0, abs=0.001)


def test_a_battery_that_falls_twice_as_fast_halves_what_it_is_worth():
    flown, now = flight(left_wh=20.0, ratio=2.0)
    outlook = energy_outlook(flown, state(east=500.0), None, now)
    assert outlook.home_wh == pytest.approx(2.0 * 2.889, abs=0.002)
    assert outlook.turn_back_in_s == pytest.approx(
        (10.0 - 2.0 * 2.889) / (2.0 * (PATH_WH_S + 1.3 / 9.0)), abs=0.01
    )


def test_if_home_is_reached_from_the_end_nobody_turns_back():
    flown, now = flight(left_wh=24.0)
    outlook = energy_outlook(flown, state(east=500.0), None, now)
    assert outlook.at_home_wh >= 10.0
    assert outlook.turn_back_in_s == math.inf


def test_if_the_margin_is_gone_it_is_now():
    flown, now = flight(left_wh=12.0)
    outlook = energy_outlook(flown, state(east=500.0), None, now)
    assert outlook.margin_wh < 0.0
    assert outlook.turn_back_in_s == 0.0


def test_behind_the_goal_the_operators_landing_counts_in_place_of_home():
    """It begins at (1400, 3000, 60); from (1500, 0, 100) that is 3002 m, and 40 m down give 4 kJ back."""
    flown, now = flight(left_wh=50.0)
    outlook = energy_outlook(with_landing(flown), state(east=500.0), None, now)
    expected = (16.0 * math.dist((1_500.0, 0.0), (1_400.0, 3_000.0)) - 4_000.0) / 3_600.0
    assert outlook.at_end_wh - outlook.at_home_wh == pytest.approx(expected, rel=1e-3)


def test_of_a_plan_what_is_left_at_its_end_and_at_home():
    """The path begins in 10 s, until when the aircraft flies at 25 m/s, as on the path."""
    flown, now = flight(left_wh=50.0)
    path = replace(straight(), times_s=straight().times_s - straight().times_s[0] + 60.0)
    at_end_wh, at_home_wh = energy_at_ends_wh(flown, state(stamp=50.0), path, None, now)
    assert at_end_wh == pytest.approx(50.0 - 70.0 * PATH_WH_S, abs=0.001)
    assert at_home_wh == pytest.approx(at_end_wh - 1.3 * 60.0 / 9.0, abs=0.001)


def test_nothing_is_said_without_the_section_or_without_home():
    now = EnergyNow(50.0)
    assert energy_outlook(flying(made(UNKNOWN), straight()), state(), None, now) is None
    assert energy_outlook(flying(begun(SECTION, OPEN), straight()), state(), None, now) is None
    for silent in (made(UNKNOWN), begun(SECTION, OPEN)):
        assert energy_at_ends_wh(silent, state(), straight(), None, now) is None
    assert energy_outlook(made(UNKNOWN, extra=SECTION), state(), None, now).turn_back_in_s == math.inf


@given(st.floats(11.0, 60.0), st.floats(0.0, 20.0), st.floats(1.0, 3.0), st.floats(0.0, 1_400.0))
def test_less_energy_or_a_faster_fall_never_gives_more_time(left_wh, less_wh, ratio, east_m):
    flown, now = flight(left_wh=left_wh)
    here = state(east=east_m)
    outlook = energy_outlook(flown, here, None, now)
    for worse in (EnergyNow(left_wh - less_wh), EnergyNow(left_wh, ratio)):
        found = energy_outlook(flown, here, None, worse)
        assert found.turn_back_in_s <= outlook.turn_back_in_s + 1e-6
        assert found.margin_wh <= outlook.margin_wh + 1e-9
        assert found.at_home_wh <= outlook.at_home_wh + 1e-9
