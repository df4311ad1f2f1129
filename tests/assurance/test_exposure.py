"""The check's own count of threats: by hand, beside the planner's, and against a planner that tells none."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csgraph
from shapely.geometry import LineString

from companion.assurance.checker import Checker
from companion.assurance.exposure import Exposure, ExposureModel, shortest_lengths
from companion.assurance.surroundings.sight_lines import SightLines
from companion.config.compose import exposure_of, vehicle_of, world_of
from companion.config.rules import rules_of
from companion.kernels.printed.reachability import dt_positions
from companion.kernels.workspace import workspace
from companion.planning.problem import Problem, StartState, initial_covariances
from companion.planning.solver import solve
from companion.types.threat import Radar, ThreatPicture, TrackState
from companion.world.pursuer_trees import threat_trees
from tests.support.paths import BOUNDS, box, check_limits, path_of
from tests.support.worlds import packed
from tests.torture.harness import NARROW

PLANE = ExposureModel(airspeed_min_m_s=12.5, airspeed_max_m_s=37.5, penetration_speed_m_s=30.0)
CERTAIN = 1.0 - 1.0 / 1.7  # CF of one threat: 1 − 1/(1 + 0.7)
HERE = path_of([0.0, 1.0], [(0.0, 0.0, 100.0), (0.0, 25.0, 100.0)], [0.0, 0.0])


def radar(east, north, up=0.0, radius=1000.0, boundary=0.0):
    return Radar("radar", (east, north, up), radius, boundary)


def track(east, north, *, speed=20.0, reach=250.0, std=0.0, airborne=False, stamp_s=0.0):
    return TrackState(
        stamp_s, "t", (east, north, 0.0), (0.0, 0.0, 0.0), std**2 * np.eye(4), speed, reach, 15.0, airborne,
        stamp_s,
    )  # fmt: skip


def levels(path, radars=(), tracks=(), walls=(), model=PLANE):
    return Exposure(walls, BOUNDS, model).levels(path, ThreatPicture(tuple(radars), tuple(tracks)))


def test_one_radar_by_hand():
    # 600 of 1000 m away: exp(−0.6⁴) = 0.87845, at 25 m/s there is no non-membership.
    assert levels(HERE, [radar(600.0, 0.0)])[0] == pytest.approx(CERTAIN * math.exp(-(0.6**4)))
    assert levels(HERE, [radar(1000.5, 0.0)])[0] == 0.0
    fast = replace(HERE, speeds_m_s=np.full(2, 37.5))  # sin(90°)·sin²(45°) = 0.5 across
    assert levels(fast, [radar(600.0, 0.0)])[0] == pytest.approx(CERTAIN * (math.exp(-(0.6**4)) - 0.5))


def test_two_radars_by_hand():
    # CF = 1 − 1/2.4; raised: 1 − (1 − a)(1 − b); IFWA of both with 1/2 each.
    certain = 1.0 - 1.0 / 2.4
    a, b = certain * math.exp(-(0.3**4)), certain * math.exp(-(0.6**4))
    free = 1.0 - a, (1.0 - a) * (1.0 - b)
    expected = 1.0 - math.sqrt(free[0] * free[1])
    assert levels(HERE, [radar(600.0, 0.0), radar(0.0, -300.0)])[0] == pytest.approx(expected)


def test_below_the_boundary_and_behind_a_wall_nothing_is_seen():
    space = replace(PLANE, is_plane=False)
    # 100 m above the radar at 400 m: below 0.001·400² = 160 m, above 0.0005·400² = 80 m.
    assert levels(HERE, [radar(400.0, 0.0, boundary=1e-3)], model=space)[0] == 0.0
    assert levels(HERE, [radar(400.0, 0.0, boundary=5e-4)], model=space)[0] > 0.3
    # The line from 0 m at 400 m away to 100 m passes 200 m out at 50 m.
    for top, is_seen in ((45.0, True), (60.0, False)):
        wall = box("wall", 199.0, -50.0, 201.0, 50.0, top=top)
        assert bool(levels(HERE, [radar(400.0, 0.0)], walls=[wall], model=space)[0]) is is_seen
    floating = box("bridge", 199.0, -50.0, 201.0, 50.0, base=40.0, top=60.0)
    assert levels(HERE, [radar(400.0, 0.0)], walls=[floating], model=space)[0] > 0.0


def test_what_a_moving_threat_can_be_by_then_by_hand():
    # It drives 20 m/s for 10 s; 450 m away it comes to 250 m, and not when it was sighted 0.2 s later.
    path = path_of([10.0, 11.0], [(0.0, 0.0, 100.0), (0.0, 1.0, 100.0)], [0.0, 0.0])
    at_reach = CERTAIN * math.exp(-1.0)
    assert levels(path, tracks=[track(449.9, 0.0)])[0] == pytest.approx(at_reach, rel=1e-2)
    assert levels(path, tracks=[track(449.9, 0.0, stamp_s=0.2)])[0] == 0.0
    assert levels(path, tracks=[track(500.0, 0.0)])[0] == 0.0
    assert levels(path, tracks=[track(500.0, 0.0, std=30.0)])[0] > 0.0  # twice 30 m nearer
    assert levels(path, tracks=[track(150.0, 0.0)])[0] == pytest.approx(CERTAIN)  # it is below by then
    assert levels(path, tracks=[track(260.0, 0.0, speed=0.0)])[0] == 0.0  # parked
    # A wall to which it does not drive does not delay it.
    aside = [box("aside", 2000.0, 2000.0, 2010.0, 2010.0)]
    assert levels(path, tracks=[track(449.9, 0.0)], walls=aside)[0] == pytest.approx(at_reach, rel=1e-2)
    wall = [box("wall", 300.0, -100.0, 310.0, 100.0)]
    # Round the wall's end it is 2·√(145² + 101²)-odd metres: it does not come into sight by then.
    assert levels(path, tracks=[track(449.9, 0.0)], walls=wall)[0] == 0.0
    assert levels(path, tracks=[track(449.9, 0.0, airborne=True)], walls=wall)[0] > 0.0
    later = replace(path, times_s=path.times_s + 20.0)
    assert levels(later, tracks=[track(449.9, 0.0)], walls=wall)[0] > at_reach


def test_between_rows_far_apart_it_is_looked_at_too():
    path = path_of([0.0, 80.0], [(-1000.0, 0.0, 100.0), (1000.0, 0.0, 100.0)], [1.57, 1.57])
    found = levels(path, [radar(0.0, 0.0, radius=300.0)])
    assert found[0] == 0.0
    assert found[1] == pytest.approx(CERTAIN, rel=1e-3)


def test_sight_lines_agree_with_shapely_in_the_plane():
    random = np.random.default_rng(5)
    walls = [box(f"w{k}", *place, *(place + random.uniform(20.0, 200.0, 2))) for k, place in
             enumerate(random.uniform(-500.0, 500.0, (12, 2)))]  # fmt: skip
    eyes, places = random.uniform(-600.0, 600.0, (2, 400, 3))
    eyes[:, 2] = places[:, 2] = 100.0
    free = SightLines(walls).is_free(eyes, places)
    polygons = SightLines(walls).grounded
    expected = [
        not any(LineString([a[:2], b[:2]]).intersection(p).length > 1e-5 for p in polygons)
        for a, b in zip(eyes, places, strict=True)
    ]
    assert free.tolist() == expected
    assert SightLines(walls).is_drivable(eyes, places).tolist() == expected


def planned(world, seed, **changes):
    """A path through a map with all its radars known and its pursuer tracked, and the picture of it."""
    mission = NARROW[world]
    rules = rules_of(mission)
    settings = replace(rules.settings, **changes)
    threats = [track(t.east_m, t.north_m, speed=t.speed_m_s, reach=t.max_threat_radius_m, std=1.0)
               for t in mission.dynamic_threats]  # fmt: skip
    snapshot = world_of(mission, none_known=False).with_tracks(0.0, threats)
    start = mission.start
    begin = StartState(
        0.0, (start.east_m, start.north_m, start.up_m), math.radians(90.0 - start.course_deg), 0.0, 25.0,
        initial_covariances(rules.vehicle, 2.0, 2.0), np.zeros((6, 6)),
    )  # fmt: skip
    problem = Problem(begin, rules.goals, snapshot, vehicle_of(mission), settings, seed)
    return mission, solve(problem).path, snapshot.picture


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("world", NARROW)
def test_the_planner_and_the_check_count_radars_alike(world, seed):
    mission, path, picture = planned(world, seed, price_seen=0.0)
    alone = replace(picture, tracks=())
    own = exposure_of(mission).levels(path, alone)
    others = exposure_of(mission).levels(path, picture)
    assert (others >= own - 1e-12).all()
    assert 0.25 < own.max() < 0.7
    # The planner takes the place for uncertain and shadows for smaller by a cell: it counts more, but on the
    # very edge of a shadow, where half of its particles are in it: there the row beside it tells.
    beside = np.pad(path.threat_levels, 1)
    assert (own <= np.maximum(np.maximum(beside[:-2], beside[1:-1]), beside[2:]) + 0.03).all()


@pytest.mark.parametrize("threat", ["radar", "track"])
def test_a_planner_that_tells_of_no_threat_gets_nothing_past_the_check(threat):
    mission, path, picture = planned("paper-2d", 2)
    picture = replace(picture, **({"tracks": ()} if threat == "radar" else {"radars": ()}))
    blind = replace(path, threat_levels=np.zeros(len(path)))
    limits = check_limits(threat_level_max=0.2, margin_m=5.0, bounds=(0.0, 2500.0, 0.0, 2500.0, 60.0, 160.0))
    believing = Checker(mission.obstacle_list, limits)
    checker = Checker(mission.obstacle_list, limits, exposure_of(mission))
    assert believing.check_path(blind) == ()
    assert {entry.rule for entry in checker.check_path(blind, picture=picture)} == {"threat"}
    assert checker.check_path(blind, picture=ThreatPicture()) == ()
    lax = Checker(mission.obstacle_list, replace(limits, threat_level_max=0.8), exposure_of(mission))
    assert lax.check_path(blind, picture=picture) == ()


def test_numbers_that_are_none_are_reported_and_break_nothing():
    broken = replace(HERE, positions_enu_m=np.full((2, 3), np.nan))
    checker = Checker([], check_limits(threat_level_max=0.2), Exposure([], BOUNDS, PLANE))
    assert {
        entry.rule for entry in checker.check_path(broken, picture=ThreatPicture((radar(0.0, 0.0),)))
    } == {"finite"}


def test_an_aircraft_that_flies_on_by_hand():
    # It is 2000 m north and flies south at 50 m/s: after 30 s 500 m are left, less what is not known.
    passing = replace(
        track(0.0, 2_000.0, reach=610.0, airborne=True), velocity_enu_m_s=(0.0, -50.0, 0.0), flies_on=True,
        position_enu_m=(0.0, 2_000.0, 100.0),
    )  # fmt: skip
    path = path_of([30.0, 31.0], [(0.0, 0.0, 100.0), (0.0, 1.0, 100.0)], [0.0, 0.0])
    assert levels(path, tracks=[passing])[0] == pytest.approx(CERTAIN * math.exp(-((500.0 / 610.0) ** 4)))
    unsure = replace(passing, covariance=np.diag([30.0**2, 1.0, 30.0**2, 1.0]))  # √(30² + 30²) = 42 m
    nearer = (500.0 - math.hypot(30.0, 30.0)) / 610.0
    assert levels(path, tracks=[unsure])[0] == pytest.approx(CERTAIN * math.exp(-(nearer**4)))
    assert levels(replace(path, times_s=path.times_s - 10.0), tracks=[passing])[0] == 0.0
    above = replace(passing, position_enu_m=(0.0, 2_000.0, 180.0))
    assert levels(path, tracks=[above])[0] == 0.0
    sinking = replace(above, velocity_enu_m_s=(0.0, -50.0, -1.0))
    assert levels(path, tracks=[sinking])[0] > 0.0


@pytest.mark.parametrize("seed", range(4))
def test_the_planner_foresees_what_flies_on_as_the_check_does(seed):
    random = np.random.default_rng(seed)
    tracks = [
        replace(
            track(*random.uniform(-2_000.0, 2_000.0, 2), reach=610.0, airborne=True), flies_on=True,
            velocity_enu_m_s=(*random.uniform(-60.0, 60.0, 2), 0.0), covariance=np.diag([9.0, 1.0, 9.0, 1.0]),
            identity=f"icao:{k}", turn_rate_rad_s=0.05 * (k - 1),
        )
        for k in range(3)
    ]  # fmt: skip
    bounds = (-3_000.0, 3_000.0, -3_000.0, 3_000.0, 0.0, 300.0)
    trees, walls = threat_trees(tracks, packed([], bounds), None, bounds), packed([], bounds)
    scratch = workspace(100, len(tracks), 1).growth.reach
    for _ in range(200):
        place, at = random.uniform(-1_500.0, 1_500.0, 2), float(random.uniform(0.0, 60.0))
        points = np.zeros((3, 4))
        dt_positions(trees, *place, 0.0, at, 3, walls, points, scratch)
        path = path_of([at, at + 1.0], [(*place, 0.0), (*place + 1e-3, 0.0)], [0.0, 0.0])
        for point, one in zip(points, tracks, strict=True):
            found = levels(path, tracks=[one])[0]
            away = np.hypot(*(point[:2] - place))
            expected = CERTAIN * math.exp(-((away / 610.0) ** 4)) if point[3] > 0.0 else 0.0
            assert found == pytest.approx(expected, abs=2e-3)


def test_shortest_lengths_agree_with_scipy():
    random = np.random.default_rng(4)
    lengths = np.triu(random.uniform(1.0, 100.0, (40, 40)), 1)
    lengths[random.random((40, 40)) < 0.9] = 0.0
    lengths += lengths.T
    expected = csgraph.dijkstra(lengths, directed=False)
    assert np.isinf(expected).any()
    assert shortest_lengths(np.where(lengths > 0.0, lengths, np.inf)) == pytest.approx(expected)
