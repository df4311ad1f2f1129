"""What is left where nothing can be planned and circled: a rally point, a return to launch, or neither."""

from dataclasses import replace

import numpy as np
import pytest
from shapely import LineString, Polygon

from companion.config import mission_from_text
from companion.flight.replanning import replanning
from companion.flight.state.modes import Mode
from companion.types.events import Dialect
from companion.types.mission import MavFrame, MissionItem
from sim.vehicle.control import Level
from tests.flight.construction.test_cycle import BLOCK, OPEN
from tests.flight.test_app import at
from tests.support.operator_places import home_at, rally_points
from tests.support.sitl_harness import SitlHarness
from tests.torture.harness import MISSION_MODE

BOTH = pytest.mark.parametrize("dialect", list(Dialect), ids=lambda dialect: dialect.value)
SHUT_IN = OPEN.replace("acceptance_radius_m: 400", "acceptance_radius_m: 60").replace(
    "total_planning_time_s: 80", "total_planning_time_s: 80, max_iterations: 4000"
)
MAY_RETURN = "authority: {allow_rtl: true}\n"


def lane(half_m, begin_m, end_m):
    """Walls north and south of the operator's leg."""
    sides = (
        ("north", begin_m, half_m, end_m, half_m + 40.0),
        ("south", begin_m, -half_m - 40.0, end_m, -half_m),
    )
    return "".join(BLOCK.format(*side) for side in sides)


def yard(east_m, half_m=150.0):
    """Walls all round a goal."""
    low, high, side, out = east_m - half_m, east_m + half_m, half_m, half_m + 50.0
    walls = (
        ("west", low - 50.0, -out, low, out), ("east", high, -out, high + 50.0, out),
        ("below", low, -out, high, -side), ("above", low, side, high, out),
    )  # fmt: skip
    return "".join(BLOCK.format(*wall) for wall in walls)


def harness_of(dialect, goal_m, *blocks, authority=""):
    """A flight along the operator's leg eastwards, taken over in it."""
    text = SHUT_IN.replace("{east_m: 1500, north_m: 0", f"{{east_m: {goal_m}, north_m: 0")
    text += "obstacles:\n" + yard(goal_m) + "".join(blocks) + "takeover: {when: item, item: 2}\n" + authority
    harness = SitlHarness(mission_from_text(text, "lane.yaml"), dialect=dialect)
    autopilot = harness.simulator.autopilot
    legs = [waypoint(autopilot, n, east) for n, east in enumerate((0.0, 300.0, 700.0, 3000.0))]
    if dialect is Dialect.PX4:
        legs = [replace(leg, sequence=n) for n, leg in enumerate(legs[1:])]  # no home slot
        autopilot.parameters["MIS_TKO_LAND_REQ"] = 0
    autopilot.start(legs, MISSION_MODE[dialect])
    return harness


def waypoint(autopilot, number, east_m):
    latitude, longitude = autopilot.projection.degrees(east_m, 0.0)
    place = round(latitude * 1e7), round(longitude * 1e7)
    return MissionItem(number, 16, MavFrame.GLOBAL_RELATIVE_ALT, (0.0,) * 4, *place, 100.0)


def nearest(harness, since_s=0.0):
    """How near the aircraft has come to the walls since they were uploaded [m]."""
    rows = np.array(harness.simulator.truth.path)
    flown = LineString(rows[rows[:, 0] >= since_s][:, 1:3])
    return min(Polygon(block.polygon_enu_m).distance(flown) for block in harness.flight.mission.obstacle_list)


def steps(harness):
    return [text.split(":")[0] for text in harness.texts("emergency")]


def returning(dialect, home_east_m):
    """In a lane that is narrower than the planner's distance and wide enough for a straight flight."""
    harness = harness_of(dialect, 3500.0, lane(9.0, 300.0, 1500.0), authority=MAY_RETURN)
    home_at(harness, home_east_m, 0.0)
    return harness


@BOTH
def test_a_return_to_launch_that_keeps_clear_is_commanded(dialect):
    harness = returning(dialect, 2200.0).fly(45.0)
    assert steps(harness) == ["return to launch"]
    assert harness.simulator.autopilot.mode == "RTL"
    assert harness.app.mode is Mode.SUSPENDED
    assert harness.texts("suspended") == ["return to launch (RTL)"]
    assert not harness.simulator.truth.collision


@BOTH
def test_a_return_to_launch_into_a_wall_is_not(dialect, monkeypatch):
    harness = returning(dialect, 0.0).fly(45.0)
    assert steps(harness)[0] == "leave the autopilot with its mission"
    assert "the way home breaks" in harness.texts("emergency")[0]
    assert harness.simulator.autopilot.mode == MISSION_MODE[dialect]
    assert not harness.simulator.truth.collision
    if dialect is Dialect.PX4:
        return  # one of them is enough to see what the judgement is for
    # The same flight without the judgement.
    monkeypatch.setattr(replanning, "return_path", lambda state, ownship, current: ())
    harness = returning(dialect, 0.0).fly(45.0)
    assert steps(harness)[0] == "return to launch"
    assert harness.simulator.truth.collision


@BOTH
def test_where_the_mission_file_does_not_allow_it_nothing_is_commanded(dialect):
    harness = harness_of(dialect, 3500.0, lane(9.0, 300.0, 1500.0)).fly(35.0)
    assert steps(harness) == ["leave the autopilot with its mission"]
    assert "does not allow return to launch" in harness.texts("emergency")[0]


def in_the_lane(dialect, *places):
    """In a lane too narrow to turn round in; the goal, which is closed in, lies behind."""
    harness = harness_of(dialect, -1500.0, lane(60.0, 300.0, 1700.0))
    if places:
        rally_points(harness, *places)
    return harness


@BOTH
def test_a_rally_point_is_flown_to_and_circled_at(dialect):
    harness = in_the_lane(dialect, (2400.0, 0.0, 100.0)).fly(130.0)
    assert harness.texts("rally") == ["1 rally point"]
    assert steps(harness)[0] == "fly to a rally point"
    # What is promised; how much farther a lane is kept from is the search's matter (28 m, 32 m).
    assert nearest(harness) > float(harness.flight.mission.planning.clearance_min_m)
    last = np.array(harness.simulator.truth.path)[-350:, 1:3]  # a whole circle
    assert np.linalg.norm(last - (2400.0, 0.0), axis=1).max() < 2.0 * 125.0 + 60.0 + 30.0
    assert harness.simulator.autopilot.mode == MISSION_MODE[dialect]


@BOTH
def test_without_a_rally_point_nothing_is_sent(dialect):
    harness = in_the_lane(dialect).fly(36.0)
    assert steps(harness)[0] == "leave the autopilot with its mission"
    assert not harness.recorder.missions


@BOTH
def test_of_two_rally_points_the_nearer_is_tried_first_and_the_other_where_it_is_shut(dialect):
    harness = harness_of(
        dialect, -1500.0, lane(60.0, 300.0, 1700.0), yard(2100.0).replace("name: ", "name: far ")
    )
    rally_points(harness, (2100.0, 0.0, 100.0), (2400.0, 500.0, 100.0))
    harness.fly(45.0)
    assert steps(harness)[0] == "fly to a rally point"
    assert harness.app.state.flown.path.positions_enu_m[-1, 1] > 400.0


@BOTH
def test_rally_points_that_are_taken_away_are_forgotten(dialect):
    harness = in_the_lane(dialect, (2400.0, 0.0, 100.0))
    harness.fly(22.0, at(12.0, rally_points))
    assert harness.texts("rally") == ["1 rally point", "0 rally points"]
    assert harness.app.state.rally_points == ()


def test_a_px4_with_rally_points_is_not_told_to_return():
    """It may not understand their frame, and then flies off."""
    harness = returning(Dialect.PX4, 2200.0)
    rally_points(harness, (2000.0, 0.0, 0.0), frame=MavFrame.GLOBAL_RELATIVE_ALT_INT)
    harness.fly(35.0)
    assert "the way home is not known" in harness.texts("emergency")[0]
    assert harness.simulator.autopilot.mode == "MISSION"
    # Told nevertheless, the simulated one flies off, as the real one.
    harness.simulator.set_mode("RTL")
    assert isinstance(harness.simulator.autopilot.flight.steering, Level)


@pytest.mark.parametrize(("name", "value"), [("TERRAIN_FOLLOW", 16.0), ("RTL_AUTOLAND", 5.0)])
def test_the_pilot_is_told_which_parameter_forbids_a_return_that_the_file_allows(name, value):
    harness = SitlHarness(mission_from_text(OPEN + MAY_RETURN, "open.yaml"))
    harness.simulator.autopilot.parameters[name] = value
    harness.fly(6.0)
    assert f"no return to launch with {name} {value:g}" in harness.texts("fault")
