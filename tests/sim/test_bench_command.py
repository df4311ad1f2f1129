"""``companion bench``: how cases become figures, and one reaction in real time."""

import json
import logging
import math

import pytest

from companion.types.events import Dialect
from sim.bench import bench_figures
from sim.bench.reaction import CHANGES, reaction_s


@pytest.fixture(autouse=True)
def others_may_log():
    """The command silences its own process for good, and here that is the tests'."""
    yield
    logging.disable(logging.NOTSET)


def test_quantiles_by_hand():
    assert bench_figures.quantiles([3.0, 1.0, 2.0], "_s") == {"median_s": 2.0, "p95_s": 3.0, "n": 3}
    assert bench_figures.quantiles(map(float, range(1, 101))) == {"median": 50.5, "p95": 95.0, "n": 100}
    assert math.isnan(bench_figures.quantiles([])["median"])


def test_json_has_none_for_what_is_no_number():
    found = bench_figures.finite({"a": {"b": math.inf, "c": math.nan, "d": 1.0}, "n": 2})
    assert found == {"a": {"b": None, "c": None, "d": 1.0}, "n": 2}


@pytest.fixture
def measured(monkeypatch):
    """Figures that need no flight."""
    took = {"pop_up": 1.0, "turn": 2.0, "fence": 1.4}
    monkeypatch.setattr(bench_figures, "react", lambda case: took[case[0]] + 0.1 * case[2])
    monkeypatch.setattr(bench_figures, "arrive", lambda case: [0.1 * case[2], -0.2 * case[2]])
    monkeypatch.setattr(bench_figures, "planned", lambda file: bench_figures.quantiles([5.0], "_ms"))
    monkeypatch.setattr("sim.bench.bench_command.ProcessPoolExecutor", Inline)
    return took


class Inline:
    def __init__(self, *_arguments, **_named):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    map = staticmethod(map)


def test_the_document_has_what_others_read(measured, companion_command, tmp_path):
    done = companion_command("bench", "m/one.yaml", "--json", tmp_path / "b.json", "--flights", 3)
    document = json.loads((tmp_path / "b.json").read_text(encoding="utf-8"))
    assert document["reaction"]["px4"]["turn"] == {"median_s": 2.2, "p95_s": pytest.approx(2.3), "n": 3}
    assert document["reaction"].keys() == {dialect.value for dialect in Dialect}
    assert all(of.keys() == set(CHANGES) for of in document["reaction"].values())
    assert document["plan"] == {"one": {"median_ms": 5.0, "p95_ms": 5.0, "n": 1}}
    assert document["arrival_error_s"]["10"]["n"] == 12
    assert document["arrival_error_s"]["10"]["median"] == 1.5
    assert done.code == 1  # a PX4's turn is promised to be answered in 1.5 s
    measured.update(turn=1.0, fence=1.0)
    again = companion_command("bench", "m/one.yaml", "--flights", 3)
    assert again.code == 0
    assert "from what changes the picture" in again.out


@pytest.mark.slow  # flies half a minute in real time
@pytest.mark.parametrize("dialect", list(Dialect), ids=lambda dialect: dialect.value)
def test_a_pop_up_is_answered_in_real_time(dialect):
    assert reaction_s("pop_up", dialect, 1) < 5.0
