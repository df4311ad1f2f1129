"""Whether what the RS estimators call unreachable is: pursuits by an adversary that knows the path."""

import csv

import numpy as np
import pytest

from tests.proofs.pursuits import EFFORTS, ESTIMATORS, FIGURES, Tally, driven, maps, tallied, write


def read(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def chases():
    return maps(1)


def test_drives_keep_speed_and_turn_radius_by_hand():
    # 100 m ahead; then a corner to the left: a quarter of a circle of 15 m and what is left of 100 m.
    times, way = driven([np.zeros(2), np.array([100.0, 0.0]), np.array([100.0, 100.0])], 0.0)
    assert way[-1].tolist() == [100.0, 100.0]
    assert times[1] == pytest.approx(4.0)
    assert times[2] - times[1] > 4.0  # it comes out of the turn 15 m aside and turns back
    assert times[2] - times[1] < (15.0 * np.pi / 2.0 + 100.0) / 25.0


def test_captures_are_what_they_say(chases):
    rng = np.random.default_rng(5)
    hunted = 0
    for chase in chases:
        for _ in range(5):
            start, heading = chase.random_start(rng)
            drive = chase.hunt(start, heading)
            if drive is None:
                continue
            hunted += 1
            times, way = drive
            assert np.diff(times).min() >= 0.0
            steps = np.hypot(*np.diff(way, axis=0).T)
            assert (steps <= 25.0 * np.diff(times) + 1e-6).all()
            caught = chase.threatened(drive)
            assert caught.any()
            # From where it stands still nothing far away is caught.
            nowhere = (np.array([0.0, 1e4]), np.array([start, start]))
            away = np.hypot(*(chase.points[:, :2] - start).T)
            assert not chase.threatened(nowhere)[away > 250.0].any()
    assert hunted >= 10


def test_few_captures_surprise_the_estimator_and_fewer_than_its_comparators(chases):
    tallies = tallied(chases, 40, (1,), seed=11)
    missed = {name: tallies[name, 1].missed / tallies[name, 1].captures for name in ESTIMATORS}
    assert tallies["ExRRT with corners", 1].captures > 300
    assert missed["ExRRT with corners"] < 0.01
    assert tallies["ExRRT with corners", 1].surprises <= 1
    assert missed["ExRRT with corners"] < missed["ExRRT"] < missed["RRT-Reach"]
    # It does not buy that by calling everything reachable: not what is passed before the DT can be near.
    assert tallies["ExRRT with corners", 1].called < 0.9 * tallies["ExRRT with corners", 1].nodes


def test_the_table_and_the_picture(tmp_path):
    made = {(name, 1): Tally(10, 8, 1, 100, 7, 300, 600) for name in ESTIMATORS}
    write(made, tmp_path)
    rows = read(tmp_path / "reachability.csv")
    assert [row["estimator"] for row in rows] == list(ESTIMATORS)
    assert rows[0]["missed %"] == "7.0"
    assert rows[0]["nodes called reachable %"] == "50.0"
    assert (tmp_path / "reachability.png").stat().st_size > 5000


@pytest.mark.slow
def test_the_table_that_is_shown_is_the_one_that_comes_out():
    shown = read(FIGURES / "reachability.csv")
    effort = EFFORTS[0]
    tallies = tallied(maps(2), 100, (effort,), seed=99)
    for name in ESTIMATORS:
        row = next(r for r in shown if r["estimator"] == name and r["iterations per node"] == str(effort))
        now = tallies[name, effort]
        # Other pursuits, a tenth as many: the share of missed captures to within 8 percentage points.
        assert 100.0 * now.missed / now.captures == pytest.approx(float(row["missed %"]), abs=8.0)
