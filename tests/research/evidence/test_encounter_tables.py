"""The tables of encounters, from rows counted by hand."""

from dataclasses import replace

import pytest

from companion.research.campaign.run_store import Row
from companion.research.evidence.encounter_drawing import passages
from companion.research.evidence.encounter_tables import encounter_tables, overview_table
from companion.research.evidence.evidence_tables import NONE
from companion.research.evidence.samples import Case, Sample, evidence_from

# With the service, alone, how much later, how fast they close.
ENCOUNTERS = [
    (False, True, 10.0, 30.0), (True, True, 0.0, 50.0), (False, True, 5.0, 90.0), (False, True, 2.0, 90.0),
    (False, False, 0.0, 70.0), (False, False, -4.0, 70.0), (True, False, 1.0, 30.0),
    (False, False, 3.0, 50.0),
]  # fmt: skip


@pytest.fixture(scope="module")
def case():
    rows = {}
    for seed, (happened, would, late, closing) in enumerate(ENCOUNTERS):
        measures = {
            "success": True, "lowc": happened, "without.lowc": would, "detour_s": late,
            "closing_m_s": closing, "aircraft_m_s": 50.0, "aircraft_up_m": 100.0,
            "alert_before_s": (40.0, 20.0, 30.0, None)[seed] if would else None,
            "alerts": int(seed in (0, 1, 2, 5)),
            "miss_m": 100.0 * seed, "above_m": 10.0, "without.miss_m": 50.0, "without.above_m": -10.0,
        }  # fmt: skip
        rows[seed] = Row(seed, "passing", "made", "safe-rrt", seed, None, measures, "c", "m")
    rows[99] = Row(99, "passing", "made", "safe-rrt", 99, "it died", {}, "c", "m")
    return Case("passing", "made", 3, {"safe-rrt": Sample(rows)})


@pytest.fixture(scope="module")
def tables(case):
    return list(encounter_tables("encounters", case))


def texts(table):
    return [[cell.text for cell in row] for row in table.rows]


def test_events_are_counted_with_and_without(tables):
    loss = texts(tables[0])[1]
    assert loss[1].startswith("loss of well clear, ASTM F3442")
    assert loss[2:5] == ["8", "2", "4"]
    assert loss[5].startswith("0.5 [")
    assert texts(tables[0])[0][2:] == ["8", "0", "0", "–"]  # No near mid-air collision happens.


def test_needless_detours_and_induced_losses_are_of_the_others(tables):
    ((_, encounters, detours, induced),) = texts(tables[1])
    assert (encounters, induced) == ("4", "1")
    assert detours.startswith("1 of 4: 0.25 [")


def test_all_settings_are_counted_together_and_each_is_a_row_of_one_table(case):
    rows = [
        replace(row, setting=setting)
        for setting in ("slow", "fast")
        for row in case.samples["safe-rrt"].rows.values()
    ]
    seeds = sorted(case.samples["safe-rrt"].rows)
    identity = {
        "name": "made", "kind": "encounters", "missions": ["passing"], "settings": ["slow", "fast"],
        "methods": ["safe-rrt"], "seeds": seeds,
    }  # fmt: skip
    table = texts(overview_table(evidence_from(rows, identity, {"passing": 3})))
    assert [row[0] for row in table] == ["passing, slow", "passing, fast", "passing, all"]
    for (name, _, num, nmac, loss, *_, detours), times in zip(table, (1, 1, 2), strict=True):
        assert (num, nmac) == (str(8 * times), f"0 / 0: {NONE}"), name
        assert loss.startswith(f"{2 * times} / {4 * times}: 0.5 [")
        assert detours.startswith(f"{times} of {4 * times}: 0.25 [")
    plans = evidence_from([], {**identity, "kind": "plans"}, {"passing": 3})
    assert overview_table(plans) is None
    assert [one.setting for one in plans.cases] == ["slow", "fast"]


def test_losses_are_counted_by_closing_speed(tables):
    assert [row[1:5] for row in texts(tables[2])] == [
        ["below 40", "2", "1", "1"], ["40 to 60", "2", "1", "1"], ["60 to 80", "2", "0", "0"],
        ["from 80 on", "2", "0", "2"],
    ]  # fmt: skip


def test_bins_without_encounters_have_no_ratio(tables):
    assert texts(tables[3])[0] == ["safe-rrt", "below 35", "0", "0", "0", "–"]


def test_alerts_are_counted_with_their_time_and_where_nothing_would_have_happened(tables):
    assert texts(tables[-1]) == [["safe-rrt", "4", "3", "30", "1", "1 of 4"]]


def test_a_scenario_that_draws_nothing_has_no_bins(case):
    rows = {
        seed: replace(
            row, measures={name: value for name, value in row.measures.items() if name != "closing_m_s"}
        )
        for seed, row in case.samples["safe-rrt"].rows.items()
    }
    few = list(encounter_tables("encounters", replace(case, samples={"safe-rrt": Sample(rows)})))
    assert len(few) == len(list(encounter_tables("encounters", case))) - 1


def test_other_campaigns_have_none():
    assert list(encounter_tables("flights", Case("passing", "made", 3, {}))) == []


def test_passages_are_drawn_where_they_are_and_counted(case):
    figure = passages("encounters", case)
    alone, planned = figure.axes
    assert [axes.get_title() for axes in (alone, planned)] == [
        "alone: 4 lose well clear", "with the planner: 2 lose well clear",
    ]  # fmt: skip
    clear, lost = planned.lines
    assert lost.get_xdata().tolist() == [100.0, 600.0]
    assert sorted(clear.get_xdata().tolist()) == [0.0, 200.0, 300.0, 400.0, 500.0, 700.0]
    assert set(alone.lines[0].get_ydata()) == {-10.0}


def test_other_campaigns_and_empty_ones_draw_none(case):
    assert passages("flights", case) is None
    assert passages("encounters", Case("passing", "made", 3, {"safe-rrt": Sample({})})) is None
