"""Curves and violins of made values: what is drawn is what they have."""

import numpy as np
import pytest

from companion.research.evidence.distributions import distributions, violins
from companion.ui.reports import style
from tests.research.evidence.made_evidence import case, sample


@pytest.fixture
def made():
    ours = sample("PC", [1.0, 2.0, 3.0, 4.0, 10.0])
    theirs = sample("PC", [5.0, None, 5.0, None, 5.0], successes=[True, False, True, False, True])
    return case(safe_rrt=ours, taddrrt=theirs, edbm=sample("PC", [None] * 5))


def test_curves_end_at_the_share_that_has_a_value(made):
    (axes,) = [axes for axes in distributions("plans", made).axes if axes.get_visible()]
    ends = [line.get_ydata()[-1] if len(line.get_ydata()) else 0.0 for line in axes.lines]
    assert ends == [1.0, 0.6, 0.0]


def test_violins_have_median_middle_half_and_number(made):
    with style.drawing():
        figure = violins("plans", made)
    (axes,) = [axes for axes in figure.axes if axes.get_visible()]
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        "safe-rrt (5)",
        "taddrrt (3)",
        "edbm (0)",
    ]
    bar, dot, other_bar, other_dot = axes.lines
    assert bar.get_xdata() == pytest.approx([2.0, 4.0])
    assert (dot.get_xdata()[0], dot.get_ydata()[0]) == (3.0, 0)
    assert other_bar.get_xdata() == pytest.approx([5.0, 5.0])  # all alike: no shape, and no fault
    assert (other_dot.get_xdata()[0], other_dot.get_ydata()[0]) == (5.0, -1)
    shape = axes.collections[0].get_paths()[0].vertices
    widest = shape[np.argmax(np.abs(shape[:, 1])), 0]
    assert 1.5 < widest < 4.0  # where the values are, and not at the one far off


def test_violins_of_times_are_logarithmic():
    (axes, *_) = violins("plans", case(safe_rrt=sample("PST", [0.01, 0.1, 1.0]))).axes
    assert axes.lines[1].get_xdata()[0] == pytest.approx(-1.0)
    assert axes.xaxis.get_major_formatter()(-1.0, 0) == "0.1"


def test_nothing_is_drawn_of_nothing():
    assert distributions("plans", case(safe_rrt=sample("PC", [None]))) is None
    assert violins("plans", case(safe_rrt=sample("PC", [None]))) is None
