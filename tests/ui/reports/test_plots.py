from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.image import imread

from companion.ui.reports import charts, style
from companion.ui.reports.perspective import (
    AZIMUTH_DEG,
    ELEVATION_DEG,
    circle,
    draw_perspective,
    prism_faces,
)
from companion.ui.reports.plots import flight_map, plot_mission, plot_plan
from companion.ui.reports.threats_met import encounter_table
from tests.ui.reports.flights import empty_record, mission, path, plan, record, snapshot_of


def is_a_picture(file):
    pixels = imread(file)[..., :3]
    return pixels.shape[0] > 600 and pixels.shape[1] > 900 and pixels.std() > 0.02


def labels_of(figure):
    legends = [axes.get_legend() for axes in figure.axes]
    return [text.get_text() for legend in legends if legend for text in legend.get_texts()]


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_mission_is_drawn(tmp_path, dimension):
    config = mission(dimension, num_goals=2)
    plot_mission(tmp_path / "mission.png", config, snapshot_of(config))
    assert is_a_picture(tmp_path / "mission.png")


def test_a_mission_without_threats_is_drawn(tmp_path):
    config = mission(radars=False, dynamic_threats=False)
    plot_mission(tmp_path / "mission.png", config, snapshot_of(config))
    assert is_a_picture(tmp_path / "mission.png")


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("found", [True, False])
def test_a_plan_is_drawn_whether_or_not_there_is_a_path(tmp_path, dimension, found):
    config = mission(dimension)
    plot_plan(tmp_path / "plan.png", config, snapshot_of(config), plan(found=found))
    assert is_a_picture(tmp_path / "plan.png")


def test_of_very_many_circles_a_sample_is_drawn_and_named_so(tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(
        "companion.ui.reports.basemap.MapSheet.finish", lambda sheet: seen.extend(sheet.handles)
    )
    found = plan()
    circles = np.tile(found.trace.reach_circles_enu_m, (60, 1))
    config = mission(2)
    crowded = replace(found, trace=replace(found.trace, reach_circles_enu_m=circles))
    plot_plan(tmp_path / "plan.png", config, snapshot_of(config), crowded)
    assert any("1 in 3 drawn" in handle.get_label() for handle in seen)


def test_the_map_of_a_flight_has_every_upload_and_the_closest_approach():
    config = mission()
    with style.drawing():
        figure = flight_map(config, snapshot_of(config), record())
    lines = [child for child in figure.axes[0].collections if isinstance(child, LineCollection)]
    assert [len(collection.get_segments()) for collection in lines] == [3]
    assert any(label.startswith("closest approach: ") for label in labels_of(figure))
    assert {"00:00", "00:30", "01:00"} <= {text.get_text() for text in figure.axes[0].texts}


def test_the_map_of_a_flight_of_72_s_marks_each_10_s_and_says_what_its_colours_are():
    config = mission()
    with style.drawing():
        figure = flight_map(config, snapshot_of(config), record())
    texts = {text.get_text() for text in figure.axes[0].texts}
    assert {text for text in texts if re.fullmatch(r"\d\d:\d\d", text)} == {
        f"0{s // 60}:{s % 60:02}" for s in range(0, 72, 10)
    }
    titles = " ".join(axes.get_title("left") for axes in figure.findobj(Axes))
    assert "by time of upload" in titles
    assert "radar threat μ" in titles
    (image,) = figure.axes[0].images
    assert image.get_clim() == (0.0, 1.0)


def test_a_plan_in_space_is_seen_from_above_and_aside():
    config = mission(3)
    with style.drawing():
        figure = style.new_figure(8.0, 8.0)
        draw_perspective(figure, figure.add_gridspec(1, 1)[0], config, snapshot_of(config), plan())
    (axes,) = figure.axes
    assert (axes.elev, axes.azim) == (ELEVATION_DEG, AZIMUTH_DEG)


def test_the_map_of_an_empty_record_is_the_world_alone():
    config = mission()
    with style.drawing():
        figure = flight_map(config, snapshot_of(config), empty_record())
    assert "flown path, time marked" not in labels_of(figure)


def test_map_chart_and_table_tell_of_the_same_approach():
    """At a slant: the flight is 120 m up and more, the vehicle on the ground."""
    config, flight = mission(), record()
    closest = flight.encounters[0].closest
    text = f"{closest.distance_m:.0f} m at {style.clock_text(closest.stamp_s - 1000.0)}"
    with style.drawing():
        figures = flight_map(config, snapshot_of(config), flight), charts.encounter_chart(flight, 1000.0)
    assert all(any(label.endswith(text) for label in labels_of(figure)) for figure in figures)
    row = next(row for row in encounter_table(flight, 1000.0).split("<tr>") if "vehicle" in row)
    assert f">{closest.distance_m:.0f}</td>" in row
    assert closest.distance_m > math.dist(closest.own_enu_m[:2], closest.other_enu_m[:2])


def test_the_chart_of_threats_shades_what_was_in_reach_and_in_sight():
    vehicle = record().encounters[0]
    vehicle = replace(vehicle, in_sight_s=vehicle.in_reach_s + np.array([2.0, -3.0]))
    with style.drawing():
        axes = charts.encounter_chart(replace(record(), encounters=(vehicle,)), 1000.0).axes[0]
    reach, sight = axes.collections
    for bars, stretches in ((reach, vehicle.in_reach_s), (sight, vehicle.in_sight_s)):
        corners = [path.vertices for path in bars.get_paths()]
        drawn = [(east.min(), east.max()) for east in (rows[:, 0] for rows in corners)]
        np.testing.assert_allclose(drawn, stretches - 1000.0)
        assert {rows[:, 1].max() for rows in corners} == {vehicle.reach_m}
    assert "8.91 s in reach, 3.91 s in sight" in axes.get_legend().get_texts()[0].get_text()


def test_of_many_threats_the_chart_has_the_nearest():
    flight = record()
    many = tuple(replace(flight.encounters[0], name=f"vehicle {number}") for number in range(9))
    with style.drawing():
        figure = charts.encounter_chart(replace(flight, encounters=many), 1000.0)
    assert [label[:9] for label in labels_of(figure)] == [f"vehicle {number}" for number in range(4)]


def test_the_chart_of_energy_has_what_is_left_and_what_is_needed():
    rows = np.array([[1_000.0, 60.0, 15.0], [1_001.0, 59.0, np.nan], [1_002.0, 58.0, 20.0]])
    with style.drawing():
        axes = charts.energy_chart(replace(record(), energy=rows), 1000.0).axes[0]
    left, needed = axes.lines[:2]
    np.testing.assert_array_equal(left.get_xdata(), [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(left.get_ydata(), rows[:, 1])
    np.testing.assert_array_equal(needed.get_ydata(), rows[:, 2])
    assert axes.get_ylim()[1] > 60.0


def test_without_moving_threats_the_chart_says_so():
    with style.drawing():
        axes = charts.encounter_chart(empty_record(), 0.0).axes[0]
    assert [text.get_text() for text in axes.texts] == ["no moving threat was known"]


def test_a_prism_has_its_walls_and_a_roof():
    wall = mission().obstacle_list[0]
    faces = prism_faces(wall)
    assert len(faces) == 5
    assert faces[-1][:, 2].tolist() == [300.0] * 4
    assert np.linalg.norm(circle((1.0, 2.0), 3.0) - np.array([1.0, 2.0]), axis=1) == pytest.approx(3.0)


def test_obstacle_tops_under_the_path():
    world = snapshot_of(mission())
    flown = np.zeros((4, 7))
    flown[:, 1:3] = [[950.0, 700.0], [875.0, 700.0], [800.0, 700.0], [400.0, 350.0]]
    stamps, tops = charts.obstacle_tops(world, flown)
    assert stamps.tolist() == [0.0] * 4
    assert tops[[0, 1, 3]].tolist() == [300.0, 300.0, 60.0], "25 m beside the wall counts"
    assert np.isnan(tops[2])


def test_the_altitude_chart_shows_bounds_and_path():
    config, flight = mission(), record()
    with style.drawing():
        figure = charts.altitude_chart(config, snapshot_of(config), flight, 1000.0)
    axes = figure.axes[0]
    assert {text.get_text() for text in axes.texts} == {"floor 50 m", "ceiling 350 m"}
    flown = next(line for line in axes.lines if line.get_label() == "flown")
    assert flown.get_ydata() == pytest.approx(path().positions_enu_m[:, 2])
    assert axes.get_xlim() == (0.0, 72.0)
    low, high = axes.get_ylim()
    assert low < 50.0
    assert high > 350.0


def test_the_latency_chart_names_median_and_percentile():
    with style.drawing():
        figure = charts.latency_chart(record())
    assert {"median 220 ms", "95th percentile 472 ms"} <= set(labels_of(figure))


def test_charts_of_an_empty_record_are_empty():
    config = mission()
    with style.drawing():
        charts.altitude_chart(config, snapshot_of(config), empty_record(), 0.0)
        charts.threat_chart(empty_record(), 0.0)
        figure = charts.latency_chart(empty_record())
    assert figure.axes[0].texts[0].get_text() == "no plan was recorded"
