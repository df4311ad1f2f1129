"""Measures over all threats of a flight, by hand."""

import math

import numpy as np
import pytest

from companion.types.threat import DynamicThreat, Obstacle, Radar
from sim.flight_measures import measured
from sim.truth import Truth


def truth_of(times, east, places, walls=()):
    """East along the axis at 30 m up, past threats that stand."""
    truth = Truth(tuple(walls), (0.0, 0.0, 0.0))
    truth.path = [[float(t), float(x), 0.0, 30.0, 0.0, 0.0, 10.0] for t, x in zip(times, east, strict=True)]
    truth.threat_paths = {name: [[float(t), *place] for t in times] for name, place in places.items()}
    return truth


def kind(name, reach_m, up_m=0.0):
    return DynamicThreat(name, (0.0, 0.0, up_m), 5.0, reach_m)


TIMES = np.arange(0.0, 20.05, 0.1)
# Reach 50 m, 30 m below: half a chord is 40 m, so 8 s at 10 m/s, from 1 s and from 5 s on.
PLACES = {"first": (50.0, 0.0), "second": (90.0, 0.0)}


def test_seconds_of_several_threats_are_those_in_which_any_has_it():
    truth = truth_of(TIMES, 10.0 * TIMES, PLACES)
    found = measured(truth, [kind("second", 50.0), kind("first", 50.0)], ())
    by_name = found.by_name()
    assert list(by_name) == ["second", "first"]
    for name, begin_s in (("first", 1.0), ("second", 5.0)):
        assert by_name[name]["seconds_in_reach"] == pytest.approx(8.0)
        assert by_name[name]["seconds_in_reach_and_sight"] == pytest.approx(8.0)
        assert by_name[name]["t_f_s"] == pytest.approx(begin_s)
        assert by_name[name]["miss_distance_m"] == pytest.approx(30.0)
        assert by_name[name]["miss_s"] == pytest.approx(begin_s + 4.0)
    all_of_them = found.over_all()
    assert all_of_them["seconds_in_reach_and_sight"] == pytest.approx(12.0)
    assert all_of_them["t_f_s"] == pytest.approx(1.0)
    assert all_of_them["TDTA"] == pytest.approx(sum(entry["TDTA"] for entry in by_name.values()))
    assert found.num_threatening == 2


def test_a_threat_behind_a_wall_reaches_and_does_not_threaten():
    wall = Obstacle("wall", np.array([[-10.0, 5.0], [210.0, 5.0], [210.0, 8.0], [-10.0, 8.0]]), 0.0, 100.0)
    truth = truth_of(TIMES, 10.0 * TIMES, {"hidden": (100.0, 30.0)}, [wall])
    found = measured(truth, [kind("hidden", 60.0)], ())
    of_it = found.by_name()["hidden"]
    assert of_it["seconds_in_reach"] == pytest.approx(2.0 * math.sqrt(60.0**2 - 2 * 30.0**2) / 10.0)
    assert of_it["seconds_in_reach_and_sight"] == of_it["TDTA"] == of_it["ADTP"] == 0.0
    assert of_it["t_f_s"] == math.inf
    assert found.num_threatening == 0


def test_a_threat_stands_as_high_as_the_mission_file_says():
    truth = truth_of(TIMES, 10.0 * TIMES, {"on a hill": (100.0, 0.0)})
    found = measured(truth, [kind("on a hill", 50.0, 25.0)], ())
    assert found.over_all()["miss_distance_m"] == pytest.approx(5.0)


def test_radars_count_apart_from_what_moves():
    truth = truth_of(TIMES, 10.0 * TIMES, {})
    radars = [Radar(name, (east, 0.0, 0.0), 50.0) for name, east in (("one", 50.0), ("two", 90.0))]
    found = measured(truth, (), radars).over_all()
    assert found["seconds_in_radar"] == pytest.approx(12.0)
    samples = 10.0 * np.arange(20 * 11 + 1) / 11.0
    ranges = np.hypot(samples[:, None] - [50.0, 90.0], 30.0)
    levels = np.where(ranges <= 50.0, np.exp(-((ranges / 50.0) ** 4)), 0.0)
    assert found["TTA"] == pytest.approx(levels.sum())
    assert 0.0 < found["ATP"] < levels.max()
    assert found["seconds_in_reach"] == found["TDTA"] == found["ADTP"] == 0.0
    assert found["miss_distance_m"] == found["t_f_s"] == math.inf
