"""The parameter of returns that the mission file lets the service set, and a return with and without it."""

from dataclasses import replace

import pytest

from companion.config import mission_from_text
from companion.flight.monitors.return_setting import return_kind_to_set
from companion.mission.operator import Operator
from companion.types.events import Dialect
from companion.types.mission import Command, MavFrame, MissionItem
from companion.types.state import AutopilotSettings
from tests.flight.construction.test_cycle import begun
from tests.flight.test_app import both, when
from tests.flight.test_flight_day import off, uploaded
from tests.sim.client import PLAIN
from tests.support.sitl_harness import SitlHarness

ALLOWED = "authority: {set_return: true}\n"
# Across the straight line from the goal to home.
WALL = """
obstacles:
  - {name: wall, polygon_enu_m: [[550, -200], [700, -200], [700, 700], [550, 700]], base_m: 0, top_m: 300}
"""
NAMES = {Dialect.ARDUPILOT: "RTL_AUTOLAND", Dialect.PX4: "RTL_TYPE"}
BOTH = pytest.mark.parametrize("dialect", list(Dialect), ids=lambda dialect: dialect.value)
LAND = MissionItem(2, Command.NAV_LAND, MavFrame.GLOBAL, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0)


def state_with(kind, *, flies_by=True, is_armed=False, items=(LAND,), extra=ALLOWED):
    """A state before the flight whose autopilot has a kind of return."""
    state = begun(extra)
    listed = replace(state.mission_list, operator=None if items is None else Operator(items, tail=len(items)))
    return replace(
        state,
        flies_by=flies_by,
        phase=replace(state.phase, is_armed=is_armed),
        settings=AutopilotSettings(return_kind=kind),
        mission_list=listed,
    )


@pytest.mark.parametrize(
    ("kind", "given", "wanted"),
    [
        (0.0, {}, 2.0),
        (1.0, {}, 2.0),
        (3.0, {}, 2.0),
        (2.0, {}, None),
        (4.0, {}, None),
        (0.0, {"items": ()}, 2.0),  # The service's return path ends in a circle over home.
        (0.0, {"is_armed": True}, None),
        (0.0, {"extra": ""}, None),
        (0.0, {"items": None}, None),  # The list was not read yet.
        (None, {}, None),
        (0.0, {"flies_by": False}, 2.0),
        (1.0, {"flies_by": False}, 2.0),
        (2.0, {"flies_by": False}, None),
        (1.0, {"flies_by": False, "items": ()}, None),
        (1.0, {"flies_by": False, "is_armed": True}, None),
    ],
)
def test_the_value_is_set_where_it_is_allowed_and_returns_are_straight(kind, given, wanted):
    assert return_kind_to_set(state_with(kind, **given)) == wanted


def clearance_m(harness):
    """The least distance to the wall [m]."""
    return harness.simulator.truth.min_obstacle_clearance_m


def sent_home(dialect, *, extra):
    """A flight from the ground with a wall on the straight line home, returned shortly before the goal."""

    def near_goal(harness):
        east_m, north_m = harness.simulator.autopilot.flight.position
        return harness.now_s > 20.0 and east_m > 1450.0 and north_m > 450.0

    def ended(harness):
        autopilot, is_flown = harness.simulator.autopilot, harness.now_s > 60.0
        has_landed = is_flown and not autopilot.is_armed
        harness.is_over = has_landed or clearance_m(harness) <= 0.0

    harness = SitlHarness(
        mission_from_text(PLAIN + WALL + extra, "day.yaml"), dialect=dialect, on_ground=True
    )
    return_now, _ = when(near_goal, lambda harness: harness.simulator.autopilot.fail_safe("RTL"))
    return harness.fly(320.0, both(uploaded(5.0), off(14.0), return_now, ended))


@BOTH
def test_a_return_of_an_autopilot_that_would_fly_straight_follows_the_checked_path(dialect):
    harness = sent_home(dialect, extra=ALLOWED)
    assert clearance_m(harness) > 10.0
    assert not harness.simulator.autopilot.is_armed
    assert harness.simulator.autopilot.parameters[NAMES[dialect]] == 2.0
    sets = [(stamp, name) for stamp, name in harness.changes() if name == "PARAM_SET"]
    assert [stamp < 14.0 for stamp, _ in sets] == [True]
    texts = [message.text for _, message in harness.said("STATUSTEXT")]
    assert f"{NAMES[dialect]} set to 2, was 0" in texts


@BOTH
def test_without_permission_nothing_is_set_and_the_return_hits_the_wall(dialect):
    harness = sent_home(dialect, extra="")
    assert [name for _, name in harness.changes() if name == "PARAM_SET"] == []
    assert clearance_m(harness) <= 0.0


@BOTH
def test_an_autopilot_that_does_not_take_the_value_is_reported(dialect, monkeypatch):
    harness = SitlHarness(mission_from_text(PLAIN + ALLOWED, "day.yaml"), dialect=dialect, on_ground=True)
    monkeypatch.setattr(harness.simulator.autopilot.parameters, "set_from_client", lambda name, value: False)
    harness.fly(25.0, uploaded(5.0))
    assert harness.texts("return").count(f"{NAMES[dialect]} 2 not set: mission set_parameter: no answer") == 1
    texts = [message.text for _, message in harness.said("STATUSTEXT")]
    assert f"{NAMES[dialect]} could not be set: RTL may be straight" in texts
