"""Flights with a worn battery: told in time, turned back in time, home with the reserve.

The campaign `make energy` flies a hundred of them, and as many that know nothing of their battery.
"""

import numpy as np
import pytest

from companion.config import load_mission
from companion.flight.state.modes import Mode
from companion.types.events import Dialect
from companion.ui.reports.charts import energy_chart
from companion.ui.reports.plots import flight_start
from tests.energy.worn_battery import (
    DRAIN,
    drawn,
    flown,
    prediction_error,
    worn_flight,
)
from tests.flight.test_app import at, both, switch
from tests.support.recorded import replayed

SHORT = 8  # A flight in the valley that turns back after 85 s.


def told(harness):
    return [
        (decision.stamp_s, decision.told or decision.text)
        for decision in harness.recorder.decisions
        if decision.kind == "energy"
    ]


def turn_of(harness):
    """The decision to turn back."""
    return next(entry for entry in harness.recorder.decisions if entry.told == "Battery: turning back now")


@pytest.fixture(scope="module")
def worn():
    harness, outcome = worn_flight(SHORT)
    return harness, outcome


def test_it_comes_home_with_the_reserve(worn):
    _, outcome = worn
    assert outcome.at_goal_s is None
    assert outcome.is_home


def test_the_way_home_costs_no_more_than_was_predicted_and_not_much_less(worn):
    """One round of the circle was not flown yet: 34 s, which are 4 Wh as told and 8 as drained.

    Measured: 19.1 Wh with that round, 24.6 predicted. On the climb out of the valley the battery fell 2.1
    times as fast as modelled, on the descent home 1.7 times.
    """
    harness, outcome = worn
    turn = turn_of(harness)
    rows = harness.recorder.record({}).energy
    at_turn_wh = float(np.interp(outcome.turned_s, rows[:, 0], rows[:, 1]))
    used_wh = at_turn_wh - outcome.left_wh + 8.0
    assert 0.67 * turn.why["home_wh"] < used_wh <= turn.why["home_wh"]


def test_the_pilot_is_told_before(worn):
    harness, outcome = worn
    texts = [text for _, text in told(harness)]
    assert texts[0].startswith("Battery: goal and home reachable, ")  # As far as the mission file knows.
    ratio = next(text for text in texts if text.startswith("Battery falls"))
    assert float(ratio.split()[2]) == pytest.approx(DRAIN, abs=0.3)
    assert outcome.notice_s >= 30.0
    assert texts[-1] == "Battery: turning back now"


def test_after_the_turn_nothing_is_uploaded_or_commanded(worn):
    harness, outcome = worn
    later = harness.changes(after_s=outcome.turned_s + 2.0)
    assert later == []
    assert harness.app.mode in (Mode.YIELDED, Mode.SUSPENDED)


def test_plans_say_what_would_be_left_at_the_goal_and_at_home(worn):
    harness, _ = worn
    plans = [entry for entry in harness.recorder.decisions if entry.kind in ("swap", "keep")]
    assert plans
    for entry in plans:
        assert entry.why["left_at_goal_wh"] > entry.why["left_at_home_wh"]


def test_what_is_left_and_needed_is_recorded_and_drawn(worn):
    harness, outcome = worn
    record = harness.recorder.record({})
    at_turn = np.argmin(np.abs(record.energy[:, 0] - outcome.turned_s))
    _, left_wh, needed_wh = record.energy[at_turn]
    turn = turn_of(harness)
    assert left_wh - needed_wh == pytest.approx(turn.why["margin_wh"], abs=0.01)
    assert turn.why["margin_wh"] > 0.0
    assert turn.why["turn_back_in_s"] <= 5.0
    assert np.all(np.diff(record.energy[:, 1]) <= 0.01 * outcome.capacity_wh)
    figure = energy_chart(record, flight_start(record))
    assert [line.get_label() for line in figure.axes[0].lines][:2] == [
        "left on board", "needed for the way home and the reserve",
    ]  # fmt: skip


@pytest.mark.slow
def test_without_the_section_the_same_flight_is_not_home_with_the_reserve():
    outcome = flown(SHORT, knows=False)
    assert not outcome.is_home
    assert outcome.turned_s is None


@pytest.mark.slow
def test_a_replay_decides_the_same(tmp_path):
    worn_flight(SHORT, folder=tmp_path)
    mission = load_mission(tmp_path / "mission.yaml")
    recording, found = replayed(tmp_path / "flight.tlog", mission)
    expected = [(entry.kind, entry.text) for entry in recording.decisions]
    assert [(entry.kind, entry.text) for entry in found.decisions] == expected
    assert any(kind == "energy" for kind, _ in expected)


def straight_home(harness):
    """RTL_AUTOLAND 0: a return to launch leads straight home."""
    harness.simulator.autopilot.parameters["RTL_AUTOLAND"] = 0


@pytest.mark.slow
def test_a_pilot_who_flies_on_all_the_same_is_not_overruled_again():
    steps = both(at(0.0, straight_home), switch(105.0, "FBWA"), switch(108.0, "AUTO"))
    mission = drawn(SHORT).model_copy(update={"obstacles": ()})
    harness, outcome = worn_flight(SHORT, mission=mission, until_s=125.0, on_step=steps)
    assert outcome.turned_s < 105.0
    assert [text for _, text in told(harness)].count("Battery: turning back now") == 1
    assert harness.app.mode is Mode.ACTIVE


@pytest.mark.slow
def test_where_the_way_home_does_not_keep_clear_it_says_so_and_flies_on():
    """Straight home leads through a ridge of the valley or the knoll."""
    harness, outcome = worn_flight(4, until_s=125.0, on_step=at(0.0, straight_home))
    assert "Battery: turn back! RTL does not keep clear" in [text for _, text in told(harness)]
    assert outcome.turned_s is None
    assert harness.app.mode is Mode.ACTIVE


@pytest.mark.slow
def test_a_px4_turns_back_by_its_own_return():
    """In open country: no obstacle lies in the way of a return straight to the landing."""
    mission = drawn(1).model_copy(update={"obstacles": ()})
    harness, outcome = worn_flight(1, mission=mission, dialect=Dialect.PX4)
    assert outcome.is_home, told(harness)
    assert outcome.notice_s >= 30.0


@pytest.mark.slow
def test_with_a_sound_battery_the_energy_predicted_at_the_takeover_is_that_of_the_flight():
    errors = [prediction_error(seed) for seed in range(1, 13)]
    assert abs(float(np.median(errors))) < 0.05
