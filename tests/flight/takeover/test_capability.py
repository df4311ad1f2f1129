"""What a mission file asks for against what the autopilot's parameters allow, by numbers worked by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.config import mission_from_text
from companion.config.rules import rules_of
from companion.flight.construction.mission_simulation import guidance_of
from companion.flight.state.flight_state import after_settings_reported, first_state
from companion.flight.takeover.capability import shortfalls
from companion.types.state import AutopilotSettings
from tests.flight.test_app import at, both
from tests.flight.test_flight_day import day, off, uploaded
from tests.flight.test_operator import BOTH
from tests.sim.client import PLAIN

MISSION = mission_from_text(PLAIN, "plain.yaml")  # 25 m/s, turn radius 125 m, in the plane, goal 1904 m away
IN_SPACE = mission_from_text(PLAIN.replace("dimension: 2", "dimension: 3"), "plain.yaml")


@pytest.mark.parametrize(
    ("settings", "found"),
    [
        ({}, ()),
        ({"airspeed_min_m_s": 12.0, "airspeed_max_m_s": 38.0, "bank_max_deg": 50.0}, ()),
        ({"passing_max_m": 0.0, "height_offset_m": 0.0}, ()),
        ({"height_offset_m": -5.0}, ("ALT_OFFSET -5: must be 0",)),
        ({"passing_max_m": 30.0}, ("WP_MAX_RADIUS 30: must be 0",)),
        ({"airspeed_max_m_s": 22.0}, ("cruise 24.2 m/s EAS, autopilot at most 22",)),
        ({"airspeed_min_m_s": 28.0}, ("cruise 24.2 m/s EAS, autopilot at least 28",)),
        # 625 / (9.80665 * tan 8 deg) = 453.5 m; half the sensing horizon are 412.5 m.
        ({"bank_max_deg": 8.0}, ("turn radius 453 m, sensing horizon 825",)),
        ({"bank_max_deg": 9.0}, ()),
        ({"fence_height_m": 90.0, "fence_enable": 1.0, "fence_types": 7.0}, ("goal 1 at 100 m, fence 90",)),
        ({"fence_height_m": 90.0, "fence_enable": 0.0}, ()),
        ({"fence_height_m": 90.0, "fence_enable": 1.0, "fence_types": 2.0}, ()),
        ({"fence_radius_m": 300.0, "fence_enable": 1.0}, ("goal 1 1904 m away, fence 300",)),
        ({"fence_radius_m": 0.0}, ()),
    ],
)
def test_both_numbers_are_told(settings, found):
    assert shortfalls(MISSION, AutopilotSettings(**settings)) == found


def test_the_fences_are_about_home_as_soon_as_it_is_known():
    fenced = AutopilotSettings(fence_radius_m=300.0, fence_height_m=90.0, fence_enable=1.0)
    # The goal is at 1750, 750, 100.
    assert shortfalls(MISSION, fenced, (1750.0, 500.0, 20.0)) == ()
    assert shortfalls(MISSION, fenced, (1750.0, 400.0, 5.0)) == (
        "goal 1 at 95 m, fence 90", "goal 1 350 m away, fence 300",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("told", "climb_deg", "descent_deg", "fast_climb_deg"),
    [
        # 25 m/s * sin 10 deg = 4.34 m/s; asin(5 / 37.5) = 7.66 deg
        ({"climb_max_m_s": 5.0, "sink_max_m_s": 5.0}, 10.0, 10.0, 7.662),
        ({"climb_max_m_s": 3.0, "sink_max_m_s": 4.0}, 6.892, 9.207, 4.588),
        # A PX4's defaults
        ({"climb_max_m_s": 5.0, "sink_max_m_s": 5.0, "climb_wanted_m_s": 3.0, "sink_wanted_m_s": 2.0},
         6.892, 4.589, 4.588),
        ({}, 10.0, 10.0, 10.0),
    ],
)  # fmt: skip
def test_plans_climb_and_descend_no_faster_than_the_autopilot(told, climb_deg, descent_deg, fast_climb_deg):
    rules = rules_of(IN_SPACE, reported=AutopilotSettings(**told))
    for limits in (rules.vehicle, rules.checker.limits):
        angles = limits.climb_angle_max_rad, limits.descent_angle_max_rad
        assert np.degrees(angles) == pytest.approx((climb_deg, descent_deg), abs=0.001)
    fast = rules.vehicle.at_speed(37.5)
    assert math.degrees(fast.climb_angle_max_rad) == pytest.approx(fast_climb_deg, abs=0.001)


@pytest.mark.parametrize(
    ("told", "bank_deg", "radius_m"),
    [
        ({}, 40.0, 125.0),
        ({"bank_max_deg": 30.0}, 30.0, 125.0),
        ({"bank_max_deg": 20.0}, 20.0, 175.1),  # 625 / (9.80665 * tan 20 deg)
        # Stall prevention limits the bank at cruise only. The least of its limits, 32 degrees, is enough for
        # 625 / (9.80665 * tan 32 deg) = 102 m.
        ({"bank_max_deg": 50.0, "airspeed_min_m_s": 22.0, "stall_prevention": 1.0}, 40.0, 125.0),
        ({"bank_max_deg": 50.0, "airspeed_min_m_s": 26.0, "stall_prevention": 1.0}, 40.0, 125.0),
        ({"bank_max_deg": 20.0, "airspeed_min_m_s": 23.0, "stall_prevention": 1.0}, 20.0, 175.1),
    ],
)
def test_plans_turn_no_tighter_than_the_autopilot(told, bank_deg, radius_m):
    rules = rules_of(IN_SPACE, reported=AutopilotSettings(**told))
    for limits in (rules.vehicle, rules.checker.limits):
        assert limits.sideways_max_m_s2 == pytest.approx(9.80665 * math.tan(math.radians(bank_deg)))
        assert limits.turn_radius_min_m == pytest.approx(radius_m, abs=0.1)


def test_plans_turn_no_tighter_than_an_aircraft_that_slips():
    """At 0.7 and 40°, 5.76 m/s²: 37.5² / 5.76 = 244 m. The check allows 0.75: it takes 5 % for noise."""
    rules = rules_of(IN_SPACE, coordination=0.7)
    assert rules.vehicle.turn_radius_min_m == 125.0  # 625 / 5.76 = 109
    assert rules.vehicle.at_speed(37.5).turn_radius_min_m == pytest.approx(244.1, abs=0.1)
    assert rules.checker.limits.sideways_max_m_s2 == pytest.approx(
        0.75 * 9.80665 * math.tan(math.radians(40.0))
    )
    assert rules_of(IN_SPACE).checker.limits.sideways_max_m_s2 == pytest.approx(8.2287, abs=0.001)
    tight = rules_of(IN_SPACE, (), AutopilotSettings(bank_max_deg=25.0), 0.7)
    assert tight.vehicle.turn_radius_min_m == pytest.approx(
        195.2, abs=0.1
    )  # 625 / (0.7 * 9.80665 * tan 25 deg)


@pytest.mark.parametrize(
    ("told", "bank_deg"),
    [
        ({}, 80.0),
        ({"bank_max_deg": 120.0}, 80.0),
        ({"bank_max_deg": 45.0}, 45.0),
        ({"bank_max_deg": 45.0, "airspeed_min_m_s": 22.0}, 45.0),
        ({"bank_max_deg": 45.0, "airspeed_min_m_s": 22.0, "stall_prevention": 0.0}, 45.0),
        (
            {"bank_max_deg": 45.0, "airspeed_min_m_s": 22.0, "stall_prevention": 1.0},
            34.26,
        ),  # cos = (22 / 24.2)^2
        ({"bank_max_deg": 30.0, "airspeed_min_m_s": 22.0, "stall_prevention": 1.0}, 30.0),
        (
            {"bank_max_deg": 45.0, "airspeed_min_m_s": 23.0, "stall_prevention": 1.0},
            32.0,
        ),  # 25.4 by that rule
        ({"bank_max_deg": 45.0, "airspeed_min_m_s": 26.0, "stall_prevention": 1.0}, 32.0),
    ],
)
def test_the_largest_bank_at_an_airspeed(told, bank_deg):
    found = AutopilotSettings(**told).bank_limit_rad(24.2)
    assert math.degrees(found) == pytest.approx(bank_deg, abs=0.01)


def test_what_was_told_is_what_tracks_are_foreseen_by():
    told = AutopilotSettings(
        acceptance_radius_m=30.0, guidance_period_s=22.0, guidance_damping=0.8, bank_max_deg=35.0,
        loiter_radius_m=-90.0, height_acceptance_m=7.0, climb_max_m_s=2.0, sink_max_m_s=3.0,
    )  # fmt: skip
    guidance = guidance_of(after_settings_reported(first_state(MISSION, 0.0), told))
    assert (guidance.acceptance_radius_m, guidance.l1_period_s, guidance.l1_damping) == (30.0, 22.0, 0.8)
    assert (guidance.loiter_radius_m, guidance.climb_rate_max_m_s) == (-90.0, pytest.approx(2.0))
    assert guidance.height_acceptance_m == 7.0
    assert guidance.sink_rate_max_m_s == pytest.approx(3.0)
    assert guidance.bank_max_rad == pytest.approx(math.radians(35.0))
    slow = after_settings_reported(
        first_state(MISSION, 0.0), replace(told, stall_prevention=1.0, airspeed_min_m_s=22.0)
    )
    assert math.degrees(guidance_of(slow).bank_max_rad) == pytest.approx(34.17, abs=0.01)
    assert math.degrees(guidance_of(slow, 31.0).bank_max_rad) == pytest.approx(
        35.0
    )  # ROLL_LIMIT_DEG; 57 by that rule
    untold = guidance_of(first_state(MISSION, 0.0))
    assert untold.acceptance_radius_m == 50.0


def limited(stamp_s, degrees):
    def limit(harness):
        harness.simulator.autopilot.parameters["ROLL_LIMIT_DEG"] = degrees

    return at(stamp_s, limit)


@BOTH
def test_a_mission_beyond_the_aircraft_is_refused_on_the_ground_and_not_taken_over(dialect):
    harness = day(dialect, 60.0, limited(0.0, 8.0), uploaded(8.0), off(14.0))
    assert "turn radius 453 m, sensing horizon 825" in harness.texts("fault")
    told = [entry.stamp_s for entry in harness.recorder.decisions if entry.kind == "fault"]
    assert max(told) < 14.0
    assert harness.app.num_swaps == 0
    assert harness.changes() == []


@BOTH
def test_once_the_parameter_is_set_right_it_is_flown(dialect):
    """Parameters are asked for again and again: one every few seconds."""
    harness = day(dialect, 130.0, limited(0.0, 8.0), uploaded(8.0), limited(12.0, 50.0), both(off(100.0)))
    assert "turn radius 453 m, sensing horizon 825" in harness.texts("fault")
    assert harness.app.num_swaps >= 1


@pytest.mark.parametrize(
    ("flies_by", "settings", "found"),
    [
        (True, {}, ()),
        (True, {"terrain_enable": 1.0}, ()),
        (True, {"terrain_enable": 0.0}, ("item_frame terrain, TERRAIN_ENABLE 0",)),
        (False, {}, ("item_frame terrain: PX4 has only amsl",)),
    ],
)
def test_heights_over_ground_need_an_arduplane_that_stores_the_ground(flies_by, settings, found):
    section = "terrain: {generated: {kind: hills, relief_m: 1}, item_frame: FRAME}\n"
    text = PLAIN.replace("dimension: 2", "dimension: 3") + section
    for frame, expected in (("terrain", found), ("amsl", ())):
        mission = mission_from_text(text.replace("FRAME", frame), "hills.yaml")
        assert shortfalls(mission, AutopilotSettings(**settings), flies_by=flies_by) == expected
