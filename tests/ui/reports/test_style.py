from __future__ import annotations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from companion.ui.reports import style


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "00:00"), (67.4, "01:07"), (-5.0, "−00:05"), (-0.2, "00:00"), (3725.0, "1:02:05"), (np.nan, "–")],
)
def test_times_read_like_a_clock(seconds, text):
    assert style.clock_text(seconds) == text


@pytest.mark.parametrize(
    ("span", "step"), [(2500.0, 500.0), (100.0, 20.0), (7.0, 2.0), (0.9, 0.2), (5.0, 1.0)]
)
def test_steps_are_round(span, step):
    assert style.round_step(span, 6) == pytest.approx(step)


def test_time_steps_are_those_of_a_clock():
    assert style.time_step(140.0, 8) == 30.0
    assert style.time_step(3000.0, 8) == 600.0
    assert style.time_step(1e6, 8) == 200_000.0


def test_a_tree_becomes_its_edges():
    nodes = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    lines = style.tree_lines(nodes, np.array([-1, 0, 1]))
    assert lines.tolist() == [[[1.0, 0.0], [0.0, 0.0]], [[1.0, 1.0], [1.0, 0.0]]]


@pytest.fixture
def axes():
    axes = style.new_figure(4.0, 4.0).add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, 100.0), ylim=(0.0, 100.0))
    return axes


def extents(axes):
    renderer = axes.figure.canvas.get_renderer()
    return [text.get_window_extent(renderer) for text in axes.texts]


def test_texts_never_cover_each_other_nor_leave_the_map(axes):
    FigureCanvasAgg(axes.figure)
    labels = style.Labels(axes)
    rng = np.random.default_rng(4)
    placed = [labels.put(east, north, "12:34", "black") for east, north in 100.0 * rng.random((60, 2))]
    boxes = extents(axes)
    assert 10 < sum(placed) == len(boxes) < 60
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    assert all(box.x0 >= 0.0 and box.y0 >= 0.0 and box.x1 <= 400.0 and box.y1 <= 400.0 for box in boxes)


def test_texts_keep_off_a_path(axes):
    labels = style.Labels(axes)
    labels.reserve_line(np.array([[0.0, 50.0], [100.0, 50.0]]))
    labels.reserve_line(np.empty((0, 2)))
    assert labels.put(50.0, 50.0, "00:30", "black")
    assert axes.texts[0].get_ha() == "center", "above or below, since the path runs left and right"
    labels.reserve(20.0, 80.0, 200.0)
    assert not labels.put(20.0, 80.0, "00:10", "black")
