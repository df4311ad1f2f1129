"""Flights of small teams in fast time, and the judge of their distances."""

import dataclasses
import json

import numpy as np
import pytest
from typer import Typer
from typer.testing import CliRunner

from sim.team.__main__ import main
from sim.team.candidates import Circling, candidates, paths_to
from sim.team.fast_time import fly, fly_straight
from sim.team.scenes import Scene
from sim.team.true_distances import Flown, pairs_lost, true_places

DENSE = Scene(num_aircraft=24, side_m=6000.0, levels_m=(100.0, 150.0), end_s=900.0)


@pytest.fixture(scope="module")
def row():
    return fly(3, DENSE)


def test_a_team_that_shares_keeps_apart_and_everybody_arrives(row):
    assert (row.pairs_lost, row.blocked, row.counted_lost) == (0, 0, 0)
    assert row.bytes_s < 100.0
    assert row.proposals >= 24


def test_a_team_that_does_not_share_loses_separation():
    assert fly_straight(3, DENSE).pairs_lost > 2


def test_a_flight_is_the_same_again(row):
    again = fly(3, DENSE)
    assert dataclasses.replace(again, wall_s=0.0) == dataclasses.replace(row, wall_s=0.0)


def test_nobody_leaves_its_circle_while_nobody_hears_anybody():
    deaf = fly(1, dataclasses.replace(DENSE, num_aircraft=4, loss=1.0, end_s=30.0))
    assert (deaf.blocked, deaf.pairs_lost) == (4, 0)


def test_pairs_that_come_near_are_found_and_no_others():
    times = np.arange(0.0, 100.0, 0.25)
    east = np.column_stack([20.0 * times, 0.0 * times, 100.0 + 0.0 * times])
    north = np.column_stack(
        [1000.0 + 0.0 * times, 20.0 * times - 1000.0, 100.0 + 0.0 * times]
    )  # they meet at 50 s
    above, beside = east + np.array([0.0, 0.0, 30.0]), east + np.array([0.0, 70.0, 0.0])
    found = pairs_lost(DENSE, np.array([east, north, above, beside]))
    assert found == {(0, 1), (1, 3)}
    assert pairs_lost(DENSE, np.array([east, north - np.array([0.0, 100.0, 0.0])])) == set()


def test_the_true_track_is_within_the_tolerance_of_the_way_and_never_jumps():
    circling = Circling(np.array([0.0, 0.0, 100.0]), 1.0, DENSE.speed_m_s / DENSE.radius_m)
    way = next(candidates(circling, paths_to(DENSE, circling, np.array([5000.0, 1000.0, 150.0])), 30.0))
    times = np.arange(0.0, way[-1, 0] + 60.0, 0.25)
    places = true_places(DENSE, Flown(circling, way), times, np.random.default_rng(1))
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 20.0
    on_way = (times > way[0, 0]) & (times < way[-2, 0])
    for column in range(2):
        off = places[on_way, column] - np.interp(times[on_way], way[:-1, 0], way[:-1, 1 + column])
        assert abs(off).max() <= DENSE.tolerance_m


def test_the_command_writes_a_row_a_flight(tmp_path):
    app, out = Typer(), tmp_path / "rows.jsonl"
    app.command()(main)
    result = CliRunner().invoke(app, ["--runs", "2", "--aircraft", "6", "--straight", "--out", str(out)])
    assert result.exit_code == 0, result.output
    rows = [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]
    assert [row["seed"] for row in rows] == [1, 2]
