"""A return that the service plans on, beside one that it leaves alone: a fence appears on the return path."""

import math
from dataclasses import replace

import numpy as np
from shapely.geometry import LineString, Point

from companion.config import mission_from_text
from companion.flight.state.checkpoint import Checkpoint
from companion.flight.state.flight_state import after_mode_event, after_reload
from companion.flight.state.goals_state import after_return_begun
from companion.flight.state.modes import Mode, ModeEvent
from tests.flight.construction.test_cycle import begun
from tests.flight.test_app import at, both, switch
from tests.flight.test_flight_day import has_landed_at, off, uploaded
from tests.flight.test_geofences import CIRCLE_OUT, fence
from tests.sim.client import PLAIN
from tests.support.sitl_harness import SitlHarness

RENEWS = "authority: {renew_return: true}\n"
GOAL, RUNWAY = (3600.0, 0.0), (2800.0, 600.0)
TEXT = PLAIN.replace("{east_m: 1750, north_m: 750, up_m: 100}", "{east_m: 3600, north_m: 0, up_m: 100}")
RETURN_S, FENCE_S = 60.0, 64.0
RADIUS_M, AHEAD_M = 120.0, 700.0


def sent_home(extra, *more, until_s=260.0):
    """A flight from the ground that is sent home; then a fence is uploaded on the way that is left."""
    centres = []

    def shut(harness):
        estimate = harness.simulator.autopilot.flight.estimate
        east, north = harness.simulator.autopilot.flight.position
        bearing = math.atan2(RUNWAY[0] - east, RUNWAY[1] - north)
        centres.append((east + AHEAD_M * math.sin(bearing), north + AHEAD_M * math.cos(bearing)))
        fence(harness, (CIRCLE_OUT, RADIUS_M, *centres[0]))
        assert estimate.up_m > 50.0

    def ended(harness):
        harness.is_over = harness.now_s > FENCE_S + 20.0 and not harness.simulator.autopilot.is_armed

    harness = SitlHarness(mission_from_text(TEXT + extra, "day.yaml"), on_ground=True)
    harness.simulator.autopilot.parameters["RTL_AUTOLAND"] = 4.0
    steps = (uploaded(5.0, goal=GOAL), off(12.0), switch(RETURN_S, "RTL"), at(FENCE_S, shut), ended, *more)
    harness.fly(until_s, both(*steps))
    rows = np.array(harness.simulator.truth.path)
    flown = LineString(rows[rows[:, 0] >= FENCE_S][:, 1:3])
    return harness, flown.distance(Point(centres[0]))


def test_a_return_that_is_left_alone_crosses_the_fence_and_one_that_is_renewed_flies_round_it():
    left_alone, nearest_m = sent_home("")
    assert nearest_m < RADIUS_M
    assert left_alone.changes(after_s=RETURN_S + 2.0) == []

    renewed, nearest_m = sent_home(RENEWS)
    assert nearest_m > RADIUS_M
    has_landed_at(renewed, RUNWAY)
    texts = [message.text for _, message in renewed.said("STATUSTEXT")]
    assert texts.count("Planner plans the rest of the return") == 1
    assert texts.count("At the end of the return, planner is done") == 1


def test_a_return_joins_the_return_path_without_turning_about():
    """The return path of half a minute before was still clear, but its first waypoint lay behind."""
    harness, _ = sent_home("", until_s=RETURN_S + 16.0)
    rows = np.array(harness.simulator.truth.path)
    steps = np.diff(rows[rows[:, 0] >= RETURN_S - 1.0][:, 1:3], axis=0)
    courses = np.unwrap(np.arctan2(steps[:, 0], steps[:, 1]))
    assert np.degrees(np.abs(courses - courses[0]).max()) < 60.0


def test_a_service_that_is_restarted_in_a_renewed_return_goes_on_with_it():
    def kill(harness):
        harness.checkpoint = Checkpoint(contents=harness.app._checkpoint.contents)
        harness.is_killed = True

    harness, nearest_m = sent_home(RENEWS, at(90.0, kill))
    assert len(harness.apps) == 2
    assert nearest_m > RADIUS_M
    has_landed_at(harness, RUNWAY)
    path = np.array(harness.simulator.truth.path)[:, 1:3]
    assert np.linalg.norm(path - GOAL, axis=1).min() > 300.0


def test_the_pilot_ends_a_renewed_return_by_leaving_the_mission_mode():
    harness, _ = sent_home(RENEWS, switch(80.0, "LOITER"), until_s=100.0)
    assert harness.app.mode is Mode.SUSPENDED
    assert harness.changes(after_s=80.5) == []


def test_after_the_landing_the_goals_are_those_of_the_mission_again():
    state = replace(begun(), mode=Mode.ACTIVE)
    goal, end = state.goals[0], state.region_at((5.0, 5.0, 100.0))
    state = after_return_begun(state, end, None, is_landing=False)
    assert state.goals_left[0].position_enu_m == end.position_enu_m
    landed = after_mode_event(state, ModeEvent.LANDED)
    assert (landed.goals, landed.next_goal, landed.is_returning) == ((goal,), 0, False)


def test_a_mission_file_that_is_read_again_does_not_end_a_renewed_return():
    state = begun()
    place = state.region_at((5.0, 5.0, 100.0))
    state = after_return_begun(state, place, None, is_landing=False)
    assert after_reload(state, state.mission).goals_left[0].position_enu_m == place.position_enu_m
