"""Two returns with the service killed, each beside the same flight that returns straight home."""

import numpy as np
import pytest
from shapely.geometry import LineString, Polygon

from companion.flight.construction import cycle
from companion.types.mission import Command
from tests.returns.return_flights import BY_PATH, PLACES, fly, is_bad, scenario
from tests.support.sitl_harness import SitlHarness

# Of each autopilot the first seed whose straight return touches something.
SEEDS = [pytest.param(2, id="arduplane"), pytest.param(3, id="px4")]


@pytest.mark.parametrize("seed", SEEDS)
def test_by_the_checked_path_it_touches_nothing_with_the_service_killed(seed):
    flight = fly(seed)
    assert flight.is_killed
    assert flight.has_path
    assert not is_bad(flight)
    straight = fly(seed, is_with_path=False)
    assert straight.touched


@pytest.mark.thorough
def test_a_landing_sequence_is_joined_at_its_start_with_the_service_killed():
    """RTL_AUTOLAND 2, by which ArduPlanes before 4.7 return as well."""
    flight = fly(2, autoland=2)
    assert flight.is_killed
    assert flight.has_path
    assert not is_bad(flight)


@pytest.mark.thorough
def test_from_a_leg_between_two_walls_a_landing_sequence_is_joined_ahead():
    """With one start, at the end of the way out, the aircraft turned back to it and touched a wall."""
    flight = fly(2, autoland=2, begun_s=76.0)
    assert flight.is_killed
    assert flight.has_path
    assert not is_bad(flight)
    assert flight.clearance_m > 30.0


@pytest.mark.slow
def test_a_return_is_judged_at_the_cruise_to_which_the_autopilot_accelerates():
    """The mission flew 4 % slower than the autopilot's cruise, and the turn at the path's start is wider."""
    flight = fly(7294, autoland=2)
    assert flight.has_path
    assert not is_bad(flight)


@pytest.mark.slow
def test_a_path_that_slows_down_is_judged_at_both_airspeeds_to_the_end_of_each_flight():
    """Slowed down at once, a mission of this flight takes a second longer, and breaks a rule in it."""
    flight = fly(4325)
    assert not is_bad(flight)


@pytest.mark.slow
def test_a_landing_that_is_itself_too_near_to_a_wall_is_flown_to_without_touching_anything():
    flight = fly(5449)
    assert flight.has_path
    assert not is_bad(flight)


def test_to_a_landing_that_is_too_near_to_a_wall_the_way_is_chosen_that_keeps_clear_for_longest():
    """Simulated, the circle of this landing touches a wall; the straight way there crosses another one."""
    mission, _, dialect, *_ = scenario(5449)
    harness = SitlHarness(mission, seed=5449, dialect=dialect)
    autopilot = harness.simulator.autopilot
    parameter, by_mission = BY_PATH[dialect]
    autopilot.parameters[parameter] = by_mission
    harness.fly(8.0)
    placed = [item for item in autopilot.mission_items if item.command in (Command.NAV_LOITER_UNLIM, *PLACES)]
    end = max(row for row, item in enumerate(placed) if item.command == Command.NAV_LOITER_UNLIM)
    places = [autopilot._position(item)[:2] for item in placed[end:-1]]
    walls = {wall.name: Polygon(wall.polygon_enu_m) for wall in mission.obstacle_list}
    straight, way = LineString([places[0], places[-1]]), LineString(places)
    assert straight.distance(walls["box_0"]) == 0.0
    assert way.distance(walls["box_0"]) > 7.5


@pytest.mark.slow
def test_a_landing_circle_beside_a_wall_is_joined_without_touching_it():
    """The PX4's circle is 25 m from the wall, and is joined from near its centre."""
    flight = fly(357)
    assert flight.has_path
    assert not is_bad(flight)


@pytest.mark.slow
def test_a_return_path_keeps_away_from_the_way_out_where_there_is_no_room_to_turn():
    """At 40 m/s between two walls the way back beside the way out is joined by a turn into the wall."""
    flight = fly(688)
    assert flight.has_path
    assert not is_bad(flight)


def test_the_scenarios_differ_and_are_repeated():
    names, begins, dialects = zip(
        *((name, s, d) for _, name, d, s, _, _ in map(scenario, range(40))), strict=True
    )
    assert len(set(begins)) == 40
    assert len(set(names)) >= 5
    assert dialects.count(dialects[0]) == 20
    assert scenario(7)[3:] == scenario(7)[3:]


def test_the_way_on_to_the_landing_is_the_same_wherever_a_pursuer_is_now(monkeypatch):
    """With the pursuer of the mission's begin, six plans took 7.8 s in this flight, and found no way."""
    taken, way_on = [], cycle.way_on
    monkeypatch.setattr(cycle, "way_on", lambda *given: taken.append(given) or way_on(*given))
    mission, _, dialect, *_ = scenario(95011)
    harness = SitlHarness(mission, seed=95011, dialect=dialect)
    parameter, by_mission = BY_PATH[dialect]
    harness.simulator.autopilot.parameters[parameter] = by_mission
    harness.fly(12.0)
    *given, snapshot = taken[0]
    assert snapshot.is_pursued
    pursued, alone = (way_on(*given, world) for world in (snapshot, snapshot.with_tracks(0.0, ())))
    assert pursued is not None
    np.testing.assert_array_equal(pursued, alone)
