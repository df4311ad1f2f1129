"""From a path to a mission: where it ends, how its waypoints lie, and how fast it is flown."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.assurance.checker import Checker
from companion.assurance.surroundings.ground_heights import GroundHeights
from companion.flight.construction import mission_construction
from companion.flight.construction.mission_construction import construct, construct_until
from companion.flight.construction.mission_simulation import (
    BOUNDS_TOLERANCE_M,
    airspeed_at_end,
    at_start,
    guidance_of,
    simulated,
)
from companion.mission.list_layout import new_banks
from companion.mission.waypoints import mission_part, waypoints_from_path
from companion.types.mission import Command
from companion.world.ground.autopilot_ground import AutopilotGround, ClimbAhead
from companion.world.vehicle.guidance import track_of_legs
from tests.flight.construction.test_cycle import BLOCK, EAST, OPEN, begun, straight
from tests.ground.maps import posts_over
from tests.mission.made import item, path_along

BOTH = pytest.mark.parametrize("flies_by", [True, False], ids=["arduplane", "px4"])
PILLARS = (
    "obstacles:\n" + BLOCK.format("north", 1000, 60, 1250, 300) + BLOCK.format("south", 1000, -300, 1250, -60)
)
GORGE = "obstacles:\n" + BLOCK.format("north", -50, 40, 2700, 60) + BLOCK.format("south", -50, -60, 2700, -40)
CORNER = (550.0, 22), (125.0, 0.5 * math.pi, 8), (600.0, 24)  # East, and by a quarter circle to the south.


def circle_of(waypoints):
    centre = shapely.Point(waypoints.loiter_centre_enu_m[:2])
    return centre.buffer(abs(waypoints.loiter_radius_m), quad_segs=64)


# --- where a mission ends


def test_a_mission_ends_where_its_circle_is_clear_of_the_ground():
    """Along a narrow valley no circle has room, and the valley is longer than ends that may be simulated."""
    made = begun()
    valley_m = 1_800.0
    posts = posts_over(
        lambda east, north: 80.0 * ((east < valley_m) & (np.abs(north) > 70.0)),
        spacing=25.0, bounds=(-300.0, 3_000.0, -600.0, 600.0),
    )  # fmt: skip
    checker = made.rules.checker
    ground = GroundHeights(posts, height_min_m=50.0, height_max_m=150.0)
    over_ground = Checker(made.rules.obstacles, checker.limits, ground=ground)
    found = construct(replace(made, rules=replace(made.rules, checker=over_ground)), straight(rows=110), 60)
    assert found.violations == ()
    assert found.waypoints.loiter_centre_enu_m[0] > valley_m
    assert construct(made, straight(rows=110), 60).waypoints.loiter_centre_enu_m[0] < 1_200.0


def test_a_mission_covers_three_horizons_and_ends_in_a_circle():
    made = begun()
    found = construct(made, straight(), 30)
    assert found.violations == ()
    assert found.covered_until_s == pytest.approx(45.0)
    waypoints = found.waypoints
    np.testing.assert_allclose(waypoints.positions_enu_m[-1], [1125.0, 0.0, 100.0], atol=1e-9)
    # An ArduPlane widens 117 m to 125 m in standard air at 684 m above the sea, where its density is 0.936 of
    # that at the sea; in hot air to 140 m: so much room it is given.
    assert abs(waypoints.loiter_radius_m) == 117.0
    centre = waypoints.loiter_centre_enu_m[:2]
    assert np.linalg.norm(centre - (1125.0, 0.0)) == pytest.approx(1.12 * 125.0)
    circled = construct(replace(made, flies_by=False), straight(), 30).waypoints
    assert abs(circled.loiter_radius_m) == 125.0
    assert circle_of(circled).exterior.distance(shapely.Point(*circled.positions_enu_m[-1, :2])) < 0.1


def test_the_circle_is_put_where_it_is_clear():
    found = construct(begun(PILLARS), straight(), 30)
    assert found.violations == ()
    assert found.covered_until_s > 45.0
    walls = shapely.union_all([shapely.box(1000, 60, 1250, 300), shapely.box(1000, -300, 1250, -60)])
    assert circle_of(found.waypoints).distance(walls) >= 7.5 - 0.1  # half of clearance_min_m


def test_a_goal_without_room_for_a_circle_is_passed_to_where_there_is():
    """The gorge ends 1200 m east of the start. The goal lies in it; nothing of the operator's is flown."""
    gorge = GORGE.replace("2700", "1200")
    found = construct(begun(gorge), straight(rows=40), 30)
    assert found.violations == ()
    assert found.covered_until_s == 40.0
    assert found.waypoints.positions_enu_m[-1, 0] > 1200.0
    behind_the_wall = replace(begun(gorge), tail_enu_m=(1000.0, 900.0, 80.0))
    with_landing = construct(behind_the_wall, straight(rows=40), 30)
    assert not with_landing.waypoints.continues_with_operator_items
    np.testing.assert_array_equal(with_landing.waypoints.positions_enu_m, found.waypoints.positions_enu_m)


def test_a_path_that_nowhere_has_room_for_a_circle_is_not_flown():
    assert [entry.rule for entry in construct(begun(GORGE), straight(), 30).violations] == ["ending"]


def test_a_path_with_more_waypoints_than_the_bank_holds_is_not_flown():
    """An entry and an end are two waypoints."""
    assert [entry.rule for entry in construct(begun(), straight(), 1).violations] == ["bank"]


@pytest.mark.parametrize("max_waypoints", [9, 17])
def test_a_path_with_more_turns_than_the_list_has_room_for_is_flown_as_far_as_it_fits(max_waypoints):
    """In a team, missions cover six horizons: here 90 s, in which the path turns twelve times."""
    bends = [(125.0, sign * 0.5 * math.pi, 8) for sign in (1, -1) * 6]
    winding = path_along((100.0, 4), *bends, (1000.0, 40), course=EAST)
    whole = construct(begun("team: {members: [1, 2]}"), winding, 60)
    part = construct(begun("team: {members: [1, 2]}"), winding, max_waypoints)
    assert (whole.violations, part.violations) == ((), ())
    assert whole.waypoints.num_items > max_waypoints >= part.waypoints.num_items > max_waypoints - 3
    assert 10.0 < part.covered_until_s < whole.covered_until_s - 10.0


def test_a_path_through_a_wall_is_not_flown():
    wall = begun("obstacles:\n" + BLOCK.format("wall", 900, -300, 950, 300))
    assert {entry.rule for entry in construct_until(wall, straight(), 59).violations} == {"clearance"}
    assert construct_until(wall, straight(), 25).violations == ()


def test_the_mission_is_what_was_decided():
    made = begun()
    waypoints = construct(made, straight(), 30).waypoints
    layout = new_banks((item(0),))
    mission, banks = layout.with_new(layout.items_for(mission_part(waypoints, made.mission.frame)), 7)
    assert mission.plan_number == 7
    assert mission.entry == 1
    assert banks.flown == tuple(replace(entry, sequence=0, is_current=False) for entry in mission.items[1:])
    assert mission.items[-1].command == Command.NAV_LOITER_UNLIM


@BOTH
@pytest.mark.parametrize("north", [0.0, 30.0, 60.0])
def test_beside_the_bounds_the_circle_and_the_turn_into_it_stay_inside(flies_by, north):
    """East along the northern bound, with a wall to the south: the circle has to be moved over the path."""
    walls = "obstacles:\n" + BLOCK.format("wall", -50, -370, 2700, -320)
    made = replace(begun(walls), flies_by=flies_by)
    bounds = (-6000.0, 6000.0, -6000.0, north, *made.rules.checker.limits.bounds[4:])
    limits = replace(made.rules.checker.limits, bounds=bounds)
    made = replace(made, rules=replace(made.rules, checker=Checker(made.rules.obstacles, limits)))
    found = construct(made, straight(), 30)
    assert found.violations == ()
    track = simulated(made, straight(), found.waypoints).positions_enu_m
    assert track[:, 1].max() <= north + BOUNDS_TOLERANCE_M + 2.0
    assert track[:, 1].min() >= -320.0 + 7.5


# --- how waypoints lie in turns


def corner_at(wind=(0.0, 0.0), *, flies_by):
    """A turn past a wall outside of it."""
    wall = BLOCK.format("wall", 692, -400, 740, 50)
    return replace(begun("obstacles:\n" + wall), flies_by=flies_by, wind_enu_m_s=wind), path_along(
        *CORNER, course=EAST
    )


def room_of(made, path, waypoints):
    """How near the track that the autopilot flies over waypoints comes to the wall [m]."""
    track = track_of_legs(
        guidance_of(made), at_start(path, made.wind_enu_m_s), waypoints.positions_enu_m, ends_s=50.0
    )
    return shapely.LineString(track.positions_enu_m[:, :2]).distance(shapely.box(692, -400, 740, 50))


@BOTH
@pytest.mark.parametrize("wind", [(0.0, 0.0), (10.0, 0.0)])
def test_a_turn_flown_too_wide_is_corrected(flies_by, wind, monkeypatch):
    """Beside the same mission without corrections."""
    made, path = corner_at(wind, flies_by=flies_by)
    plain = waypoints_from_path(path, 25.0, flies_by=flies_by)
    found = construct_until(made, path, len(path) - 1)
    assert found.violations == ()
    assert room_of(made, path, found.waypoints) > room_of(made, path, plain) + 2.0
    monkeypatch.setattr(mission_construction, "CORRECTIONS", 0)
    monkeypatch.setattr(mission_construction, "SPACINGS", (1.0,))
    uncorrected = construct_until(made, path, len(path) - 1)
    assert room_of(made, path, found.waypoints) > room_of(made, path, uncorrected.waypoints) + 2.0


@BOTH
@settings(max_examples=30, deadline=None)
@given(
    st.floats(-2.5, 2.5), st.floats(-2.5, 2.5), st.floats(150.0, 400.0),
    st.tuples(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0)),
)  # fmt: skip
def test_the_track_is_never_farther_from_the_path_than_without_corrections(
    flies_by, one, other, between, wind
):
    radius = 180.0
    rows = [max(1, round(radius * abs(turn) / 25.0)) for turn in (one, other)]
    path = path_along(
        (300.0, 12), (radius, one, rows[0]), (between, round(between / 25.0)), (radius, other, rows[1]),
        (400.0, 16), course=EAST,
    )  # fmt: skip
    made = replace(begun(), flies_by=flies_by, wind_enu_m_s=wind)
    found = construct_until(made, path, len(path) - 1)
    plain = replace(
        waypoints_from_path(path, found.waypoints.airspeed_m_s, flies_by=flies_by),
        loiter_centre_enu_m=found.waypoints.loiter_centre_enu_m,
        loiter_radius_m=found.waypoints.loiter_radius_m,
    )
    deviations = []
    for waypoints in (found.waypoints, plain):
        track = simulated(made, path, waypoints).positions_enu_m
        line = shapely.LineString(track[:, :2])
        deviations.append(max(line.distance(shapely.Point(place[:2])) for place in path.positions_enu_m))
    assert found.violations or deviations[0] <= max(deviations[1], 10.0) + 0.1


# --- how fast a mission is flown


def round_a_corner(made):
    """The mission for a path that comes to 37.5 m/s and turns left, and how near it comes to walls [m]."""
    path = path_along((700.0, 28), (170.0, math.radians(-80.0), 9), (600.0, 24), course=EAST)
    path = replace(path, speeds_m_s=np.linspace(25.0, 37.5, len(path)))
    found = construct_until(made, path, len(path) - 1)
    line = shapely.LineString(simulated(made, path, found.waypoints, at_once=True).positions_enu_m[:, :2])
    walls = [shapely.Polygon(wall.polygon_enu_m) for wall in made.rules.obstacles]
    return found, min((wall.distance(line) for wall in walls), default=math.inf)


def test_a_mission_that_flies_wide_is_corrected_or_else_flown_at_cruise(monkeypatch):
    found, _ = round_a_corner(begun())
    assert (found.violations, found.waypoints.airspeed_m_s) == ((), 37.5)
    near = begun("obstacles:\n" + BLOCK.format("tower", 896, 95, 930, 115))
    found, nearest = round_a_corner(near)
    assert (found.violations, found.waypoints.airspeed_m_s) == ((), 37.5)
    assert nearest > near.rules.checker.limits.margin_m
    monkeypatch.setattr(mission_construction, "CORRECTIONS", 0)
    monkeypatch.setattr(mission_construction, "SPACINGS", (1.0,))
    found, _ = round_a_corner(near)
    assert (found.violations, found.waypoints.airspeed_m_s) == ((), 25.0)
    monkeypatch.setattr(mission_construction, "_airspeeds", lambda *_: [37.5])
    found, nearest = round_a_corner(near)
    assert {entry.rule for entry in found.violations} == {"clearance"}
    assert nearest == 0.0


def test_what_is_slowed_down_is_slower_at_the_end():
    """37 m/s and 0.5 m/s² over 600 m: 37² - 600 = 769, 27.7 m/s; over 1,200 m it is at cruise."""
    vehicle = replace(begun().rules.vehicle, acceleration_max_m_s2=0.5)
    path = straight(rows=24)
    fast = replace(path, speeds_m_s=np.full(len(path), 37.0))
    assert airspeed_at_end(fast, vehicle, 25.0) == pytest.approx(math.sqrt(769.0))
    assert airspeed_at_end(fast, vehicle, 37.0) == 37.0
    assert airspeed_at_end(path, vehicle, 25.0) == 25.0


# --- heights over ground


def over_ground(monkeypatch, heights, spacing_m=100.0, look_ahead_m=2000.0):
    """A state of a flight over flat ground, whose autopilot has other heights of the ground stored."""
    text = OPEN.replace("dimension: 2", "dimension: 3")
    section = "terrain: {generated: {kind: hills, relief_m: 0.01}, height_min_m: 50, height_max_m: 100}\n"
    made = begun(section, text)
    east = (-200.0, 2000.0, -500.0, 500.0)
    ground = AutopilotGround(heights, made.mission.frame, east, spacing_m)
    ground = ground.looking(ClimbAhead(look_ahead_m, 2.0))
    monkeypatch.setattr(mission_construction, "followed_ground", lambda state: ground)
    return made, ground


def test_a_mission_over_ground_has_terrain_frames(monkeypatch):
    made, ground = over_ground(monkeypatch, lambda latitude, longitude: 0.0 * latitude + 584.0)
    path = straight()
    path = replace(path, positions_enu_m=path.positions_enu_m - [0.0, 0.0, 25.0])
    found = construct(made, path, 30)
    assert found.violations == ()
    assert found.waypoints.ground is ground


def test_a_mission_that_the_autopilot_would_fly_too_low_over_ground_is_above_the_sea(monkeypatch):
    """The autopilot believes in pits 80 m deep every 100 m, between which no waypoints fit."""

    def pits(latitude, longitude):
        east = (longitude - 149.16523) * 111_195.0 * math.cos(math.radians(35.36))
        return 544.0 + 40.0 * np.cos(2.0 * math.pi * east / 100.0)

    made, _ = over_ground(monkeypatch, pits, spacing_m=25.0, look_ahead_m=0.0)
    path = straight()
    path = replace(path, positions_enu_m=path.positions_enu_m - [0.0, 0.0, 46.0])
    found = construct(made, path, 30)
    assert found.violations == ()
    assert found.waypoints.ground is None
