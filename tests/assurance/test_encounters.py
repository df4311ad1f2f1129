"""Distances, time in reach and in sight, and levels: by hand, and beside plain sampling of the paths."""

import itertools
import math

import numpy as np
import pytest
import shapely

from companion.assurance.encounters import (
    GAP_S,
    THREATS_MAX,
    Masks,
    ThreatHistory,
    aggregated_threat,
    encounter_with,
    known_encounters,
    merged_intervals,
    radar_threats,
    total_duration_s,
    total_threat,
)
from companion.types.encounter import Encounter
from companion.types.threat import Obstacle, Radar

OPEN = Masks(())


def prism(corners, base_m=0.0, top_m=100.0):
    return Obstacle("wall", np.array(corners, dtype=float), base_m, top_m)


def rows_of(times, east, north, up):
    return np.column_stack(np.broadcast_arrays(times, east, north, up)).astype(float)


def stands(place, times, reach_m=50.0):
    return ThreatHistory("dt", reach_m, rows_of(times, *place))


def with_levels(name, levels):
    nothing = np.empty((0, 2))
    return Encounter(name, 1.0, True, np.empty(0), np.empty(0), np.array(levels), nothing, nothing, None)


@pytest.mark.parametrize("step_s", [1.0, 0.7, 5.0])
@pytest.mark.parametrize("place", [(50.0, 30.0, 0.0), (50.0, 0.0, 30.0), (50.0, 18.0, 24.0)])
def test_a_straight_flight_past_a_standing_threat_by_hand(place, step_s):
    """East at 10 m/s, 30 m beside, below or both: half the chord of a circle of 50 m is 40 m."""
    times = np.append(np.arange(0.0, 10.0, step_s), 10.0)
    found = encounter_with(stands(place, [0.0, 5.0, 10.0]), rows_of(times, 10.0 * times, 0.0, 0.0), OPEN)
    np.testing.assert_allclose(found.in_reach_s, [[1.0, 9.0]])
    np.testing.assert_allclose(found.in_sight_s, [[1.0, 9.0]])
    assert total_duration_s(found.in_reach_s) == pytest.approx(8.0)
    assert found.closest.stamp_s == pytest.approx(5.0)
    assert found.closest.distance_m == pytest.approx(30.0)
    assert found.closest.own_enu_m == pytest.approx((50.0, 0.0, 0.0))
    assert found.closest.other_enu_m == place


def test_both_move_and_are_told_of_at_different_times():
    """Head-on at 30 m/s together, 40 m beside each other: 60 m of way within 50 m, met at 5 s."""
    own, other = np.array([0.0, 3.3, 6.6, 10.0]), np.array([0.0, 4.1, 8.2, 10.0])
    threat = ThreatHistory("dt", 50.0, rows_of(other, 300.0 - 20.0 * other, 40.0, 0.0))
    found = encounter_with(threat, rows_of(own, 10.0 * own + 150.0, 0.0, 0.0), OPEN)
    np.testing.assert_allclose(found.in_reach_s, [[4.0, 6.0]])
    assert (found.closest.stamp_s, found.closest.distance_m) == pytest.approx((5.0, 40.0))


def test_the_same_way_and_speed_is_in_reach_all_the_time_or_never():
    times = np.arange(4.0)
    own = rows_of(times, 10.0 * times, 0.0, 0.0)
    beside = [ThreatHistory("dt", 50.0, rows_of(times, 10.0 * times, north, 0.0)) for north in (50.0, 51.0)]
    assert [total_duration_s(encounter_with(dt, own, OPEN).in_reach_s) for dt in beside] == [3.0, 0.0]


# The threat stands at the origin, the aircraft passes 100 m to the east at 50 m up, from 50 m south to 50 m
# north in 10 s. The wall stands between, 40 to 60 m east, from north = 0 on: the line to the northern half
# of the flight is 20 m up where it comes to the wall, and 30 m up where it leaves it.
@pytest.mark.parametrize(
    ("base_m", "top_m", "is_masked"),
    [
        (0.0, 100.0, True), (0.0, 25.0, True), (0.0, 19.0, False), (0.0, 20.0, False),
        (31.0, 100.0, False), (30.0, 100.0, False), (28.0, 100.0, True), (24.0, 25.0, True),
    ],
)  # fmt: skip
def test_a_wall_masks_where_the_line_is_between_base_and_top(base_m, top_m, is_masked):
    times = np.arange(0.0, 10.05, 0.1)
    wall = prism([(40, 0), (60, 0), (60, 200), (40, 200)], base_m, top_m)
    flown = rows_of(times, 100.0, 10.0 * times - 50.0, 50.0)
    found = encounter_with(stands((0.0, 0.0, 0.0), times, 500.0), flown, Masks([wall]))
    assert total_duration_s(found.in_reach_s) == pytest.approx(10.0)
    assert total_duration_s(found.in_sight_s) == pytest.approx(5.0 if is_masked else 10.0)
    assert found.in_sight_s[0, 0] == 0.0


def test_along_a_side_over_an_edge_and_straight_up():
    wall = prism([(0, 0), (10, 0), (10, 10), (0, 10)], 0.0, 20.0)
    lines = {
        ((-5, 0, 5), (15, 0, 5)): True,  # along its side
        ((-5, 5, 20), (15, 5, 20)): True,  # along its roof
        ((-5, 5, 19.9), (15, 5, 19.9)): False,
        ((-5, 5, 5), (15, 5, 5)): False,
        ((-5, 5, 0), (15, 5, 0)): False,  # on the ground it stands on
        ((5, 5, 25), (5, 5, 90)): True,
        ((5, 5, 15), (5, 5, 90)): False,  # straight up from inside
        ((20, 5, 0), (20, 5, 90)): True,
        ((-10, 10, 5), (10, -10, 5)): True,  # past its corner
    }
    eyes, places = (np.array(ends, dtype=float) for ends in zip(*lines, strict=True))
    assert Masks([wall]).is_free(eyes, places).tolist() == list(lines.values())


def random_world(rng, grow_m=0.0):
    """Prisms of any shape, and the same grown or shrunk."""
    world = []
    for _ in range(12):
        middle, size = rng.uniform(-200.0, 200.0, 2), rng.uniform(20.0, 90.0)
        angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, rng.integers(3, 8)))
        polygon = shapely.Polygon(middle + size * np.column_stack([np.cos(angles), np.sin(angles)]))
        base = rng.choice([0.0, 40.0])
        world.append((polygon, base, base + rng.uniform(20.0, 90.0)))
    return world, [(shape.buffer(grow_m), base - grow_m, top + grow_m) for shape, base, top in world]


def is_met(world, eye, place):
    """Whether any of many points on a line lies in a prism."""
    points = eye + np.linspace(0.0, 1.0, 1201)[:, None] * (place - eye)
    flat = shapely.points(points[:, :2])
    return any(
        (shapely.contains(shape, flat) & (points[:, 2] > base) & (points[:, 2] < top)).any()
        for shape, base, top in world
        if not shape.is_empty
    )


@pytest.mark.parametrize("seed", range(4))
def test_sight_agrees_with_points_on_the_line(seed):
    """What meets the shrunk prisms is hidden, and what misses the grown ones is seen."""
    shrunk = random_world(np.random.default_rng(seed), -0.3)
    grown = random_world(np.random.default_rng(seed), 0.3)
    rng = np.random.default_rng(100 + seed)
    eyes = np.column_stack([rng.uniform(-250.0, 250.0, (60, 2)), rng.choice([0.0, 5.0], 60)])
    places = np.column_stack([rng.uniform(-250.0, 250.0, (60, 2)), rng.uniform(0.0, 200.0, 60)])
    solid = [prism(shapely.get_coordinates(shape)[:-1], base, top) for shape, base, top in shrunk[0]]
    free = Masks(solid).is_free(eyes, places)
    assert 5 < free.sum() < 55
    for is_free, eye, place in zip(free, eyes, places, strict=True):
        if is_free:
            assert not is_met(shrunk[1], eye, place)
        else:
            assert is_met(grown[1], eye, place)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.thorough
def test_time_in_reach_and_in_sight_agrees_with_fine_sampling(seed):
    rng = np.random.default_rng(seed)
    world, _ = random_world(rng)
    times = np.arange(0.0, 60.05, 0.1)
    own = rows_of(times, 8.0 * times - 240.0 + 60.0 * np.sin(times / 5.0), 90.0 * np.sin(times / 9.0), 60.0)
    other = rows_of(times, 40.0 * np.cos(times / 7.0), 60.0 - 3.0 * times, 0.0)
    masks = Masks([prism(shapely.get_coordinates(shape)[:-1], base, top) for shape, base, top in world])
    found = encounter_with(ThreatHistory("dt", 160.0, other), own, masks)
    fine = np.arange(0.0, 60.0, 0.05) + 0.025
    here, there = (
        np.column_stack([np.interp(fine, times, column) for column in rows.T[1:]]) for rows in (own, other)
    )
    away = np.linalg.norm(here - there, axis=1)
    is_near = away <= 160.0
    ends = zip(is_near, there, here, strict=True)
    is_seen = np.array([near and not is_met(world, eye, place) for near, eye, place in ends])
    assert total_duration_s(found.in_reach_s) == pytest.approx(0.05 * is_near.sum(), abs=0.05 * 2)
    edges = np.count_nonzero(np.diff(is_seen)) + 2
    assert total_duration_s(found.in_sight_s) == pytest.approx(0.05 * is_seen.sum(), abs=0.08 * edges)
    assert found.in_sight_s[0, 0] == pytest.approx(fine[np.argmax(is_seen)], abs=0.12)
    assert found.closest.distance_m == pytest.approx(away.min(), abs=0.3)
    assert found.closest.distance_m <= away.min() + 1e-9


def test_the_sum_and_the_mean_of_levels_by_hand():
    """Three seconds at half the reach: four waypoints and thirty points between, μ = exp(−1/16) at each."""
    times = np.array([0.0, 1.5, 3.2])
    found = encounter_with(stands((0.0, 0.0, 0.0), times), rows_of(times, 15.0, 16.0, 12.0), OPEN)
    assert np.linalg.norm((15.0, 16.0, 12.0)) == 25.0
    assert total_threat([found]) == pytest.approx(34 * math.exp(-1 / 16))
    assert aggregated_threat([found]) == pytest.approx(math.exp(-1 / 16))


def test_the_mean_is_of_waypoints_alone():
    """At the edge of its reach at 0 s, μ = 1/e, and outside at 1 s."""
    times = np.array([0.0, 1.0])
    found = encounter_with(stands((0.0, 0.0, 0.0), times), rows_of(times, [50.0, 80.0], 0.0, 0.0), OPEN)
    assert found.levels[0] == pytest.approx(math.exp(-1.0))
    assert total_threat([found]) == pytest.approx(math.exp(-1.0))
    assert aggregated_threat([found]) == pytest.approx(1.0 - math.sqrt(1.0 - math.exp(-1.0)))


def test_what_is_hidden_is_no_threat():
    times = np.array([0.0, 1.0])
    wall = Masks([prism([(10, -50), (20, -50), (20, 50), (10, 50)])])
    found = encounter_with(stands((0.0, 0.0, 0.0), times), rows_of(times, 30.0, 0.0, 10.0), wall)
    assert (found.levels == 0.0).all()
    assert total_duration_s(found.in_reach_s) == 1.0
    assert len(found.in_sight_s) == 0


def test_levels_of_several_threats_by_hand():
    """0.5 and 0.2 at one waypoint: the second is raised to 0.6. At the other 0.5 alone: no overlap."""
    pair = [with_levels("a", [0.2, *[0.0] * 10, 0.5]), with_levels("b", [0.5, *[0.0] * 10, 0.0])]
    assert total_threat(pair) == pytest.approx(1.2)
    assert aggregated_threat(pair) == pytest.approx(1.0 - math.sqrt(math.sqrt(0.5 * 0.4) * 0.5))
    assert aggregated_threat([with_levels("sure", [1.0])]) == 1.0
    assert aggregated_threat([]) == total_threat([]) == 0.0


def test_a_radar_sees_above_its_boundary_only():
    """K_R = 0.01/m: 100 m away the boundary is 100 m up, reached after 5 s of climb at 20 m/s."""
    times = np.arange(0.0, 10.05, 0.1)
    flown = rows_of(times, 100.0, 0.0, 20.0 * times)
    (radar,) = radar_threats([Radar("radar", (0.0, 0.0, 0.0), 500.0, 0.01)], flown)
    found = encounter_with(radar, flown, OPEN)
    np.testing.assert_allclose(found.in_sight_s, [[5.0, 10.0]])
    assert total_duration_s(found.in_reach_s) == pytest.approx(10.0)
    assert not found.is_moving
    (radar,) = radar_threats([Radar("in the plane", (0.0, 0.0, 150.0), 500.0)], flown)
    assert total_duration_s(encounter_with(radar, flown, OPEN).in_sight_s) == pytest.approx(10.0)


def test_a_gap_in_a_track_counts_as_nothing():
    times = np.arange(0.0, 40.5, 0.5)
    seen = np.concatenate([np.arange(0.0, 10.5, 0.5), np.arange(20.0, 30.5, 0.5)])
    found = encounter_with(stands((0.0, 0.0, 0.0), seen), rows_of(times, 25.0, 0.0, 0.0), OPEN)
    np.testing.assert_allclose(found.in_reach_s, [[0.0, 10.0], [20.0, 30.0]])
    assert np.isnan(found.distances_m[(found.times_s > 10.0) & (found.times_s < 20.0)]).all()
    assert np.isfinite(found.distances_m).sum() == len(seen)
    assert total_threat([found]) == pytest.approx(2 * 111 * math.exp(-1 / 16))
    assert GAP_S < 10.0


@pytest.mark.parametrize("seen", [[], [50.0, 51.0], [3.0]])
def test_without_common_time_there_is_no_approach(seen):
    times = np.arange(10.0)
    found = encounter_with(stands((0.0, 0.0, 0.0), seen), rows_of(times, 10.0, 0.0, 0.0), OPEN)
    assert found.closest is None
    assert len(found.in_reach_s) == len(found.in_sight_s) == 0
    nothing = encounter_with(stands((0.0, 0.0, 0.0), times), np.empty((0, 7)), OPEN)
    assert (nothing.closest, len(nothing.levels)) == (None, 0)


def test_rows_that_are_not_whole_or_not_in_order_do_no_harm():
    times = np.arange(0.0, 10.5, 0.5)
    rows = rows_of(times, 10.0 * times, 30.0, 0.0)
    spoilt = np.vstack([rows[::-1], [[3.3, np.nan, 0.0, 0.0]], [[np.nan, 1.0, 1.0, 1.0]]])
    there = stands((50.0, 0.0, 0.0), times)
    assert encounter_with(there, spoilt, OPEN).closest == encounter_with(there, rows, OPEN).closest


def test_stretches_of_several_are_joined_by_hand():
    one, other = np.array([[0.0, 2.0], [5.0, 6.0]]), np.array([[1.0, 3.0], [6.0, 7.0], [9.0, 9.5]])
    assert merged_intervals(one, other).tolist() == [[0.0, 3.0], [5.0, 7.0], [9.0, 9.5]]
    assert merged_intervals(np.array([[0.0, 9.0], [1.0, 2.0], [8.0, 10.0]])).tolist() == [[0.0, 10.0]]
    assert merged_intervals().shape == merged_intervals(np.empty((0, 2))).shape == (0, 2)
    assert total_duration_s(merged_intervals(one, other)) == 5.5


def test_of_a_recording_those_tracked_longest_that_hunt():
    times = np.arange(0.0, 10.0, 0.2)
    flown = rows_of(times, 10.0 * times, 0.0, 0.0)

    def track(num_rows, reach):
        return [[float(t), 50.0, 30.0, 0.0, reach] for t in times[:num_rows]]

    tracks = {f"dt{number}": track(30 + number, 50.0) for number in range(THREATS_MAX + 1)}
    tracks |= {"flies on": track(50, 0.0), "not known": track(50, math.nan), "once": track(1, 50.0)}
    found = known_encounters(flown, tracks.items(), [Radar("radar", (0.0, 0.0, 9.0), 20.0)], ())
    names = [f"dt{number}" for number in range(THREATS_MAX, 0, -1)]
    assert [entry.name for entry in found] == [*names, "radar"]
    assert found[0].closest.distance_m == pytest.approx(30.0)


def test_however_long_it_claims_to_be_it_is_read_in_bounds(monkeypatch):
    monkeypatch.setattr("companion.assurance.encounters.PAIRS_MAX", 300)
    asked, is_free = [], Masks.is_free
    monkeypatch.setattr(
        Masks, "is_free", lambda masks, eyes, places: asked.append(len(eyes)) or is_free(masks, eyes, places)
    )
    times = np.arange(0.0, 100.0, 0.2)
    tracks = {name: [[float(t), 0.0, 0.0, 0.0, 900.0] for t in times] for name in "ab"}
    wall = prism([(5, 5), (6, 5), (6, 6)])
    found = known_encounters(rows_of(times, 100.0, 0.0, 0.0), tracks.items(), (), [wall])
    assert max(asked) <= 151
    assert [len(entry.levels) for entry in found] == [0, 0]
    assert total_duration_s(found[0].in_reach_s) == pytest.approx(99.6, abs=1.0)
    claimed = rows_of(np.array([0.0, 1e12]), 0.0, 0.0, 0.0)
    assert len(known_encounters(claimed, tracks.items(), (), [])) == 0


def test_many_prisms_are_asked_in_parts(monkeypatch):
    monkeypatch.setattr("companion.assurance.encounters.CHUNK_PAIRS", 6)
    walls = [prism([(x, -1), (x + 1, -1), (x + 1, 1), (x, 1)]) for x in (10.0, 30.0)]
    ends = list(itertools.product([5.0, 20.0, 40.0], [0.0, 3.0]))
    places = np.array([[east, north, 1.0] for east, north in ends])
    eyes = places * (0.0, 1.0, 1.0)
    assert Masks(walls).is_free(eyes, places).tolist() == [True, True, False, True, False, True]
