"""The comparison of figures, without measuring any."""

import json

import pytest

from tests.bench import figures

REPORT = """<testsuites><testsuite><testcase name="a"><properties>
<property name="plan [ms]" value="12.5"/><property name="note" value="none"/>
</properties></testcase></testsuite></testsuites>"""


def test_figures_are_read_from_a_report(tmp_path):
    report = tmp_path / "report.xml"
    report.write_text(REPORT, encoding="utf-8")
    assert figures.figures_in(report) == {"plan [ms]": 12.5}


def test_medians_are_over_the_rounds_that_have_the_figure():
    assert figures.medians([{"a": 1.0}, {"a": 5.0, "b": 2.0}, {"a": 3.0}]) == {"a": 3.0, "b": 2.0}


def test_a_table_finds_figures_of_checkouts_that_tell_no_unit():
    lines = list(figures.table({"plan [ms]": 6.0, "new [ms]": 1.0}, {"plan": 12.0}, ("here", "beside")))
    assert lines[1].split() == ["plan", "[ms]", "6", "12", "0.500"]
    assert lines[2].split() == ["new", "[ms]", "1", "-", "-"]


def test_rounds_alternate_which_checkout_comes_first(monkeypatch):
    asked = []
    monkeypatch.setattr(figures, "measured", lambda checkout: asked.append(checkout) or {"a": 1.0})
    assert figures.side_by_side("here", "beside", 3) == ({"a": 1.0}, {"a": 1.0})
    assert asked == ["here", "beside", "beside", "here", "here", "beside"]


def test_a_baseline_is_scaled_to_this_computer(tmp_path, monkeypatch):
    # Stored where the yardstick took 1 s; here it takes 2 s: times double, rates halve, shares stay.
    monkeypatch.setattr(figures, "BASELINE", tmp_path / "baseline.json")
    assert figures.baseline() is None
    monkeypatch.setattr(figures, "yardstick_s", lambda: 1.0)
    figures.saved({"plan [ms]": 10.0, "simulator [times real time]": 50.0, "share [%]": 80.0})
    assert json.loads(figures.BASELINE.read_text(encoding="utf-8"))["yardstick_s"] == 1.0
    monkeypatch.setattr(figures, "yardstick_s", lambda: 2.0)
    values, speed = figures.baseline()
    assert speed == pytest.approx(2.0)
    assert values == {"plan [ms]": 20.0, "simulator [times real time]": 25.0, "share [%]": 80.0}
