"""The emergency strategy carried out: what is flown when no plan passes, and that it is announced."""

import math
from dataclasses import replace

import numpy as np
import pytest
from shapely import LineString, Point, Polygon

from companion.assurance.emergency import EmergencyStep
from companion.config import mission_from_text
from companion.flight.construction import fallback
from companion.flight.construction.fallback import flown_violations, respond, straight_ahead
from companion.flight.construction.mission_construction import construct_until
from companion.flight.state.modes import Mode
from companion.flight.state.progress import is_on_last_leg, start_after
from companion.types.plan import PlanStatus
from tests.flight.construction.test_cycle import BLOCK, OPEN, WALL, begun, flying, plan, state, straight
from tests.support.sitl_harness import SitlHarness

NO_PLAN = plan(None, status=PlanStatus.APPROXIMATE)
ROOM = 20
# The goal stands in a closed yard.
YARD = "obstacles:\n" + "".join(
    BLOCK.format(*wall)
    for wall in (
        ("west", 1150, -350, 1200, 350), ("east", 1800, -350, 1850, 350),
        ("south", 1200, -350, 1800, -300), ("north", 1200, 300, 1800, 350),
    )
)  # fmt: skip
SHUT_IN = OPEN.replace("acceptance_radius_m: 400", "acceptance_radius_m: 60").replace(
    "total_planning_time_s: 80", "total_planning_time_s: 80, max_iterations: 4000"
)


def starting(made, **changes):
    return start_after(made, state(**changes), 4.0)


def answered(made, start, least=NO_PLAN, failed=(), may_return=False, return_path=()):
    return respond(made, start, least, failed, ROOM, may_return=may_return, return_path=return_path)


def test_straight_ahead_by_hand():
    made = begun()
    path = straight_ahead(starting(made).state, (0.0, 0.0))
    assert path.times_s[[0, 1, -1]].tolist() == [54.0, 55.0, 78.0]
    assert path.positions_enu_m[[0, -1]] == pytest.approx(
        np.array([[100.0, 0.0, 100.0], [700.0, 0.0, 100.0]])
    )
    assert path.courses_rad == pytest.approx(np.full(25, 0.5 * math.pi))
    blown = straight_ahead(starting(made).state, (-10.0, 0.0))  # 15 m/s are left, 360 m in 24 s
    assert blown.positions_enu_m[-1] == pytest.approx([460.0, 0.0, 100.0])
    windy = replace(made, wind_enu_m_s=(-10.0, 0.0))
    assert {entry.rule for entry in windy.violations_to(None, blown)} == {"threat"}
    assert {entry.rule for entry in windy.violations_to(None, path)} == {"threat", "pace"}


def test_the_least_threat_plan_is_flown_though_its_threat_is_past_the_limit():
    made = begun()
    start = starting(made)
    path = straight(levels=0.7)
    path = path.until(len(path) - 1)
    response = answered(made, start, plan(path))
    assert response.decision.step is EmergencyStep.LEAST_THREAT
    assert response.route.path is path
    assert response.route.waypoints.positions_enu_m[-1, 0] <= 1500.0


def test_a_refuge_lies_where_the_threat_is_least():
    # An approximate path whose threat falls to nothing between 500 and 600 m: the circle begins there.
    made = begun()
    start = starting(made)
    levels = np.full(31, 0.9)
    levels[20:25] = 0.0
    path = straight(rows=30)
    path = type(path)(
        path.times_s, path.positions_enu_m + start.state.position_enu_m - path.positions_enu_m[0],
        *(getattr(path, name) for name in ("courses_rad", "climb_angles_rad", "speeds_m_s")),
        path.position_covariances_m2, path.collision_free, levels,
    )  # fmt: skip
    response = answered(made, start, NO_PLAN, [path])
    assert response.decision.step is EmergencyStep.LOITER
    assert response.route.path.threat_levels[-1] == 0.0
    assert 600.0 <= response.route.path.positions_enu_m[-1, 0] <= 700.0
    assert response.route.waypoints.loiter_centre_enu_m is not None


def two_goals_left():
    """One 500 m ahead of where the tests' paths begin, and one that they do not come to."""
    text = OPEN.replace("goals:\n", "goals:\n  - {east_m: 600, north_m: 0, up_m: 100}\n")
    return begun(text=text.replace("east_m: 1500, north_m: 0", "east_m: 1500, north_m: 900"))


@pytest.mark.parametrize(("highest", "is_behind"), [(0.0, True), (0.05, True), (0.15, False)])
def test_a_refuge_lies_behind_the_goals_on_the_way_where_that_is_as_safe(highest, is_behind):
    made = two_goals_left()
    start = starting(made)
    path = straight(rows=30)
    levels = np.full(31, highest)
    levels[:10] = 0.0
    path = replace(
        path, positions_enu_m=path.positions_enu_m + start.state.position_enu_m - path.positions_enu_m[0],
        threat_levels=levels,
    )  # fmt: skip
    response = answered(made, start, NO_PLAN, [path])
    assert response.decision.step is EmergencyStep.LOITER
    assert (float(response.route.path.positions_enu_m[-1, 0]) > 540.0) is is_behind
    assert response.decision.reason.endswith("behind 1 of 2 goals") is is_behind


def test_straight_ahead_is_a_refuge_only_as_far_as_it_is_clear():
    made = begun(WALL)  # from 700 to 750 m east
    response = answered(made, starting(made))
    assert response.decision.step is EmergencyStep.LOITER
    centre = response.route.waypoints.loiter_centre_enu_m
    assert response.route.path.positions_enu_m[-1, 0] < 685.0
    wall = Polygon([(700, -100), (750, -100), (750, 100), (700, 100)])
    assert wall.distance(LineString([centre[:2], centre[:2] + 1e-6])) >= 125.0


def test_a_refuge_at_the_end_of_a_path_does_not_go_on_to_the_landing():
    made = replace(begun(), tail_enu_m=(1500.0, 900.0, 80.0))
    to_the_goal, short = straight(rows=60), straight(rows=20)
    assert construct_until(made, to_the_goal, len(to_the_goal) - 1).waypoints.continues_with_operator_items
    assert not construct_until(made, short, len(short) - 1).waypoints.continues_with_operator_items


def test_paths_from_elsewhere_are_no_safe_loiter():
    made = begun(WALL)
    elsewhere = straight(north=500.0, levels=0.0)
    response = answered(made, starting(made), NO_PLAN, [elsewhere])
    assert abs(response.route.path.positions_enu_m[-1, 1]) < 1.0


def test_with_nowhere_to_go_the_autopilot_returns_if_it_may_and_keeps_its_mission_if_not():
    made = begun("obstacles:\n" + BLOCK.format("wall", 150, -900, 200, 900))  # 50 m ahead of the start
    start = starting(made)
    for may_return, step in (
        (True, EmergencyStep.RETURN_TO_LAUNCH),
        (False, EmergencyStep.LEAVE_TO_AUTOPILOT),
    ):
        response = answered(made, start, may_return=may_return)
        assert response.decision.step is step
        assert response.route is None


def test_the_flown_path_is_judged_with_its_goal_and_a_refuge_without():
    made = begun()
    start = starting(made)
    assert flown_violations(made, start) is None
    made = flying(made, straight())
    assert made.flies_to_goal
    assert flown_violations(made, start_after(made, state(), 4.0)) == ()
    made = flying(made, straight().until(20))
    assert not made.flies_to_goal
    assert flown_violations(made, start) == ()
    assert not is_on_last_leg(made, state(east=450.0), 10.0)


def flown_in(text, until_s, **changes):
    harness = SitlHarness(mission_from_text(text, "shut-in.yaml"), **changes)
    return harness.fly(until_s)


def test_the_goals_that_can_be_reached_are_flown_to_beside_the_same_flight_without(monkeypatch):
    text = SHUT_IN.replace("goals:\n", "goals:\n  - {east_m: 700, north_m: 300, up_m: 100}\n") + YARD

    def nearest_m():
        harness = flown_in(text, 60.0)
        assert harness.texts("emergency")[0].startswith("loiter at the safest reachable point")
        flown = LineString(np.array(harness.simulator.truth.path)[:, 1:3])
        yard = [Polygon(obstacle.polygon_enu_m) for obstacle in harness.flight.mission.obstacle_list]
        assert min(wall.distance(flown) for wall in yard) > 15.0
        return flown.distance(Point(700.0, 300.0))

    assert nearest_m() < 60.0
    monkeypatch.setattr(fallback, "rows_at_goals", lambda *_: [])
    assert nearest_m() > 200.0


def test_a_goal_that_cannot_be_reached_ends_in_a_circle_that_was_announced():
    harness = flown_in(SHUT_IN + YARD, 85.0)
    assert harness.app.mode is Mode.ACTIVE
    assert [text.split(":")[0] for text in harness.texts("emergency")] == [
        "loiter at the safest reachable point"
    ]
    assert any(
        message.text.startswith("NOT safe ahead: circling") and message.severity == 2
        for _, message in harness.said("STATUSTEXT")
    )
    flown = np.array(harness.simulator.truth.path)[:, 1:3]
    yard = [Polygon(obstacle.polygon_enu_m) for obstacle in harness.flight.mission.obstacle_list]
    assert min(wall.distance(LineString(flown)) for wall in yard) > 15.0
    last = flown[-350:]  # a whole circle
    assert np.ptp(last, axis=0).max() < 2.0 * 125.0 + 60.0
    # It goes on looking for a plan, without sending the same refuge again and again.
    assert len(harness.recorder.missions) <= 2
    assert harness.kinds().count("no plan") >= 5
