"""The ground in reports: below the flown path, with the limits and the least height over it."""

import re
from dataclasses import replace

import numpy as np
import pytest

from companion.config import load_mission
from companion.config.compose import world_of
from companion.config.sections.terrain_map import posts_of
from companion.ui.reports import charts, style
from companion.ui.reports.ground_profile import flown_over_ground, lowest_over_ground
from companion.ui.reports.report import write_report
from sim.vehicle.true_ground import TrueGround
from tests.sim.client import CONFIGS
from tests.ui.reports.flights import empty_record, mission, record, snapshot_of

RIDGE = load_mission(CONFIGS / "ridge.yaml")


def over_ridges():
    """A flight from 1,000 to 3,000 m east at 330 m, and its least height over ground by the simulator."""
    times = np.linspace(100.0, 180.0, 801)
    flown = np.zeros((len(times), 7))
    flown[:, 0], flown[:, 1], flown[:, 2], flown[:, 3] = times, np.linspace(1e3, 3e3, 801), 1_700.0, 330.0
    over = 330.0 - TrueGround(posts_of(RIDGE)).ups_m(flown[:, 1], flown[:, 2])
    return replace(empty_record(), flown=flown, begin_s=100.0), over, times


def test_the_altitude_chart_shows_the_ground_and_the_limits_over_it():
    flight, over, times = over_ridges()
    with style.drawing():
        figure = charts.altitude_chart(RIDGE, world_of(RIDGE), flight, 100.0)
    (axes,) = figure.axes
    lines = {line.get_label(): line for line in axes.get_lines()}
    ground = lines["ground"].get_ydata()
    assert ground == pytest.approx(330.0 - over, abs=0.05)
    assert lines["lowest over ground, 50 m"].get_ydata() == pytest.approx(ground + 50.0)
    assert lines["highest over ground, 150 m"].get_ydata() == pytest.approx(ground + 150.0)
    marked = lines[f"lowest: {over.min():.0f} m over ground"]
    assert marked.get_xdata()[0] == pytest.approx(times[np.argmin(over)] - 100.0, abs=0.11)
    low, high = axes.get_ylim()
    assert low < ground.min()
    assert high > 330.0


def test_the_report_says_how_low_the_flight_was(tmp_path):
    flight, over, times = over_ridges()
    page, _ = write_report(tmp_path, RIDGE, world_of(RIDGE), flight)
    text = page.read_text(encoding="utf-8")
    (height, at) = re.search(r"Lowest: (-?\d+) m over ground, at (\d\d:\d\d)\.", text).groups()
    assert int(height) == round(over.min())
    assert at == style.clock_text(times[np.argmin(over)] - 100.0)
    assert "Contours are heights of the ground" in text


def test_without_a_map_no_ground_is_shown(tmp_path):
    config = mission()
    assert flown_over_ground(config, record().flown).shape == (0, 3)
    page, _ = write_report(tmp_path, config, snapshot_of(config), record())
    assert "over ground" not in page.read_text(encoding="utf-8")


def test_places_that_are_not_known_do_not_count():
    flight, over, _ = over_ridges()
    gap = flight.flown.copy()
    gap[np.argmin(over) - 5 : np.argmin(over) + 6, 1] = np.nan
    rows = flown_over_ground(RIDGE, gap)
    assert len(rows) == len(gap) - 11
    assert lowest_over_ground(rows[:, 1], rows[:, 2])[1] > over.min()
