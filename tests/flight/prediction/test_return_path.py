"""The way that a return to launch takes: where it leads, by hand, and how it is flown, by the simulator."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, Point

from companion.flight.prediction.return_path import return_altitude_m, return_path, return_tracks
from companion.flight.state.flight_state import (
    after_home_reported,
    after_rally_points,
    after_rally_reported,
    after_settings_reported,
)
from companion.mission.operator import Operator
from companion.types.events import Dialect, HomePosition, MissionCurrent
from companion.types.mission import Command, MavFrame, MissionItem
from companion.types.state import AutopilotSettings
from sim.simulator import Simulator
from tests.flight.construction.test_cycle import BLOCK, begun, state
from tests.sim.client import plain_mission
from tests.support.operator_places import home_at, rally_points
from tests.world.vehicle.test_guidance import state_of

BOTH = pytest.mark.parametrize("dialect", list(Dialect), ids=lambda dialect: dialect.value)
ARDUPLANE = AutopilotSettings(
    loiter_radius_m=125.0, return_height_m=100.0, return_radius_m=0.0, return_kind=0.0, rally_limit_km=5.0,
    rally_includes_home=0.0,
)  # fmt: skip
PX4 = AutopilotSettings(loiter_radius_m=125.0, return_height_m=60.0, return_radius_m=80.0, return_kind=0.0)


def made(settings=ARDUPLANE, *, extra="", home=(0.0, 0.0, 0.0), rally=()):
    """A state with home and parameters told."""
    begins = replace(begun(extra), flies_by=settings.rally_limit_km is not None)
    begins = after_settings_reported(begins, settings)
    latitude, longitude, altitude = begins.mission.frame.global_from_local(*home)
    begins = after_home_reported(begins, HomePosition(1.0, latitude, longitude, altitude))
    begins = after_rally_reported(begins, holds_any=bool(rally))
    return after_rally_points(begins, tuple(rally))


def way_of(made_state, here):
    """The likeliest of the ways home."""
    return return_tracks(made_state, here)[0]


def circled(made_state, here, turn_s=37.0):
    """Middle of the circle at the end, and its radius [m]."""
    last = way_of(made_state, here)[-round(2.0 * turn_s) :]
    low, high = last.min(axis=0), last.max(axis=0)
    return 0.5 * (low + high), 0.5 * (high - low)[:2].mean()


HERE = state(east=3000.0, north=0.0, up=100.0)


def test_an_arduplane_returns_to_a_circle_of_its_own_about_home():
    centre, radius = circled(made(), HERE)
    np.testing.assert_allclose(centre, (0.0, 0.0, 100.0), atol=4.0)
    assert 125.0 - 4.0 <= radius <= 1.15 * 125.0  # wider in thin air


def test_the_radius_of_the_circle_is_rtl_radius_where_that_is_given():
    _, radius = circled(made(replace(ARDUPLANE, return_radius_m=300.0)), HERE, 88.0)
    assert 300.0 - 6.0 <= radius <= 1.15 * 300.0


@pytest.mark.parametrize(("airspeed", "flown"), [(18.0, 25.84), (30.0, 30.0)])
def test_a_return_is_flown_at_the_autopilots_cruise_unless_the_aircraft_is_faster(airspeed, flown):
    """By hand: 684 m above the sea the air is 0.9360 times as dense: 25 / 0.9360**0.5 = 25.84 m/s."""
    made_state = made(replace(ARDUPLANE, airspeed_cruise_m_s=25.0))
    assert float(made_state.mission.origin.altitude_amsl_m) == 584.0
    here = replace(HERE, airspeed_m_s=airspeed, ground_speed_m_s=airspeed)
    steps_m = np.linalg.norm(np.diff(way_of(made_state, here)[:, :2], axis=0), axis=1)
    assert np.median(steps_m) / 0.5 == pytest.approx(flown, rel=0.01)


@pytest.mark.parametrize(
    ("settings", "up_m"),
    [
        (ARDUPLANE, 100.0),
        (replace(ARDUPLANE, return_kind=2.0), 100.0),  # There is no landing.
        (replace(ARDUPLANE, return_height_m=-1.0), None),
        (replace(ARDUPLANE, return_height_m=None), None),
        (replace(ARDUPLANE, return_kind=None), None),
        (PX4, 60.0),
        (replace(PX4, return_kind=2.0), None),
    ],
)
def test_the_altitude_of_a_return_counts_from_home(settings, up_m):
    """Home is 10 m above the origin, which is 584 m above the sea."""
    found = return_altitude_m(made(settings, home=(0.0, 0.0, 10.0)), HERE)
    assert found == (None if up_m is None else pytest.approx(584.0 + 10.0 + up_m, abs=0.01))


def test_the_altitude_of_a_return_to_a_rally_point_is_that_of_the_point():
    assert return_altitude_m(made(rally=[(3000.0, 1200.0, 130.0)]), HERE) == pytest.approx(584.0 + 130.0)


@pytest.mark.parametrize(
    ("changes", "rally", "north_m"),
    [
        ({}, [(3000.0, 1200.0, 100.0)], 1200.0),
        ({}, [(3000.0, 1200.0, 100.0), (3000.0, -900.0, 100.0)], -900.0),
        ({"rally_limit_km": 1.0}, [(3000.0, 1200.0, 100.0)], 0.0),
        ({"rally_limit_km": 0.0}, [(3000.0, 5200.0, 100.0)], 5200.0),
        ({}, [(3000.0, 5200.0, 100.0)], 0.0),  # farther than RALLY_LIMIT_KM
        ({"rally_includes_home": 1.0}, [(3000.0, 3500.0, 100.0)], 0.0),
        ({"rally_includes_home": 1.0}, [(3000.0, 2500.0, 100.0)], 2500.0),
        ({}, [(3000.0, 3500.0, 100.0)], 3500.0),
    ],
)
def test_which_rally_point_an_arduplane_returns_to(changes, rally, north_m):
    centre, _ = circled(made(replace(ARDUPLANE, **changes), rally=rally), HERE)
    assert centre[1] == pytest.approx(north_m, abs=4.0)


TOUCHDOWN, BEGINS = (1000.0, 3000.0, 0.0), (1400.0, 3000.0, 60.0)


def with_landing(begins):
    """Of a mission that ends in a circle to lose height in, and a landing."""
    frame = begins.mission.frame
    items = [MissionItem(0, Command.DO_LAND_START, MavFrame.MISSION, (0.0,) * 4, 0, 0, 0.0)]
    for command, place in ((Command.NAV_LOITER_TO_ALT, BEGINS), (Command.NAV_LAND, TOUCHDOWN)):
        latitude, longitude, altitude = frame.global_from_local(*place)
        whole = round(1e7 * latitude), round(1e7 * longitude)
        items.append(MissionItem(len(items), command, MavFrame.GLOBAL, (0.0,) * 4, *whole, altitude))
    listed = replace(begins.mission_list, operator=Operator(tuple(items), 0))
    return replace(begins, mission_list=listed, tail_enu_m=BEGINS)


@pytest.mark.parametrize(
    ("kind", "landing", "north_m", "end"),
    [
        (0.0, True, 2500.0, (0.0, 0.0)),
        (1.0, False, 0.0, (0.0, 0.0)),  # a fixed wing's default
        (1.0, True, 0.0, BEGINS[:2]),
        (3.0, True, -500.0, (0.0, 0.0)),
        (3.0, True, 2500.0, BEGINS[:2]),
    ],
)
def test_where_a_px4_returns_to_by_its_rtl_type(kind, landing, north_m, end):
    begins = made(replace(PX4, return_kind=kind))
    here = state(east=3000.0, north=north_m, up=100.0)
    centre, _ = circled(with_landing(begins) if landing else begins, here, 21.0)
    np.testing.assert_allclose(centre[:2], end, atol=4.0)


def test_a_px4_with_rally_points_may_fly_anywhere():
    assert return_path(made(PX4, rally=[(2000.0, 0.0, 20.0)]), HERE) is None


def test_to_the_landing_the_height_may_be_lost_on_the_way_or_in_the_circle():
    begins = with_landing(made(replace(PX4, return_kind=1.0)))
    heights = sorted({round(float(way[-1, 2])) for way in return_tracks(begins, HERE)})
    assert heights == [60, 100]


def test_an_arduplane_descends_along_the_way_and_climbs_at_once():
    down = way_of(made(), state(east=-3000.0, up=160.0, course=0.5 * np.pi))
    half = down[np.argmax(down[:, 0] >= -1500.0)]
    assert half[2] == pytest.approx(130.0, abs=1.0)
    up = way_of(made(), state(east=-3000.0, up=60.0, course=0.5 * np.pi))
    climbed_m = up[np.argmax(up[:, 2] >= 99.0), 0] + 3000.0
    assert climbed_m < 40.0 / np.tan(np.radians(6.0))  # the vehicle's climb, not the way's length


@pytest.mark.parametrize(("slope_min_m", "half_m"), [(15.0, 130.0), (61.0, 100.0), (0.0, 100.0)])
def test_a_descent_that_is_no_slope_is_made_at_once(slope_min_m, half_m):
    down = way_of(
        made(replace(ARDUPLANE, slope_min_m=slope_min_m)), state(east=-3000.0, up=160.0, course=0.5 * np.pi)
    )
    assert down[np.argmax(down[:, 0] >= -1500.0), 2] == pytest.approx(half_m, abs=1.0)


CLIMB_FIRST = 1 << 4


@pytest.mark.parametrize(
    ("changes", "from_m", "climbed_m"),
    [
        ({"return_climb_m": 20.0}, 100.0, 120.0),  # also from the height of the return
        ({"return_climb_m": 20.0}, 160.0, 180.0),
        ({"return_climb_m": 0.0}, 60.0, None),
        ({"flight_options": CLIMB_FIRST}, 60.0, 100.0),
        ({"flight_options": CLIMB_FIRST, "return_climb_m": 20.0}, 60.0, 100.0),
        ({"flight_options": CLIMB_FIRST}, 120.0, None),
        ({"flight_options": CLIMB_FIRST - 1}, 60.0, None),
    ],
)
def test_an_arduplane_may_climb_before_it_turns(changes, from_m, climbed_m):
    """Eastwards, away from home: at 5 degrees of bank, 26.7 m/s turn by 1.8 degrees a second."""
    track = way_of(made(replace(ARDUPLANE, **changes)), state(east=3000.0, up=from_m, course=0.5 * np.pi))
    turned = np.flatnonzero(np.diff(track[:, 0]) < 0.0)[0]
    if climbed_m is None:
        assert turned < 2.0 * 15.0  # At 125 m of radius a quarter of a turn takes 8 s.
        return
    before = track[: np.argmax(track[:, 2] > climbed_m)]
    steps = np.diff(before[:, :2], axis=0)
    turned_deg = np.degrees(np.abs(np.diff(np.unwrap(np.arctan2(steps[:, 0], steps[:, 1]))))) / 0.5
    assert len(before) > 8
    assert turned_deg.max() < 2.2
    assert turned > len(before)


@pytest.mark.parametrize(("level_bank_deg", "bank_deg"), [(None, 5.0), (12.0, 12.0), (0.0, 1.0)])
def test_the_bank_of_the_first_climb_is_the_autopilots(level_bank_deg, bank_deg):
    """At 25 m/s; a limit of 0 is simulated with 1 degree."""
    settings = replace(ARDUPLANE, return_climb_m=60.0, level_bank_deg=level_bank_deg)
    track = way_of(made(settings), state(east=3000.0, up=100.0, course=0.5 * np.pi))
    steps = np.diff(track[6:24, :2], axis=0)
    turned = np.abs(np.diff(np.unwrap(np.arctan2(steps[:, 0], steps[:, 1])))) / 0.5
    assert np.median(turned) == pytest.approx(9.80665 * np.tan(np.radians(bank_deg)) / 25.0, rel=0.02)


def test_an_arduplane_that_climbs_first_may_hit_what_it_would_else_turn_away_from():
    wall = "obstacles:\n" + BLOCK.format("barn", 3150, -40, 3250, 40)
    here = state(east=3000.0, up=100.0, course=0.5 * np.pi)
    assert not return_path(made(extra=wall), here)
    wrong = return_path(made(replace(ARDUPLANE, return_climb_m=20.0), extra=wall), here)
    assert "barn" in wrong[0].detail


@pytest.mark.parametrize(
    ("up_m", "climb_m", "options"), [(150.0, 20.0, 0), (60.0, 20.0, 0), (150.0, 0.0, CLIMB_FIRST)]
)
def test_the_simulated_arduplane_climbs_first_as_foreseen(up_m, climb_m, options):
    simulator = Simulator(plain_mission(), seed=1)
    simulator.step(20.0)
    harness = SimpleNamespace(simulator=simulator, flight=SimpleNamespace(dialect=Dialect.ARDUPILOT))
    home_at(harness, -1500.0, -600.0)
    parameters = simulator.autopilot.parameters
    parameters["RTL_ALTITUDE"], parameters["RTL_CLIMB_MIN"] = up_m, climb_m
    parameters["FLIGHT_OPTIONS"] = options
    settings = replace(
        ARDUPLANE, return_height_m=up_m, return_climb_m=climb_m, flight_options=float(options),
        return_radius_m=parameters["RTL_RADIUS"],
    )  # fmt: skip
    foreseen = return_tracks(made(settings, home=(-1500.0, -600.0, 0.0)), state_of(simulator))
    simulator.set_mode("RTL")
    flown = []
    for _ in range(80):
        estimate = simulator.autopilot.flight.estimate
        flown.append((estimate.east_m, estimate.north_m, estimate.up_m))
        simulator.step(0.5)
    off = [[LineString(way).distance(Point(row)) for row in flown] for way in foreseen]
    assert min(max(row) for row in off) < 40.0


def test_a_height_that_is_kept():
    track = way_of(made(replace(ARDUPLANE, return_height_m=-1.0)), state(east=3000.0, up=140.0))
    np.testing.assert_allclose(track[:, 2], 140.0)


def test_a_px4_climbs_in_a_circle_before_it_leaves():
    here = state(east=3000.0, up=20.0)
    track = way_of(made(PX4), here)
    below = track[track[:, 2] < 60.0 - 5.0]
    assert len(below) > 10
    assert np.linalg.norm(below[:, :2] - (3000.0, 0.0), axis=1).max() < 300.0
    centre, _ = circled(made(PX4), here)
    assert centre[2] == pytest.approx(60.0, abs=1.0)
    assert circled(made(PX4), state(east=3000.0, up=150.0))[0][2] == pytest.approx(150.0)  # never descends


@pytest.mark.parametrize(
    "settings",
    [
        replace(ARDUPLANE, return_height_m=None), replace(ARDUPLANE, return_kind=None),
        replace(ARDUPLANE, return_kind=5.0), replace(PX4, return_kind=2.0), replace(PX4, return_kind=4.0),
        replace(PX4, return_kind=5.0), replace(ARDUPLANE, terrain_follow=1.0),
        replace(ARDUPLANE, terrain_follow=16.0),
    ],
)  # fmt: skip
def test_what_is_not_foreseen_is_not_known(settings):
    assert return_path(made(settings), HERE) is None


def test_only_a_straight_return_follows_the_ground():
    assert return_path(made(replace(ARDUPLANE, terrain_follow=2.0 + 4.0 + 8.0)), HERE) == ()
    assert return_path(made(replace(ARDUPLANE, return_kind=2.0, terrain_follow=1.0)), HERE) == ()


def test_rally_points_that_were_told_of_and_not_read_may_be_anywhere():
    assert return_path(after_rally_reported(made(), holds_any=True), HERE) is None


def test_without_a_home_it_is_not_known():
    assert return_path(replace(made(), home_enu_m=None), HERE) is None


def test_with_rtl_autoland_2_it_leads_to_the_landing_sequence():
    begins = replace(made(replace(ARDUPLANE, return_kind=2.0)), tail_enu_m=(1000.0, 2000.0, 80.0))
    centre, _ = circled(begins, HERE)
    np.testing.assert_allclose(centre[:2], (1000.0, 2000.0), atol=4.0)


def test_with_rtl_type_2_it_ends_in_the_circle_in_which_height_is_lost():
    begins = with_landing(made(replace(PX4, return_kind=2.0)))
    listed = replace(begins.mission_list, stored=begins.mission_list.operator.items)
    begins = replace(begins, mission_list=listed)
    track = return_tracks(begins, HERE, MissionCurrent(1.0, 0, 3, 0))[0]
    away = np.linalg.norm(track[-60:, :2] - BEGINS[:2], axis=1)  # Half a minute of it.
    radius = begins.rules.vehicle.turn_radius_min_m
    np.testing.assert_allclose(away, radius, atol=0.15 * radius)
    assert track[-1][2] == pytest.approx(BEGINS[2], abs=1.0)


def test_what_the_way_breaks_is_told():
    wall = "obstacles:\n" + BLOCK.format("barn", 1400, -200, 1450, 200)
    wrong = return_path(made(extra=wall), HERE)
    assert wrong[0].rule == "clearance"
    assert "barn" in wrong[0].detail
    assert return_path(made(), HERE) == ()


@given(
    east=st.floats(-4000.0, 4000.0), north=st.floats(-4000.0, 4000.0), up=st.floats(60.0, 160.0),
    course=st.floats(0.0, 6.28), is_px4=st.booleans(),
)  # fmt: skip
def test_every_way_begins_here_and_ends_in_the_circle(east, north, up, course, is_px4):
    settings = PX4 if is_px4 else ARDUPLANE
    track = way_of(made(settings), state(east=east, north=north, up=up, course=course))
    np.testing.assert_allclose(track[0], (east, north, up))
    assert np.isfinite(track).all()
    steps = np.linalg.norm(np.diff(track[:, :2], axis=0), axis=1)
    assert steps.max() < 25.0 * 0.5 + 0.1
    assert np.linalg.norm(track[-20:, :2], axis=1).max() < 1.15 * 125.0 + 30.0


@pytest.mark.parametrize(
    ("dialect", "place"), [(Dialect.ARDUPILOT, "home"), (Dialect.ARDUPILOT, "rally"), (Dialect.PX4, "home")]
)
def test_the_simulated_autopilots_fly_the_way_that_was_foreseen(dialect, place):
    simulator = Simulator(plain_mission(), seed=1, dialect=dialect)
    simulator.step(20.0)
    autopilot, is_plane = simulator.autopilot, dialect is Dialect.ARDUPILOT
    harness = SimpleNamespace(simulator=simulator, flight=SimpleNamespace(dialect=dialect))
    home_at(harness, -1500.0, -600.0)
    autopilot.parameters["RTL_ALTITUDE" if is_plane else "RTL_RETURN_ALT"] = 120.0
    settings = replace(
        ARDUPLANE if is_plane else PX4, return_height_m=120.0,
        return_radius_m=autopilot.parameters["RTL_RADIUS" if is_plane else "RTL_LOITER_RAD"],
    )  # fmt: skip
    begins = replace(made(settings, home=(-1500.0, -600.0, 0.0)), flies_by=dialect.flies_by)
    if place == "rally":
        rally_points(harness, (900.0, 400.0, 120.0))
        begins = after_rally_points(begins, ((900.0, 400.0, 120.0),))
    foreseen = return_tracks(begins, state_of(simulator))
    simulator.set_mode("RTL")
    flown = []
    for _ in range(max(len(way) for way in foreseen)):
        estimate = autopilot.flight.estimate
        flown.append((estimate.east_m, estimate.north_m))
        simulator.step(0.5)
    end = (-1500.0, -600.0) if place == "home" else (900.0, 400.0)
    assert np.linalg.norm(np.array(flown[-20:]) - end, axis=1).max() < 1.15 * 125.0 + 30.0
    lines = [LineString(way[:, :2]) for way in foreseen]
    off = [[line.distance(Point(row)) for row in flown] for line in lines]
    assert min(np.percentile(row, 95) for row in off) < 15.0
    assert min(max(row) for row in off) < 30.0
