"""What ``sitl --json`` tells of threats, worked out again from its own paths by plain sampling."""

import copy
import json
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from tests.flights.flown import mission_named, shipped

pytestmark = pytest.mark.xdist_group("shipped flights")  # they share flights that are made once a process

STEP_S = 0.02


class Sampled:
    """A flight looked at fifty times a second."""

    def __init__(self, mission, told):
        self.mission = mission
        path = np.array(told["true_path"])
        self.walls = [(shapely.Polygon(o.polygon_enu_m), o.base_m, o.top_m) for o in mission.obstacles]
        for polygon, _, _ in self.walls:
            shapely.prepare(polygon)
        self.times = np.arange(0.0, path[-1, 0] - STEP_S, STEP_S) + 0.5 * STEP_S
        self.path = path

    def own(self, times):
        return np.column_stack([np.interp(times, self.path[:, 0], self.path[:, axis]) for axis in (1, 2, 3)])

    def other(self, rows, times):
        rows = np.array(rows)
        east, north = (np.interp(times, rows[:, 0], rows[:, axis]) for axis in (1, 2))
        return np.column_stack([east, north, np.zeros(len(times))])

    def is_seen(self, eye, place):
        """Whether no one of many points on the line is within a wall."""
        points = eye + np.linspace(0.0, 1.0, 801)[:, None] * (place - eye)
        flat = shapely.points(points[:, :2])
        return not any(
            (shapely.contains(polygon, flat) & (points[:, 2] >= base) & (points[:, 2] <= top)).any()
            for polygon, base, top in self.walls
        )

    def seconds(self, there, reach_m):
        """In reach, and in reach and sight, and when first so."""
        here = self.own(self.times)
        is_near = np.linalg.norm(here - there, axis=1) <= reach_m
        seen = np.zeros(len(here), dtype=bool)
        for row in np.flatnonzero(is_near)[::5]:  # ten times a second is enough
            seen[row : row + 5] = is_near[row : row + 5] & self.is_seen(there[row], here[row])
        first = float(self.times[np.argmax(seen)]) if seen.any() else None
        return STEP_S * is_near.sum(), STEP_S * seen.sum(), first

    def levels(self, there_at, reach_m):
        """Membership at one waypoint a second and ten points between; every eleventh is a waypoint."""
        times = np.arange(int(self.path[-1, 0]) * 11 + 1) / 11.0
        here, there = self.own(times), there_at(times)
        ranges = np.linalg.norm(here - there, axis=1)
        found = np.where(ranges <= reach_m, np.exp(-((ranges / reach_m) ** 4)), 0.0)
        return np.array([
            level if level > 0.0 and self.is_seen(eye, place) else 0.0
            for level, eye, place in zip(found, there, here, strict=True)
        ])  # fmt: skip


def checked(flight):
    """The measures of a flight beside those sampled; what was told."""
    told = json.loads(json.dumps(flight.document(), allow_nan=False))
    sampled, seconds = Sampled(flight.mission, told), {}
    assert list(told["dt_paths"]) == [entry.name for entry in flight.mission.dynamic_threats]
    assert told["dt_path"] == next(iter(told["dt_paths"].values()))
    for threat in flight.mission.dynamic_threats:
        of_it, rows = told["dynamic_threats"][threat.name], told["dt_paths"][threat.name]
        reach = threat.max_threat_radius_m
        away = np.linalg.norm(sampled.own(sampled.times) - sampled.other(rows, sampled.times), axis=1)
        assert of_it["miss_distance_m"] == pytest.approx(away.min(), abs=0.5)
        assert of_it["miss_s"] == pytest.approx(sampled.times[np.argmin(away)], abs=0.5)
        in_reach, in_sight, first = sampled.seconds(sampled.other(rows, sampled.times), reach)
        assert of_it["seconds_in_reach"] == pytest.approx(in_reach, abs=0.3)
        assert of_it["seconds_in_reach_and_sight"] == pytest.approx(in_sight, abs=1.0)
        assert (of_it["t_f_s"] is None) == (first is None)
        assert of_it["t_f_s"] == pytest.approx(first, abs=0.3) if first is not None else True
        levels = sampled.levels(lambda times, rows=rows: sampled.other(rows, times), reach)
        assert of_it["TDTA"] == pytest.approx(levels.sum(), abs=3.0)
        mean = 1.0 - math.prod((1.0 - levels[::11]) ** (1.0 / len(levels[::11])))
        assert of_it["ADTP"] == pytest.approx(mean, abs=0.01)
        seconds[threat.name] = of_it["seconds_in_reach_and_sight"]
    assert told["threatened"] == sum(value > 0.0 for value in seconds.values())
    assert told["is_safe"] is (told["success"] and told["threatened"] == 0)
    assert told["min_dt_distance_m"] == told["miss_distance_m"]
    levels = sum(
        sampled.levels(
            lambda times, radar=radar: np.tile((radar.east_m, radar.north_m, radar.up_m), (len(times), 1)),
            radar.max_threat_radius_m,
        )
        for radar in flight.mission.radars
    )
    assert told["TTA"] == pytest.approx(levels.sum(), abs=max(3.0, 0.01 * levels.sum()))
    assert told["seconds_in_radar"] == pytest.approx(np.count_nonzero(levels) / 11.0, abs=1.0)
    return told


def test_a_flight_that_met_nothing_says_so():
    told = checked(shipped("first-flight", 1))
    assert told["is_safe"] is True
    assert told["seconds_in_reach"] == told["TDTA"] == told["TTA"] == 0.0
    assert told["t_f_s"] is None


def test_the_same_flight_judged_by_longer_reaches_is_told_as_its_paths_say():
    """A low wall stands before the vehicle for a part of it, and the map's own before the radar."""
    flight = copy.copy(shipped("first-flight", 1))
    mission, truth = flight.mission, flight.simulator.truth
    threat, radar = (
        entry.model_copy(update={"max_threat_radius_m": reach})
        for entry, reach in ((mission.dynamic_threats[0], 500.0), (mission.radars[0], 1000.0))
    )
    corners = ((900.0, 600.0), (1000.0, 600.0), (1000.0, 620.0), (900.0, 620.0))
    low = mission.obstacles[0].model_copy(update={"polygon_enu_m": corners, "top_m": 60.0})
    walls = (*mission.obstacles, low)
    flight.mission = mission_named(
        "first-flight", dynamic_threats=(threat,), radars=(radar,), obstacles=walls
    )
    flight.simulator = copy.copy(flight.simulator)
    flight.simulator.truth = replace(truth, obstacles=flight.mission.obstacle_list)
    told = checked(flight)
    assert told["seconds_in_reach"] > told["seconds_in_reach_and_sight"] + 3.0 > 6.0
    assert told["TDTA"] > 10.0
    assert told["TTA"] > 10.0
    assert told["is_safe"] is False


@pytest.mark.slow
def test_a_pursued_flight_s_measures_are_those_of_its_paths():
    told = checked(shipped("paper-2d", 3))
    assert told["threatened"] == 1
